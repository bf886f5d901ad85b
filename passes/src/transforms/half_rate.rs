//! `half-rate`: computes slow values for one pixel of each 2x2, and interpolates them along edges.
//!
//! Goal: ambient occlusion, light of many lamps, fog and reflections change slowly from pixel to pixel,
//! except at edges of what they light. Computed for every fourth pixel they cost a quarter (Kopf et al.
//! 2007; Sloan et al. 2007; Yang et al. 2008).
//!
//! ```text
//! before:  main       fs(at):  ao = sum of 16 taps(depth[at]);      color = albedo[at] * ao
//!
//! after:   half-rate  fs(at):  ao = sum of 16 taps(depth[at]);      texel = ao, depth[at]
//!          main       fs(at):  ao = mean of the four nearest texels, those of like depth;  color = albedo[at] * ao
//! ```
//!
//! [`crate::analysis::half_rate`] chooses the values and their guides; [`text`] has the arithmetic. A
//! texel stands for the pixel at twice its coordinates, exactly: the half-rate pass has a viewport that
//! puts its fragments' centres on those of these pixels (see [`Attachment`]), so varyings are
//! interpolated there, and `position.xy` is replaced by the pixel's. Loads at the pixel's coordinates
//! and noise from them are those of a real pixel. Only derivatives are twice as large, because a quad
//! spans twice as many pixels: they are halved, and implicit levels are one lower.
//!
//! The same geometry is drawn at half the rate, and a texel that it does not cover has no weight. A pixel
//! that is like none of its neighbours takes their mean. With `edges=computed` it computes the values
//! itself, unless they need derivatives, which a branch must not take. On a GPU that skips a branch only
//! where none of dozens of lanes takes it, few such pixels cost much; llvmpipe skips none.
//!
//! The contract is your budget.

use naga::{
    Binding, BuiltIn, Expression, Function, FunctionResult, Handle, Literal, Module, SampleLevel,
    Scalar, ShaderStage, Statement, TypeInner, UnaryOperator, VectorSize,
};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::analysis::below::dearest;
use crate::analysis::half_rate::{self, Choice, Stays};
use crate::analysis::implicit_inputs::{ImplicitInputs, PassEffect};
use crate::analysis::named::{name, span};
use crate::analysis::refusals as shared;
use crate::analysis::simplify::{self, FragmentStage};
use crate::analysis::values::{ValueId, Values};
use crate::core::budget::{Budget, Metric};
use crate::core::contract::Contract;
use crate::core::pass::{
    Change, Example, Facts, Left, Outcome, Pass, PassInfo, Refusal, Refused, Site, SiteCost, Use,
};
use crate::core::plan::{
    Attachment, AttachmentFormat, BindingKind, BindingSource, BindingUse, ClearValue, Draws,
    GpuPass, ORIGINAL, Phase, Plan, Role, Step, Visibility,
};
use crate::core::program::Program;
use crate::core::reflect;
use crate::core::refusals::RefusalInfo;
use crate::core::state::{ColorTarget, CompareFunction};
use crate::graph::FunctionId;
use crate::graph::effect::Effect;
use crate::rebuild::color;
use crate::rebuild::outline::{self, Extracted, Failed, Names, Wanted};
use crate::rebuild::place::{self, CodeBuilder, Replacement, Rewrite};
use crate::rebuild::remainder::{self, Given};
use crate::rebuild::snippet::{Linked, ours};
use crate::slice::Termination;

pub mod refusals;
mod text;

use text::Layout;

/// The pass.
pub struct HalfRate;

/// What a pixel does that is like none of its neighbours.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Edges {
    /// It takes the mean of its neighbours.
    #[default]
    Blended,
    /// It computes the values itself, where they need no derivative.
    Computed,
}

