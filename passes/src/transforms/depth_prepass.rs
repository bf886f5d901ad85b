//! `depth-prepass`: draws the depth of every opaque surface first, then shades only the nearest
//! one.
//!
//! Goal: run the fragment stage once for each covered pixel, however much lies behind it (Primozic,
//! "Implementing Depth Pre-Pass Optimization for Three.JS", 2022; engines call it Z pre-pass or
//! early-Z pass).
//!
//! ```text
//! before:  main     vs + fs          depth less, write
//!
//! biased:  prepass  vs_depth         depth less, write, pushed away by a bias      (+ fs_depth where fs discards or writes depth)
//!          main     vs + fs          depth less, write: as the author wrote it
//!
//! equal:   prepass  vs               depth less, write                             (+ fs_depth)
//!          main     vs + fs          depth equal, no write
//! ```
//!
//! `form=biased` (the default) leaves the author's main pass unchanged, to the byte. Hidden
//! fragments fail against a depth slightly behind the nearest surface, so this form needs neither
//! invariance nor the absence of ties. `form=equal` shades exactly once. Its contract holds only
//! while both passes compute the same position bits and no two surfaces tie.
//!
//! Under alpha to coverage the pre-pass also keeps the alpha of location 0. It binds the main
//! pass's colour targets with a write mask of 0, so the same alpha covers the same samples in both
//! passes. `same-alpha-coverage` is the assumption that EQUAL then meets the depth of the pre-pass;
//! the self-test checks it.
//!
//! Both forms have a self-test ([`self_test::biased`], [`self_test::equal`]). If `form=equal`
//! leaves discarding to EQUAL, only half of the test remains: it finds samples of the main pass
//! behind the pre-pass, not those in front.
//!
//! On Vulkan, a depth bias is part of the `position.z` that a fragment stage reads (Vulkan 1.3,
//! 28.9 "Depth Bias"; Direct3D leaves it out). So `form=biased` refuses a material that discards by
//! it. If the material writes depth, the pre-pass adds the bias in the shader and leaves the
//! rasteriser's bias as the author set it.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::analysis::implicit_inputs::PassEffect;
use crate::analysis::opaque::{self, Opaque};
use crate::analysis::{effects, refusals as shared};
use crate::rebuild::depth_only::{self, DepthOnly, Invariance, VertexStage};
use crate::rebuild::depth_pass::{self, PrepassProgram};
use crate::rebuild::place::{self, PositionInvariance};
use preshade_dataflow::graph::FunctionId;
use preshade_plan::contract::{Assumption, Contract};
use preshade_plan::pass::{Example, Facts, Outcome, Pass, PassInfo, Refusal, Refused, Use};
use preshade_plan::plan::{Plan, Role, Step};
use preshade_plan::self_test::{self, MainDiscards};
use preshade_plan::state::{CompareFunction, DepthBias, DepthDirection, DepthFormat, DepthState};
use shader_text::refusals::RefusalInfo;

mod near_plane;
pub mod refusals;

pub struct DepthPrepass;

/// How the main pass finds the nearest fragment.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum PrepassForm {
    /// The pre-pass is pushed away from the viewer; the main pass keeps the author's state.
    #[default]
    Biased,
    /// The main pass compares EQUAL and writes no depth.
    Equal,
}

/// Parameters.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
pub struct DepthPrepassParams {
    /// How the main pass finds the nearest fragment.
    pub form: PrepassForm,
    /// Vertex stage of the pre-pass. Default: `sliced` for `biased`, `same` for `equal`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub vertex: Option<VertexStage>,
    /// `form=equal`: whether to add `@invariant`. Default: `as-written` with `vertex=same`, `add`
    /// with `vertex=sliced`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub invariant: Option<Invariance>,
    /// `form=biased`: constant bias in steps of the depth format, at least 1. The default depends
    /// on the format.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 1, max = MOST_BIAS))]
    pub bias_constant: Option<u32>,
    /// `form=biased`: slope-scaled bias, at least 0; default 2.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 0.0))]
    pub bias_slope: Option<f32>,
}

/// Constant bias that covers the difference between two pipelines' positions. 64 steps of a 24-bit
/// mantissa are the measured default of the hand-written reference; one 16-bit step is already 256
/// of those.
fn default_bias(format: DepthFormat) -> u32 {
    match format {
        DepthFormat::Depth16unorm => 2,
        _ => 64,
    }
}

/// Slope-scaled bias. Two subpixel steps of 1/256 would suffice; 2 covers two pixels of slope, for
/// MSAA and coarse snapping.
const DEFAULT_SLOPE: f32 = 2.0;

/// Largest useful constant bias: the whole range of a 24-bit depth.
const MOST_BIAS: u32 = 1 << 24;

