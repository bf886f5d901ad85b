//! Detects calls with a pointer to part of a variable. WGSL allows them
//! (`unrestricted_pointer_parameters`), naga's validator too, but its SPIR-V writer panics.

use naga::{Block, Expression, Function, Module, Span, Statement, TypeInner};
use preshade_plan::program::Program;

/// The location of such a call in the program's text, with a remedy.
pub fn find(program: &Program) -> Option<String> {
    let module = program.module();
    let functions = module.functions.iter().map(|(_, f)| f);
    let entries = module.entry_points.iter().map(|e| &e.function);
    let span = functions
        .chain(entries)
        .find_map(|f| in_block(module, f, &f.body))?;
    let sources = program.sources();
    let place = sources.locate(span).map_or(String::new(), |at| {
        let range = at.range.start as usize..at.range.end as usize;
        let file = sources.file_of(span);
        let text = file.and_then(|f| f.text.get(range)).unwrap_or_default();
        format!("{}:{}:{}: `{text}`: ", at.file, at.line, at.column)
    });
    Some(format!(
        "{place}a pointer to a part of a variable is passed to a function, which naga cannot write \
         for any adapter or for SPIR-V: pass a copy and store it back, or pass the whole variable"
    ))
}

fn in_block(module: &Module, function: &Function, block: &Block) -> Option<Span> {
    block.iter().find_map(|statement| {
        if let Statement::Call {
            function: callee,
            arguments,
            ..
        } = statement
        {
            let takes = &module.functions[*callee].arguments;
            let is_pointer = |ty| {
                matches!(
                    module.types[ty].inner,
                    TypeInner::Pointer { .. } | TypeInner::ValuePointer { .. }
                )
            };
            let part = arguments.iter().zip(takes).find(|(value, argument)| {
                let is_part = matches!(
                    function.expressions[**value],
                    Expression::Access { .. } | Expression::AccessIndex { .. }
                );
                is_part && is_pointer(argument.ty)
            });
            if let Some((value, _)) = part {
                return Some(function.expressions.get_span(*value));
            }
        }
        let mut inner = naga_operands::blocks(statement).into_iter();
        inner.find_map(|b| in_block(module, function, b))
    })
}
