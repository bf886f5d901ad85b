//! naga declares `sample_mask` as a scalar. Vulkan demands an array (VUID-SampleMask-SampleMask-04359).

use std::collections::HashMap;

use super::{HEADER, OP_DECORATE, OP_TYPE_POINTER, OP_VARIABLE, instructions};

const BUILTIN: u32 = 11;
const SAMPLE_MASK: u32 = 20;
const OP_TYPE_ARRAY: u16 = 28;
const OP_CONSTANT: u16 = 43;
const OP_LOAD: u16 = 61;
const OP_STORE: u16 = 62;
const OP_ACCESS_CHAIN: u16 = 65;

/// Position of the first unused id in the header (SPIR-V 2.3).
const BOUND: usize = 3;

/// Declares each sample mask as an array of one element, and reads and writes that element.
pub(super) fn as_arrays(words: &[u32]) -> Vec<u32> {
    let mut masks = Vec::new();
    let mut pointees = HashMap::new();
    // The type of a pointer to the element, and the constant 0, by variable.
    let mut elements: HashMap<u32, [u32; 2]> = HashMap::new();
    let mut out = words[..HEADER.min(words.len())].to_vec();
    let mut next = out.get(BOUND).copied().unwrap_or_default();
    let mut fresh = || {
        next += 1;
        next - 1
    };
    for (start, opcode, operands) in instructions(words) {
        match (opcode, operands) {
            (OP_DECORATE, [id, BUILTIN, SAMPLE_MASK]) => masks.push(*id),
            (OP_TYPE_POINTER, [pointer, _, of]) => {
                pointees.insert(*pointer, *of);
            }
            (OP_VARIABLE, [pointer, id, class, ..]) if masks.contains(id) => {
                let scalar = pointees.get(pointer).copied().unwrap_or_default();
                let [one, zero, array, own] = [fresh(), fresh(), fresh(), fresh()];
                push(&mut out, OP_CONSTANT, &[scalar, one, 1]);
                push(&mut out, OP_CONSTANT, &[scalar, zero, 0]);
                push(&mut out, OP_TYPE_ARRAY, &[array, scalar, one]);
                push(&mut out, OP_TYPE_POINTER, &[own, *class, array]);
                push(&mut out, OP_VARIABLE, &[own, *id, *class]);
                elements.insert(*id, [*pointer, zero]);
                continue;
            }
            (OP_LOAD, [ty, result, id, rest @ ..]) if elements.contains_key(id) => {
                let [pointer, zero] = elements[id];
                let element = fresh();
                push(&mut out, OP_ACCESS_CHAIN, &[pointer, element, *id, zero]);
                push(
                    &mut out,
                    OP_LOAD,
                    &[&[*ty, *result, element], rest].concat(),
                );
                continue;
            }
            (OP_STORE, [id, value @ ..]) if elements.contains_key(id) => {
                let [pointer, zero] = elements[id];
                let element = fresh();
                push(&mut out, OP_ACCESS_CHAIN, &[pointer, element, *id, zero]);
                push(&mut out, OP_STORE, &[&[element], value].concat());
                continue;
            }
            _ => {}
        }
        out.extend(&words[start..=start + operands.len()]);
    }
    if let Some(bound) = out.get_mut(BOUND) {
        *bound = next;
    }
    out
}

fn push(out: &mut Vec<u32>, opcode: u16, operands: &[u32]) {
    let length = operands.len() as u32 + 1;
    out.push(length << 16 | u32::from(opcode));
    out.extend(operands);
}