impl DepthPrepassParams {
    fn vertex(&self) -> VertexStage {
        self.vertex.unwrap_or(match self.form {
            PrepassForm::Biased => VertexStage::Sliced,
            PrepassForm::Equal => VertexStage::Same,
        })
    }

    fn invariant(&self) -> Invariance {
        self.invariant
            .unwrap_or_else(|| Invariance::default_for(self.vertex()))
    }

    /// The pipeline's bias: the author's plus ours, pointing away from the viewer.
    fn bias(&self, author: DepthBias, format: DepthFormat, direction: DepthDirection) -> DepthBias {
        let away = direction.away();
        let constant = self
            .bias_constant
            .unwrap_or_else(|| default_bias(format))
            .min(MOST_BIAS) as i32;
        DepthBias {
            constant: author.constant.saturating_add(constant * away as i32),
            slope_scale: author.slope_scale + self.bias_slope.unwrap_or(DEFAULT_SLOPE) * away,
            // `check` refuses an author's clamp: it would also clamp the sum and leave no margin.
            clamp: 0.0,
        }
    }
}

impl Pass for DepthPrepass {
    type Params = DepthPrepassParams;

    const INFO: PassInfo = PassInfo {
        name: "depth-prepass",
        summary: "draws the depth of opaque surfaces first, so that each pixel is shaded once",
        source: "Primozic, Implementing Depth Pre-Pass Optimization for Three.JS (2022)",
        when: "many fragments are hidden and expensive, in any order of draws; \
               it is the first to try, since its default leaves the author's main pass as it is",
        hurts: "where little is hidden: every vertex is transformed twice (3-5% lost in two \
                articles' open views)",
        reads_scene: false,
    };

    const REFUSALS: &'static [RefusalInfo] = refusals::REFUSALS;

    const EXAMPLES: &'static [Example] = &[
        Example {
            recipe: "depth-prepass",
            uses: &[
                Use::Snapshot,
                Use::Inject,
                Use::Break,
                Use::Pictures(4),
                Use::Fuzz,
                Use::Plan,
                Use::Cover,
                Use::Verify,
                Use::Growth,
                Use::Exact,
                Use::Page("pages/leaf"),
                Use::Picture {
                    scene: "fixtures/scenes/shrine.toml --camera wall --size 256x144 --frames 1 \
                            --order front-to-back",
                    caption: "a wall that hides a shrine: no pixel differs, and each is shaded \
                              once instead of 3.2 times",
                    rows: 2,
                },
            ],
        },
        Example {
            recipe: "depth-prepass:form=equal",
            uses: &[
                Use::Snapshot,
                Use::ExactWithoutTies,
                Use::Pictures(4),
                Use::Plan,
                Use::Cover,
                Use::Verify,
            ],
        },
        Example {
            recipe: "depth-prepass:form=equal,vertex=sliced",
            uses: &[
                Use::Snapshot,
                Use::ExactWithoutTies,
                Use::Inject,
                Use::Break,
                Use::Fuzz,
            ],
        },
    ];

    fn run(plan: &Plan, facts: &Facts, params: &DepthPrepassParams) -> Result<Outcome, Refused> {
        let opaque = check(plan, facts, params)?;
        let slice = depth_only::slice(&opaque, params.vertex(), &[]);
        let mut effects = vec![PassEffect::RejectsEarly, PassEffect::Slices];
        effects.extend((params.form == PrepassForm::Biased).then_some(PassEffect::Biases));
        let given = slice.assumptions(&opaque, plan, Self::INFO.name, &effects)?;
        if given.contains(&Assumption::BeyondNearPlane)
            && let Some(refusal) = on_near_plane(&opaque, facts)
        {
            return Err(vec![refusal].into());
        }
        let next = match params.form {
            PrepassForm::Biased => biased(plan, &opaque, &slice, params, given),
            PrepassForm::Equal => equal(plan, &opaque, &slice, (params, facts), given),
        }?;
        Ok(slice.outcome(&opaque, what(params, &opaque), next))
    }
}

