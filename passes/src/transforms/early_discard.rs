//! `early-discard`: compares with the nearest depth before any other work, and discards fragments
//! behind it.
//!
//! Goal: an early depth test in the shader where the hardware's cannot run: in a material that
//! writes depth, or on an API without control over it (Primozic, "Speeding Up Three.JS with
//! Depth-Based Fragment Culling", 2022).
//!
//! ```text
//! before:  main     fs(..) { work }                                        depth less, write
//!
//! after:   prepass  vs_depth (+ fs_depth)                                  writes the attachment `prepass-depth`
//!          main     fs(..) { if hidden(position) { discard; } work }       depth less, write, and `prepass-depth` bound as a texture
//! ```
//!
//! `quad=vote` (the default) discards only if all four lanes of the 2x2 quad are behind. Every
//! derivative and implicit level of detail of a surviving pixel stays the same. `quad=lane`
//! discards each lane by itself and evaluates gradients first. That is not exact: a level of detail
//! from gradients may round differently from the implicit one, mostly under anisotropic filtering.
//! The difference depends on adapter and texture, so you must give a budget (`budget=0.02`), and
//! `verify` measures it.
//!
//! A fragment is dropped only if it is behind by more than two pipelines may differ. The tolerance
//! follows from depth format, depth and slope ([`EarlyDiscardParams::tolerance`]). The article's fixed 0.0001
//! is wrong near the far plane and under reversed Z, but it is an option.
//!
//! `texture=packed` adds a colour attachment, [`PREPASS_PACKED`], and binds it; the pre-pass then
//! always has a fragment stage.
//!
//! A depth that the shader writes is clamped to 0..1 before the comparison, under the assumption
//! `whole-depth-range`.
//!
//! A vote needs fine derivatives, which GLSL ES 3.00 lacks. With coarse ones three lanes could
//! discard although the fourth continues, and spoil its derivatives. A visible lane itself is never
//! discarded. For that target `plan.json` therefore has no contract
//! ([`crate::rebuild::quad::vote_shields_derivatives`]), unless the fragment stage takes no
//! derivative and no implicit sample.
//!
//! `attachment=readonly` has a self-test ([`self_test::read_only`]). `attachment=own` has none: its
//! prologue tolerates different positions, so only the original's picture shows whether a fragment
//! was dropped wrongly. `verify` draws it.

use naga::ResourceBinding;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::analysis::implicit_inputs::PassEffect;
use crate::analysis::opaque::{self, Opaque};
use crate::analysis::refusals as shared;
use crate::rebuild::depth_only::{self, DepthOnly, Invariance, VertexStage};
use crate::rebuild::depth_pass::{self, PrepassProgram};
use naga_edit::declared::CombinedSampler;
use preshade_dataflow::slice::{self, Criterion, OutputFilter};
use preshade_plan::budget::Budget;
use preshade_plan::contract::{Assumption, Contract};
use preshade_plan::pass::{
    Example, Expected, Facts, Outcome, Pass, PassInfo, Refusal, Refused, Use,
};
use preshade_plan::plan::{Attachment, BindingKind, BindingSource, BindingUse, Plan, Role};
use preshade_plan::program::Program;
use preshade_plan::self_test;
use preshade_plan::state::{CompareFunction, DepthDirection, DepthFormat, DepthState};
use shader_text::refusals::RefusalInfo;

mod gradients;
mod packed;
mod prologue;
mod quad;
pub mod refusals;
pub use packed::PREPASS_PACKED;
pub use packed::stored as packed_depth;
use prologue::{DepthRange, Prologue};

/// Name of the depth attachment that the prologue reads if the main pass has its own.
pub(crate) const PREPASS_DEPTH: &str = "prepass-depth";

pub struct EarlyDiscard;

/// The depth attachment of the main pass.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum MainAttachment {
    /// Its own, with the author's state, as in the article.
    #[default]
    Own,
    /// The compared depth itself, bound read-only; the hardware test rejects fragments too.
    Readonly,
}

