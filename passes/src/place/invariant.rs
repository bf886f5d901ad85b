//! `@invariant` on a vertex entry point's position.

use naga::{Binding, BuiltIn, Handle, Module, Type, TypeInner};

/// Marks the position of vertex entry point `entry`. A result struct that other functions or entry points share is marked where it stands: the attribute
/// says nothing to them.
pub fn mark(mut module: Module, entry: usize) -> Module {
    let Some(result) = &mut module.entry_points[entry].function.result else { return module };
    if let Some(binding) = &mut result.binding {
        set(binding);
        return module;
    }
    let ty = result.ty;
    replace_type(&mut module, ty, |inner| {
        if let TypeInner::Struct { members, .. } = inner {
            members.iter_mut().filter_map(|m| m.binding.as_mut()).for_each(set);
        }
    });
    module
}

fn set(binding: &mut Binding) {
    if let Binding::BuiltIn(BuiltIn::Position { invariant }) = binding {
        *invariant = true;
    }
}

/// Changes one type of the module where it stands; all handles keep their meaning.
fn replace_type(module: &mut Module, ty: Handle<Type>, change: impl FnOnce(&mut TypeInner)) {
    let mut changed = module.types[ty].clone();
    change(&mut changed.inner);
    if changed == module.types[ty] {
        return;
    }
    // naga's arena holds a type once. The author may have the changed one too, under the same name in another file.
    while module.types.get(&changed).is_some() {
        changed.name = changed.name.map(|n| format!("{n}_invariant"));
    }
    module.types.replace(ty, changed);
}
