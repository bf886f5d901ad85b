//! The slice that decides which samples a fragment covers and at which depth: discard,
//! `frag_depth`, and under alpha to coverage the alpha of location 0. A pre-pass draws it, an early
//! discard must not change it, and a shading count keeps it.

use naga::{Binding, BuiltIn, EarlyDepthTest, ShaderStage, TypeInner};
use naga_edit::interface;

use preshade_dataflow::graph::{FunctionId, Graph};
use preshade_dataflow::slice::{self, Criterion, OutputFilter, Slice};
use preshade_plan::plan::GpuPass;
use preshade_plan::program::Program;
use preshade_plan::state::ColorTarget;

/// The component of location 0 that alpha to coverage reads.
pub(crate) const ALPHA: u32 = 3;

/// The component of `@builtin(position)` that is a depth.
const DEPTH: u32 = 2;

/// How a fragment stage decides coverage and depth.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Decides {
    pub discards: bool,
    /// It writes a depth of its own.
    pub depth: bool,
    /// Its alpha becomes a coverage mask.
    pub alpha: bool,
    /// The depth test runs before it, so neither its discards nor its depth change the stored
    /// depth.
    pub is_forced: bool,
}

impl Decides {
    /// Examines the fragment entry point `entry` as `pass` draws it.
    pub fn of(graph: &Graph, program: &Program, entry: usize, pass: &GpuPass) -> Self {
        let early = program.module().entry_points[entry].early_depth_test;
        let function = &program.module().entry_points[entry].function;
        Self {
            discards: graph.may_discard(FunctionId::EntryPoint(entry)),
            depth: interface::outputs(program.module(), function)
                .iter()
                .any(|o| o.binding == Some(Binding::BuiltIn(BuiltIn::FragDepth))),
            alpha: pass.multisample.alpha_to_coverage,
            is_forced: early == Some(EarlyDepthTest::Force),
        }
    }

    /// Whether a depth-only pass needs a fragment stage.
    pub fn anything(self) -> bool {
        self.discards || self.depth || self.alpha
    }

    /// The slice that decides coverage and depth.
    pub fn slice(self, graph: &Graph, entry: usize) -> Slice {
        slice::backward(graph, entry, &self.criteria())
    }

    /// The targets of that slice.
    pub fn criteria(self) -> Vec<Criterion> {
        let mut criteria = vec![
            Criterion::Discard,
            Criterion::Output(OutputFilter::FragDepth),
        ];
        criteria.extend(
            self.alpha
                .then_some(Criterion::Component(OutputFilter::Location(0), ALPHA)),
        );
        criteria
    }
}

/// Whether a slice of a fragment stage reads the rasteriser's depth: the third component of
/// `@builtin(position)`. On some APIs (Vulkan, GL) it includes the depth bias, on others it does
/// not.
pub(crate) fn reads_rasterised_depth(program: &Program, slice: &Slice) -> bool {
    let module = program.module();
    let function = &module.entry_points[slice.entry].function;
    let is_position =
        |b: Option<&Binding>| matches!(b, Some(Binding::BuiltIn(BuiltIn::Position { .. })));
    let arguments = function.arguments.iter().zip(&slice.root().kept.arguments);
    arguments
        .filter_map(|(argument, need)| Some((argument, need.as_ref()?)))
        .any(|(argument, need)| match &module.types[argument.ty].inner {
            TypeInner::Struct { members, .. } if argument.binding.is_none() => (0..)
                .zip(members)
                .any(|(i, m)| is_position(m.binding.as_ref()) && need.below(&[i, DEPTH]).is_some()),
            _ => is_position(argument.binding.as_ref()) && need.of(DEPTH).is_some(),
        })
}

/// The colour targets of a coverage-only pass: none, or under alpha to coverage the main pass's
/// targets with an empty write mask.
pub(crate) fn targets(main: &GpuPass) -> Vec<Option<ColorTarget>> {
    if !main.multisample.alpha_to_coverage {
        return Vec::new();
    }
    let unwritten = |target: &ColorTarget| ColorTarget {
        blend: None,
        write_mask: 0,
        ..target.clone()
    };
    main.targets
        .iter()
        .map(|t| t.as_ref().map(unwritten))
        .collect()
}

/// Formats for alpha to coverage in WebGPU: with alpha, blendable and multisampled (WebGPU, texture
/// format capabilities).
const ALPHA_FORMATS: [&str; 6] = [
    "rgba8unorm",
    "rgba8unorm-srgb",
    "bgra8unorm",
    "bgra8unorm-srgb",
    "rgb10a2unorm",
    "rgba16float",
];

/// Why a pass's alpha to coverage cannot be reproduced in another pass: the problem and a remedy.
pub(crate) fn refuse_alpha(
    program: &Program,
    fragment: Option<usize>,
    pass: &GpuPass,
) -> Option<(String, &'static str)> {
    if !pass.multisample.alpha_to_coverage {
        return None;
    }
    if pass.multisample.count <= 1 {
        return Some((
            "alpha to coverage needs more than one sample a pixel, and this pass has one"
                .to_owned(),
            "leave alpha_to_coverage off, or draw the scene with 4 samples",
        ));
    }
    match pass.targets.first() {
        Some(Some(target)) if target.attachment.is_some() => {
            return Some((
                "colour target 0 is an attachment of the plan, which a pre-pass cannot bind as the \
                 scene's colour".to_owned(),
                "draw to the scene's colour, or test alpha by discard",
            ));
        }
        Some(Some(target)) if !ALPHA_FORMATS.contains(&target.format.as_str()) => {
            return Some((
                format!(
                    "colour target 0 is {}, which has no alpha or does not blend: coverage has \
                     nothing to come from",
                    target.format
                ),
                "give target 0 a blendable format with alpha, rgba8unorm say, or test alpha by \
                 discard",
            ));
        }
        Some(Some(_)) => {}
        _ => {
            return Some((
                "there is no colour target 0 for coverage to take its alpha from".to_owned(),
                "bind a colour target 0 with alpha, or test alpha by discard",
            ));
        }
    }
    let module = program.module();
    let function = &module.entry_points[fragment?].function;
    let is_vec4 = interface::outputs(module, function).iter().any(|o| {
        matches!(o.binding, Some(Binding::Location { location: 0, .. }))
            && matches!(
                module.types[o.ty].inner,
                TypeInner::Vector { size: naga::VectorSize::Quad, scalar } if scalar.kind == naga::ScalarKind::Float
            )
    });
    (!is_vec4).then(|| {
        (
            "the fragment stage writes no vec4<f32> to location 0, whose alpha coverage comes from"
                .to_owned(),
            "return a vec4<f32> at location 0",
        )
    })
}

/// The fragment entry point of a pass, and how it decides coverage.
pub fn of_pass(graph: &Graph, program: &Program, pass: &GpuPass) -> Option<(usize, Decides)> {
    let name = pass.fragment.as_deref()?;
    let (entry, _) = program.entry_point(ShaderStage::Fragment, name)?;
    Some((entry, Decides::of(graph, program, entry, pass)))
}