fn check<'a>(
    plan: &'a Plan,
    facts: &Facts,
    params: &DepthPrepassParams,
) -> Result<Opaque<'a>, Vec<Refusal>> {
    let name = DepthPrepass::INFO.name;
    let opaque = Opaque::examine(plan, name)?;
    let mut refusals = Vec::new();
    match params.form {
        PrepassForm::Biased => {
            if !opaque.pass.primitive.topology.is_triangles() {
                refusals.push(Refusal::new(
                    name,
                    &refusals::BIAS_NEEDS_TRIANGLES,
                    "depth bias applies to triangles only; these are lines or points",
                    "take form=equal",
                ));
            }
            refusals.extend(reads_biased_depth(&opaque));
            if opaque.depth.bias.clamp != 0.0 {
                refusals.push(Refusal::new(
                    name,
                    &refusals::DEPTH_BIAS_CLAMP,
                    "the material clamps a depth bias of its own: both passes would be clamped to \
                     one bias, and no margin be left between them",
                    "take form=equal, or leave the clamp out",
                ));
            }
            if params.bias_constant.is_some_and(|c| c > MOST_BIAS) {
                refusals.push(Refusal::new(
                    name,
                    &refusals::BIAS_CONSTANT,
                    format!(
                        "a bias of more than {MOST_BIAS} steps is more than the whole depth range"
                    ),
                    "leave it out for the default",
                ));
            }
            if params.bias_constant == Some(0) {
                refusals.push(Refusal::new(
                    name,
                    &refusals::NO_BIAS,
                    "a bias of 0 makes the pre-pass hide what it was drawn for",
                    "give bias-constant=1 or more",
                ));
            }
            if params
                .bias_slope
                .is_some_and(|s| !(s >= 0.0 && s.is_finite()))
            {
                refusals.push(Refusal::new(
                    name,
                    &refusals::BIAS_SLOPE,
                    "the slope bias is not a finite number of at least 0",
                    "leave it out for 2",
                ));
            }
        }
        PrepassForm::Equal => {
            if opaque.decides.depth {
                // Measured on an NVIDIA H200: 5 of 2,073,600 pixels lost, with equal depths, in a
                // material whose depth both passes compute.
                refusals.push(Refusal::new(
                    name,
                    &refusals::DEPTH_NOT_INVARIANT,
                    "the fragment stage writes depth, and no language can mark that invariant: two \
                     pipelines may round it differently, and EQUAL would drop the pixel",
                    "take form=biased",
                ));
            }
            // Under LessEqual the last of several tied fragments wins, as under EQUAL.
            if opaque.depth.compare == opaque.strict() {
                refusals.extend(opaque::refuse_ties(
                    name,
                    facts,
                    "take form=biased, which keeps the author's comparison",
                ));
            }
        }
    }
    if refusals.is_empty() {
        Ok(opaque)
    } else {
        Err(refusals)
    }
}

/// On Vulkan a depth bias is part of `position.z`, so the pre-pass would decide by another depth
/// than the main pass. If the stage writes depth, the rasteriser has no bias and there is no
/// conflict.
fn reads_biased_depth(opaque: &Opaque) -> Option<Refusal> {
    (!opaque.decides.depth && opaque.reads_rasterised_depth()).then(|| {
        Refusal::new(
            DepthPrepass::INFO.name,
            &shared::BIASED_POSITION,
            "what decides whether a fragment is kept reads the z of \
             @builtin(position), of which a depth bias is part on some APIs: the pre-pass would \
             keep others",
            "take form=equal, or early-discard, where both passes have one bias; \
             or pass the depth along as a varying of its own",
        )
    })
}

/// A surface on the near plane, measured or by construction.
fn on_near_plane(opaque: &Opaque, facts: &Facts) -> Option<Refusal> {
    let refuse = |reason: String| {
        Refusal::new(
            DepthPrepass::INFO.name,
            &refusals::NEAR_PLANE,
            format!(
                "{reason}, where a bias pushes nothing away (float depth formats, surfaces that \
                 are clamped, triangles of no area) and the pre-pass would hide what it was drawn \
                 for"
            ),
            "draw it without depth, in its own phase, or clipped and with a unorm depth format; \
             or take form=equal",
        )
    };
    let module = opaque.program.module();
    let vertex = &module.entry_points[opaque.vertex].function;
    let by_construction = match opaque.direction {
        DepthDirection::Forward => near_plane::literal_zero_depth(module, vertex),
        DepthDirection::Reversed => None,
    };
    if let Some(span) = by_construction {
        let refusal =
            refuse("the vertex stage puts every position on the near plane (z is 0)".to_owned());
        return Some(refusal.at(opaque.program.sources(), span));
    }
    let n = facts.near_plane_pixels.filter(|n| *n > 0)?;
    Some(refuse(format!(
        "the frame was measured to lie on the near plane in places (pixels: {n})"
    )))
}

fn what(params: &DepthPrepassParams, opaque: &Opaque) -> String {
    let vertex = match params.vertex() {
        VertexStage::Same => "the same vertex stage",
        VertexStage::Sliced => "the vertex stage sliced to position",
    };
    let decides = opaque.decides;
    let decided: Vec<&str> = [
        (decides.alpha, "alpha to coverage"),
        (decides.discards, "discard"),
        (decides.depth, "frag_depth"),
    ]
    .into_iter()
    .filter_map(|(does, what)| does.then_some(what))
    .collect();
    let fragment = match decided[..] {
        [] => "no fragment stage".to_owned(),
        _ => format!("the slice that decides {}", decided.join(" and ")),
    };
    let main = match params.form {
        PrepassForm::Biased => "main pass as written",
        PrepassForm::Equal => "main pass EQUAL without depth write",
    };
    let late = match opaque.decides.depth {
        true => {
            "; the material writes depth, so hidden fragments still run before they are tested: \
             take early-discard"
        }
        false => "",
    };
    format!("pre-pass with {vertex} and {fragment}; {main}{late}")
}