/// Parameters.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
pub struct Params {
    /// Largest allowed picture error by `metric`, above 0 and at most 1.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(range(max = 1.0), extend("exclusiveMinimum" = 0.0))]
    pub budget: Option<f64>,
    /// The metric of the budget.
    pub metric: Metric,
    /// What a pixel does that is like none of its neighbours.
    pub edges: Edges,
    /// The values that tell edges, by the author's names for them or their textures, joined by `+`; or
    /// `none`. Default: all that are loaded at the pixel itself.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub guide: Option<String>,
    /// Least static cost that each pixel must save, in ops.
    #[schemars(range(min = 0.0))]
    pub least: f64,
}

impl Default for Params {
    fn default() -> Self {
        Self {
            budget: None,
            metric: Metric::default(),
            edges: Edges::default(),
            guide: None,
            least: 32.0,
        }
    }
}

impl Pass for HalfRate {
    type Params = Params;

    const INFO: PassInfo = PassInfo {
        name: "half-rate",
        summary: "computes slow values of a full-screen draw for one pixel of each 2x2, and \
                  interpolates them along edges, within a budget",
        source: "Kopf et al., Joint Bilateral Upsampling (2007); Yang, Sander and Lawrence, \
                 Geometry-Aware Framebuffer Level of Detail (2008)",
        when: "a full-screen draw computes something slow that changes little from pixel to pixel: \
               ambient occlusion, light of many lamps, fog, reflections",
        hurts: "where neighbouring pixels have little in common (foliage, noise), because most \
                compute the values themselves; and on cheap draws, which read four texels instead",
        reads_scene: false,
    };

    const REFUSALS: &'static [RefusalInfo] = refusals::REFUSALS;

    const EXAMPLES: &'static [Example] = &[
        Example {
            recipe: "half-rate:budget=0.01",
            uses: &[
                Use::Page("shaders/deferred"),
                Use::Picture {
                    scene: "fixtures/scenes/deferred.toml --size 256x144 --frames 1",
                    caption: "a wall lit by two dozen lamps, with the light and the occlusion of \
                              every fourth pixel",
                    rows: 1,
                },
            ],
        },
        Example {
            recipe: "half-rate:BUDGET",
            uses: &[Use::PlanWithin, Use::Simplify],
        },
        Example {
            recipe: "half-rate:BUDGET,guide=none",
            uses: &[Use::PlanWithin],
        },
        Example {
            recipe: "half-rate:BUDGET,edges=computed",
            uses: &[Use::PlanWithin],
        },
    ];

    fn run(plan: &Plan, _facts: &Facts, params: &Params) -> Result<Outcome, Refused> {
        let stage = examine(plan)?;
        let values = Values::new(&stage.graph, stage.entry)
            .map_err(|e| refuse(&shared::TOO_LARGE, e.to_string(), "split the shader"))?;
        let found = Found::new(&stage, &values, params)?;
        let Some(limit) = params.budget else {
            let refusal = refuse(
                &shared::NO_BUDGET,
                "values at half the rate change the picture, and there is no budget",
                "set budget=0.01 (of flip_mean, or with metric=max_abs)",
            );
            return Err((refusal, found.left).into());
        };
        let built = match found.rebuild() {
            Ok(built) => built,
            Err(why) => return Err((Box::new(failed(why)), found.left).into()),
        };
        let inputs = ImplicitInputs::new(plan, stage.pass, &stage.graph).replaced_by(&built.main);
        inputs.examine(Self::INFO.name, &[PassEffect::RemovesInputs])?;
        let budget = Budget {
            metric: params.metric,
            limit,
        };
        Ok(found.outcome(plan, built, params, budget))
    }
}

fn refuse(
    code: &RefusalInfo,
    reason: impl Into<String>,
    remedy: impl Into<String>,
) -> Box<Refusal> {
    Box::new(Refusal::new(HalfRate::INFO.name, code, reason, remedy))
}

/// A rebuild that failed.
fn failed(why: Failed) -> Refusal {
    let name = HalfRate::INFO.name;
    match why {
        Failed::NotSeparable => Refusal::new(
            name,
            &shared::NOT_SEPARABLE,
            why.to_string(),
            "compute it before the branch or return that precedes it",
        ),
        Failed::NoOutput(_) | Failed::Built(_) => Refusal::bug(name, why),
    }
}

