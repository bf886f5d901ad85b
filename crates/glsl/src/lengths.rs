//! Finds the arrays whose lengths are specialisation constants, and names their types.
//!
//! The IR has only default lengths. So the text is resolved a second time with a default that is
//! larger by one. An array that becomes longer by one has the constant as its length. If anything
//! else differs, the constant affects more than lengths, and its default is final.

use std::collections::HashMap;

use naga::{
    ArraySize, Expression, Handle, Module, Span, StructMember, Type, TypeInner, UniqueArena,
};
use naga_edit::declared::LengthConstant;

/// A constant that may be an array length, and its default.
pub type Candidate = (LengthConstant, u32);

/// A candidate, with the modules of the run with its default raised.
pub(super) type Raised = (Candidate, Vec<Module>);

/// Names the array types in the modules of all stages. Returns the constants that affect only
/// lengths.
pub(super) fn mark(modules: &mut [Module], candidates: Vec<Raised>) -> Vec<LengthConstant> {
    let ids: Vec<u32> = candidates.iter().map(|(of, _)| of.0.id).collect();
    let is_only = |id: u32| ids.iter().filter(|other| **other == id).count() == 1;
    let mut candidates = candidates;
    candidates.retain(|(candidate, raised)| {
        // The other stage may have another constant with this id.
        if !is_only(candidate.0.id) {
            return false;
        }
        let mut stages = modules.iter().zip(raised);
        stages.all(|(module, raised)| differ_by_lengths(module, raised, candidate))
    });
    let marked = modules.iter().enumerate().map(|(n, module)| {
        let raised = candidates.iter().map(|(c, raised)| (c, raised[n].clone()));
        Some(named(module, raised.collect())?.0)
    });
    let Some(marked) = marked.collect::<Option<Vec<Module>>>() else {
        return Vec::new();
    };
    modules.clone_from_slice(&marked);
    let found = candidates.into_iter().map(|((length, _), _)| length);
    found.collect()
}

fn differ_by_lengths(module: &Module, raised: &Module, candidate: &Candidate) -> bool {
    named(module, vec![(candidate, raised.clone())]).is_some_and(|(mut module, raised)| {
        module.types.clear();
        raised
            .iter()
            .all(|raised| format!("{module:?}") == format!("{raised:?}"))
    })
}

/// The module with named types, and the others changed in the same way. `None` if types differ by
/// more than lengths.
fn named(module: &Module, raised: Vec<(&Candidate, Module)>) -> Option<(Module, Vec<Module>)> {
    let mut module = module.clone();
    let (candidates, mut raised): (Vec<&Candidate>, Vec<Module>) = raised.into_iter().unzip();
    let of_raised = raised.iter_mut().map(|r| std::mem::take(&mut r.types));
    let mut paired = Paired {
        raised: of_raised.collect(),
        types: std::mem::take(&mut module.types),
        candidates: &candidates,
        found: HashMap::new(),
    };
    let mut types = types(&mut module);
    let mut others: Vec<Vec<&mut Handle<Type>>> = raised.iter_mut().map(self::types).collect();
    if others.iter().any(|others| others.len() != types.len()) {
        return None;
    }
    for (n, ty) in types.iter_mut().enumerate() {
        let others_now: Vec<Handle<Type>> = others.iter().map(|others| *others[n]).collect();
        **ty = paired.pair(**ty, others_now)?;
        others.iter_mut().for_each(|others| *others[n] = **ty);
    }
    module.types = paired.types;
    for raised in &mut raised {
        raised.special_types = module.special_types.clone();
    }
    Some((module, raised))
}

/// A type of the first run, with the corresponding types of the others.
type Pair = (Handle<Type>, Vec<Handle<Type>>);

/// Types of the first run, by the corresponding types of all runs.
struct Paired<'c> {
    types: UniqueArena<Type>,
    raised: Vec<UniqueArena<Type>>,
    candidates: &'c [&'c Candidate],
    found: HashMap<Pair, Handle<Type>>,
}

