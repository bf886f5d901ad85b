//! Keeps OpenGL depth exact in GLSL that came from OpenGL: removes the front end's depth
//! conversion.

use naga::{
    Arena, BinaryOperator, Expression, Function, Handle, Literal, LocalVariable, ShaderStage,
    Statement,
};
use naga_operands::calls;
use preshade_plan::program::Program;

/// Removes the statement `p.z = (p.z + p.w) * 0.5` that the front end appends to a vertex entry
/// point. `None` unless there is exactly one, because the author may have written another.
pub(super) fn as_authored(program: &Program, stage: ShaderStage, entry: &str) -> Option<Program> {
    let mut module = program.module().clone();
    let at = |e: &naga::EntryPoint| e.stage == stage && e.name == entry;
    let index = module.entry_points.iter().position(at)?;
    let mut found = 0;
    for handle in calls::called(&module, &module.entry_points[index].function.body) {
        found += leave_out(&mut module.functions[handle]);
    }
    found += leave_out(&mut module.entry_points[index].function);
    (found == 1).then(|| program.with_module(module).ok())?
}

/// Removes the statement at the body's top level, and counts removals.
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

/// Whether `value` is the mean of z and w of the variable, and `pointer` is its z.
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
