//! Feeds the second program the first one's values, where their buffers have other layouts.

use std::collections::BTreeMap;

use naga::{ArraySize, BinaryOperator, Handle, Module, Type, TypeInner};

use naga_edit::declared::is_padding;
use naga_interp::{Number, Value, math};
use preshade_plan::mapping::members;

/// How a value of one type becomes one of another.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Cast {
    Same,
    /// Each member from another one: their index, our index.
    Members(Vec<(usize, usize, Cast)>),
    Elements(Box<Cast>),
    /// Theirs is a block with one member, as languages without loose uniforms have it.
    Wrapped(Box<Cast>),
    /// Ours is a block with one member.
    Unwrapped(Box<Cast>),
    /// Each scalar from the one at its byte: their steps, our steps.
    Bytes(Vec<(Vec<usize>, Vec<usize>)>),
}

/// A part of a buffer of the second program that holds a part of a buffer of the first.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Rule {
    /// Their buffer's group and binding in the renamed program.
    pub(super) to: (u32, u32),
    pub(super) to_steps: Vec<usize>,
    /// Our buffer's group and binding.
    pub(super) from: (u32, u32),
    pub(super) from_steps: Vec<usize>,
    /// Matrices that it is multiplied by, from left to right.
    pub(super) times: Vec<((u32, u32), Vec<usize>)>,
    pub(super) cast: Cast,
    /// The two have other names: in a frame, each view has its own value.
    pub(super) is_of_view: bool,
    /// Theirs is the value of the previous frame.
    pub(super) is_previous: bool,
}

impl Cast {
    /// The steps to the part of ours that a part of theirs has its value from.
    pub(super) fn steps(&self, theirs: &[usize]) -> Option<Vec<usize>> {
        match (self, theirs) {
            (Self::Same, all) => Some(all.to_vec()),
            (Self::Members(all), [first, rest @ ..]) => {
                let (_, ours, cast) = all.iter().find(|(their, ..)| their == first)?;
                Some([&[*ours][..], &cast.steps(rest)?].concat())
            }
            (Self::Elements(cast), [first, rest @ ..]) => {
                Some([&[*first][..], &cast.steps(rest)?].concat())
            }
            (Self::Wrapped(cast), [0, rest @ ..]) => cast.steps(rest),
            (Self::Unwrapped(cast), all) => Some([&[0][..], &cast.steps(all)?].concat()),
            _ => None,
        }
    }
}

/// How our type becomes theirs; `None` if they don't hold the same.
pub(super) fn cast(theirs: (&Module, Handle<Type>), ours: (&Module, Handle<Type>)) -> Option<Cast> {
    cast_by(theirs, ours, false)
}

/// Like [`cast`]. With `is_by_offset`, members at one offset are partners, because one host fills
/// both.
pub(super) fn cast_by(
    (theirs, their): (&Module, Handle<Type>),
    (ours, our): (&Module, Handle<Type>),
    is_by_offset: bool,
) -> Option<Cast> {
    use TypeInner as T;
    match (&theirs.types[their].inner, &ours.types[our].inner) {
        (T::Scalar(a) | T::Atomic(a), T::Scalar(b) | T::Atomic(b)) => {
            (a == b).then_some(Cast::Same)
        }
        (
            T::Array {
                base: a,
                size: n,
                stride,
            },
            T::Array {
                base: b,
                size: m,
                stride: our_stride,
            },
        ) => {
            let by_type = cast_by((theirs, *a), (ours, *b), is_by_offset);
            let by_bytes = || (stride == our_stride).then(|| padded((theirs, *a), (ours, *b)))?;
            let element = by_type.or_else(by_bytes)?;
            let is_runtime = |size: &ArraySize| !matches!(size, ArraySize::Constant(_));
            let is_same = n == m || (is_runtime(n) && is_runtime(m));
            Some(match element {
                Cast::Same if is_same => Cast::Same,
                element => Cast::Elements(Box::new(element)),
            })
        }
        (T::Struct { .. }, T::Struct { .. }) => {
            of_members((theirs, their), (ours, our), is_by_offset)
        }
        (T::Struct { members, .. }, _) if let [one] = &members[..] => {
            let inner = cast_by((theirs, one.ty), (ours, our), is_by_offset)?;
            Some(Cast::Wrapped(Box::new(inner)))
        }
        (_, T::Struct { members, .. }) if let [one] = &members[..] => {
            let inner = cast_by((theirs, their), (ours, one.ty), is_by_offset)?;
            Some(Cast::Unwrapped(Box::new(inner)))
        }
        (a @ (T::Vector { .. } | T::Matrix { .. }), b) => (a == b).then_some(Cast::Same),
        _ => None,
    }
}