/// Declaration of the depth texture.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum DepthTexture {
    /// `texture_depth_2d`.
    #[default]
    Depth,
    /// `texture_2d<f32>` with an unfilterable sample type, which the GLSL writer supports.
    Float,
    /// `texture_2d<f32>` over an `rgba8unorm` colour attachment with the depth packed as in
    /// three.js of 2022, for hosts that cannot bind a depth texture.
    Packed,
}

/// Which lanes discard early.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Quad {
    /// All four of a quad, if all four are behind.
    #[default]
    Vote,
    /// Each lane by itself.
    Lane,
}

/// Which fragments to drop.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Mode {
    /// Drops hidden fragments.
    #[default]
    Cull,
    /// Drops visible fragments: a diagnostic picture of the saved work, as in the article.
    Invert,
}

/// Parameters.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
pub struct EarlyDiscardParams {
    /// Depth attachment of the main pass.
    pub attachment: MainAttachment,
    /// Type of the depth texture.
    pub texture: DepthTexture,
    /// Which lanes discard early.
    pub quad: Quad,
    /// `quad=lane` with gradients evaluated first: largest allowed difference of a channel
    /// (`max_abs`), 0 to 1. Otherwise unused, because nothing differs.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 0.0, max = 1.0))]
    pub budget: Option<f64>,
    /// Whether to drop hidden fragments or visible ones.
    pub mode: Mode,
    /// A fixed tolerance in units of depth, at least 0, instead of the derived one.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 0.0))]
    pub tolerance: Option<f32>,
    /// `@group` of the depth texture. Default: the highest group that the shader uses.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub group: Option<u32>,
    /// `@binding` of the depth texture. Default: the first free one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub binding: Option<u32>,
    /// `attachment=readonly`: whether to add `@invariant`. Default: `as-written` with
    /// `vertex=same`, `add` with `vertex=sliced`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub invariant: Option<Invariance>,
    /// Vertex stage of the depth pass. Default: `sliced`, or `same` with `attachment=readonly`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub vertex: Option<VertexStage>,
}

impl EarlyDiscardParams {
    fn vertex(&self) -> VertexStage {
        self.vertex.unwrap_or(match self.attachment {
            MainAttachment::Own => VertexStage::Sliced,
            MainAttachment::Readonly => VertexStage::Same,
        })
    }

    fn invariant(&self) -> Invariance {
        self.invariant
            .unwrap_or_else(|| Invariance::default_for(self.vertex()))
    }

    fn program(&self) -> PrepassProgram {
        match (self.attachment, self.vertex()) {
            (MainAttachment::Readonly, VertexStage::Same) => PrepassProgram::Main,
            _ => PrepassProgram::Own,
        }
    }
}

impl Pass for EarlyDiscard {
    type Params = EarlyDiscardParams;

    const INFO: PassInfo = PassInfo {
        name: "early-discard",
        summary: "compares with the nearest depth ahead of all work and leaves when behind it",
        source: "Primozic, Speeding Up Three.JS with Depth-Based Fragment Culling (2022)",
        when: "the hardware's early test cannot run (a material that writes depth), or a host \
               cannot set the depth test of its main pass; else take depth-prepass",
        hurts: "where little is hidden (3-5% lost in the article's open views), and where the \
                hardware's early test rejects anyway: a texture read and a vote for each fragment, \
                for nothing",
        reads_scene: true,
    };

    const REFUSALS: &'static [RefusalInfo] = refusals::REFUSALS;

