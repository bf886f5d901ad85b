//! The interface of a stage, read from the words alone. naga's reader lacks some of what its writer
//! writes, and does not count a binding that is only named (`_ = t;`) as used.

use std::collections::{HashMap, HashSet};

use rspirv::dr::{Module, Operand};
use rspirv::spirv::{BuiltIn, Decoration, Op, StorageClass};

use crate::emit::combined::BindingPlace;
use naga_spirv::words::ids;

/// Instructions of GLSL.std.450 whose results are structs that naga's reader does not declare.
const MODF_STRUCT: u32 = 36;
const FREXP_STRUCT: u32 = 52;

/// The operand of each decoration of an id, by both. [`Operand::IdRef`] of the id itself if the
/// decoration has none.
pub(super) fn decorations(module: &Module) -> HashMap<(u32, Decoration), &Operand> {
    let annotations = module.annotations.iter();
    annotations
        .filter(|i| i.class.opcode == Op::Decorate)
        .filter_map(|i| match i.operands.as_slice() {
            [id, Operand::Decoration(decoration), value @ ..] => {
                let value = value.first().unwrap_or(id);
                Some(((id.id_ref_any()?, *decoration), value))
            }
            _ => None,
        })
        .collect()
}

/// Sorted lines as those of [`fingerprint::interface`](crate::wgsl::fingerprint::interface) and
/// [`bindings`](crate::wgsl::fingerprint::bindings), without types, and the specialisation
/// constants.
pub(super) fn lines(module: &Module) -> Vec<String> {
    let decorations = decorations(module);
    let mut lines = Vec::new();
    for instruction in &module.types_global_values {
        let Some(id) = instruction.result_id else {
            continue;
        };
        let value = |decoration| match decorations.get(&(id, decoration)) {
            Some(Operand::LiteralBit32(value)) => Some(*value),
            _ => None,
        };
        lines.extend(value(Decoration::SpecId).map(|id| format!("specialisation constant {id}")));
        let Some(Operand::StorageClass(class)) = instruction.operands.first() else {
            continue;
        };
        let builtin = match decorations.get(&(id, Decoration::BuiltIn)) {
            Some(Operand::BuiltIn(builtin)) => Some(*builtin),
            _ => None,
        };
        lines.extend(match (*class, builtin, value(Decoration::Location)) {
            (StorageClass::Input, _, Some(at)) => Some(format!("input location {at}")),
            (StorageClass::Output, _, Some(at)) => Some(format!("output location {at}")),
            (StorageClass::Input, Some(BuiltIn::FragCoord), _) => Some("input position".to_owned()),
            (StorageClass::Output, Some(BuiltIn::Position), _) => {
                Some(match decorations.get(&(id, Decoration::Invariant)) {
                    Some(_) => "output invariant position".to_owned(),
                    None => "output position".to_owned(),
                })
            }
            (StorageClass::Output, Some(BuiltIn::FragDepth), _) => Some("output depth".to_owned()),
            _ => None,
        });
        let place = [Decoration::DescriptorSet, Decoration::Binding].map(value);
        if let [Some(group), Some(binding)] = place {
            lines.push(bound((group, binding)));
        }
    }
    lines.sort();
    lines
}

/// The line of a resource.
pub(super) fn bound((group, binding): BindingPlace) -> String {
    format!("group {group} binding {binding}")
}

/// A feature that naga's reader accepts, but then cannot validate.
pub(super) fn unreadable(module: &Module) -> Option<&'static str> {
    // Types of depth textures and values of these, and values from parameters.
    let mut depths = HashSet::new();
    let mut received = HashSet::new();
    for i in module.all_inst_iter() {
        let of_depth = |id: Option<u32>| id.is_some_and(|id| depths.contains(&id));
        let first = ids(i).next();
        let is_depth = match i.class.opcode {
            Op::TypeImage => i.operands.get(2) == Some(&Operand::LiteralBit32(1)),
            Op::TypeSampledImage => of_depth(first),
            Op::SampledImage
                if of_depth(i.result_type)
                    && ids(i).nth(1).is_some_and(|id| received.contains(&id)) =>
            {
                return Some("comparison samplers as parameters");
            }
            Op::SampledImage => of_depth(i.result_type),
            Op::FunctionParameter => {
                received.extend(i.result_id);
                false
            }
            Op::Load if first.is_some_and(|id| received.contains(&id)) => {
                received.extend(i.result_id);
                false
            }
            Op::ImageGather if of_depth(first) => return Some("textureGather of a depth texture"),
            _ => false,
        };
        depths.extend(i.result_id.filter(|_| is_depth));
    }
    let mut all = module.all_inst_iter();
    all.find_map(|i| match (i.class.opcode, i.operands.as_slice()) {
        (Op::TypeInt, [Operand::LiteralBit32(8), ..]) => Some("8-bit integers"),
        (Op::ImageTexelPointer, _) => Some("atomic functions of images"),
        (
            Op::ExtInst,
            [
                _,
                Operand::LiteralExtInstInteger(MODF_STRUCT | FREXP_STRUCT),
                ..,
            ],
        ) => Some("modf and frexp"),
        _ => None,
    })
}
