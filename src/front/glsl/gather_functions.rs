//! Implements `textureGather`, which naga's IR has and its GLSL front end lacks. The rewritten text
//! calls placeholder functions that sample; this replaces their bodies by a gather.

use std::collections::HashMap;

use naga::{Expression, Function, Module, SampleLevel, Span, Statement, SwizzleComponent};
use preshade_passes::rebuild::writer::FunctionWriter;

/// Replaces the bodies of the placeholder functions. `gathers` maps their names to components.
pub(super) fn replace(module: &mut Module, gathers: &HashMap<String, u32>) {
    let handles: Vec<_> = module.functions.iter().map(|(h, _)| h).collect();
    for handle in handles {
        let span = module.functions.get_span(handle);
        let function = &mut module.functions[handle];
        let name = function.name.as_deref();
        if let Some(component) = name.and_then(|n| gathers.get(n)) {
            gather(function, *component, span);
        }
    }
}

fn gather(function: &mut Function, component: u32, span: Span) {
    let mut writer = FunctionWriter::like(function);
    writer.function.local_variables = naga::Arena::new();
    let mut argument = |i: u32| writer.append(Expression::FunctionArgument(i), span);
    let (image, sampler, coordinate) = (argument(0), argument(1), argument(2));
    let depth_ref = (function.arguments.len() > 3).then(|| argument(3));
    let component = SwizzleComponent::XYZW[component.min(3) as usize];
    writer.begin();
    let sample = Expression::ImageSample {
        image,
        sampler,
        gather: Some(component),
        coordinate,
        array_index: None,
        offset: None,
        level: SampleLevel::Zero,
        depth_ref,
        clamp_to_edge: false,
    };
    let value = Some(writer.append(sample, span));
    writer.statement(Statement::Return { value }, span);
    *function = writer.finish();
}