    const EXAMPLES: &'static [Example] = &[
        Example {
            recipe: "early-discard",
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
                    scene: "fixtures/scenes/late-depth.toml --size 256x144 --frames 1 --order \
                            front-to-back",
                    caption: "five layers that write depth, which hardware cannot test early: each \
                              pixel is shaded once instead of five times",
                    rows: 2,
                },
            ],
        },
        Example {
            recipe: "early-discard:texture=float",
            uses: &[Use::Snapshot],
        },
        Example {
            recipe: "early-discard:texture=float,attachment=readonly",
            uses: &[Use::Snapshot],
        },
        Example {
            recipe: "early-discard:attachment=readonly",
            uses: &[Use::ExactWithoutTies],
        },
        Example {
            recipe: "early-discard:texture=packed",
            uses: &[Use::Snapshot],
        },
        Example {
            recipe: "early-discard:quad=lane,budget=0.02",
            uses: &[Use::Snapshot],
        },
        Example {
            recipe: "early-discard:quad=lane,mode=invert",
            uses: &[Use::Snapshot],
        },
        Example {
            recipe: "early-discard:quad=lane,budget=1",
            uses: &[Use::Fuzz],
        },
    ];

    fn expected(params: &EarlyDiscardParams) -> Expected {
        Expected {
            approximates_levels: true,
            is_diagnostic: params.mode == Mode::Invert,
            ..Expected::default()
        }
    }

    fn run(plan: &Plan, facts: &Facts, params: &EarlyDiscardParams) -> Result<Outcome, Refused> {
        let opaque = check(plan, facts, params)?;
        let slice = depth_only::slice(&opaque, params.vertex(), &[]);
        let mut effects = vec![
            PassEffect::LeavesEarly,
            PassEffect::Slices,
            PassEffect::ComparesDepth,
        ];
        if params.attachment == MainAttachment::Readonly {
            effects.push(PassEffect::RejectsEarly);
        }
        let given = slice.assumptions(&opaque, plan, Self::INFO.name, &effects)?;
        let next = transform(plan, &opaque, &slice, params, given)?;
        Ok(slice.outcome(&opaque, what(params, &opaque), next))
    }
}

fn check<'a>(
    plan: &'a Plan,
    facts: &Facts,
    params: &EarlyDiscardParams,
) -> Result<Opaque<'a>, Vec<Refusal>> {
    let name = EarlyDiscard::INFO.name;
    let opaque = Opaque::examine(plan, name)?;
    let mut refusals = Vec::new();
    let refuse =
        |code: &RefusalInfo, reason: &str, remedy: &str| Refusal::new(name, code, reason, remedy);
    if opaque.fragment.is_none() {
        refusals.push(refuse(
            &shared::NO_FRAGMENT_STAGE,
            "the material has no fragment stage to leave early",
            "nothing to do",
        ));
    }
    if params
        .tolerance
        .is_some_and(|t| !(t >= 0.0 && t.is_finite()))
    {
        refusals.push(refuse(
            &refusals::TOLERANCE,
            "the tolerance is not a finite number of at least 0",
            "leave it out to have it derived",
        ));
    }
    if params.budget.is_some_and(|b| !(0.0..=1.0).contains(&b)) {
        refusals.push(refuse(
            &preshade_plan::refusals::BUDGET,
            "the budget is the largest difference of a channel, which lies between 0 and 1",
            "give budget=0.02, say",
        ));
    }
    if is_clamped(&opaque) && facts.narrow_depths.contains(&plan.material) {
        refusals.push(refuse(
            &shared::DEPTH_RANGE,
            "a draw sets a depth range other than 0 to 1, to which its depth is clamped, and the \
             prologue clamps it to 0 to 1",
            "take depth-prepass, where the hardware clamps",
        ));
    }
    if !opaque.pass.primitive.topology.is_triangles() && params.quad == Quad::Vote {
        refusals.push(refuse(
            &shared::VOTE_NEEDS_TRIANGLES,
            "lines and points have no 2x2 quads to vote in",
            "take quad=lane",
        ));
    }
    if params.quad == Quad::Lane
        && let Some(fragment) = opaque.fragment
    {
        refusals.extend(quad::refuse_lane(&opaque, fragment, params));
    }
    if is_biased(&opaque, params) {
        refusals.push(refuse(
            &refusals::DEPTH_BIAS,
            "the material has a depth bias of its own, which a fragment stage does not see on \
             every API: it could take itself for hidden",
            "take depth-prepass, where the hardware compares biased depths with biased depths",
        ));
    }
    let is_read_only = params.attachment == MainAttachment::Readonly;
    if is_read_only && opaque.decides.depth {
        refusals.push(refuse(
            &refusals::READONLY_DEPTH_WRITER,
            "the material writes depth, which a read-only attachment cannot take",
            "take attachment=own",
        ));
    }
    refusals.extend(endless_depth(&opaque));
    if is_read_only && params.mode == Mode::Invert {
        refusals.push(refuse(
            &refusals::READONLY_INVERT,
            "under a read-only attachment the hardware rejects what mode=invert would show",
            "take attachment=own",
        ));
    }
    if params.texture == DepthTexture::Packed && is_read_only {
        refusals.push(refuse(
            &refusals::PACKED_READONLY,
            "a packed depth is a colour, which cannot be attached as depth",
            "take attachment=own, or texture=float",
        ));
    }
    if params.texture == DepthTexture::Packed && opaque.pass.multisample.count > 1 {
        refusals.push(refuse(
            &refusals::PACKED_MSAA,
            "under multisampling the fragment stage packs one depth for all samples of a \
             pixel, which is not that of each",
            "take texture=depth or texture=float, which hold every sample's depth",
        ));
    }
    if is_read_only && opaque.depth.compare == opaque.strict() {
        refusals.extend(opaque::refuse_ties(
            name,
            facts,
            "take attachment=own, which keeps the author's comparison",
        ));
    }
    if refusals.is_empty() {
        Ok(opaque)
    } else {
        Err(refusals)
    }
}