/// Members are partners by name, or, if no name is common, by order.
fn of_members(
    (theirs, their): (&Module, Handle<Type>),
    (ours, our): (&Module, Handle<Type>),
    is_by_offset: bool,
) -> Option<Cast> {
    let (a, b) = (members(theirs, their), members(ours, our));
    let one = |(i, (_, their)): (usize, &(String, Handle<Type>)), j: usize| {
        let (_, our) = b.get(j)?;
        let cast = cast_by((theirs, *their), (ours, *our), is_by_offset)?;
        Some((i, j, cast))
    };
    let pads = fills(theirs, their);
    let data = || a.iter().enumerate().filter(|(i, _)| !pads[*i]);
    if is_by_offset {
        let (at, to) = (offsets(theirs, their), offsets(ours, our));
        let place = |i: usize| to.iter().position(|offset| at.get(i) == Some(offset));
        let all: Vec<_> = data()
            .map(|member| one(member, place(member.0)?))
            .collect::<Option<_>>()?;
        let is_same = a.len() == b.len() && all.iter().all(|(i, j, c)| i == j && *c == Cast::Same);
        return Some(match is_same {
            true => Cast::Same,
            false => Cast::Members(all),
        });
    }
    let partner = |name: &str| b.iter().position(|(other, _)| plain(other) == plain(name));
    let by_name: Option<Vec<_>> = data()
        .map(|member| one(member, partner(&member.1.0)?))
        .collect();
    let has_common = data().any(|(_, (name, _))| partner(name).is_some());
    let all = match by_name {
        Some(all) => all,
        None if has_common || a.len() != b.len() => return None,
        None => a
            .iter()
            .enumerate()
            .map(|member| one(member, member.0))
            .collect::<Option<_>>()?,
    };
    let is_same = a.len() == b.len() && all.iter().all(|(i, j, c)| i == j && *c == Cast::Same);
    Some(match is_same {
        true => Cast::Same,
        false => Cast::Members(all),
    })
}

/// Which members of a struct fill gaps alone.
fn fills(module: &Module, ty: Handle<Type>) -> Vec<bool> {
    let name = module.types[ty].name.as_deref().unwrap_or_default();
    let is_fill = |member: &str| {
        is_padding(name, member) || member.strip_prefix("padding_").is_some_and(is_number)
    };
    let members = members(module, ty);
    members.iter().map(|(member, _)| is_fill(member)).collect()
}

fn is_number(text: &str) -> bool {
    !text.is_empty() && text.bytes().all(|b| b.is_ascii_digit())
}

/// How elements of arrays of one stride fit if the languages pad them differently: a scalar of
/// `std140` is the first of a vector in GLSL, and the first member of a struct in SPIR-V.
fn padded(theirs: (&Module, Handle<Type>), ours: (&Module, Handle<Type>)) -> Option<Cast> {
    let (mut a, mut b) = (Vec::new(), Vec::new());
    flat(theirs, (0, false), &mut Vec::new(), &mut a)?;
    flat(ours, (0, false), &mut Vec::new(), &mut b)?;
    let is_covered = |own: &[Flat], others: &[Flat]| {
        own.iter().filter(|x| !x.fills).all(|x| {
            let mut others = others.iter();
            // Beyond its padding, a vector has nothing.
            others.any(|y| y.offset == x.offset && (y.fills || y.scalar == x.scalar))
        })
    };
    let is_same = |(x, y): &(&Flat, &Flat)| x.offset == y.offset && x.scalar == y.scalar;
    let pairs = a.iter().flat_map(|x| b.iter().map(move |y| (x, y)));
    let pairs = pairs.filter(is_same);
    let all: Vec<_> = pairs
        .map(|(x, y)| (x.steps.clone(), y.steps.clone()))
        .collect();
    let has_fill = a.iter().chain(&b).any(|x| x.fills);
    let fits = has_fill && !all.is_empty() && is_covered(&a, &b) && is_covered(&b, &a);
    fits.then_some(Cast::Bytes(all))
}

/// A scalar of a type.
struct Flat {
    offset: u32,
    scalar: naga::Scalar,
    /// It only fills a gap.
    fills: bool,
    steps: Vec<usize>,
}

