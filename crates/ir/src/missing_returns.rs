//! Adds a `return` after each `discard` that ends a function. In GLSL `discard` ends the function.
//! In WGSL it demotes the invocation to a helper and continues (WGSL 10.2), so a function with a
//! result still needs a `return`.

use naga::{Block, Expression, Function, Module, Span, Statement};

/// Returns zeros at the end of each function with a result whose end is reachable by WGSL's rules.
pub(crate) fn add(module: &mut Module) {
    let functions = module.functions.iter_mut().map(|(_, f)| f);
    let entries = module.entry_points.iter_mut().map(|e| &mut e.function);
    for function in functions.chain(entries) {
        if reaches_end(&function.body) {
            give(function);
        }
    }
}

/// Whether control can reach the end of a block by WGSL's rules. A `discard` does not stop it.
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

/// How a block can end (WGSL 9.6, behaviour analysis), without returns.
#[derive(Clone, Copy, Default)]
struct Behaviour {
    /// Continues with the next statement.
    next: bool,
    /// Leaves the enclosing loop or switch.
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
        // This includes `discard`.
        _ => Behaviour {
            next: true,
            breaks: false,
        },
    }
}