/// The stage of a draw whose values may come from another pass of the same geometry.
fn examine(plan: &Plan) -> Result<FragmentStage<'_>, Refused> {
    let stage = simplify::examine(
        plan,
        HalfRate::INFO.name,
        "take `half-rate` behind the passes that change the fragment stage, and ahead of none",
        "there is nothing to compute at half the rate",
    )?;
    let pass = stage.pass;
    let mut found = Vec::new();
    let mut told = |code, reason: &str, remedy: &str| found.push(*refuse(code, reason, remedy));
    let depth = pass.depth.as_ref();
    if depth.is_some_and(|d| d.write || d.compare != CompareFunction::Always) {
        let remedy = "set `depth_compare` to `always` and `depth_write` to false, if it covers the \
                      screen";
        told(
            &refusals::DEPTH_TEST,
            "the material tests or writes depth",
            remedy,
        );
    }
    if pass.stencil.is_some() {
        let remedy = "mask by `discard`";
        told(
            &refusals::HALF_RATE_STENCIL,
            "the material tests or writes stencil",
            remedy,
        );
    }
    if pass.multisample.count > 1 {
        let reason = "the material is drawn with several samples a pixel";
        told(
            &refusals::HALF_RATE_SAMPLES,
            reason,
            "draw it with one sample",
        );
    }
    let vertex = stage
        .graph
        .program()
        .entry_point(ShaderStage::Vertex, &pass.vertex);
    let writes = [Effect::Store, Effect::ImageStore, Effect::Atomic];
    let stores = |entry| {
        let effects = stage.graph.effects(FunctionId::EntryPoint(entry));
        effects.iter().any(|e| writes.contains(e))
    };
    if stores(stage.entry) {
        let reason =
            "the fragment stage writes memory, and `half-rate` does not follow what it writes";
        told(
            &shared::FRAGMENT_STORES,
            reason,
            "move the writes to a pass of their own",
        );
    }
    if vertex.is_some_and(|(entry, _)| stores(entry)) {
        let reason = "the vertex stage writes memory, and it would run twice";
        told(
            &shared::VERTEX_STORE,
            reason,
            "move the writes to a compute pass",
        );
    }
    match found.is_empty() {
        true => Ok(stage),
        false => Err(found.into()),
    }
}

/// A value in a texel.
struct Carried {
    width: u8,
}

/// Values that pay.
struct Found<'v, 'g, 'p> {
    stage: &'v FragmentStage<'p>,
    values: &'v Values<'g, 'p>,
    choice: Choice,
    wanted: Vec<Wanted>,
    guides: Vec<Wanted>,
    layout: Layout,
    edges: Edges,
    left: Vec<Left>,
}

impl<'v, 'g, 'p> Found<'v, 'g, 'p> {
    fn new(
        stage: &'v FragmentStage<'p>,
        values: &'v Values<'g, 'p>,
        params: &Params,
    ) -> Result<Self, (Box<Refusal>, Vec<Left>)> {
        let verdicts = half_rate::judge(values);
        let named = |id: ValueId| half_rate::guide_name(values, id);
        let asked = params.guide.as_deref();
        let is_guide =
            |id: ValueId| asked.is_none_or(|all| all.split('+').any(|one| one.trim() == named(id)));
        let choice = half_rate::choose(values, &verdicts, params.least, &is_guide);
        let left = left(values, &verdicts);
        let Some(choice) = choice else {
            let reason = format!(
                "no value that may be computed at half the rate saves {} ops",
                params.least
            );
            let refusal = refuse(
                &refusals::NOTHING_AT_HALF_RATE,
                reason,
                "`preshade explain` lists the values that stay, and why",
            );
            return Err((refusal, left));
        };
        if let Some(all) = asked.filter(|a| *a != "none")
            && choice.guides.len() < all.split('+').count()
        {
            let any = half_rate::choose(values, &verdicts, params.least, &|_| true);
            let known = any.map_or_else(Vec::new, |c| c.guides);
            let known: Vec<String> = known.into_iter().map(named).collect();
            let reason = format!("`guide={all}` names a value that cannot guide");
            let remedy = match known.is_empty() {
                true => "no value can: leave it out, or give `guide=none`".to_owned(),
                false => format!("these can: {}", known.join(", ")),
            };
            return Err((refuse(&refusals::NO_GUIDE, reason, remedy), left));
        }
        let wanted = outline::wanted(values, choice.moved.iter().copied(), "carried");
        let guides = outline::wanted(values, choice.guides.iter().copied(), "guide");
        let carried = |ids: &[ValueId]| -> Vec<Carried> {
            let widths = ids.iter().filter_map(|id| half_rate::width(values, *id));
            widths.map(|width| Carried { width }).collect()
        };
        let layout = Layout::of(&carried(&choice.moved), &carried(&choice.guides));
        let is_moved = |l: &Left| wanted.iter().any(|w| w.name == l.name);
        Ok(Self {
            stage,
            values,
            left: left.into_iter().filter(|l| !is_moved(l)).collect(),
            choice,
            wanted,
            guides,
            layout,
            edges: params.edges,
        })
    }

