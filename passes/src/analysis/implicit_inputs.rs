//! Implicit inputs of a stage, on which its result depends in addition to its declared inputs, and
//! the consequence for a pass that changes one.
//!
//! A slice of a stage computes the same values as the stage if both get the same inputs. Some
//! inputs are declared nowhere: the other invocations of its group, the number of shaded samples,
//! the compiler's rounding. A pass that changes one of them changes the picture, although every
//! statement is the author's.
//!
//! | a stage depends on | if it | a pass changes it by | so the pass |
//! |---|---|---|---|
//! | the subgroup | has a subgroup operation | rejecting fragments, slicing, moving code | refuses |
//! | the sample rate | reads an input by sample, multisampled | slicing that input away | refuses |
//! | surviving samples | reads a centroid or the sample mask, multisampled | rejecting samples | refuses |
//! | the quad | takes derivatives in a branch that not all lanes take, after a discard | letting lanes leave | refuses |
//! | contraction | decides coverage or depth | deciding by a slice | assumes `invariant-discard` |
//! | contraction | decides them by a sum with a term that other code reads too | deciding ahead by a slice | refuses |
//! | the alpha mask | has alpha to coverage | slicing | assumes `same-alpha-coverage` |
//! | the near plane's clamp | has depths that are clamped, or a float format | biasing depth | assumes `beyond-near-plane` |
//! | the viewport's depth range | has depths that are clamped to it | comparing its own depth | assumes `whole-depth-range` |
//! | the vertex stage's text | has no `@invariant` position | adding to that stage | assumes `unchanged-position` |
//!
//! Where all lanes of a quad run, passes that let single lanes leave shield derivatives themselves
//! (`rebuild::quad`, `rebuild::gradients`).

use std::collections::BTreeSet;

use naga::{Binding, BuiltIn, Interpolation, Sampling, ShaderStage, Span};

use crate::analysis::coverage::Decides;
use crate::analysis::uniformity::{self, Need};
use crate::analysis::{contraction, effects, refusals};
use naga_edit::interface::{self, Io};
use preshade_dataflow::graph::effect::Effect;
use preshade_dataflow::graph::{FunctionId, Graph};
use preshade_dataflow::slice::Slice;
use preshade_plan::contract::Assumption;
use preshade_plan::pass::Refusal;
use preshade_plan::plan::{GpuPass, Plan};
use preshade_plan::program::Program;
use preshade_plan::state::DepthDirection;
use shader_text::refusals::RefusalInfo;

/// How a pass changes the conditions under which the author's stages run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PassEffect {
    /// Depth that was drawn ahead rejects fragments, or samples of them, before the author's stage
    /// runs.
    RejectsEarly,
    /// Some lanes leave the author's stage before the others.
    LeavesEarly,
    /// Another pass decides coverage and depth, by a slice of the fragment stage.
    Slices,
    /// A pass of one sample decides coverage and depth for another view, by a slice of the fragment
    /// stage.
    SlicesForView,
    /// Another pass draws the same depth with a bias.
    Biases,
    /// The fragment stage compares its own depth with a stored one.
    ComparesDepth,
    /// Code joins or leaves the vertex stage; the text that computes the position stays.
    EditsVertexStage,
    /// Code joins or leaves the fragment stage.
    EditsFragmentStage,
    /// The vertex stage runs in other invocations than the author's.
    RunsElsewhere,
    /// Inputs of the fragment stage are removed.
    RemovesInputs,
}

/// The stages of a main pass, as a pass finds them.
#[derive(Clone, Debug)]
pub struct ImplicitInputs<'a> {
    plan: &'a Plan,
    pass: &'a GpuPass,
    program: &'a Program,
    graph: &'a Graph<'a>,
    vertex: Option<usize>,
    fragment: Option<usize>,
    decides: Decides,
    /// The inputs of the fragment stage that the pass keeps, or that its slice reads.
    kept: Option<Vec<Io>>,
    /// The slices of the fragment stage and of the vertex stage that another pass draws with.
    slices: [Option<&'a Slice>; 2],
}

impl<'a> ImplicitInputs<'a> {
    /// The stages that `pass` of `plan` draws with. `graph` is its program's.
    pub fn new(plan: &'a Plan, pass: &'a GpuPass, graph: &'a Graph<'a>) -> Self {
        let program = graph.program();
        let index = |stage, name| program.entry_point(stage, name).map(|(index, _)| index);
        let fragment = pass.fragment.as_deref();
        let fragment = fragment.and_then(|name| index(ShaderStage::Fragment, name));
        Self {
            plan,
            pass,
            program,
            graph,
            vertex: index(ShaderStage::Vertex, &pass.vertex),
            fragment,
            decides: fragment.map_or_else(Decides::default, |entry| {
                Decides::of(graph, program, entry, pass)
            }),
            kept: None,
            slices: [None; 2],
        }
    }

