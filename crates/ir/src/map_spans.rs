//! Maps a module's spans from the rewritten text to the source. naga's arenas cannot change spans
//! in place, so they are rebuilt in order and all handles stay valid.

use naga::{Arena, Block, Function, Module, Span, UniqueArena};

/// Maps every span of the module with `to`.
pub fn map_spans(module: &mut Module, to: &impl Fn(Span) -> Span) {
    let mut types = UniqueArena::new();
    for (handle, ty) in module.types.iter() {
        types.insert(ty.clone(), to(module.types.get_span(handle)));
    }
    module.types = types;
    module.constants = arena(&module.constants, to);
    module.overrides = arena(&module.overrides, to);
    module.global_variables = arena(&module.global_variables, to);
    module.global_expressions = arena(&module.global_expressions, to);
    module.functions = arena(&module.functions, to);
    for (_, each) in module.functions.iter_mut() {
        function(each, to);
    }
    for entry in &mut module.entry_points {
        function(&mut entry.function, to);
    }
}

fn arena<T: Clone>(from: &Arena<T>, to: &impl Fn(Span) -> Span) -> Arena<T> {
    let mut out = Arena::new();
    for (handle, item) in from.iter() {
        out.append(item.clone(), to(from.get_span(handle)));
    }
    out
}

fn function(function: &mut Function, to: &impl Fn(Span) -> Span) {
    function.local_variables = arena(&function.local_variables, to);
    function.expressions = arena(&function.expressions, to);
    block(&mut function.body, to);
}

fn block(body: &mut Block, to: &impl Fn(Span) -> Span) {
    for (statement, span) in body.span_iter_mut() {
        if let Some(span) = span {
            *span = to(*span);
        }
        for inner in naga_operands::blocks_mut(statement) {
            block(inner, to);
        }
    }
}