/// Whether the author's depth bias could make a fragment behind its own depth.
fn is_biased(opaque: &Opaque, params: &EarlyDiscardParams) -> bool {
    let bias = opaque.depth.bias;
    let biases = [bias.constant as f32, bias.slope_scale];
    let away = opaque.direction.away();
    biases.iter().any(|bias| bias * away < 0.0)
        || (params.texture == DepthTexture::Packed && biases != [0.0; 2])
}

/// A written depth behind a loop that may not end. The prologue would run it a second time, without
/// the discards that may end it.
fn endless_depth(opaque: &Opaque) -> Option<Refusal> {
    let fragment = opaque.fragment.filter(|_| opaque.decides.depth)?;
    let decided = [Criterion::Output(OutputFilter::FragDepth)];
    let slice = slice::backward(&opaque.graph, fragment, &decided);
    let span = slice.endless_loop(&opaque.graph)?;
    let refusal = Refusal::new(
        EarlyDiscard::INFO.name,
        &refusals::DEPTH_LOOP,
        "the depth that the material writes depends on a loop that may not end, which the prologue \
         would run a second time, without the discards that leave it",
        "count its turns by constants (for i < 32), or take depth-prepass",
    );
    Some(refusal.at(opaque.program.sources(), span))
}

fn what(params: &EarlyDiscardParams, opaque: &Opaque) -> String {
    let lanes = match params.quad {
        Quad::Vote => "when all four lanes of a quad are behind",
        Quad::Lane => "lane by lane",
    };
    let hardware = match (params.attachment, opaque.decides.depth) {
        (MainAttachment::Readonly, _) => {
            "; the depth is attached read-only too, so the hardware test already rejects and the \
             prologue only adds its cost"
        }
        (MainAttachment::Own, true) => {
            "; the material writes depth, so the hardware cannot test early and this is where it \
             pays most"
        }
        (MainAttachment::Own, false) => "",
    };
    format!("discard ahead of all work {lanes}{hardware}")
}

