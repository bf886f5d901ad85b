//! The variables of a program that a host fills.

use naga::{AddressSpace, Handle, Type};
use preshade_plan::program::Program;

use super::Material;

#[derive(Clone, Copy, Debug)]
pub struct Global<'a> {
    /// Name; empty for an unnamed GLSL block.
    pub name: &'a str,
    pub ty: Handle<Type>,
    pub group: u32,
    pub binding: u32,
    pub is_storage: bool,
    pub is_buffer: bool,
}

/// The bound global variables of a program.
pub fn globals(program: &Program) -> impl Iterator<Item = Global<'_>> {
    program
        .module()
        .global_variables
        .iter()
        .filter_map(|(_, g)| {
            let at = g.binding.as_ref()?;
            let is_storage = matches!(g.space, AddressSpace::Storage { .. });
            Some(Global {
                name: g.name.as_deref().unwrap_or(""),
                ty: g.ty,
                group: at.group,
                binding: at.binding,
                is_storage,
                is_buffer: is_storage || g.space == AddressSpace::Uniform,
            })
        })
}

/// The variables of immediate data, by name and type.
pub(super) fn immediates(program: &Program) -> impl Iterator<Item = (&str, Handle<Type>)> {
    let globals = program.module().global_variables.iter();
    let own = globals.filter(|(_, g)| g.space == AddressSpace::Immediate);
    own.map(|(_, g)| (g.name.as_deref().unwrap_or(""), g.ty))
}

/// Whether the vertex stage of a material uses the variable of this group and binding.
pub(super) fn is_read(material: &Material, group: u32, binding: u32) -> bool {
    let stage = naga::ShaderStage::Vertex;
    let Some((index, _)) = material.program.entry_point(stage, &material.vertex) else {
        return false;
    };
    let info = material.program.info().get_entry_point(index);
    let globals = material.program.module().global_variables.iter();
    globals
        .filter(|(_, g)| {
            g.binding
                .is_some_and(|b| (b.group, b.binding) == (group, binding))
        })
        .any(|(handle, _)| !info[handle].is_empty())
}
