//! The interface of a stage, read from the words alone. naga's reader lacks some of what its writer
//! writes, and does not count a binding that is only named (`_ = t;`) as used.

use std::collections::HashMap;

use super::{OP_DECORATE, OP_EXT_INST, OP_TYPE_INT, OP_VARIABLE, instructions};

const BUILTIN: u32 = 11;
const INVARIANT: u32 = 18;
const LOCATION: u32 = 30;
const BINDING: u32 = 33;
const DESCRIPTOR_SET: u32 = 34;

const POSITION: u32 = 0;
const FRAG_COORD: u32 = 15;
const FRAG_DEPTH: u32 = 22;

const INPUT: u32 = 1;
const OUTPUT: u32 = 3;

/// Instructions of GLSL.std.450 whose results are structs that naga's reader does not declare.
const MODF_STRUCT: u32 = 36;
const FREXP_STRUCT: u32 = 52;

/// Sorted lines as those of [`fingerprint::interface`](crate::wgsl::fingerprint::interface) and
/// [`bindings`](crate::wgsl::fingerprint::bindings), without types.
pub(super) fn lines(words: &[u32]) -> Vec<String> {
    let mut decorations: HashMap<(u32, u32), u32> = HashMap::new();
    let mut lines = Vec::new();
    for (_, opcode, operands) in instructions(words) {
        match (opcode, operands) {
            (OP_DECORATE, [id, decoration, value @ ..]) => {
                let value = value.first().copied().unwrap_or_default();
                decorations.insert((*id, *decoration), value);
            }
            (OP_VARIABLE, [_, id, class, ..]) => {
                let value = |decoration| decorations.get(&(*id, decoration)).copied();
                lines.extend(match (*class, value(BUILTIN), value(LOCATION)) {
                    (INPUT, _, Some(at)) => Some(format!("input location {at}")),
                    (OUTPUT, _, Some(at)) => Some(format!("output location {at}")),
                    (INPUT, Some(FRAG_COORD), _) => Some("input position".to_owned()),
                    (OUTPUT, Some(POSITION), _) => Some(match value(INVARIANT) {
                        Some(_) => "output invariant position".to_owned(),
                        None => "output position".to_owned(),
                    }),
                    (OUTPUT, Some(FRAG_DEPTH), _) => Some("output depth".to_owned()),
                    _ => None,
                });
                if let (Some(group), Some(binding)) = (value(DESCRIPTOR_SET), value(BINDING)) {
                    lines.push(format!("group {group} binding {binding}"));
                }
            }
            _ => {}
        }
    }
    lines.sort();
    lines
}

/// What naga's reader takes and then cannot validate.
pub(super) fn unreadable(words: &[u32]) -> Option<&'static str> {
    instructions(words).find_map(|(_, opcode, operands)| match (opcode, operands) {
        (OP_TYPE_INT, [_, 8, ..]) => Some("8-bit integers"),
        (OP_EXT_INST, [_, _, _, MODF_STRUCT | FREXP_STRUCT, ..]) => Some("modf and frexp"),
        _ => None,
    })
}
