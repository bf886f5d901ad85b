//! Calls that may write one variable under two names, which WGSL forbids (11.3.1) and naga takes.

use std::collections::HashSet;

use naga::{
    Block, Expression, Function, GlobalVariable, Handle, LocalVariable, Module, Span, Statement,
};

/// The variable that a pointer points into.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
enum Root {
    Argument(u32),
    Local(Handle<LocalVariable>),
    Global(Handle<GlobalVariable>),
}

/// The variables that a function reads and writes, including all calls.
#[derive(Clone, Debug, Default)]
struct Uses {
    read: HashSet<Root>,
    written: HashSet<Root>,
}

impl Uses {
    fn has(&self, root: Root) -> bool {
        self.read.contains(&root) || self.written.contains(&root)
    }

    /// Whether the two are used, and one of them is written.
    fn clash(&self, a: Root, b: Root) -> bool {
        let one = self.written.contains(&a) || self.written.contains(&b);
        one && self.has(a) && self.has(b)
    }
}

/// Finds the first call that passes a variable under two names and writes one of them.
pub(super) fn check(module: &Module) -> Result<(), Span> {
    // A function calls earlier ones only.
    let mut uses: Vec<Uses> = Vec::with_capacity(module.functions.len());
    for (_, function) in module.functions.iter() {
        let own = of_function(function, &uses)?;
        uses.push(own);
    }
    for entry in &module.entry_points {
        of_function(&entry.function, &uses)?;
    }
    Ok(())
}

fn of_function(function: &Function, done: &[Uses]) -> Result<Uses, Span> {
    let mut own = Uses::default();
    for (_, expression) in function.expressions.iter() {
        if let Expression::Load { pointer } = expression {
            own.read.extend(root(function, *pointer));
        }
    }
    let mut clash = None;
    naga_operands::visit(&function.body, &mut |statement| match statement {
        Statement::Store { pointer, .. } => own.written.extend(root(function, *pointer)),
        Statement::Atomic { pointer, .. } => {
            own.written.extend(root(function, *pointer));
        }
        Statement::Call {
            function: callee,
            arguments,
            ..
        } => {
            let Some(of) = done.get(callee.index()) else {
                return;
            };
            let roots: Vec<Option<Root>> = arguments.iter().map(|a| root(function, *a)).collect();
            for (n, at) in roots
                .iter()
                .enumerate()
                .filter_map(|(n, r)| Some((n, (*r)?)))
            {
                let name = Root::Argument(n as u32);
                let other = |m: usize| of.clash(name, Root::Argument(m as u32));
                let twice = (n + 1..roots.len()).any(|m| roots[m] == Some(at) && other(m));
                let is_global = matches!(at, Root::Global(_)) && of.clash(name, at);
                if twice || is_global {
                    clash.get_or_insert(statement);
                }
                if of.read.contains(&name) {
                    own.read.insert(at);
                }
                if of.written.contains(&name) {
                    own.written.insert(at);
                }
            }
            let is_global = |r: &&Root| matches!(r, Root::Global(_));
            own.read.extend(of.read.iter().filter(is_global));
            own.written.extend(of.written.iter().filter(is_global));
        }
        _ => {}
    });
    match clash {
        Some(call) => Err(place(&function.body, call).unwrap_or_default()),
        None => Ok(own),
    }
}

/// Where a statement of a block is written.
fn place(block: &Block, wanted: &Statement) -> Option<Span> {
    block.span_iter().find_map(|(statement, span)| {
        let mut inner = naga_operands::blocks(statement).into_iter();
        match std::ptr::eq(statement, wanted) {
            true => Some(*span),
            false => inner.find_map(|block| place(block, wanted)),
        }
    })
}

/// The variable that a pointer points into; `None` for a value.
fn root(function: &Function, pointer: Handle<Expression>) -> Option<Root> {
    match function.expressions[pointer] {
        Expression::Access { base, .. } | Expression::AccessIndex { base, .. } => {
            root(function, base)
        }
        Expression::FunctionArgument(n) => Some(Root::Argument(n)),
        Expression::LocalVariable(v) => Some(Root::Local(v)),
        Expression::GlobalVariable(v) => Some(Root::Global(v)),
        _ => None,
    }
}
