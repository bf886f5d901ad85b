//! A `return` behind every `discard` that ends a function. GLSL's `discard` ends it, and naga's takes it to; WGSL's demotes the invocation to a helper and goes on (WGSL 10.2), so
//! that a function with a result needs one there too.

use naga::{Block, Expression, Function, Module, Span, Statement};

/// Gives each function with a result, whose end may be reached by WGSL's rules, a result of zeros there.
pub(super) fn complete(module: &mut Module) {
    let functions = module.functions.iter_mut().map(|(_, f)| f);
    let entries = module.entry_points.iter_mut().map(|e| &mut e.function);
    for function in functions.chain(entries) {
        if reaches_end(&function.body) {
            give(function);
        }
    }
}

/// Whether control may come to the end of a block by WGSL's rules, a `discard` or not.
pub(super) fn reaches_end(block: &Block) -> bool {
    behaviour(block).next
}

fn give(function: &mut Function) {
    let Some(result) = &function.result else {
        return;
    };
    let zero = Expression::ZeroValue(result.ty);
    let value = function.expressions.append(zero, Span::UNDEFINED);
    let value = Some(value);
    function
        .body
        .push(Statement::Return { value }, Span::UNDEFINED);
}

/// How a block may end (WGSL 9.6, behaviour analysis); that it returns decides nothing here.
#[derive(Clone, Copy, Default)]
struct Behaviour {
    /// What stands behind it is reached.
    next: bool,
    /// The loop or switch around it is left.
    breaks: bool,
}

fn behaviour(block: &Block) -> Behaviour {
    let mut out = Behaviour {
        next: true,
        breaks: false,
    };
    for statement in block {
        if !out.next {
            break;
        }
        let of = of_statement(statement);
        out.next = of.next;
        out.breaks |= of.breaks;
    }
    out
}

fn of_statement(statement: &Statement) -> Behaviour {
    let either = |a: Behaviour, b: Behaviour| Behaviour {
        next: a.next || b.next,
        breaks: a.breaks || b.breaks,
    };
    match statement {
        Statement::Return { .. } | Statement::Continue => Behaviour::default(),
        Statement::Break => Behaviour {
            next: false,
            breaks: true,
        },
        Statement::Block(inner) => behaviour(inner),
        Statement::If { accept, reject, .. } => either(behaviour(accept), behaviour(reject)),
        Statement::Switch { cases, .. } => {
            let all = cases.iter().map(|c| behaviour(&c.body));
            let all = all.reduce(either).unwrap_or_default();
            Behaviour {
                next: all.next || all.breaks,
                breaks: false,
            }
        }
        Statement::Loop {
            body,
            continuing,
            break_if,
        } => {
            let all = either(behaviour(body), behaviour(continuing));
            Behaviour {
                next: all.breaks || break_if.is_some(),
                breaks: false,
            }
        }
        // A discard among them.
        _ => Behaviour {
            next: true,
            breaks: false,
        },
    }
}
