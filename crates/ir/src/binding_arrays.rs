//! Turns arrays of textures, samplers, images and blocks into binding arrays: naga's SPIR-V reader
//! makes plain arrays, which a binding cannot have.

use naga::{AddressSpace, Expression, Function, GlobalVariable, Handle, Module, Span};
use naga::{Type, TypeInner};

/// Replaces the types of such variables.
pub fn replace(module: &mut Module) {
    let (mut handles, mut arrays) = (Vec::new(), Vec::new());
    for (handle, global) in module.global_variables.iter_mut() {
        let TypeInner::Array { base, size, .. } = module.types[global.ty].inner else {
            continue;
        };
        let inner = TypeInner::BindingArray { base, size };
        match module.types[base].inner {
            TypeInner::Image { .. } | TypeInner::Sampler { .. } => {
                handles.push(handle);
                // A plain array cannot have such elements.
                arrays.push((global.ty, inner));
                global.space = AddressSpace::Handle;
            }
            TypeInner::Struct { .. } if is_resource(global.space) => {
                let ty = Type { name: None, inner };
                global.ty = module.types.insert(ty, Span::UNDEFINED);
            }
            _ => {}
        }
    }
    if handles.is_empty() {
        return;
    }
    arrays.sort_by_key(|(ty, _)| ty.index());
    arrays.dedup_by_key(|(ty, _)| *ty);
    for (ty, inner) in arrays {
        module.types.replace(ty, Type { name: None, inner });
    }
    let functions = module.functions.iter_mut().map(|(_, f)| f);
    let entries = module.entry_points.iter_mut().map(|e| &mut e.function);
    for function in functions.chain(entries) {
        load_no_handles(function, &handles);
    }
}

fn is_resource(space: AddressSpace) -> bool {
    matches!(space, AddressSpace::Uniform | AddressSpace::Storage { .. })
}

/// An element of a binding array of textures is the texture, not a pointer to it.
fn load_no_handles(function: &mut Function, handles: &[Handle<GlobalVariable>]) {
    let all: Vec<Handle<Expression>> = function.expressions.iter().map(|(h, _)| h).collect();
    for load in all {
        let Expression::Load { pointer } = function.expressions[load] else {
            continue;
        };
        let element = function.expressions[pointer].clone();
        let (Expression::Access { base, .. } | Expression::AccessIndex { base, .. }) = element
        else {
            continue;
        };
        let of = &function.expressions[base];
        if matches!(of, Expression::GlobalVariable(g) if handles.contains(g)) {
            function.expressions[load] = element;
        }
    }
}