    fn rebuild(&self) -> Result<Built, Failed> {
        let program = self.stage.graph.program();
        let pass = self.stage.pass;
        let fragment = pass.fragment.as_deref().unwrap_or_default();
        let computed = Called::new(outline::extract(
            program,
            self.values,
            &self.wanted,
            &NAMES,
        )?);
        let mut module = computed.module;
        let computed = computed.part;
        let mut guide = None;
        if !self.guides.is_empty() {
            let with = program.with_module(module)?;
            let found = Called::new(outline::extract(&with, self.values, &self.guides, &GUIDE)?);
            module = found.module;
            guide = Some(found.part);
        }
        let entry = format!("{fragment}_half_rate");
        let half = self.half(&module, &computed, guide.as_ref(), &entry)?;
        let half = place::retain(
            &half,
            &[
                (ShaderStage::Vertex, pass.vertex.as_str()),
                (ShaderStage::Fragment, &entry),
            ],
        );
        let (half, has_derivatives) = at_full_rate(half);
        let (group, binding) = reflect::free_binding(program.module());
        let at = [group, binding];
        let edges = match has_derivatives {
            true => Edges::Blended,
            false => self.edges,
        };
        let text = self.layout.reading(at, edges == Edges::Computed);
        let Linked { module, ours: own } = Linked::new(module, &text).map_err(Failed::Built)?;
        let read = ours(&own, text::READ).map_err(Failed::Built)?;
        // The half-rate pass runs what the loops decided.
        let loops = Termination::Assumed;
        let read = &mut |build: &mut CodeBuilder<'_>| {
            self.read(build, read, &computed, guide.as_ref(), edges)
        };
        let main = remainder::rebuild(program, &module, self.values, &self.wanted, loops, read)?;
        let entries = [
            (ShaderStage::Vertex, pass.vertex.as_str()),
            (ShaderStage::Fragment, fragment),
        ];
        Ok(Built {
            main: program.with_module(place::retain(&main, &entries))?,
            half: program.with_module(half)?,
            entry,
            at,
            edges,
        })
    }

    /// The module with the entry point of the half-rate pass.
    fn half(
        &self,
        module: &Module,
        computed: &Part,
        guide: Option<&Part>,
        name: &str,
    ) -> Result<Module, Failed> {
        let Linked {
            mut module,
            ours: own,
        } = Linked::new(module.clone(), &self.layout.storing()).map_err(Failed::Built)?;
        let [pixel, store] = [text::PIXEL, text::STORE].map(|name| ours(&own, name));
        let (pixel, store) = (pixel.map_err(Failed::Built)?, store.map_err(Failed::Built)?);
        let result = module.functions[store].result.as_ref().map(|r| r.ty);
        let ty = result.ok_or_else(|| Failed::Built("it stores nothing".to_owned()))?;
        let binding = (self.layout.targets() == 1).then(|| color::location(0));
        let mut entry = color::empty_fragment(name);
        entry.function.name = Some(name.to_owned());
        entry.function.result = Some(FunctionResult { ty, binding });
        module.entry_points.push(entry);
        let id = FunctionId::EntryPoint(module.entry_points.len() - 1);
        Ok(place::rewritten(&module, id, |build| {
            let mut at = None;
            let mut values = computed.called(build, self.wanted.len(), Some(pixel), &mut at);
            if let Some(guide) = guide {
                values.extend(guide.called(build, self.guides.len(), Some(pixel), &mut at));
            }
            let value = build.call(store, values);
            build.statement(Statement::Return { value });
            Rewrite::default()
        }))
    }

    /// Reads the values, or computes them.
    fn read(
        &self,
        build: &mut CodeBuilder<'_>,
        read: Handle<Function>,
        computed: &Part,
        guide: Option<&Part>,
        edges: Edges,
    ) -> Given {
        let mut at = None;
        let mut passed = vec![position(build, None, &mut at)];
        if let Some(guide) = guide {
            passed.extend(guide.called(build, self.guides.len(), None, &mut at));
        }
        let Some(found) = build.call(read, passed) else {
            return Given::new();
        };
        let member = |build: &mut CodeBuilder<'_>, index: usize| {
            build.expression(Expression::AccessIndex {
                base: found,
                index: index as u32,
            })
        };
        let count = self.wanted.len();
        if edges == Edges::Blended {
            return (self.wanted.iter().enumerate())
                .map(|(i, wanted)| {
                    let value = member(build, i);
                    build.name(value, &wanted.name);
                    (i, value)
                })
                .collect();
        }
        let mut pointers = Vec::new();
        for (i, wanted) in self.wanted.iter().enumerate() {
            let ty = build.ty(wanted.inner.clone());
            let pointer = build.local(&format!("half_rate_{}", wanted.name), ty);
            let value = member(build, i);
            build.statement(Statement::Store { pointer, value });
            pointers.push(pointer);
        }
        let alike = member(build, count);
        let unlike = build.expression(Expression::Unary {
            op: UnaryOperator::LogicalNot,
            expr: alike,
        });
        build.if_then(unlike, |build| {
            let values = computed.called(build, count, None, &mut at);
            for (pointer, value) in pointers.iter().zip(values) {
                build.statement(Statement::Store {
                    pointer: *pointer,
                    value,
                });
            }
        });
        let loaded = pointers.iter().zip(&self.wanted).enumerate();
        loaded
            .map(|(i, (pointer, wanted))| {
                let value = build.named(&wanted.name, Expression::Load { pointer: *pointer });
                (i, value)
            })
            .collect()
    }

    fn outcome(self, plan: &Plan, built: Built, params: &Params, budget: Budget) -> Outcome {
        let mut next = plan.clone();
        let main = self.stage.pass;
        let names: Vec<String> = (0..self.layout.targets())
            .map(|i| match i {
                0 => format!("half-rate-{}", plan.material),
                _ => format!("half-rate-{}-more", plan.material),
            })
            .collect();
        next.attachments.extend(names.iter().map(|name| Attachment {
            name: name.clone(),
            format: AttachmentFormat::Color(FORMAT.to_owned()),
            samples: 1,
            sampled: true,
            clear: ClearValue::Color([0.0; 4]),
            divisor: 2,
        }));
        let mut half = GpuPass {
            role: Role::HalfRate,
            phase: Phase::HalfRate,
            program: Role::HalfRate.name().to_owned(),
            fragment: Some(built.entry.clone()),
            depth: None,
            targets: names
                .iter()
                .map(|name| {
                    Some(ColorTarget {
                        attachment: Some(name.clone()),
                        ..ColorTarget::opaque(FORMAT)
                    })
                })
                .collect(),
            draws: Draws::All,
            ..main.clone()
        };
        reflect::fill(&mut half, &built.half);
        for pass in &mut next.passes {
            pass.bindings.extend(built.bindings(&names));
            reflect::fill(pass, &built.main);
        }
        next.passes.insert(0, half);
        next.programs.insert(main.program.clone(), built.main);
        next.programs
            .insert(Role::HalfRate.name().to_owned(), built.half);
        let contract = Contract::Approximate {
            budget,
            given: self.stage.given.clone(),
        };
        let change = self.change(built.edges);
        next.steps.push(Step {
            pass: HalfRate::INFO.name.to_owned(),
            site: change.key.clone(),
            params: serde_json::to_value(params).unwrap_or_default(),
            contract: contract.clone(),
        });
        next.contract = next.contract.and(contract);
        next.fallback = Some(ORIGINAL.to_owned());
        next.notes.push(change.what.clone());
        Outcome {
            plan: next,
            change,
            left: self.left,
        }
    }

    fn change(&self, edges: Edges) -> Change {
        let moved = || self.choice.moved.iter().copied();
        let sources = self.stage.graph.program().sources();
        let names = self.wanted.iter().map(|w| format!("`{}`", w.name));
        let names: Vec<String> = names.collect();
        let guides = self.choice.guides.iter();
        let guides: Vec<String> = guides
            .map(|id| format!("`{}`", half_rate::guide_name(self.values, *id)))
            .collect();
        let guided = match guides.is_empty() {
            true => "no value tells edges".to_owned(),
            false => format!("edges are those of {}", guides.join(", ")),
        };
        let alone = match (edges, self.edges) {
            (Edges::Computed, _) => "a pixel unlike its neighbours computes them itself",
            (Edges::Blended, Edges::Blended) => "a pixel unlike its neighbours takes their mean",
            (Edges::Blended, Edges::Computed) => {
                "a pixel unlike its neighbours takes their mean, for they need derivatives"
            }
        };
        Change {
            key: Site {
                role: Role::Main,
                entry_point: self.stage.pass.fragment.clone().unwrap_or_default(),
                slice: outline::hash(self.values, moved()),
            },
            what: format!(
                "computes {} for one pixel of each 2x2 ({:.0} ops); {guided}, and {alone}; a pixel \
                 costs {:.0} ops instead of {:.0}",
                names.join(", "),
                self.choice.half,
                self.choice.after,
                self.choice.before
            ),
            location: moved()
                .filter_map(|id| span(self.values, id))
                .find_map(|span| sources.locate(span)),
            cost: SiteCost {
                slice: self.choice.before - self.choice.after,
                whole: self.choice.before,
            },
        }
    }
}