fn biased(
    plan: &Plan,
    opaque: &Opaque,
    slice: &DepthOnly,
    params: &DepthPrepassParams,
    mut given: Vec<Assumption>,
) -> Result<Plan, Box<Refusal>> {
    let format = plan
        .depth_format(&opaque.depth.attachment)
        .unwrap_or_default();
    let bias = params.bias(opaque.depth.bias, format, opaque.direction);
    // The rasteriser's bias does not affect a depth that the shader writes, but affects a depth
    // that it reads.
    let bias = match opaque.decides.depth {
        true => opaque.depth.bias,
        false => bias,
    };
    let constant = params.bias_constant.unwrap_or_else(|| default_bias(format));
    let shader_bias = constant as f32 * format.step() * opaque.direction.away();
    let placed = slice.place(
        opaque,
        "depth",
        PositionInvariance::AsWritten,
        Some(shader_bias),
    );
    let mut next = plan.clone();
    let depth = DepthState {
        bias,
        ..opaque.depth.clone()
    };
    // The author's program stays unchanged, so the pre-pass has its own, even with the same vertex
    // stage.
    PrepassProgram::Own.insert(&mut next, opaque, placed, depth, DepthPrepass::INFO.name)?;
    given.extend(depth_pass::WITH_MARGIN);
    next.steps.push(step(slice, opaque, params, given));
    next.self_test = self_test::with_earlier(self_test::biased(&next), next.self_test.take());
    depth_pass::finish(&mut next, "original");
    Ok(next)
}

fn equal(
    plan: &Plan,
    opaque: &Opaque,
    slice: &DepthOnly,
    (params, facts): (&DepthPrepassParams, &Facts),
    mut given: Vec<Assumption>,
) -> Result<Plan, Box<Refusal>> {
    let name = DepthPrepass::INFO.name;
    let mut next = plan.clone();
    let invariant = params.invariant();
    let placed = slice.place(opaque, "depth", invariant.position(), None);
    let program = match params.vertex() {
        VertexStage::Same => PrepassProgram::Main,
        VertexStage::Sliced => PrepassProgram::Own,
    };
    let mut main = program.main_module(opaque, &placed, invariant);
    let dropped = opaque.fragment.filter(|fragment| {
        let fragment = FunctionId::EntryPoint(*fragment);
        opaque.decides.discards
            && facts.undiscarded_depth_ties == Some(0)
            && !effects::differentiates_after_discard(&opaque.graph, fragment)
    });
    if let Some(fragment) = dropped {
        main = place::without_discard(&main, fragment);
        next.notes.push(
            "no depth ties were measured, discarded fragments counted in: the main pass no longer \
             discards, EQUAL already drops what the pre-pass discarded"
                .to_owned(),
        );
    }
    depth_pass::replace_main(&mut next, opaque, main, name)?;
    for pass in next.passes.iter_mut().filter(|p| p.role == Role::Main) {
        if let Some(depth) = &mut pass.depth {
            depth.compare = CompareFunction::Equal;
            depth.write = false;
        }
    }
    program.insert(&mut next, opaque, placed, opaque.depth.clone(), name)?;
    given.extend(invariant.assumptions(opaque));
    given.extend([
        Assumption::SameDrawOrder,
        Assumption::SameViewport,
        Assumption::OrdinaryNeighbours,
    ]);
    given.extend(
        (opaque.depth.compare == opaque.strict() || dropped.is_some())
            .then_some(Assumption::NoDepthTies),
    );
    next.steps.push(step(slice, opaque, params, given));
    let discards = match dropped {
        Some(_) => MainDiscards::NoMore,
        None => MainDiscards::AsPrepass,
    };
    // Without its discard the main pass has fragments that the original lacks.
    let earlier = match discards {
        MainDiscards::AsPrepass => next.self_test.take(),
        MainDiscards::NoMore => None,
    };
    let test = self_test::equal(&next, opaque.depth.compare, discards);
    next.self_test = self_test::with_earlier(test, earlier);
    depth_pass::finish(&mut next, "depth-prepass:form=biased");
    Ok(next)
}

fn step(
    slice: &DepthOnly,
    opaque: &Opaque,
    params: &DepthPrepassParams,
    mut given: Vec<Assumption>,
) -> Step {
    given.sort();
    let contract = Contract::Exact { given };
    slice.step(opaque, DepthPrepass::INFO.name, params, contract)
}
