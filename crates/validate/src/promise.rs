//! Derives the promises of a pass from its plan: the outputs that must match, where, and how
//! closely.

use std::collections::BTreeMap;
use std::sync::Arc;

use naga::ShaderStage;

use super::compare::{Colors, Depths, Discards, Positions, Rule, Stores};
use super::environment::{self, PassStages, TestPoint};
use super::inputs::{self, Inputs};
use super::levels::Levels;
use super::made_up_draw::Drawn;
use super::stage::{POSITION, Slot, Stage};
use super::verdict::not_evaluated;
use super::{By, Check, Effort, Proof, Verdict};
use preshade_geometry::pass_named;
use preshade_passes::analysis::rounding;
use preshade_passes::transforms::early_discard;
use preshade_plan::contract::Contract;
use preshade_plan::geometry::Geometry;
use preshade_plan::guard::{Guard, Place as Assumed};
use preshade_plan::pass::Expected;
use preshade_plan::plan::{
    BindingSource, BindingUse, ClearValue, GeometryPart, GpuPass, Plan, Role, Step,
};
use preshade_plan::program::Program;
use preshade_plan::state::{CompareFunction, CullMode, DepthDirection};

/// One in this many inputs is also run if a proof depends on the slicer.
const BESIDE: u64 = 8;

/// A pass of a variant and the original's main pass.
pub(super) struct Pair<'a> {
    pub(super) variant: &'a Plan,
    pub(super) pass: &'a GpuPass,
    pub(super) original: PassStages<'a>,
    pub(super) other: PassStages<'a>,
    pub(super) effort: Effort,
    /// The lookups that receive gradients and biases.
    pub(super) levels: Arc<Levels>,
    /// The executor, if not the interpreter.
    by: By<'a>,
    /// Whether the pass reads buffers of the draw ([`Drawn`]).
    pub(super) reads_draw: bool,
    cull: CullMode,
    pub(super) direction: DepthDirection,
    /// The clear values and contents of the attachments that the pass reads, by binding.
    pub(super) attachments: BTreeMap<(u32, u32), (ClearValue, Held)>,
}

/// The content of an attachment.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Held {
    /// Depths, unpacked.
    Depths,
    /// Depths packed into a colour.
    Packed,
    /// Any other content.
    Colors,
}

impl Held {
    fn of(name: &str, clear: ClearValue) -> Self {
        match clear {
            ClearValue::Depth(_) => Self::Depths,
            ClearValue::Color(_) if name == early_discard::PREPASS_PACKED => Self::Packed,
            ClearValue::Color(_) => Self::Colors,
        }
    }
}

pub(super) fn stages<'a>(pass: &GpuPass, program: &'a Program) -> Result<PassStages<'a>, String> {
    let vertex =
        Stage::new(program, ShaderStage::Vertex, &pass.vertex).ok_or("it has no vertex stage")?;
    let fragment = match &pass.fragment {
        None => None,
        Some(name) => Some(
            Stage::new(program, ShaderStage::Fragment, name).ok_or("it has no fragment stage")?,
        ),
    };
    Ok(PassStages { vertex, fragment })
}

/// Whether a program has a variable of that binding.
fn declares(program: &Program, binding: &BindingUse) -> bool {
    let mut all = program.module().global_variables.iter();
    all.any(|(_, g)| {
        g.binding
            .is_some_and(|b| (b.group, b.binding) == (binding.group, binding.binding))
    })
}

/// Why a pass that reads the draw is not tried on an adapter.
pub(super) const NOT_DRAWN: &str =
    "an adapter is not given the buffers of a draw; the interpreter is";

/// Scalars in buffers that all inputs of a promise have together.
const MOST_SCALARS: u64 = 1 << 21;

/// Inputs that every promise has: they cover each profile at each corner ([`Inputs::corner`]).
const FEWEST_INPUTS: u64 = 18;

/// The effort with fewer inputs if the buffers are long.
pub(super) fn effort(stages: PassStages<'_>, effort: &Effort) -> Effort {
    let scalars = inputs::filled(stages.vertex.module());
    let most = (MOST_SCALARS / scalars.max(1)).max(FEWEST_INPUTS);
    Effort {
        inputs: effort.inputs.min(most),
        ..*effort
    }
}