/// Format of the targets: words, which no driver rounds.
const FORMAT: &str = "rgba32uint";

const NAMES: Names = Names {
    function: "half_rate",
    values: "HalfRate",
};

const GUIDE: Names = Names {
    function: "half_rate_guide",
    values: "HalfRateGuide",
};

/// The programs of both passes.
struct Built {
    main: Program,
    half: Program,
    /// Fragment entry point of the half-rate pass.
    entry: String,
    /// Group of the targets' bindings, and the first.
    at: [u32; 2],
    edges: Edges,
}

impl Built {
    /// The targets' bindings with their sources, for [`reflect::fill`].
    fn bindings(&self, names: &[String]) -> Vec<BindingUse> {
        let [group, first] = self.at;
        let all = names.iter().enumerate();
        all.map(|(i, name)| BindingUse {
            group,
            binding: first + i as u32,
            name: String::new(),
            kind: BindingKind::Texture,
            visibility: Visibility::default(),
            source: BindingSource::Attachment { name: name.clone() },
            layout: None,
        })
        .collect()
    }
}

/// A function cut out of the fragment stage, and its inputs.
struct Called {
    module: Module,
    part: Part,
}

/// How to call it.
struct Part {
    function: Handle<Function>,
    arguments: Vec<Vec<Binding>>,
}

