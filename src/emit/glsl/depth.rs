//! OpenGL's depths in GLSL that was made of OpenGL's: the front end's halving of the range is left out, so that positions are the author's to the bit.

use naga::{
    Arena, BinaryOperator, Block, Expression, Function, Handle, Literal, LocalVariable, Module,
    ShaderStage, Statement,
};
use preshade_passes::program::Program;

/// The program without the statement `p.z = (p.z + p.w) * 0.5` of a vertex entry point, which the front end puts at its end. `None` where there is none, or more than one: an author may
/// have written the like, and it cannot be told which is whose.
pub(super) fn as_authored(program: &Program, stage: ShaderStage, entry: &str) -> Option<Program> {
    let mut module = program.module().clone();
    let at = |e: &naga::EntryPoint| e.stage == stage && e.name == entry;
    let index = module.entry_points.iter().position(at)?;
    let mut found = 0;
    for handle in called(&module, &module.entry_points[index].function) {
        found += leave_out(&mut module.functions[handle]);
    }
    found += leave_out(&mut module.entry_points[index].function);
    (found == 1).then(|| program.with_module(module).ok())?
}

/// The functions that `function` calls, and those that they call.
fn called(module: &Module, function: &Function) -> Vec<Handle<Function>> {
    fn calls(block: &Block, out: &mut Vec<Handle<Function>>) {
        for statement in block {
            if let Statement::Call { function, .. } = statement {
                out.push(*function);
            }
            inner(statement).into_iter().for_each(|b| calls(b, out));
        }
    }
    let mut waiting = Vec::new();
    calls(&function.body, &mut waiting);
    let mut found = Vec::new();
    while let Some(next) = waiting.pop() {
        if !found.contains(&next) {
            found.push(next);
            calls(&module.functions[next].body, &mut waiting);
        }
    }
    found
}

fn inner(statement: &Statement) -> Vec<&Block> {
    match statement {
        Statement::Block(block) => vec![block],
        Statement::If { accept, reject, .. } => vec![accept, reject],
        Statement::Switch { cases, .. } => cases.iter().map(|c| &c.body).collect(),
        Statement::Loop {
            body, continuing, ..
        } => vec![body, continuing],
        _ => Vec::new(),
    }
}

/// Leaves the statement out wherever it stands at the level of the body itself, and counts how often it did.
fn leave_out(function: &mut Function) -> usize {
    let halves = |statement: &Statement| match statement {
        Statement::Store { pointer, value } => halved(&function.expressions, *pointer, *value),
        _ => false,
    };
    let places: Vec<usize> = (0..function.body.len())
        .filter(|i| halves(&function.body[*i]))
        .collect();
    for i in places.iter().rev() {
        function.body.cull(*i..=*i);
    }
    places.len()
}

/// Whether `value`, stored at `pointer`, is the middle between the z and the w of the variable whose z that is.
fn halved(
    expressions: &Arena<Expression>,
    pointer: Handle<Expression>,
    value: Handle<Expression>,
) -> bool {
    let variable = |pointer: Handle<Expression>| match expressions[pointer] {
        Expression::LocalVariable(local) => Some(local),
        _ => None,
    };
    let part = |e: Handle<Expression>| -> Option<(Handle<LocalVariable>, u32)> {
        let Expression::AccessIndex { base, index } = expressions[e] else {
            return None;
        };
        match expressions[base] {
            Expression::Load { pointer } => Some((variable(pointer)?, index)),
            Expression::LocalVariable(local) => Some((local, index)),
            _ => None,
        }
    };
    let Some((position, 2)) = part(pointer) else {
        return false;
    };
    let Expression::Binary {
        op: BinaryOperator::Multiply,
        left,
        right,
    } = expressions[value]
    else {
        return false;
    };
    let Expression::Binary {
        op: BinaryOperator::Add,
        left: z,
        right: w,
    } = expressions[left]
    else {
        return false;
    };
    let half = matches!(expressions[right], Expression::Literal(Literal::F32(h)) if h == 0.5);
    half && part(z) == Some((position, 2)) && part(w) == Some((position, 3))
}