fn flat(
    (module, ty): (&Module, Handle<Type>),
    (offset, is_fill): (u32, bool),
    steps: &mut Vec<usize>,
    all: &mut Vec<Flat>,
) -> Option<()> {
    match &module.types[ty].inner {
        TypeInner::Scalar(scalar) => all.push(Flat {
            offset,
            scalar: *scalar,
            fills: is_fill,
            steps: steps.clone(),
        }),
        TypeInner::Vector { size, scalar } => {
            all.extend((0..*size as usize).map(|i| Flat {
                offset: offset + i as u32 * u32::from(scalar.width),
                scalar: *scalar,
                fills: is_fill,
                steps: [&steps[..], &[i]].concat(),
            }));
        }
        TypeInner::Struct { members, .. } => {
            for (i, (member, fill)) in members.iter().zip(fills(module, ty)).enumerate() {
                steps.push(i);
                let at = (offset + member.offset, is_fill || fill);
                flat((module, member.ty), at, steps, all)?;
                steps.pop();
            }
        }
        _ => return None,
    }
    Some(())
}

/// The offsets of a struct's members.
pub(super) fn offsets(module: &Module, ty: Handle<Type>) -> Vec<u32> {
    match &module.types[ty].inner {
        TypeInner::Struct { members, .. } => members.iter().map(|m| m.offset).collect(),
        _ => Vec::new(),
    }
}

/// A name without the habits of its language: `u_viewProj` and `view_proj` are one.
pub(super) fn plain(name: &str) -> String {
    let lower = name.to_lowercase();
    let prefixes = ["u_", "a_", "v_", "m_", "g_", "in_"];
    let bare = prefixes.iter().find_map(|p| lower.strip_prefix(p));
    bare.unwrap_or(&lower).replace('_', "")
}

/// Writes the values that the rules feed into the resources of a world.
pub(super) fn feed<F: Number>(rules: &[Rule], resources: &mut BTreeMap<(u32, u32), Value<F>>) {
    for rule in rules {
        let value = |(at, steps): (&(u32, u32), &[usize])| part(resources.get(at)?, steps).cloned();
        let first = value((&rule.from, &rule.from_steps));
        let product = rule.times.iter().fold(first, |product, (at, steps)| {
            math::binary(BinaryOperator::Multiply, &product?, &value((at, steps))?).ok()
        });
        let Some(from) = product else {
            continue;
        };
        let to = resources.get_mut(&rule.to);
        if let Some(to) = to.and_then(|v| part_mut(v, &rule.to_steps)) {
            overlay(to, &from, &rule.cast);
        }
    }
}

pub(super) fn part<'v, F>(value: &'v Value<F>, steps: &[usize]) -> Option<&'v Value<F>> {
    steps.iter().try_fold(value, |value, step| match value {
        Value::Composite(parts) => parts.get(*step),
        _ => None,
    })
}

pub(super) fn part_mut<'v, F>(
    value: &'v mut Value<F>,
    steps: &[usize],
) -> Option<&'v mut Value<F>> {
    steps.iter().try_fold(value, |value, step| match value {
        Value::Composite(parts) => parts.get_mut(*step),
        _ => None,
    })
}

pub(super) fn overlay<F: Number>(to: &mut Value<F>, from: &Value<F>, cast: &Cast) {
    match (cast, to, from) {
        (Cast::Same, to, from) => *to = from.clone(),
        (Cast::Members(all), Value::Composite(to), Value::Composite(from)) => {
            for (i, j, cast) in all {
                if let (Some(to), Some(from)) = (to.get_mut(*i), from.get(*j)) {
                    overlay(to, from, cast);
                }
            }
        }
        (Cast::Elements(cast), Value::Composite(to), Value::Composite(from)) => {
            for (to, from) in to.iter_mut().zip(from) {
                overlay(to, from, cast);
            }
        }
        (Cast::Wrapped(cast), Value::Composite(to), from) => {
            if let [to] = &mut to[..] {
                overlay(to, from, cast);
            }
        }
        (Cast::Bytes(all), to, from) => {
            for (at, by) in all {
                if let (Some(to), Some(from)) = (part_mut(to, at), part(from, by)) {
                    to.clone_from(from);
                }
            }
        }
        (Cast::Unwrapped(cast), to, Value::Composite(from)) => {
            if let [from] = &from[..] {
                overlay(to, from, cast);
            }
        }
        _ => {}
    }
}