impl Called {
    fn new(extracted: Extracted) -> Self {
        Self {
            module: extracted.module,
            part: Part {
                function: extracted.function,
                arguments: extracted.arguments,
            },
        }
    }
}

impl Part {
    /// The values that it returns, of the entry point's inputs. `pixel` maps the position.
    fn called(
        &self,
        build: &mut CodeBuilder<'_>,
        count: usize,
        pixel: Option<Handle<Function>>,
        at: &mut Option<Handle<Expression>>,
    ) -> Vec<Handle<Expression>> {
        let arguments = build.module().functions[self.function].arguments.clone();
        let mut passed = Vec::new();
        for (argument, bindings) in arguments.iter().zip(&self.arguments) {
            let inner = build.module().types[argument.ty].inner.clone();
            let members = match &inner {
                TypeInner::Struct { members, .. } => members.clone(),
                _ => Vec::new(),
            };
            let mut parts = Vec::new();
            for (i, binding) in bindings.iter().enumerate() {
                let (name, ty) = match members.get(i) {
                    Some(m) => (m.name.as_deref(), m.ty),
                    None => (argument.name.as_deref(), argument.ty),
                };
                parts.push(match binding {
                    Binding::BuiltIn(BuiltIn::Position { .. }) => position(build, pixel, at),
                    _ => build.input(name.unwrap_or("varying"), ty, binding),
                });
            }
            passed.push(match (members.is_empty(), parts.as_slice()) {
                (true, [one]) => *one,
                _ => build.expression(Expression::Compose {
                    ty: argument.ty,
                    components: parts,
                }),
            });
        }
        let Some(result) = build.call(self.function, passed) else {
            return Vec::new();
        };
        match count {
            1 => vec![result],
            _ => (0..count as u32)
                .map(|index| {
                    build.expression(Expression::AccessIndex {
                        base: result,
                        index,
                    })
                })
                .collect(),
        }
    }
}

