//! What the stages declare, for writing it again: the author's side of what `interface` decided.

use naga::{ResourceBinding, ShaderStage};
use preshade_passes::declared::{
    Block, Chosen, CombinedSampler, Declaration, Declared, Depth, Located, Type,
};

use super::interface::{Interface, Slot, index};
use super::stage::{Stage, Variable};
use super::ty::{Structs, Ty};
use crate::front::ClipSpace;

/// Of the stages whose bindings and locations `interface` has.
pub(super) fn declared(stages: &[Stage<'_>], interface: &Interface, clip: ClipSpace) -> Declared {
    let mut out = Declared {
        loose: (!interface.uniforms.is_empty()).then(|| binding(interface.uniform_slot)),
        depth: match clip {
            ClipSpace::AsWritten => Depth::AsWritten,
            ClipSpace::OpenGl => Depth::OpenGl,
        },
        point_size: stages
            .iter()
            .any(|s| s.kind == ShaderStage::Vertex && s.used.contains("gl_PointSize")),
        ..Declared::default()
    };
    for stage in stages {
        for uniform in &stage.uniforms {
            let Some(ty) = ty(&stage.structs, &uniform.ty) else {
                continue;
            };
            if out.uniforms.iter().all(|u| u.name != uniform.name) {
                let name = uniform.name.clone();
                out.uniforms.push(Declaration { name, ty });
            }
        }
        for block in &stage.blocks {
            if let Some(slot) = interface.blocks.get(&block.name)
                && out.blocks.iter().all(|b| b.name != block.name)
            {
                out.blocks.push(Block {
                    binding: binding(*slot),
                    name: block.name.clone(),
                    instance: block.instance.clone(),
                });
            }
        }
        let (variables, locations, into) = match stage.kind {
            ShaderStage::Vertex => (&stage.inputs, &interface.inputs, &mut out.attributes),
            _ => (&stage.outputs, &interface.outputs, &mut out.targets),
        };
        let locations = &locations[index(stage.kind)];
        into.extend(variables.iter().filter_map(|v| {
            let location = *locations.get(&v.key())?;
            located(&stage.structs, v, location)
        }));
    }
    out.samplers = interface
        .samplers
        .iter()
        .map(|(path, bound)| CombinedSampler {
            path: path.clone(),
            texture: binding(bound.slots[0]),
            sampler: binding(bound.slots[1]),
        })
        .collect();
    out
}

fn binding((group, binding): Slot) -> ResourceBinding {
    ResourceBinding { group, binding }
}

fn located(structs: &Structs, variable: &Variable, location: u32) -> Option<Located> {
    let name = variable.emitted();
    let ty = ty(structs, &variable.ty)?;
    let chosen = match variable.qualifiers.number("location") {
        Some(_) => Chosen::ByAuthor,
        None => Chosen::ByUs,
    };
    Some(Located {
        declaration: Declaration { name, ty },
        location,
        chosen,
    })
}

/// `None` for what a uniform outside of blocks cannot be.
fn ty(structs: &Structs, of: &Ty) -> Option<Type> {
    Some(match of {
        Ty::Scalar(_) | Ty::Vector(..) | Ty::Matrix(..) => Type::Plain(of.name()),
        Ty::Array(element, n) => Type::Array(Box::new(ty(structs, element)?), (*n)?),
        Ty::Combined(name) => Type::Sampler(name.clone()),
        Ty::Struct(name) => {
            let members = structs.get(name)?.members.iter().map(|m| {
                let name = m.name.clone();
                ty(structs, &m.ty).map(|ty| Declaration { name, ty })
            });
            Type::Struct(name.clone(), members.collect::<Option<_>>()?)
        }
        Ty::Void | Ty::Opaque(_) | Ty::Unknown => return None,
    })
}
