//! Leaves the function after a `discard` in a loop. GLSL's `discard` and SPIR-V's `OpKill` end the
//! invocation. WGSL's only demotes it, so a loop that nothing else ends would never end.
//!
//! ```text
//! loop {                                  loop {
//!     cut();                                  cut();
//!                                             if killed { return; }
//!     discard;                                discard;
//!                                             return;
//! }                                       }
//! ```

use std::collections::HashSet;

use crate::variable::private_bool;
use naga::{
    Block, Expression, Function, GlobalVariable, Handle, Literal, Module, Range, Span, Statement,
};

/// Adds a `return` after each `discard` in a loop, and a conditional one after each call in a loop
/// of a function that may discard.
pub fn end(module: &mut Module) {
    let mut killers: HashSet<Handle<Function>> = HashSet::new();
    // Callees precede their callers.
    for (handle, function) in module.functions.iter() {
        if kills(&function.body, &killers) {
            killers.insert(handle);
        }
    }
    let functions = module.functions.iter().map(|(_, f)| f);
    let entries = module.entry_points.iter().map(|e| &e.function);
    let asks = functions
        .chain(entries)
        .any(|f| calls_in_loop(&f.body, false, &killers));
    // True once the invocation discarded.
    let flag = asks.then(|| private_bool(module, "killed"));
    for (handle, function) in module.functions.iter_mut() {
        let own = flag.filter(|_| killers.contains(&handle));
        Ending {
            killers: &killers,
            flag,
            own,
        }
        .end(function);
    }
    for entry in &mut module.entry_points {
        // No caller needs to know whether it discarded.
        Ending {
            killers: &killers,
            flag,
            own: None,
        }
        .end(&mut entry.function);
    }
}

fn kills(block: &Block, killers: &HashSet<Handle<Function>>) -> bool {
    block.iter().any(|statement| match statement {
        Statement::Kill => true,
        Statement::Call { function, .. } => killers.contains(function),
        other => naga_operands::blocks(other)
            .iter()
            .any(|b| kills(b, killers)),
    })
}

fn calls_in_loop(block: &Block, is_in_loop: bool, killers: &HashSet<Handle<Function>>) -> bool {
    block.iter().any(|statement| {
        let is_in_loop = is_in_loop || matches!(statement, Statement::Loop { .. });
        match statement {
            Statement::Call { function, .. } => is_in_loop && killers.contains(function),
            other => naga_operands::blocks(other)
                .iter()
                .any(|b| calls_in_loop(b, is_in_loop, killers)),
        }
    })
}

struct Ending<'a> {
    /// The functions that may discard.
    killers: &'a HashSet<Handle<Function>>,
    flag: Option<Handle<GlobalVariable>>,
    /// The flag to set, if a caller reads it.
    own: Option<Handle<GlobalVariable>>,
}

impl Ending<'_> {
    fn end(&self, function: &mut Function) {
        let mut body = std::mem::take(&mut function.body);
        self.end_block(function, &mut body, false);
        function.body = body;
    }

    fn end_block(&self, function: &mut Function, block: &mut Block, is_in_loop: bool) {
        let mut added = Vec::new();
        for (i, statement) in block.iter_mut().enumerate() {
            match statement {
                Statement::Kill => added.push((i, true)),
                Statement::Call { function, .. } if self.killers.contains(function) => {
                    added.push((i, false));
                }
                _ => {}
            }
            let is_in_loop = is_in_loop || matches!(statement, Statement::Loop { .. });
            for inner in naga_operands::blocks_mut(statement) {
                self.end_block(function, inner, is_in_loop);
            }
        }
        for (i, is_kill) in added.into_iter().rev() {
            let returns = matches!(block.get(i + 1), Some(Statement::Return { .. }));
            if is_in_loop && !returns {
                let leave = match (is_kill, self.flag) {
                    (false, Some(flag)) => if_killed(function, flag),
                    _ => leave(function),
                };
                block.splice(i + 1..i + 1, leave);
            }
            if let (true, Some(flag)) = (is_kill, self.own) {
                block.splice(i..i, set(function, flag));
            }
        }
    }
}

/// A `return`. Its value no longer matters.
fn leave(function: &mut Function) -> Block {
    let ty = function.result.as_ref().map(|r| r.ty);
    let value = ty.map(|ty| append(function, Expression::ZeroValue(ty)));
    Block::from_vec(vec![Statement::Return { value }])
}

/// `if killed { return; }`
fn if_killed(function: &mut Function, flag: Handle<GlobalVariable>) -> Block {
    let accept = leave(function);
    let pointer = append(function, Expression::GlobalVariable(flag));
    let condition = append(function, Expression::Load { pointer });
    Block::from_vec(vec![
        Statement::Emit(Range::new_from_bounds(condition, condition)),
        Statement::If {
            condition,
            accept,
            reject: Block::new(),
        },
    ])
}

/// `killed = true;`
fn set(function: &mut Function, flag: Handle<GlobalVariable>) -> Block {
    let pointer = append(function, Expression::GlobalVariable(flag));
    let value = append(function, Expression::Literal(Literal::Bool(true)));
    Block::from_vec(vec![Statement::Store { pointer, value }])
}

fn append(function: &mut Function, expression: Expression) -> Handle<Expression> {
    function.expressions.append(expression, Span::UNDEFINED)
}
