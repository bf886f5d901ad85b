//! Compares the layouts of two types.

use naga::{ArraySize, Handle, Module, Span, StructMember, Type, TypeInner};

/// Types of the second module, with the types of the first that replace them.
pub(crate) type Pairs = Vec<(Handle<Type>, Handle<Type>)>;

/// A member of a struct, to be located in the text.
#[derive(Clone, Debug, PartialEq)]
pub struct Member {
    /// Span of the struct, or of a variable of it, in the address space of the source map.
    pub of: Span,
    pub name: String,
    pub text: String,
}

/// The first members that differ between two structs, or between nested structs. Each type comes
/// with the span of a variable of that type, for structs without a span. `None` if one struct only
/// has more members than the other, or they are not structs.
pub(super) fn members_that_differ(
    module: &Module,
    a: (Handle<Type>, Span),
    b: (Handle<Type>, Span),
) -> Option<(Member, Member)> {
    let members = |ty: Handle<Type>| match &module.types[ty].inner {
        TypeInner::Struct { members, .. } => Some(members),
        _ => None,
    };
    let (m, n) = members(a.0)?.iter().zip(members(b.0)?).find(|(m, n)| {
        m.offset != n.offset || !matches(module, m.ty, module, n.ty, &mut Vec::new())
    })?;
    let place = |ty: Handle<Type>, variable: Span| match module.types.get_span(ty) {
        span if span.is_defined() => span,
        _ => variable,
    };
    let (of_a, of_b) = (place(a.0, a.1), place(b.0, b.1));
    if m.offset == n.offset
        && let Some(inner) = members_that_differ(module, (m.ty, of_a), (n.ty, of_b))
    {
        return Some(inner);
    }
    let member = |of: Span, m: &naga::StructMember| Member {
        of,
        name: m.name.clone().unwrap_or_default(),
        text: format!(
            "a {} at byte {}",
            crate::interface::wgsl_type(module, m.ty),
            m.offset
        ),
    };
    Some((member(of_a, m), member(of_b, n)))
}

/// A map from the second module's types to the first's, if their layouts differ only in the names
/// of structs and members. `None` if they differ otherwise, or there is nothing to map.
pub(crate) fn same(
    first: &Module,
    a: Handle<Type>,
    second: &Module,
    b: Handle<Type>,
) -> Option<Pairs> {
    let mut pairs = Vec::new();
    matches(first, a, second, b, &mut pairs).then_some(pairs)
}

/// Which module's struct has more members.
pub(crate) enum Longer {
    First,
    Second,
}

/// If one of two structs only has more members at its end, or a last member that does: which one,
/// and a map from the second module's member types to the first's.
pub(crate) fn longer(
    first: &Module,
    a: Handle<Type>,
    second: &Module,
    b: Handle<Type>,
) -> Option<(Longer, Pairs)> {
    let (TypeInner::Struct { members: m, .. }, TypeInner::Struct { members: n, .. }) =
        (&first.types[a].inner, &second.types[b].inner)
    else {
        return None;
    };
    let mut pairs = Vec::new();
    let mut is_alike = |m: &StructMember, n: &StructMember| {
        m.offset == n.offset && matches(first, m.ty, second, n.ty, &mut pairs)
    };
    // A `cbuffer` of HLSL may hold all its members in one struct.
    if let ([m @ .., last], [n @ .., other]) = (m.as_slice(), n.as_slice())
        && m.len() == n.len()
        && last.offset == other.offset
        && m.iter().zip(n).all(|(m, n)| is_alike(m, n))
    {
        let (longer, inner) = self::longer(first, last.ty, second, other.ty)?;
        pairs.extend(inner);
        if matches!(longer, Longer::First) {
            pairs.push((other.ty, last.ty));
        }
        return Some((longer, pairs));
    }
    let alike = m.iter().zip(n).all(|(m, n)| is_alike(m, n));
    let longer = match m.len() > n.len() {
        true => Longer::First,
        false => Longer::Second,
    };
    (alike && m.len() != n.len()).then_some((longer, pairs))
}

fn matches(
    first: &Module,
    a: Handle<Type>,
    second: &Module,
    b: Handle<Type>,
    pairs: &mut Pairs,
) -> bool {
    let same = match (&first.types[a].inner, &second.types[b].inner) {
        (
            TypeInner::Struct {
                members: m,
                span: s,
            },
            TypeInner::Struct {
                members: n,
                span: t,
            },
        ) => {
            s == t
                && m.len() == n.len()
                && m.iter().zip(n).all(|(m, n)| {
                    m.offset == n.offset
                        && m.binding == n.binding
                        && matches(first, m.ty, second, n.ty, pairs)
                })
        }
        (
            TypeInner::Array {
                base: x,
                size: ArraySize::Constant(s),
                stride: p,
            },
            TypeInner::Array {
                base: y,
                size: ArraySize::Constant(t),
                stride: q,
            },
        ) => s == t && p == q && matches(first, *x, second, *y, pairs),
        (
            TypeInner::Array {
                base: x,
                size: ArraySize::Dynamic,
                stride: p,
            },
            TypeInner::Array {
                base: y,
                size: ArraySize::Dynamic,
                stride: q,
            },
        ) => p == q && matches(first, *x, second, *y, pairs),
        (
            TypeInner::Pointer { .. } | TypeInner::Array { .. } | TypeInner::BindingArray { .. },
            _,
        ) => false,
        (x, y) => x == y,
    };
    if same {
        pairs.push((b, a));
    }
    same
}
