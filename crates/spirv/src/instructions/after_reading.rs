//! Replacements that need the IR: a `discard` that does not end the invocation, and the layer
//! count.

use naga::{Block, Expression, Function, Handle, ImageQuery, Module, Statement, TypeInner};
use rspirv::dr::{self, Builder, Instruction, Operand};
use rspirv::spirv::{FunctionControl, Op, Word};

/// Name of the function that demotes its invocation to a helper.
const DEMOTE: &str = "preshade_demote";

pub(super) fn declare_demote(module: &mut Builder, id: Word) {
    let void = module.type_void();
    let ty = module.type_function(void, []);
    let def = Instruction::new(
        Op::Function,
        Some(void),
        Some(id),
        vec![
            Operand::FunctionControl(FunctionControl::NONE),
            Operand::IdRef(ty),
        ],
    );
    let label = Instruction::new(Op::Label, None, Some(module.id()), Vec::new());
    let mut function = dr::Function::new();
    function.def = Some(def);
    function.blocks.push(dr::Block {
        label: Some(label),
        instructions: vec![Instruction::new(Op::Kill, None, None, Vec::new())],
    });
    function.end = Some(Instruction::new(Op::FunctionEnd, None, None, Vec::new()));
    module.module_mut().functions.push(function);
    module.name(id, DEMOTE);
}

/// Writes `discard` in place of the calls that [`super::replace`] inserted for demotions. SPIR-V
/// has no such instruction that naga reads inside of a block.
pub(crate) fn demote(module: &mut Module) {
    let is_demote = |f: &Function| f.name.as_deref() == Some(DEMOTE);
    let all: Vec<_> = module.functions.iter().collect();
    let named = all.into_iter().find(|(_, f)| is_demote(f));
    let Some(demote) = named.map(|(handle, _)| handle) else {
        return;
    };
    fn discard(block: &mut Block, demote: Handle<Function>) {
        for statement in block.iter_mut() {
            match statement {
                Statement::Call { function, .. } if *function == demote => {
                    *statement = Statement::Kill;
                }
                other => naga_operands::blocks_mut(other)
                    .into_iter()
                    .for_each(|b| discard(b, demote)),
            }
        }
    }
    for (_, function) in module.functions.iter_mut() {
        discard(&mut function.body, demote);
    }
    for entry in &mut module.entry_points {
        discard(&mut entry.function.body, demote);
    }
    naga::compact::compact(module, naga::compact::KeepUnused::No);
}

/// Queries the layer count in place of the sample counts that [`super::replace`] inserted. An array
/// texture has no samples.
pub fn layers(module: &mut Module) {
    let types = &module.types;
    let globals = &module.global_variables;
    let functions = module.functions.iter_mut().map(|(_, f)| f);
    let entries = module.entry_points.iter_mut().map(|e| &mut e.function);
    for function in functions.chain(entries) {
        let is_array = |image: Handle<Expression>| {
            let ty = match function.expressions[image] {
                Expression::GlobalVariable(handle) => globals[handle].ty,
                Expression::FunctionArgument(i) => function.arguments[i as usize].ty,
                _ => return false,
            };
            matches!(types[ty].inner, TypeInner::Image { arrayed: true, .. })
        };
        let all = function.expressions.iter();
        let found: Vec<Handle<Expression>> = all
            .filter(|(_, e)| {
                matches!(e, Expression::ImageQuery { image, query: ImageQuery::NumSamples } if is_array(*image))
            })
            .map(|(handle, _)| handle)
            .collect();
        for handle in found {
            if let Expression::ImageQuery { query, .. } = &mut function.expressions[handle] {
                *query = ImageQuery::NumLayers;
            }
        }
    }
}