    /// With the slice of the fragment stage that decides coverage and depth in another pass, and
    /// the slice of the vertex stage that the pass draws with.
    #[must_use]
    pub fn sliced(self, fragment: Option<&'a Slice>, vertex: Option<&'a Slice>) -> Self {
        let inputs = self.fragment_inputs();
        let read = |slice: &Slice| {
            let read = slice.inputs.iter().filter_map(|i| inputs.get(*i).cloned());
            read.collect()
        };
        Self {
            kept: fragment.map(read),
            slices: [fragment, vertex],
            ..self
        }
    }

    /// With the program that a pass puts in place of this one.
    #[must_use]
    pub fn replaced_by(self, program: &Program) -> Self {
        let fragment = self.pass.fragment.as_deref();
        let entry = fragment.and_then(|name| program.entry_point(ShaderStage::Fragment, name));
        let kept = entry.map(|(_, entry)| interface::inputs(program.module(), &entry.function));
        Self { kept, ..self }
    }

    /// The assumptions under which `effects` leave every result as it was.
    ///
    /// # Errors
    /// A refusal for each implicit input that no assumption covers.
    pub fn examine(
        &self,
        pass: &'static str,
        effects: &[PassEffect],
    ) -> Result<Vec<Assumption>, Vec<Refusal>> {
        let (mut given, mut refusals) = (Vec::new(), Vec::new());
        for row in TABLE {
            if !row.moved_by.iter().any(|effect| effects.contains(effect)) {
                continue;
            }
            let Some(dependence) = (row.dependence)(self) else {
                continue;
            };
            match &row.then {
                Then::Assume(assumption) => given.push(assumption.clone()),
                Then::Refuse(code, consequence, remedy) => {
                    let reason = format!("{dependence}: {consequence}");
                    refusals.push(Refusal::new(pass, code, reason, *remedy));
                }
            }
        }
        match refusals.is_empty() {
            true => Ok(given),
            false => Err(refusals),
        }
    }

    fn is_multisampled(&self) -> bool {
        self.pass.multisample.count > 1
    }

    fn entry_points(&self) -> impl Iterator<Item = usize> {
        self.vertex.into_iter().chain(self.fragment)
    }

    fn fragment_inputs(&self) -> Vec<Io> {
        let module = self.program.module();
        let entry = self.fragment.map(|entry| &module.entry_points[entry]);
        entry.map_or_else(Vec::new, |e| interface::inputs(module, &e.function))
    }
}

