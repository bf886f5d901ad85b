//! A test of alpha in place of alpha to coverage and blending, which have no place in a picture with
//! one value for each pixel.

use naga::{
    BinaryOperator, Binding, Block, Expression, Handle, Literal, Module, ScalarKind, ShaderStage,
    Span, Statement, TypeInner, UnaryOperator, VectorSize,
};
use naga_edit::interface;

use super::names::refusal;
use super::{NAME, refusals, with_main};
use crate::analysis::coverage::ALPHA;
use naga_edit::returns;
use naga_edit::writer::FunctionWriter;
use preshade_plan::pass::Refusal;
use preshade_plan::plan::{Phase, Plan, Role};
use preshade_plan::state::ColorTarget;

/// The plan with a main pass that discards below `cutoff`, and a sentence on what that leaves out.
/// `None`: its alpha covers nothing.
///
/// # Errors
/// There is no `cutoff`, or no alpha.
pub(crate) fn tested(
    plan: &Plan,
    cutoff: Option<f32>,
) -> Result<Option<(Plan, String)>, Box<Refusal>> {
    let Some(pass) = plan.main() else {
        return Ok(None);
    };
    let is_blended =
        pass.phase == Phase::Blended || pass.targets.iter().flatten().any(|t| t.is_blended());
    let what = match (pass.multisample.alpha_to_coverage, is_blended) {
        (true, _) => "alpha to coverage",
        (false, true) => "blending",
        (false, false) => return Ok(None),
    };
    let refuse = |why: &str| {
        let reason = format!("{what} decides how much of a pixel is covered, {why}");
        refusal(&refusals::ALPHA_DECIDES, reason)
    };
    let Some(cutoff) = cutoff else {
        return Err(refuse("and a pixel of these pictures is covered or not"));
    };
    let entry = plan.program(pass).and_then(|program| {
        let name = pass.fragment.as_deref()?;
        let (entry, _) = program.entry_point(ShaderStage::Fragment, name)?;
        Some((program, entry))
    });
    // Alpha to coverage takes the alpha of location 0; blending, that of each target.
    let is_own = |t: &Option<ColorTarget>| t.as_ref().is_some_and(ColorTarget::is_blended);
    let blended = pass.targets.iter().position(is_own).unwrap_or(0);
    let location = match pass.multisample.alpha_to_coverage {
        true => 0,
        false => blended as u32,
    };
    let why = format!("but the fragment stage writes no alpha to location {location}");
    let without = || refuse(&why);
    let (program, entry) = entry.ok_or_else(without)?;
    let mut module = program.module().clone();
    test(&mut module, entry, (location, cutoff)).ok_or_else(without)?;
    let program = program.with_module(module);
    let program = program.map_err(|e| Refusal::bug(NAME, e))?;
    let mut plan = with_main(plan, &program, None);
    for pass in plan.passes.iter_mut().filter(|p| p.role == Role::Main) {
        pass.phase = Phase::Opaque;
        pass.multisample.alpha_to_coverage = false;
        for target in pass.targets.iter_mut().flatten() {
            target.blend = None;
        }
        if let Some(depth) = &mut pass.depth {
            depth.write = true;
        }
    }
    let left = format!("{what}: what has an alpha of at least {cutoff} is covered");
    Ok(Some((plan, left)))
}

/// Discards at each return of the fragment stage where the alpha of a location is below `cutoff`, or no number.
fn test(module: &mut Module, entry: usize, (of, cutoff): (u32, f32)) -> Option<()> {
    let outputs = interface::outputs(module, &module.entry_points[entry].function);
    let is_color = |binding: &Option<Binding>| {
        let first = matches!(binding, Some(Binding::Location { location, blend_src, .. })
            if *location == of && blend_src.is_none_or(|i| i == 0));
        first
    };
    let index = outputs.iter().position(|io| is_color(&io.binding))?;
    let has_alpha = matches!(
        module.types[outputs[index].ty].inner,
        TypeInner::Vector { size: VectorSize::Quad, scalar } if scalar.kind == ScalarKind::Float && scalar.width == 4
    );
    if !has_alpha {
        return None;
    }
    let function = &mut module.entry_points[entry].function;
    let is_struct = function.result.as_ref()?.binding.is_none();
    returns::rewrite(function, &mut |writer, value| {
        let value = value?;
        let color = match is_struct {
            true => part(writer, value, index as u32, true),
            false => value,
        };
        let left = part(writer, color, ALPHA, false);
        let right = writer.expression(Expression::Literal(Literal::F32(cutoff)));
        let covers = writer.expression(Expression::Binary {
            op: BinaryOperator::GreaterEqual,
            left,
            right,
        });
        let condition = writer.expression(Expression::Unary {
            op: UnaryOperator::LogicalNot,
            expr: covers,
        });
        let enclosing = writer.open(Span::UNDEFINED);
        writer.statement(Statement::Kill, Span::UNDEFINED);
        let accept = writer.close(enclosing, Span::UNDEFINED);
        let reject = Block::new();
        let statement = Statement::If {
            condition,
            accept,
            reject,
        };
        writer.statement(statement, Span::UNDEFINED);
        Some(value)
    });
    Some(())
}

/// A member or a component, without the whole where the whole is composed of its parts.
fn part(
    writer: &mut FunctionWriter,
    base: Handle<Expression>,
    index: u32,
    is_struct: bool,
) -> Handle<Expression> {
    match &writer.function.expressions[base] {
        Expression::Compose { components, .. } if is_struct || components.len() == 4 => {
            components[index as usize]
        }
        Expression::Splat { value, .. } => *value,
        _ => writer.expression(Expression::AccessIndex { base, index }),
    }
}
