//! Valid modules that no author wrote: a fixture's, with some of its expressions and statements
//! changed, as far as naga's validator takes the result.

use naga::{
    BinaryOperator, Expression, Function, Handle, Literal, MathFunction, Statement, UnaryOperator,
};
use preshade_compiler::recipe::Recipe;
use preshade_geometry::examples;
use preshade_plan::pass::{Facts, Use};
use preshade_plan::plan::Plan;
use preshade_plan::program::Program;

use super::{Bytes, emitted, recipes::materials};

const BINARY: [BinaryOperator; 12] = [
    BinaryOperator::Add,
    BinaryOperator::Subtract,
    BinaryOperator::Multiply,
    BinaryOperator::Divide,
    BinaryOperator::Modulo,
    BinaryOperator::Less,
    BinaryOperator::LessEqual,
    BinaryOperator::Equal,
    BinaryOperator::NotEqual,
    BinaryOperator::And,
    BinaryOperator::ExclusiveOr,
    BinaryOperator::ShiftLeft,
];

const MATH: [MathFunction; 14] = [
    MathFunction::Abs,
    MathFunction::Sin,
    MathFunction::Exp,
    MathFunction::Log,
    MathFunction::Sqrt,
    MathFunction::InverseSqrt,
    MathFunction::Fract,
    MathFunction::Floor,
    MathFunction::Normalize,
    MathFunction::Length,
    MathFunction::Acos,
    MathFunction::Tan,
    MathFunction::Sign,
    MathFunction::Round,
];

const FLOATS: [f32; 12] = [
    0.0, -0.0, 1.0, -1.0, 0.5, 1e-40, 1e-30, 1e30, 3.4e38, 43758.547, 1e7, 65504.0,
];

/// Changes one thing of a function.
fn change(function: &mut Function, bytes: &mut Bytes<'_>) {
    let n = function.expressions.len();
    if n == 0 {
        return;
    }
    let handles: Vec<Handle<Expression>> = function.expressions.iter().map(|(h, _)| h).collect();
    let at = handles[bytes.below(n)];
    // Expressions rest on earlier ones alone.
    let other = handles[bytes.below(at.index().max(1))];
    let operator = bytes.byte();
    match &mut function.expressions[at] {
        Expression::Literal(Literal::F32(f)) => {
            *f = FLOATS[usize::from(operator) % FLOATS.len()];
        }
        Expression::Literal(Literal::I32(i)) => *i = i32::from(operator as i8),
        Expression::Literal(Literal::U32(u)) => *u = u32::from(operator),
        Expression::Literal(Literal::Bool(b)) => *b = !*b,
        Expression::Binary { op, left, right } => match operator % 3 {
            0 => *op = BINARY[usize::from(operator / 3) % BINARY.len()],
            1 => *left = other,
            _ => *right = other,
        },
        Expression::Unary { op, expr } => match operator % 2 {
            0 => *expr = other,
            _ => {
                *op = match op {
                    UnaryOperator::Negate => UnaryOperator::BitwiseNot,
                    _ => UnaryOperator::Negate,
                }
            }
        },
        Expression::Math { fun, arg, arg1, .. } => match operator % 3 {
            0 => *fun = MATH[usize::from(operator / 3) % MATH.len()],
            1 => *arg = other,
            _ => *arg1 = arg1.map(|_| other),
        },
        Expression::Select {
            condition,
            accept,
            reject,
        } => match operator % 3 {
            0 => std::mem::swap(accept, reject),
            1 => *condition = other,
            _ => *accept = other,
        },
        Expression::AccessIndex { index, .. } => *index = u32::from(operator % 5),
        Expression::Swizzle { pattern, .. } => pattern.swap(0, usize::from(operator % 2)),
        Expression::Compose { components, .. } => {
            let n = components.len().max(1);
            if let Some(c) = components.get_mut(usize::from(operator) % n) {
                *c = other;
            }
        }
        Expression::Load { pointer } => *pointer = other,
        _ => {}
    }
}

/// Whether naga's own writer makes a text of it that naga's own parser reads: its validator lets an
/// expression rest on one that was evaluated in a block which has ended.
fn is_text(program: &Program) -> bool {
    let flags = naga::back::wgsl::WriterFlags::empty();
    let text = naga::back::wgsl::write_string(program.module(), program.info(), flags);
    text.is_ok_and(|text| naga::front::wgsl::parse_str(&text).is_ok())
}

/// Changes one statement somewhere in a block. What naga's validator takes and no front end makes
/// is left out: a path without its return, code behind a discard that is always reached.
fn disturb(block: &mut naga::Block, depth: usize, bytes: &mut Bytes<'_>) {
    let n = block.len();
    if n == 0 {
        return;
    }
    let at = bytes.below(n);
    let deeper = bytes.below(3) != 0;
    match &mut block[at] {
        Statement::Block(inner) => disturb(inner, depth, bytes),
        Statement::If { accept, reject, .. } if deeper => match bytes.below(2) {
            0 => disturb(accept, depth + 1, bytes),
            _ => disturb(reject, depth + 1, bytes),
        },
        Statement::Loop {
            body, continuing, ..
        } if deeper => match bytes.below(4) {
            0 => disturb(continuing, 0, bytes),
            _ => disturb(body, depth + 1, bytes),
        },
        Statement::Switch { cases, .. } if deeper => {
            let n = cases.len().max(1);
            if let Some(case) = cases.get_mut(bytes.below(n)) {
                disturb(&mut case.body, depth + 1, bytes);
            }
        }
        Statement::If { accept, reject, .. } => std::mem::swap(accept, reject),
        Statement::Store { .. } | Statement::Call { result: None, .. } => match bytes.below(2) {
            0 if depth > 0 && at + 1 == n => block[at] = Statement::Kill,
            _ => block.cull(at..at + 1),
        },
        _ => {}
    }
}

/// Whether the changed module was valid.
pub fn ir(data: &[u8]) -> bool {
    let bytes = &mut Bytes(data);
    let all = materials();
    let (name, plan) = &all[bytes.below(all.len())];
    let recipes: Vec<&str> = examples()
        .filter(|(_, used)| **used == Use::Fuzz)
        .map(|(recipe, _)| recipe)
        .collect();
    let recipe = recipes[bytes.below(recipes.len())];
    let pass = plan.main().unwrap();
    let program = plan.program(pass).unwrap();
    let mut module = program.module().clone();
    for _ in 0..1 + bytes.below(4) {
        let before = module.clone();
        let functions = module.functions.len();
        let which = bytes.below(functions + module.entry_points.len());
        let function = match which.checked_sub(functions) {
            Some(entry) => &mut module.entry_points[entry].function,
            None => {
                let handle = module.functions.iter().nth(which).unwrap().0;
                &mut module.functions[handle]
            }
        };
        match bytes.below(3) {
            0 => disturb(&mut function.body, 0, bytes),
            _ => change(function, bytes),
        }
        if program.with_module(module.clone()).is_err() {
            module = before;
        }
        if bytes.is_empty() {
            break;
        }
    }
    let Ok(program) = program.with_module(module) else {
        return false;
    };
    if !is_text(&program) {
        return false;
    }
    let state = preshade_plan::state::MaterialState::default();
    let plan = Plan::original(
        name,
        program,
        &pass.vertex,
        pass.fragment.as_deref(),
        &state,
    );
    let recipe = Recipe::parse_list(recipe).unwrap();
    if let Ok(plan) = recipe.apply(&plan, &Facts::without_ties()) {
        emitted(&plan);
    }
    true
}