struct InputRow {
    moved_by: &'static [PassEffect],
    /// How the stages depend on it; `None`: they do not.
    dependence: fn(&ImplicitInputs<'_>) -> Option<String>,
    then: Then,
}

/// The consequence for a pass that changes an implicit input.
enum Then {
    /// It promises the same picture only under this assumption.
    Assume(Assumption),
    /// It refuses: the code, the consequence, the remedy.
    Refuse(&'static RefusalInfo, &'static str, &'static str),
}

const TABLE: &[InputRow] = &[
    InputRow {
        moved_by: &[
            PassEffect::RejectsEarly,
            PassEffect::LeavesEarly,
            PassEffect::Slices,
            PassEffect::SlicesForView,
            PassEffect::RunsElsewhere,
            // Other code around an operation may change which lanes run it together.
            PassEffect::EditsVertexStage,
            PassEffect::EditsFragmentStage,
        ],
        dependence: subgroup,
        then: Then::Refuse(
            &refusals::SUBGROUP,
            "its result depends on which other lanes run with it, and the pass changes that",
            "compute it without the subgroup, or leave the material as it is",
        ),
    },
    InputRow {
        moved_by: &[PassEffect::Slices, PassEffect::RemovesInputs],
        dependence: sample_rate,
        then: Then::Refuse(
            &refusals::SAMPLE_RATE,
            "so it runs once for each sample, and without that input it would run once for each \
             pixel",
            "interpolate at the centre, or draw with one sample",
        ),
    },
    InputRow {
        moved_by: &[PassEffect::RejectsEarly],
        dependence: surviving_samples,
        then: Then::Refuse(
            &refusals::SURVIVING_SAMPLES,
            "with several samples a driver may take it from the samples that pass the early depth \
             test, which depth drawn ahead changes",
            "interpolate at the centre, or take `early-discard`, whose main pass keeps its own \
             depth",
        ),
    },
    InputRow {
        moved_by: &[PassEffect::LeavesEarly],
        dependence: undefined_derivative,
        then: Then::Refuse(
            &refusals::UNDEFINED_DERIVATIVE,
            "its value is undefined there, and may change with the lanes that leave early",
            "take the derivative or the sample before the branch, or give the level explicitly; \
             `depth-prepass` leaves this stage as it is",
        ),
    },
    InputRow {
        moved_by: &[
            PassEffect::LeavesEarly,
            PassEffect::Slices,
            PassEffect::SlicesForView,
        ],
        dependence: decides,
        then: Then::Assume(Assumption::InvariantDiscard),
    },
    InputRow {
        moved_by: &[
            PassEffect::RejectsEarly,
            PassEffect::LeavesEarly,
            PassEffect::SlicesForView,
        ],
        dependence: fused_discard,
        then: Then::Refuse(
            &refusals::FUSED_DISCARD,
            "a slice lacks that code, and without it a compiler may fuse the term into the sum, \
             which rounds otherwise",
            "compute what decides from values that the colours don't read, or pass it as a varying",
        ),
    },
    InputRow {
        moved_by: &[PassEffect::Slices],
        dependence: alpha_mask,
        then: Then::Assume(Assumption::SameAlphaCoverage),
    },
    InputRow {
        moved_by: &[PassEffect::Biases],
        dependence: near_plane,
        then: Then::Assume(Assumption::BeyondNearPlane),
    },
    InputRow {
        moved_by: &[PassEffect::ComparesDepth],
        dependence: depth_range,
        then: Then::Assume(Assumption::WholeDepthRange),
    },
    InputRow {
        moved_by: &[PassEffect::EditsVertexStage],
        dependence: vertex_text,
        then: Then::Assume(Assumption::UnchangedPosition),
    },
];

fn subgroup(stages: &ImplicitInputs<'_>) -> Option<String> {
    let module = stages.program.module();
    stages.entry_points().find_map(|index| {
        let entry = &module.entry_points[index];
        let inputs = interface::inputs(module, &entry.function);
        let place = inputs.iter().find(|input| {
            matches!(
                input.binding,
                Some(Binding::BuiltIn(
                    BuiltIn::SubgroupInvocationId | BuiltIn::SubgroupSize
                ))
            )
        });
        let effects = stages.graph.effects(FunctionId::EntryPoint(index));
        match place {
            _ if effects.contains(&Effect::Subgroup) => Some(format!(
                "`{}` exchanges values with its subgroup",
                entry.name
            )),
            Some(input) => Some(format!(
                "`{}` reads `{}`, its place in the subgroup",
                entry.name,
                input.name.as_deref().unwrap_or_default()
            )),
            None => None,
        }
    })
}

/// Changes to a stage that runs once for each sample: positions, varyings without explicit
/// sampling, and derivatives. A stage that reads flat values alone has the same result at either
/// rate. With one sample a pixel both rates shade the same points, but SwiftShader interpolates to
/// them by another formula.
fn sample_rate(stages: &ImplicitInputs<'_>) -> Option<String> {
    let kept = stages.kept.as_ref()?;
    let inputs = stages.fragment_inputs();
    let is_by_sample = |input: &Io| {
        matches!(
            input.binding,
            Some(
                Binding::BuiltIn(BuiltIn::SampleIndex)
                    | Binding::Location {
                        sampling: Some(Sampling::Sample),
                        ..
                    }
            )
        )
    };
    let is_flat = |input: &Io| {
        matches!(
            input.binding,
            Some(
                Binding::Location {
                    interpolation: Some(Interpolation::Flat | Interpolation::PerVertex),
                    ..
                } | Binding::BuiltIn(
                    BuiltIn::FrontFacing | BuiltIn::PrimitiveIndex | BuiltIn::ViewIndex
                )
            )
        )
    };
    let by_sample = inputs.iter().find(|input| is_by_sample(input))?;
    if kept.iter().any(is_by_sample) || kept.iter().all(is_flat) {
        return None;
    }
    let name = by_sample.name.as_deref().unwrap_or_default();
    Some(format!("the fragment stage reads `{name}` by sample"))
}

fn surviving_samples(stages: &ImplicitInputs<'_>) -> Option<String> {
    let inputs = stages.fragment_inputs();
    let input = inputs
        .iter()
        .filter(|_| stages.is_multisampled())
        .find(|input| {
            matches!(
                input.binding,
                Some(
                    Binding::BuiltIn(BuiltIn::SampleMask)
                        | Binding::Location {
                            sampling: Some(Sampling::Centroid),
                            ..
                        }
                )
            )
        })?;
    let name = input.name.as_deref().unwrap_or_default();
    Some(match input.binding {
        Some(Binding::BuiltIn(_)) => format!("the fragment stage reads the sample mask `{name}`"),
        _ => format!("the fragment stage reads `{name}` at the centroid of the covered samples"),
    })
}

/// Behind a discard, a branch or loop may run in some lanes of a quad only. On SwiftShader the
/// others keep old values there.
fn undefined_derivative(stages: &ImplicitInputs<'_>) -> Option<String> {
    let fragment = FunctionId::EntryPoint(stages.fragment?);
    if !effects::differentiates_after_discard(stages.graph, fragment) {
        return None;
    }
    let found = uniformity::non_uniform(stages.program.module())
        .into_iter()
        .find(|found| {
            matches!(found.need, Need::Derivative | Need::ImplicitLod)
                && stages.graph.reaches(fragment, found.function)
        })?;
    let at = at(stages.program, found.span);
    Some(format!(
        "the fragment stage takes a derivative, or samples at an implicit level,{at} where not all \
         lanes of a quad may be, after a discard"
    ))
}

fn decides(stages: &ImplicitInputs<'_>) -> Option<String> {
    let decides = stages.decides.anything();
    decides.then(|| "the fragment stage decides coverage or depth".to_owned())
}

fn fused_discard(stages: &ImplicitInputs<'_>) -> Option<String> {
    let [fragment, vertex] = stages.slices;
    let fragment = fragment?;
    let inputs = stages.kept.iter().flatten();
    let read: BTreeSet<u32> = inputs
        .filter_map(|input| match input.binding {
            Some(Binding::Location { location, .. }) => Some(location),
            _ => None,
        })
        .collect();
    let varyings = vertex.map(|vertex| (vertex, read, "vertex"));
    let slices = [(fragment, BTreeSet::new(), "fragment")]
        .into_iter()
        .chain(varyings);
    for (slice, locations, stage) in slices {
        match contraction::rounded_in_slice(stages.graph, slice, &locations) {
            Ok(None) => {}
            Ok(Some(span)) => {
                let at = at(stages.program, span);
                return Some(format!(
                    "coverage or depth depends on the sum{at}, and other code of the {stage} stage \
                     reads one of its terms too"
                ));
            }
            Err(why) => {
                return Some(format!(
                    "coverage or depth may depend on a sum with a term that other code reads too \
                     ({why})"
                ));
            }
        }
    }
    None
}

/// Where a span is, to follow a word; empty if that is unknown.
fn at(program: &Program, span: Span) -> String {
    let place = program.sources().locate(span);
    place.map_or_else(String::new, |place| {
        format!(" at {}:{}:{}", place.file, place.line, place.column)
    })
}

fn alpha_mask(stages: &ImplicitInputs<'_>) -> Option<String> {
    let alpha = stages.decides.alpha;
    alpha.then(|| "the alpha of location 0 becomes a coverage mask".to_owned())
}

/// The bias of a float format is relative to the depth and vanishes at 0. Unclipped depths, and
/// depths that the shader writes, are clamped after biasing (Vulkan 1.3, 28.10 and 29.5). Under
/// reversed Z a bias works, except for triangles without area: their slope divides by the area, and
/// llvmpipe clamps the result to 1 with or without a bias.
fn near_plane(stages: &ImplicitInputs<'_>) -> Option<String> {
    let depth = stages.pass.depth.as_ref()?;
    let format = stages.plan.depth_format(&depth.attachment);
    let is_reversed = depth.compare.direction() == Some(DepthDirection::Reversed);
    let clamps = is_clamped(stages) || is_reversed || format.unwrap_or_default().may_be_float();
    clamps.then(|| "a bias may push nothing away on the near plane".to_owned())
}

fn depth_range(stages: &ImplicitInputs<'_>) -> Option<String> {
    is_clamped(stages).then(|| "its depth is clamped to the viewport's depth range".to_owned())
}

fn is_clamped(stages: &ImplicitInputs<'_>) -> bool {
    stages.decides.depth || stages.pass.primitive.unclipped_depth
}

fn vertex_text(stages: &ImplicitInputs<'_>) -> Option<String> {
    let module = stages.program.module();
    let entry = &module.entry_points[stages.vertex?];
    let is_invariant = has_invariant_position(stages.program, stages.vertex?);
    (!is_invariant).then(|| format!("`{}` has no @invariant position", entry.name))
}

/// Whether the author marked the position of a vertex entry point `@invariant`.
pub(crate) fn has_invariant_position(program: &Program, vertex: usize) -> bool {
    let module = program.module();
    let outputs = interface::outputs(module, &module.entry_points[vertex].function);
    let invariant = Some(Binding::BuiltIn(BuiltIn::Position { invariant: true }));
    outputs.iter().any(|output| output.binding == invariant)
}