impl Paired<'_> {
    /// The type with named arrays. `None` if more than lengths differs.
    fn pair(&mut self, ty: Handle<Type>, raised: Vec<Handle<Type>>) -> Option<Handle<Type>> {
        let key = (ty, raised);
        if let Some(found) = self.found.get(&key) {
            return Some(*found);
        }
        let mut paired = self.types[ty].clone();
        let others: Vec<Type> = self
            .raised
            .iter()
            .zip(&key.1)
            .map(|(types, ty)| types[*ty].clone())
            .collect();
        if others.iter().any(|other| other.name != paired.name) {
            return None;
        }
        match &mut paired.inner {
            TypeInner::Array { base, size, .. } => {
                let (bases, sizes): (Vec<_>, Vec<_>) = others
                    .iter()
                    .map(|other| match other.inner {
                        TypeInner::Array { base, size, .. } => Some((base, size)),
                        _ => None,
                    })
                    .collect::<Option<Vec<_>>>()?
                    .into_iter()
                    .unzip();
                *base = self.pair(*base, bases)?;
                for (other, (length, default)) in sizes.iter().zip(self.candidates) {
                    match (*size, *other) {
                        (own, other) if own == other => {}
                        (ArraySize::Constant(own), ArraySize::Constant(other))
                            if own.get() == *default && other.get() == own.get() + 1 =>
                        {
                            paired.name = Some(length.type_name());
                        }
                        _ => return None,
                    }
                }
            }
            TypeInner::Struct { members, .. } => {
                let others: Vec<&Vec<StructMember>> = others
                    .iter()
                    .map(|other| match &other.inner {
                        TypeInner::Struct { members: of, .. } if of.len() == members.len() => {
                            Some(of)
                        }
                        _ => None,
                    })
                    .collect::<Option<_>>()?;
                for (n, member) in members.iter_mut().enumerate() {
                    let is_same = |other: &&Vec<StructMember>| {
                        other[n].name == member.name && other[n].binding == member.binding
                    };
                    if !others.iter().all(is_same) {
                        return None;
                    }
                    member.ty = self.pair(member.ty, others.iter().map(|o| o[n].ty).collect())?;
                }
            }
            TypeInner::Pointer { base, space } => {
                let bases = others.iter().map(|other| match other.inner {
                    TypeInner::Pointer { base, space: of } if of == *space => Some(base),
                    _ => None,
                });
                *base = self.pair(*base, bases.collect::<Option<_>>()?)?;
            }
            own if others.iter().all(|other| other.inner == *own) => {}
            _ => return None,
        }
        let span = match paired == self.types[ty] {
            true => self.types.get_span(ty),
            false => Span::UNDEFINED,
        };
        let new = self.types.insert(paired, span);
        self.found.insert(key, new);
        Some(new)
    }
}

/// All references to types in a module.
fn types(module: &mut Module) -> Vec<&mut Handle<Type>> {
    let mut out: Vec<&mut Handle<Type>> = Vec::new();
    out.extend(module.constants.iter_mut().map(|(_, c)| &mut c.ty));
    out.extend(module.overrides.iter_mut().map(|(_, o)| &mut o.ty));
    out.extend(module.global_variables.iter_mut().map(|(_, g)| &mut g.ty));
    let mut arenas = vec![&mut module.global_expressions];
    let functions = module.functions.iter_mut().map(|(_, f)| f);
    for function in functions.chain(module.entry_points.iter_mut().map(|e| &mut e.function)) {
        out.extend(function.arguments.iter_mut().map(|a| &mut a.ty));
        out.extend(function.result.iter_mut().map(|r| &mut r.ty));
        out.extend(function.local_variables.iter_mut().map(|(_, l)| &mut l.ty));
        arenas.push(&mut function.expressions);
    }
    for (_, expression) in arenas.into_iter().flat_map(|a| a.iter_mut()) {
        match expression {
            Expression::Compose { ty, .. }
            | Expression::ZeroValue(ty)
            | Expression::AtomicResult { ty, .. }
            | Expression::WorkGroupUniformLoadResult { ty }
            | Expression::SubgroupOperationResult { ty } => out.push(ty),
            _ => {}
        }
    }
    out
}
