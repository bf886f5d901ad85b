//! Explicit levels of detail for samples whose coordinates are the same all over a draw.
//!
//! Their derivatives are 0, so the level is the sampler's smallest, as for an explicit level of 0. A sample with an
//! explicit level needs no quad: a vertex stage or a compute stage can take it.

use std::borrow::Cow;

use naga::{
    Expression, Handle, ImageClass, ImageDimension, SampleLevel, ScalarKind, ShaderStage, TypeInner,
};

use crate::core::plan::Plan;
use crate::core::program::Program;
use crate::graph::rate::Rate;
use crate::graph::{FunctionGraph, FunctionId, Graph};
use crate::rebuild::place;

/// The plan with explicit levels in the fragment stage of its main pass.
pub fn explicit(plan: &Plan) -> Cow<'_, Plan> {
    let main = plan.main();
    let built = main.and_then(|pass| {
        let program = plan.program(pass)?;
        let (entry, _) = program.entry_point(ShaderStage::Fragment, pass.fragment.as_deref()?)?;
        Some((&pass.program, edited(program, entry)?))
    });
    match built {
        Some((key, program)) => {
            let mut next = plan.clone();
            next.programs.insert(key.clone(), program);
            Cow::Owned(next)
        }
        None => Cow::Borrowed(plan),
    }
}

/// The program with explicit levels; `None` if nothing changes. A coordinate from a sample that gets one keeps its own
/// implicit level.
fn edited(program: &Program, entry: usize) -> Option<Program> {
    let graph = Graph::build(program);
    let mut module = None;
    for f in graph.functions() {
        if !graph.reaches(FunctionId::EntryPoint(entry), f.id) {
            continue;
        }
        for (sample, expression) in f.function.expressions.iter() {
            if !is_steady(&graph, f, expression) {
                continue;
            }
            let module = module.get_or_insert_with(|| program.module().clone());
            let function = place::function_mut(module, f.id);
            if let Expression::ImageSample { level, .. } = &mut function.expressions[sample] {
                *level = SampleLevel::Zero;
            }
        }
    }
    program.with_module(module?).ok()
}

/// Whether an expression is a sample with an implicit level, at a coordinate that every call gives the same all over a
/// draw.
fn is_steady(graph: &Graph<'_>, f: &FunctionGraph<'_>, expression: &Expression) -> bool {
    let Expression::ImageSample {
        image,
        coordinate,
        array_index,
        level: SampleLevel::Auto | SampleLevel::Bias(_),
        gather: None,
        depth_ref: None,
        ..
    } = expression
    else {
        return false;
    };
    let is_fixed = |e: Handle<Expression>| graph.rate(f.id, e) <= Rate::Draw;
    is_fixed(*coordinate)
        && array_index.is_none_or(is_fixed)
        && has_levels(f.ty(graph.module(), *image))
}

/// Whether WGSL has samples of such a texture with a level of its own, or with a bias: not of depths, nor in one
/// dimension.
pub fn has_levels(texture: &TypeInner) -> bool {
    matches!(
        texture,
        TypeInner::Image {
            dim: ImageDimension::D2 | ImageDimension::D3 | ImageDimension::Cube,
            class: ImageClass::Sampled {
                kind: ScalarKind::Float,
                ..
            },
            ..
        }
    )
}