/// The pixel's position, mapped by `pixel` once.
fn position(
    build: &mut CodeBuilder<'_>,
    pixel: Option<Handle<Function>>,
    at: &mut Option<Handle<Expression>>,
) -> Handle<Expression> {
    if let Some(known) = *at {
        return known;
    }
    let ty = build.ty(TypeInner::Vector {
        size: VectorSize::Quad,
        scalar: Scalar::F32,
    });
    let binding = Binding::BuiltIn(BuiltIn::Position { invariant: false });
    let given = build.input("position", ty, &binding);
    let mapped = pixel.and_then(|pixel| build.call(pixel, vec![given]));
    let found = mapped.unwrap_or(given);
    *at = Some(found);
    found
}

/// The half-rate module with the derivatives and implicit levels of neighbouring pixels, and whether
/// there are any.
fn at_full_rate(mut module: Module) -> (Module, bool) {
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
        let samples = of(|e| {
            let level = match e {
                Expression::ImageSample { level, .. } => level,
                _ => return false,
            };
            matches!(level, SampleLevel::Auto | SampleLevel::Bias(_))
        });
        if derivatives.is_empty() && samples.is_empty() {
            continue;
        }
        any = true;
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

/// Named values that stay, the most expensive first.
fn left(values: &Values<'_, '_>, verdicts: &[Result<(), Stays>]) -> Vec<Left> {
    let sources = values.graph.program().sources();
    let staying: Vec<(ValueId, String)> = (0..values.values.len())
        .filter_map(|id| match verdicts[id] {
            Ok(()) => Some((id, "it saves too little".to_owned())),
            Err(Stays::Uniform | Stays::Shape | Stays::Cheap) => None,
            Err(stays) => Some((id, stays.to_string())),
        })
        .collect();
    let ids: Vec<ValueId> = staying.iter().map(|(id, _)| *id).collect();
    let costs = dearest(values, &ids, MOST_LEFT, 0.0);
    let mut left: Vec<Left> = costs
        .into_iter()
        .filter_map(|(id, cost)| {
            let (_, reason) = staying.iter().find(|(of, _)| *of == id)?;
            Some(Left {
                name: name(values, id)?,
                reason: reason.clone(),
                cost: cost.round(),
                location: span(values, id).and_then(|s| sources.locate(s)),
            })
        })
        .collect();
    left.sort_by(|a, b| b.cost.total_cmp(&a.cost).then_with(|| a.name.cmp(&b.name)));
    left.dedup_by(|a, b| a.name == b.name && a.location == b.location);
    left.truncate(MOST_LEFT);
    left
}

/// Most values to report.
const MOST_LEFT: usize = 100;
