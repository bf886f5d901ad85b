//! Derivatives of neighbouring pixels, in a pass whose quads span twice as many.

use naga::{
    Expression, Handle, ImageClass, ImageDimension, Literal, Module, SampleLevel, TypeInner,
};

use crate::rebuild::place::{self, Replacement, Rewrite};
use preshade_dataflow::graph::FunctionId;

/// The half-rate module with the derivatives and implicit levels of neighbouring pixels, and whether
/// there are any.
pub(crate) fn at_full_rate(mut module: Module) -> (Module, bool) {
    let functions = module
        .functions
        .iter()
        .map(|(h, _)| FunctionId::Function(h));
    let entries = 0..module.entry_points.len();
    let all: Vec<FunctionId> = functions
        .chain(entries.map(FunctionId::EntryPoint))
        .collect();
    let mut any = false;
    for id in all {
        let function = place::function_mut(&mut module, id);
        let of = |wanted: fn(&Expression) -> bool| -> Vec<Handle<Expression>> {
            let all = function.expressions.iter();
            all.filter(|(_, e)| wanted(e)).map(|(h, _)| h).collect()
        };
        let derivatives = of(|e| matches!(e, Expression::Derivative { .. }));
        let implicit = of(|e| {
            let level = match e {
                Expression::ImageSample { level, .. } => level,
                _ => return false,
            };
            matches!(level, SampleLevel::Auto | SampleLevel::Bias(_))
        });
        if derivatives.is_empty() && implicit.is_empty() {
            continue;
        }
        any = true;
        let samples: Vec<_> = implicit
            .into_iter()
            .filter(|e| takes_bias(&module, id, *e))
            .collect();
        module = place::rewritten(&module, id, |build| {
            let half = build.literal(Literal::F32(0.5));
            let finer = build.literal(Literal::F32(-1.0));
            let derivatives = derivatives.iter().map(|e| (*e, Replacement::Times(half)));
            let samples = samples.iter().map(|e| (*e, Replacement::Level(finer)));
            Rewrite {
                replacements: derivatives.chain(samples).collect(),
                ..Rewrite::default()
            }
        });
    }
    (module, any)
}

/// Whether WGSL has a sample of the same image with a bias: not of depths, nor in one dimension. Those keep their level.
fn takes_bias(module: &Module, id: FunctionId, sample: Handle<Expression>) -> bool {
    let function = match id {
        FunctionId::Function(function) => &module.functions[function],
        FunctionId::EntryPoint(entry) => &module.entry_points[entry].function,
    };
    let Expression::ImageSample { image, .. } = function.expressions[sample] else {
        return false;
    };
    let ty = match function.expressions[image] {
        Expression::GlobalVariable(global) => module.global_variables[global].ty,
        Expression::FunctionArgument(argument) => function.arguments[argument as usize].ty,
        // An element of an array of bindings.
        _ => return false,
    };
    matches!(
        module.types[ty].inner,
        TypeInner::Image {
            dim: ImageDimension::D2 | ImageDimension::D3 | ImageDimension::Cube,
            class: ImageClass::Sampled { .. },
            ..
        }
    )
}
