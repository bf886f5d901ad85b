//! Gives everything a name that is valid in other languages. Compilers put signatures, classes and
//! dots into names: `shade(vf3;`, `in.var.TEXCOORD0`, `type.ConstantBuffer.Scene`. Unnamed values
//! are called by their id, as in spirv-cross: `_12`, and members `_m0`.

use std::collections::{HashMap, HashSet};

use rspirv::dr::{Builder, Operand};
use rspirv::spirv::{BuiltIn, Decoration, Op, Word};

use crate::words::{decorations, ids, names};

/// Names all variables, parameters, functions, specialisation constants, structs and members.
/// Returns the new and old names of structs that were renamed.
pub(super) fn give(module: &mut Builder) -> Vec<(String, String)> {
    let mut named = names(module.module_ref());
    let mut members: HashMap<(Word, u32), String> = HashMap::new();
    for i in &module.module_ref().debug_names {
        if let [
            Operand::IdRef(id),
            Operand::LiteralBit32(member),
            Operand::LiteralString(name),
        ] = i.operands.as_slice()
        {
            members.insert((*id, *member), identifier(name));
        }
    }
    let decorated = module.module_ref().annotations.iter();
    let built_ins: HashMap<Word, BuiltIn> = decorated
        .filter_map(|i| match i.operands.as_slice() {
            [Operand::IdRef(id), _, Operand::BuiltIn(built_in)] => Some((*id, *built_in)),
            _ => None,
        })
        .collect();
    let constants = decorations(module.module_ref(), Decoration::SpecId);
    let mut out: Vec<(Word, String)> = Vec::new();
    let mut of_members: Vec<(Word, u32, String)> = Vec::new();
    let mut changed = Vec::new();
    for i in module.module_ref().all_inst_iter() {
        let Some(id) = i.result_id else { continue };
        match i.class.opcode {
            Op::TypeStruct => {
                let mut taken = HashSet::new();
                for n in 0..ids(i).count() as u32 {
                    let own = members
                        .remove(&(id, n))
                        .filter(|name| taken.insert(name.clone()));
                    let name = own.unwrap_or_else(|| format!("_m{n}"));
                    of_members.push((id, n, name));
                }
                if let Some(name) = named.get(&id)
                    && identifier(name) != *name
                {
                    changed.push((identifier(name), name.clone()));
                }
            }
            Op::Variable
            | Op::Function
            | Op::FunctionParameter
            | Op::SpecConstant
            | Op::SpecConstantTrue
            | Op::SpecConstantFalse => {}
            _ => continue,
        }
        let own = named.remove(&id).map(|name| identifier(&name));
        let name = own.or_else(|| built_in_name(*built_ins.get(&id)?).map(str::to_owned));
        // The other stage may have another constant with the same id.
        let name = name.or_else(|| Some(format!("constant_{}", constants.get(&id)?)));
        out.push((id, name.unwrap_or_else(|| format!("_{id}"))));
    }
    module.module_mut().debug_names.clear();
    for (id, name) in out {
        module.name(id, name);
    }
    for (id, n, name) in of_members {
        module.member_name(id, n, name);
    }
    changed
}

/// WGSL's name for a built-in that DXC leaves unnamed.
fn built_in_name(built_in: BuiltIn) -> Option<&'static str> {
    Some(match built_in {
        BuiltIn::Position | BuiltIn::FragCoord => "position",
        BuiltIn::VertexIndex => "vertex_index",
        BuiltIn::InstanceIndex => "instance_index",
        BuiltIn::FrontFacing => "front_facing",
        BuiltIn::FragDepth => "frag_depth",
        BuiltIn::SampleId => "sample_index",
        BuiltIn::SampleMask => "sample_mask",
        BuiltIn::PrimitiveId => "primitive_index",
        _ => return None,
    })
}

/// A name as a valid identifier of WGSL and GLSL.
pub(super) fn identifier(name: &str) -> String {
    let name = name.split('(').next().unwrap_or_default();
    let own = ["in.var.", "out.var."];
    let name = own
        .iter()
        .find_map(|c| name.strip_prefix(c))
        .unwrap_or(name);
    let name = name.trim_end_matches(|c: char| !c.is_ascii_alphanumeric() && c != '_');
    let mut out = String::new();
    for c in name.chars() {
        match c.is_ascii_alphanumeric() {
            true => out.push(c),
            // Two underscores are reserved.
            false if !out.ends_with('_') => out.push('_'),
            false => {}
        }
    }
    match out.as_str() {
        "" | "_" => "_value".to_owned(),
        name if name.starts_with(|c: char| c.is_ascii_digit()) => format!("_{name}"),
        name => name.to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::identifier;

    #[test]
    fn names_of_compilers_become_identifiers() {
        for (name, expected) in [
            ("shade(vf3;f1;", "shade"),
            ("in.var.TEXCOORD0", "TEXCOORD0"),
            ("type.ConstantBuffer.Scene", "type_ConstantBuffer_Scene"),
            ("gl_PerVertex", "gl_PerVertex"),
            ("3d", "_3d"),
            ("a::b<f32>", "a_b_f32"),
            ("(", "_value"),
        ] {
            assert_eq!(identifier(name), expected);
        }
    }
}
