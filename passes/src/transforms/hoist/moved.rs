//! Inputs that the vertex stage reads now and only the fragment stage read before: a host must give
//! them to the vertex stage too.

use std::collections::BTreeSet;

use naga::{Expression, Module, ShaderStage};

use crate::rebuild::place;
use naga_interp::overrides;
use preshade_plan::limits;
use preshade_plan::plan::GpuPass;
use preshade_plan::program::Program;

/// The note for the host; `None` if the vertex stage reads nothing new.
pub(crate) fn note(before: (&GpuPass, &Program), after: (&GpuPass, &Program)) -> Option<String> {
    let constants = &constants(after) - &constants(before);
    let is_new = |group, binding| {
        let mut known = before.0.bindings.iter();
        !known.any(|b| (b.group, b.binding) == (group, binding) && b.visibility.vertex)
    };
    let bindings = after.0.bindings.iter().filter(|b| b.visibility.vertex);
    let bindings = bindings.filter(|b| is_new(b.group, b.binding));
    let bindings: Vec<String> = bindings
        .map(|b| format!("binding {} of group {}, `{}`", b.binding, b.group, b.name))
        .collect();
    let immediates =
        |(pass, program): (&GpuPass, &Program)| limits::immediate_size(program, &[vertex(pass)]);
    let bytes = immediates(after);
    let has_more = bytes > immediates(before);

    let mut moved: Vec<String> = constants.into_iter().collect();
    let mut to_do = Vec::new();
    if !moved.is_empty() {
        to_do.push("its constants (`VkSpecializationInfo` in Vulkan)");
    }
    if !bindings.is_empty() {
        to_do.push("the visibility of bindings (`stageFlags` in Vulkan)");
    }
    if has_more {
        to_do.push("the `stageFlags` of the push-constant range");
    }
    moved.extend(bindings);
    moved.extend(has_more.then(|| format!("the first {bytes} bytes of the push constants")));
    (!moved.is_empty()).then(|| {
        format!(
            "the vertex stage reads what only the fragment stage read before: {}; give it to the \
             vertex stage too: {}",
            moved.join(", "),
            to_do.join(", ")
        )
    })
}

fn vertex(pass: &GpuPass) -> (ShaderStage, &str) {
    (ShaderStage::Vertex, pass.vertex.as_str())
}

/// The constants that the vertex stage reads, in words.
fn constants((pass, program): (&GpuPass, &Program)) -> BTreeSet<String> {
    let module = place::retain(program.module(), &[vertex(pass)]);
    let declared = program.declared();
    let word = |name: &str, id: Option<u32>| {
        let own = declared.constants.iter().find(|c| c.name == name);
        let (id, name) = own.map_or((id, name), |own| (Some(own.id), own.own.as_str()));
        match id {
            Some(id) => format!("the constant {id}, `{name}`"),
            None => format!("the constant `{name}`"),
        }
    };
    let lengths = declared.lengths.iter().filter(|length| {
        let mut types = module.types.iter();
        types.any(|(_, ty)| ty.name == Some(length.type_name()))
    });
    let lengths = lengths.map(|length| word(&length.own, Some(length.id)));
    let read = read(&module).into_iter().map(|of| {
        let constant = &module.overrides[of];
        let name = constant.name.as_deref().unwrap_or_default();
        word(name, constant.id.map(u32::from))
    });
    read.chain(lengths).collect()
}

/// The overrides that functions read, by themselves or by the default of another.
fn read(module: &Module) -> Vec<naga::Handle<naga::Override>> {
    let functions = module.functions.iter().map(|(_, f)| f);
    let functions = functions.chain(module.entry_points.iter().map(|e| &e.function));
    let expressions = functions.flat_map(|f| f.expressions.iter());
    let mut found: Vec<_> = expressions
        .filter_map(|(_, e)| match e {
            Expression::Override(of) => Some(*of),
            _ => None,
        })
        .collect();
    let mut at = 0;
    while let Some(of) = found.get(at).copied() {
        let default = module.overrides[of].init;
        let parts = default.map(|init| overrides::overrides_of(module, init));
        for part in parts.into_iter().flatten() {
            if !found.contains(&part) {
                found.push(part);
            }
        }
        at += 1;
    }
    found
}