impl<'a> Pair<'a> {
    pub(super) fn new(
        variant: &'a Plan,
        (main, program): (&GpuPass, &'a Program),
        (pass, other): (&'a GpuPass, &'a Program),
        by: By<'a>,
    ) -> Result<Self, String> {
        if !matches!(pass.geometry, Geometry::AsGiven | Geometry::Unindexed) {
            return Err(
                "its vertices are new ones, which the interpreter does not make; \
                 `verify` draws them"
                    .to_owned(),
            );
        }
        let mut attachments = BTreeMap::new();
        let mut reads_draw = false;
        for binding in &pass.bindings {
            match &binding.source {
                BindingSource::Author => {}
                // [`super::at_rest`].
                BindingSource::Previous { .. } | BindingSource::Host { .. }
                    if pass.role == Role::Outputs => {}
                // [`super::of_draw`].
                BindingSource::Geometry {
                    part: GeometryPart::Values { .. },
                } if !declares(other, binding) => {}
                BindingSource::Geometry { .. } if pass.role == Role::Ids => reads_draw = true,
                BindingSource::Attachment { name } => {
                    let clear = variant.attachment(name).map(|a| a.clear);
                    let clear = clear.ok_or("it reads an attachment that is not there")?;
                    let held = (clear, Held::of(name, clear));
                    attachments.insert((binding.group, binding.binding), held);
                }
                BindingSource::View { name } => {
                    return Err(format!("it reads `{name}`, which is another view's"));
                }
                BindingSource::Previous { .. } | BindingSource::Host { .. } => {
                    return Err(
                        "it reads buffers that the author does not have; `verify` draws it"
                            .to_owned(),
                    );
                }
                _ => {
                    return Err(
                        "it reads buffers of the draw's geometry, which the interpreter does not \
                         fill; `verify` draws it"
                            .to_owned(),
                    );
                }
            }
        }
        let compare = main.depth.as_ref().map(|d| d.compare);
        let (original, other) = (stages(main, program)?, stages(pass, other)?);
        Ok(Self {
            variant,
            pass,
            original,
            other,
            levels: Arc::new(Levels::between(original, other)),
            effort: effort(original, by.effort),
            by,
            reads_draw,
            cull: main.primitive.cull,
            direction: compare
                .and_then(CompareFunction::direction)
                .unwrap_or_default(),
            attachments,
        })
    }

    /// The draw of these inputs, if the pass reads it.
    pub(super) fn drawn<'d>(&'d self, inputs: &'d Inputs) -> Option<Drawn<'d>> {
        // Vertex `3 t + c` is then corner `c` of triangle `t` in both.
        let is_plain = self.pass.geometry == Geometry::Unindexed;
        let vertex = self.original.vertex;
        self.reads_draw
            .then(|| Drawn::new(inputs, vertex, self.variant, self.cull, is_plain))
    }

    pub(super) fn checks(&self) -> Vec<Check> {
        let check = |promise: &str, verdict| Check {
            role: self.pass.role,
            promise: promise.to_owned(),
            verdict,
        };
        let held = |promise: &str, places: &[TestPoint], colors| {
            (self.by.told)(self.pass.role, promise);
            check(promise, self.verdict(places, colors))
        };
        let mut checks = vec![held("positions", &[TestPoint::Vertex], Colors::Ignored)];
        let corners = [
            TestPoint::Corner(0),
            TestPoint::Corner(1),
            TestPoint::Corner(2),
        ];
        if self.pass.role == Role::HalfRate {
            return checks;
        }
        if self.pass.role != Role::Main {
            let colors = match self.pass.multisample.alpha_to_coverage {
                true => Colors::Alpha,
                false => Colors::Ignored,
            };
            let places = [&corners[..1], &[TestPoint::Inside]].concat();
            let promise = "what it discards, and depths";
            checks.push(match self.pass.left_out.is_empty() {
                true => held(promise, &places, colors),
                false => check(
                    promise,
                    not_evaluated("it leaves out some of what decides coverage, on purpose"),
                ),
            });
            return checks;
        }
        if self.steps().any(|(_, of)| of.is_diagnostic) {
            let why = "`mode=invert` draws what would be dropped, on purpose";
            checks.push(check("colours", not_evaluated(why)));
            return checks;
        }
        let told = |colors: &Result<Colors, String>| match colors {
            Ok(colors) => *colors,
            Err(_) => Colors::Ignored,
        };
        let [at_vertices, inside] = self.colors();
        for (promise, kept, places, colors) in [
            (
                "colours, depths and discards at vertices",
                "depths and discards at vertices",
                &corners[..],
                &at_vertices,
            ),
            (
                "colours, depths and discards inside triangles",
                "depths and discards inside triangles",
                &[TestPoint::Inside][..],
                &inside,
            ),
        ] {
            let promise = if colors.is_ok() { promise } else { kept };
            checks.push(held(promise, places, told(colors)));
            if let Err(why) = colors {
                let what = match places.len() {
                    1 => "colours inside triangles",
                    _ => "colours at vertices",
                };
                checks.push(check(what, not_evaluated(why)));
            }
        }
        if self.has_the_authors_varyings() {
            let promise = "the fragment stage, of any varyings";
            checks.push(held(promise, &[TestPoint::Anywhere], told(&at_vertices)));
        }
        checks
    }

    /// The steps, each with the changes that its pass expects.
    fn steps(&self) -> impl Iterator<Item = (&'a Step, Expected)> {
        self.variant.steps.iter().map(|step| {
            let pass = pass_named(&step.pass);
            let expected = pass.map(|pass| pass.expected(&step.params));
            (step, expected.unwrap_or_default())
        })
    }

    /// Whether float sums with 0 and products with 0 and 1 were folded. Ordinary numbers keep their
    /// values; there is no promise about others.
    pub(super) fn folds_floats(&self) -> bool {
        let is_rounding = |s: &Step| matches!(s.contract, Contract::Rounding { .. });
        self.steps()
            .any(|(s, of)| of.folds_floats && is_rounding(s))
    }

    pub(super) fn stores(&self) -> Stores {
        match self.pass.role {
            Role::Main => Stores::Same,
            _ => Stores::Ignored,
        }
    }

    /// Whether varyings are unchanged, so any number may stand for them.
    fn has_the_authors_varyings(&self) -> bool {
        let mut assumed = self.variant.guard.iter().flat_map(|g| &g.values);
        !assumed.any(|a| self.may_reach_varyings(&a.place))
            && !self.steps().any(|(_, of)| of.replaces_varyings)
    }

    /// Whether an assumed number may affect varyings, so the fragment stage may be specialised for
    /// it.
    fn may_reach_varyings(&self, place: &Assumed) -> bool {
        let (group, binding) = match place {
            Assumed::Uniform { group, binding, .. } | Assumed::Texture { group, binding, .. } => {
                (*group, *binding)
            }
            Assumed::Attribute { .. } | Assumed::Override { .. } => return true,
        };
        let Stage { program, entry } = self.original.vertex;
        let uses = program.info().get_entry_point(entry);
        let mut globals = program.module().global_variables.iter();
        globals.any(|(handle, global)| {
            let is_it = global
                .binding
                .is_some_and(|b| (b.group, b.binding) == (group, binding));
            is_it && !uses[handle].is_empty()
        })
    }

    /// The promise about colours at vertices and inside triangles, or why they are not compared.
    fn colors(&self) -> [Result<Colors, String>; 2] {
        let mut promised: [Result<Colors, String>; 2] = [Ok(Colors::Bits), Ok(Colors::Bits)];
        let budget = |metric: &str, limit: f64| {
            Err(format!(
                "they may be off by {limit} ({metric}) in the picture, and nobody draws it here: \
                 `verify` does"
            ))
        };
        for (step, of) in self.steps() {
            let is_moved = of.interpolates;
            match &step.contract {
                Contract::Exact { .. } => {}
                Contract::Rounding { .. } if is_moved => {
                    let is_srgb =
                        |t: &preshade_plan::state::ColorTarget| t.format.ends_with("-srgb");
                    let most = match self.pass.targets.iter().flatten().any(is_srgb) {
                        true => rounding::MOST / rounding::STEEPEST_SRGB,
                        false => rounding::MOST,
                    };
                    let of_scene = step
                        .contract
                        .given()
                        .contains(&preshade_plan::contract::Assumption::NumbersOfTheScene);
                    promised[1] = match (&promised[1], of_scene) {
                        (Err(why), _) => Err(why.clone()),
                        (Ok(_), true) => {
                            Err("how far they may be off depends on the numbers of a scene"
                                .to_owned())
                        }
                        (Ok(_), false) => Ok(Colors::Within(most)),
                    };
                }
                Contract::Rounding { .. } => {
                    for promised in &mut promised {
                        if *promised == Ok(Colors::Bits) {
                            *promised = Ok(Colors::Numbers);
                        }
                    }
                }
                // Our texels don't depend on an implicit level.
                Contract::Approximate { .. } if of.approximates_levels => {}
                Contract::Approximate { budget: most, .. } => {
                    promised[1] = budget(most.metric.name(), most.limit);
                    if !is_moved {
                        promised[0] = budget(most.metric.name(), most.limit);
                    }
                }
                Contract::Budgets { .. } => {
                    promised = [budget("several", 0.0), budget("several", 0.0)];
                }
            }
        }
        promised
    }

    pub(super) fn rule(
        &self,
        place: TestPoint,
        colors: Colors,
        inputs: Option<&Inputs>,
    ) -> (Rule, Attached) {
        if place == TestPoint::Vertex {
            let positions = match self.folds_floats() {
                true => Positions::Numbers,
                false => Positions::Bits,
            };
            return (Rule::Vertices(positions), Attached::new());
        }
        let mut attached = Attached::new();
        let mut discards = Discards::Same;
        let depth = self.pass.depth.as_ref();
        let is_equal = depth.is_some_and(|d| d.compare == CompareFunction::Equal && !d.write);
        let has_prepass = self.variant.passes.iter().any(|p| p.role == Role::Prepass);
        if self.pass.role == Role::Main && is_equal && has_prepass {
            discards = Discards::LeftToEqual;
        }
        if let Some(inputs) = inputs {
            for (at, (clear, held)) in &self.attachments {
                let far = match (clear, held) {
                    (ClearValue::Depth(clear), _) => Some(*clear),
                    (ClearValue::Color([clear, ..]), Held::Packed) => Some(*clear as f32),
                    (ClearValue::Color(_), _) => None,
                };
                let texel = match (far, clear) {
                    (Some(far), _) => {
                        let fragment = self.other.fragment.map(|f| (f.module(), f.inputs()));
                        let [own, other] = match &fragment {
                            Some((module, found)) => {
                                let is_position = |io: &&naga_edit::interface::Io| {
                                    io.binding.as_ref().map(Slot::of) == Some(POSITION)
                                };
                                let io = found.iter().find(is_position);
                                environment::depths(inputs, module, io, far)
                            }
                            None => [0.5, far],
                        };
                        discards = Discards::Hidden {
                            own,
                            other,
                            direction: self.direction,
                        };
                        match held {
                            Held::Packed => {
                                early_discard::packed_depth(other).map(|d| f32::from(d) / 255.0)
                            }
                            _ => [other; 4],
                        }
                    }
                    (None, ClearValue::Color(color)) => color.map(|c| c as f32),
                    (None, ClearValue::Depth(clear)) => [*clear; 4],
                };
                attached.insert(*at, texel);
            }
        }
        // A pre-pass may be biased.
        let depths = match self.pass.role {
            Role::Prepass => Depths::NotNearer(self.direction),
            _ => Depths::Same,
        };
        let rule = Rule::Fragments {
            colors,
            discards,
            depths,
            stores: self.stores(),
        };
        (rule, attached)
    }

    fn verdict(&self, places: &[TestPoint], colors: Colors) -> Verdict {
        if let Some(runner) = self.by.runner {
            if self.reads_draw {
                return not_evaluated(NOT_DRAWN);
            }
            return self.tried_on(runner, places, colors);
        }
        if places.iter().all(|p| self.slices_are_same(*p, colors)) {
            return self.confirmed(places, colors);
        }
        self.by_terms(places, colors)
            .unwrap_or_else(|| self.tried(places, colors, self.effort.inputs))
    }

    /// For slices that are equal according to the slicer. A faulty slicer may have cut the variant
    /// too, so we run both in full.
    fn confirmed(&self, places: &[TestPoint], colors: Colors) -> Verdict {
        match self.tried(places, colors, self.effort.inputs.div_ceil(BESIDE)) {
            Verdict::Agreed { compared, .. } => Verdict::Proved {
                by: Proof::Slices { inputs: compared },
            },
            found @ Verdict::Counterexample(_) => found,
            // Terms may still terminate.
            found => self.by_terms(places, colors).unwrap_or(found),
        }
    }

    fn by_terms(&self, places: &[TestPoint], colors: Colors) -> Option<Verdict> {
        // Numbers that a guard leaves open would be fixed.
        let guard = self.variant.guard.as_ref();
        let is_fixed = |g: &Guard| g.values.iter().all(|a| a.bounds.low == a.bounds.high);
        if !guard.is_none_or(is_fixed) {
            return None;
        }
        let mut each = places.iter();
        let paths = each.try_fold(0, |sum, place| Some(sum + self.proved(*place, colors)?))?;
        Some(Verdict::Proved {
            by: Proof::Terms { paths },
        })
    }
}

/// Contents of the attachments that a pass reads.
pub(super) type Attached = BTreeMap<(u32, u32), [f32; 4]>;
