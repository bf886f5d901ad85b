//! A test of alpha in place of alpha to coverage and blending, which have no place in a picture with
//! one value for each pixel.

use naga::{
    BinaryOperator, Binding, Block, Expression, Literal, Module, ScalarKind, ShaderStage, Span,
    Statement, TypeInner, UnaryOperator, VectorSize,
};

use super::names::refusal;
use super::{NAME, refusals, with_main};
use crate::analysis::coverage::ALPHA;
use crate::core::pass::Refusal;
use crate::core::plan::{Phase, Plan, Role};
use crate::core::reflect;
use crate::rebuild::returns;

/// The plan with a main pass that discards below `cutoff`, and what it leaves out, in words. `None`:
/// its alpha covers nothing.
///
/// # Errors
/// There is no `cutoff`, or no alpha.
pub fn tested(plan: &Plan, cutoff: Option<f32>) -> Result<Option<(Plan, String)>, Box<Refusal>> {
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
    let without = || refuse("but the fragment stage writes no alpha to location 0");
    let (program, entry) = entry.ok_or_else(without)?;
    let mut module = program.module().clone();
    test(&mut module, entry, cutoff).ok_or_else(without)?;
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

/// Discards at each return of the fragment stage where alpha is below `cutoff`, or no number.
fn test(module: &mut Module, entry: usize, cutoff: f32) -> Option<()> {
    let outputs = reflect::outputs(module, &module.entry_points[entry].function);
    let is_color = |binding: &Option<Binding>| {
        let first = matches!(binding, Some(Binding::Location { location: 0, blend_src, .. })
            if blend_src.is_none_or(|i| i == 0));
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
        let mut part = |base, index| writer.expression(Expression::AccessIndex { base, index });
        let color = match is_struct {
            true => part(value, index as u32),
            false => value,
        };
        let left = part(color, ALPHA);
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
