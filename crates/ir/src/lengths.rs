//! Specialisation constants that are array lengths, in all stages of a material. See
//! [`LengthConstant`].

use std::collections::BTreeSet;

use crate::declared::{Declared, FinalConstant, LengthConstant};
use naga::{Handle, Module, Override, Scalar, Type, TypeInner};
use naga_interp::overrides;

use shader_text::error::{Code, Error};

/// Makes the defaults of constants final if the stages do not agree on them.
pub fn settle(modules: &mut [Module], declared: &mut Declared) -> Result<(), Error> {
    let differing = match &*modules {
        [first, second] => differing(first, second),
        _ => BTreeSet::new(),
    };
    let (apart, agreed): (Vec<_>, Vec<_>) = std::mem::take(&mut declared.lengths)
        .into_iter()
        .partition(|of| differing.contains(&of.type_name()) || !is_one(modules, of));
    declared.lengths = agreed;
    for of in apart {
        let constant = (of.id, of.own);
        fix(modules, constant, declared)?;
    }
    Ok(())
}

/// Makes the default of a specialisation constant final. `constant`: its id and name.
pub fn fix(
    modules: &mut [Module],
    (id, own): (u32, String),
    declared: &mut Declared,
) -> Result<(), Error> {
    let mut default = None;
    for module in modules {
        let Some(of) = with_id(module, id) else {
            continue;
        };
        if module.overrides[of].name.as_ref() != Some(&own) {
            continue;
        }
        default = default.or(overrides::integer_default(module, of));
        *module = overrides::fixed(module, of).ok_or_else(|| {
            let message = format!("the specialisation constant {id}, `{own}`, has no default");
            Error::new(Code::Unsupported, message)
        })?;
    }
    record(FinalConstant { id, own, default }, declared);
    Ok(())
}

/// Records that the default of a constant is final, with a note.
pub fn record(constant: FinalConstant, declared: &mut Declared) {
    let FinalConstant { id, own, .. } = &constant;
    declared.notes.push(format!(
        "the specialisation constant {id}, `{own}`, gives a length or another number that must be \
         known here: its default is final, and it is no constant of the output"
    ));
    declared.finals.push(constant);
}

fn with_id(module: &Module, id: u32) -> Option<Handle<Override>> {
    let mut all = module.overrides.iter();
    let found = all.find(|(_, o)| o.id.map(u32::from) == Some(id));
    found.map(|(of, _)| of)
}

/// Whether all stages that read a constant with this id have this constant, and declare it alike.
fn is_one(modules: &[Module], of: &LengthConstant) -> bool {
    let scalar = match of.is_signed {
        true => Scalar::I32,
        false => Scalar::U32,
    };
    let declarations = modules.iter().filter_map(|module| {
        let Override { name, ty, init, .. } = &module.overrides[with_id(module, of.id)?];
        let init = init.map(|init| format!("{:?}", module.global_expressions[init]));
        Some((name.as_ref(), module.types[*ty].inner.scalar(), init))
    });
    let declarations: Vec<_> = declarations.collect();
    let is_it = |(name, ty, _): &(Option<&String>, Option<Scalar>, Option<String>)| {
        *name == Some(&of.own) && *ty == Some(scalar)
    };
    declarations.iter().all(is_it) && declarations.windows(2).all(|two| two[0] == two[1])
}

/// The type names of resource arrays that two stages declare with different lengths.
fn differing(first: &Module, second: &Module) -> BTreeSet<String> {
    let mut found = BTreeSet::new();
    for (_, global) in first.global_variables.iter() {
        let mut others = second.global_variables.iter().map(|(_, g)| g);
        let other = others.find(|g| {
            let is_immediate = g.space == naga::AddressSpace::Immediate;
            g.space == global.space
                && g.binding == global.binding
                && (g.binding.is_some() || is_immediate)
        });
        if let Some(other) = other {
            differ((first, global.ty), (second, other.ty), &mut found);
        }
    }
    found
}

fn differ(a: (&Module, Handle<Type>), b: (&Module, Handle<Type>), found: &mut BTreeSet<String>) {
    let (of_a, of_b) = (&a.0.types[a.1], &b.0.types[b.1]);
    match (&of_a.inner, &of_b.inner) {
        (TypeInner::Array { base, .. }, TypeInner::Array { base: other, .. }) => {
            let names =
                [of_a, of_b].map(|ty| ty.name.clone().filter(|_| LengthConstant::is_of(ty)));
            if names[0] != names[1] {
                found.extend(names.into_iter().flatten());
            }
            differ((a.0, *base), (b.0, *other), found);
        }
        (
            TypeInner::Struct { members, .. },
            TypeInner::Struct {
                members: others, ..
            },
        ) => {
            for (member, other) in members.iter().zip(others) {
                differ((a.0, member.ty), (b.0, other.ty), found);
            }
        }
        _ => {}
    }
}