fn transform(
    plan: &Plan,
    opaque: &Opaque,
    slice: &DepthOnly,
    params: &EarlyDiscardParams,
    mut given: Vec<Assumption>,
) -> Result<Plan, Box<Refusal>> {
    let name = EarlyDiscard::INFO.name;
    let Some(fragment) = opaque.fragment else {
        return Err(Box::new(Refusal::new(
            name,
            &shared::NO_FRAGMENT_STAGE,
            "the material has no fragment stage",
            "nothing to do",
        )));
    };
    let binding = free_binding(opaque.program, params, name)?;
    // The attachment that the pre-pass writes. The positions of both passes must be equal only if
    // the hardware tests too.
    let (produced, invariant) = match params.attachment {
        MainAttachment::Own => (PREPASS_DEPTH.to_owned(), Invariance::AsWritten),
        MainAttachment::Readonly => (opaque.depth.attachment.clone(), params.invariant()),
    };
    let mut placed = slice.place(opaque, "depth", invariant.position(), None);
    if params.texture == DepthTexture::Packed {
        let entry = &opaque.program.module().entry_points[fragment];
        placed = packed::write(placed, &format!("{}_depth", entry.name))
            .map_err(|e| Refusal::bug(name, e))?;
    }
    let taken = match params.quad {
        Quad::Vote => Vec::new(),
        Quad::Lane => gradients::find(&opaque.graph, fragment).unwrap_or_default(),
    };
    let mut main = params.program().main_module(opaque, &placed, invariant);
    let mut own_depth = None;
    if opaque.decides.depth
        && let Some((module, function)) = slice.depth_function(opaque, &main)
    {
        main = module;
        own_depth = Some(function);
    }
    let main = prologue(plan, opaque, params, binding)
        .inject(main, fragment, own_depth.as_ref(), &taken)
        .map_err(|e| Refusal::bug(name, e))?;

    let mut next = plan.clone();
    depth_pass::replace_main(&mut next, opaque, main, name)?;
    bind_depth(&mut next, opaque, params, binding, &produced);
    let depth = DepthState {
        attachment: produced.clone(),
        read_only: false,
        ..opaque.depth.clone()
    };
    let program = params.program();
    program.insert(&mut next, opaque, placed, depth, name)?;
    add_attachments(&mut next, plan, opaque, params, &produced);
    given.extend(depth_pass::WITH_MARGIN);
    let compare = opaque.depth.compare;
    next.self_test = self_test::after_prepass(next.self_test.take(), compare, &produced);
    if params.attachment == MainAttachment::Readonly {
        given.extend(invariant.assumptions(opaque));
        given.extend([Assumption::NoDepthTies, Assumption::SameDrawOrder]);
        let test = self_test::read_only(&next, compare, &produced);
        next.self_test = self_test::with_earlier(test, next.self_test.take());
        next.notes.push(
            "the hardware depth test already rejects what the prologue would: it only adds its cost"
                .to_owned(),
        );
    }
    if params.mode == Mode::Invert {
        next.notes
            .push("diagnostic: shows only the fragments that would be saved".to_owned());
    }
    let contract = contract(params, !taken.is_empty(), given);
    next.steps.push(slice.step(opaque, name, params, contract));
    depth_pass::finish(&mut next, "original");
    Ok(next)
}

/// Format and samples of the author's depth attachment.
fn depth_target(plan: &Plan, opaque: &Opaque) -> (DepthFormat, u32) {
    let scene = plan.attachment(&opaque.depth.attachment);
    let format = scene.and_then(|a| a.format.depth()).unwrap_or_default();
    (format, scene.map_or(1, |a| a.samples))
}

/// Whether depths are clamped before they are stored.
fn is_clamped(opaque: &Opaque) -> bool {
    opaque.decides.depth || opaque.pass.primitive.unclipped_depth
}

/// The prologue for a plan and its parameters.
fn prologue(
    plan: &Plan,
    opaque: &Opaque,
    params: &EarlyDiscardParams,
    binding: ResourceBinding,
) -> Prologue {
    let (format, samples) = depth_target(plan, opaque);
    Prologue {
        texture: params.texture,
        samples,
        format,
        direction: opaque.direction,
        quad: params.quad,
        mode: params.mode,
        range: match is_clamped(opaque) {
            true => DepthRange::Clamped,
            false => DepthRange::Clipped,
        },
        tolerance: params.tolerance,
        binding,
    }
}

/// Binds the attachment `produced` in the main pass, as a texture and, if requested, also
/// read-only.
fn bind_depth(
    next: &mut Plan,
    opaque: &Opaque,
    params: &EarlyDiscardParams,
    ResourceBinding { group, binding }: ResourceBinding,
    produced: &str,
) {
    for pass in next.passes.iter_mut().filter(|p| p.role == Role::Main) {
        let source = BindingSource::Attachment {
            name: match params.texture {
                DepthTexture::Depth | DepthTexture::Float => produced.to_owned(),
                DepthTexture::Packed => PREPASS_PACKED.to_owned(),
            },
        };
        let kind = BindingKind::DepthTexture;
        pass.bindings
            .push(BindingUse::new([group, binding], kind, source));
        if let (MainAttachment::Readonly, Some(depth)) = (params.attachment, &mut pass.depth) {
            // The nearest fragment ties with the stored depth; the strict comparison would drop it.
            depth.compare = match opaque.direction {
                DepthDirection::Forward => CompareFunction::LessEqual,
                DepthDirection::Reversed => CompareFunction::GreaterEqual,
            };
            depth.write = false;
            depth.read_only = true;
        }
    }
}

/// Adds the attachments of the pre-pass that the plan lacks, and makes the bound one readable.
fn add_attachments(
    next: &mut Plan,
    plan: &Plan,
    opaque: &Opaque,
    params: &EarlyDiscardParams,
    produced: &str,
) {
    if next.attachment(produced).is_none() {
        let (format, samples) = depth_target(plan, opaque);
        let depth = Attachment::depth(produced, format, opaque.direction, samples);
        next.attachments.push(depth);
    }
    if params.texture == DepthTexture::Packed {
        next.attachments.push(packed::attachment(opaque.direction));
        for pass in next.passes.iter_mut().filter(|p| p.role == Role::Prepass) {
            pass.targets = vec![Some(packed::target())];
        }
    } else if let Some(depth) = next.attachments.iter_mut().find(|a| a.name == produced) {
        depth.sampled = true;
    }
}

/// The contract of the main pass under the assumptions `given`.
fn contract(
    params: &EarlyDiscardParams,
    has_gradients: bool,
    mut given: Vec<Assumption>,
) -> Contract {
    given.sort();
    let max_abs = |budget, given| Contract::Approximate {
        budget: Budget::max_abs(budget),
        given,
    };
    match params.mode {
        // A diagnostic picture: every pixel may differ.
        Mode::Invert => max_abs(1.0, Vec::new()),
        // `check` made sure that there is one.
        Mode::Cull if has_gradients => max_abs(params.budget.unwrap_or(0.0), given),
        Mode::Cull => Contract::Exact { given },
    }
}

/// The last `@group` of WebGPU's default limits.
const LAST_GROUP: u32 = 3;

/// The requested binding if it is free, or else the first free one after the author's.
fn free_binding(
    program: &Program,
    params: &EarlyDiscardParams,
    name: &str,
) -> Result<ResourceBinding, Box<Refusal>> {
    let (module, declared) = (program.module(), program.declared());
    let variable = |place: ResourceBinding| {
        let mut globals = module.global_variables.iter();
        let (_, global) = globals.find(|(_, g)| g.binding == Some(place))?;
        let name = global.name.clone();
        Some(name.unwrap_or_else(|| "a variable of the shader".to_owned()))
    };
    // A combined sampler has its two bindings also where the program reads only the texture, and in
    // Vulkan's languages it has the author's number.
    let sampler = |place: ResourceBinding| {
        let samplers = &declared.samplers;
        let is_its = |s: &&CombinedSampler| s.texture == place || s.sampler == place;
        samplers.iter().find(is_its).map(|s| s.path.clone())
    };
    let number = |place: ResourceBinding| {
        let mut numbers = declared.numbers.iter();
        let of = numbers.find(|n| (n.binding.group, n.number) == (place.group, place.binding))?;
        variable(of.binding)
    };
    let taken = |group: u32, binding: u32| {
        let place = ResourceBinding { group, binding };
        let named = variable(place).or_else(|| sampler(place));
        named.or_else(|| number(place))
    };
    let bindings = || {
        module
            .global_variables
            .iter()
            .filter_map(|(_, g)| g.binding.as_ref())
    };
    let highest = bindings().map(|b| b.group).max().unwrap_or(0);
    let group = params.group.unwrap_or(highest);
    if group > highest.max(LAST_GROUP) {
        return Err(Box::new(Refusal::new(
            name,
            &refusals::GROUP_LIMIT,
            format!(
                "@group({group}) is beyond the bind groups that every WebGPU device has \
                 (maxBindGroups is 4)"
            ),
            "give a group of at most 3, or leave it out",
        )));
    }
    let binding = params
        .binding
        .unwrap_or_else(|| (0..).find(|b| taken(group, *b).is_none()).unwrap_or(0));
    match taken(group, binding) {
        None => Ok(ResourceBinding { group, binding }),
        Some(of) => Err(Box::new(Refusal::new(
            name,
            &refusals::BINDING_TAKEN,
            format!("@group({group}) @binding({binding}) is `{of}`"),
            "give a free binding, or leave it out",
        ))),
    }
}
