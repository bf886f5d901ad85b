//! `specialize`: removes the effects that a scene does not use from a material that can do
//! everything.
//!
//! Goal: engines write one material with every effect, and uniforms select the effects of a draw.
//! Most of these uniforms never change (Crawford and O'Boyle 2019 found 48 to 91% of them constant
//! at run time), yet every fragment pays for the disabled code in registers, branches, varyings and
//! bindings.
//!
//! ```text
//! before:  fs(normal, tangent, world): if material.fog_density > 0 { fog(..) }  if has(NORMAL_MAP) { .. }  ..
//!          a draw has fog_density = 0, flags = 0
//!
//! after:   fs(normal): ..                          guard: material.fog_density = 0, material.flags = 0
//! ```
//!
//! Known values are uniforms that no frame changes, attributes and textures of one value, and
//! values that you set. Online partial evaluation ([`fold`]) propagates them through the stages as
//! intervals rounded outwards ([`arithmetic`]), and removes branches that are proved never to be
//! taken. Then both stages are sliced to their remaining outputs, which removes dead code,
//! varyings, attributes and bindings.
//!
//! We fold only integers, bools, selections and branches. A float stays behind the variable it is
//! read from, because front ends fold calls of literals on the CPU. With `fold=rounding`, sums with
//! 0 and products with 0 and 1 are folded too.
//!
//! The contract is `Exact` if the surroundings of every float operation, by which compilers fuse
//! and reorder, stay the same. Otherwise it is `Rounding`, with the share of pixels in which a
//! decision may change ([`contraction`]). After a branch is removed, a compiler may fuse a product
//! into a sum, and no text prevents it.
//!
//! The assumptions are the plan's [guard](../guides/specialize.md#the-guard), which a host checks before it
//! draws.

use std::collections::BTreeSet;

use naga::{Binding, Expression, Handle, Interpolation, ShaderStage};

use crate::analysis::implicit_inputs::{ImplicitInputs, PassEffect};
use crate::analysis::values::Values;
use crate::analysis::zero::{self, Zeros};
use crate::analysis::{contraction, refusals as shared};
use naga_edit::interface;
use naga_interp::accuracy::Accuracy;
use naga_interp::overrides;
use preshade_dataflow::graph::{FunctionId, Graph};
use preshade_dataflow::slice::{self, Criterion, OutputFilter};
use preshade_plan::contract::{Assumption, Contract, Surface, Turned};
use preshade_plan::guard::Guard;
use preshade_plan::pass::{
    Example, Expected, Facts, Misnamed, Outcome, Pass, PassInfo, Refusal, Refused, Use,
};
use preshade_plan::plan::{Change, GpuPass, ORIGINAL, Plan, Role, Site, SiteCost};
use preshade_plan::program::Program;
use preshade_plan::{reflect, self_test};
use shader_text::refusals::RefusalInfo;

pub mod arithmetic;
pub mod assume;
pub mod branches;
mod control;
pub mod decision;
pub mod dispatch;
mod dynamic_cost;
pub mod effects;
mod expressions;
pub mod fold;
pub mod known;
mod params;
pub mod refusals;
mod shrink;
mod unroll;
mod versions;

pub use dynamic_cost::as_drawn;
pub use params::{Fold, SpecializeParams};

use assume::Assumptions;
use contraction::Exposed;
use decision::Placed;
use fold::{FoldedStage, Folder};
use known::{AbstractValue, Scalar};

pub struct Specialize;

impl Pass for Specialize {
    type Params = SpecializeParams;

    const INFO: PassInfo = PassInfo {
        name: "specialize",
        summary: "leaves out what the scene's own values switch off, with a guard that says which \
                  values",
        source: "Crawford and O'Boyle, Specialization Opportunities in Graphical Workloads (2019)",
        when: "one material serves many objects, and uniforms switch its effects on and off \
               (engine standard materials)",
        hurts: "where values change from frame to frame, and where many draws want many variants: \
                each is another pipeline",
        reads_scene: true,
    };

    const REFUSALS: &'static [RefusalInfo] = refusals::REFUSALS;

    const EXAMPLES: &'static [Example] = &[
        Example {
            recipe: "specialize",
            uses: &[
                Use::Fuzz,
                Use::Pictures(1),
                Use::Truth,
                Use::Plan,
                Use::Simplify,
                Use::Ahead(0),
                Use::Picture {
                    scene: "fixtures/scenes/museum.toml --size 256x144 --frames 1 --order \
                            front-to-back",
                    caption: "one shader for all exhibits, a version for each kind: the same \
                              picture",
                    rows: 1,
                },
            ],
        },
        Example {
            recipe: "specialize:fold=rounding",
            uses: &[Use::Truth],
        },
        Example {
            recipe: "specialize:set=fog=0",
            uses: &[Use::Page("pages/leaf")],
        },
        Example {
            recipe: "specialize:set=material.fog=0",
            uses: &[Use::Break],
        },
        Example {
            recipe: "specialize:set=material.fog=0,fold=rounding",
            uses: &[Use::Break],
        },
        Example {
            recipe: "specialize:set=material.flags=3+hall.fog_density=0+hall.light_count=2+morph_targets=0",
            uses: &[Use::Compile],
        },
        Example {
            recipe: "specialize:set=material.flags=3+hall.fog_density=0+hall.light_count=2+morph_targets=0,\
                     depth-prepass:form=equal",
            uses: &[Use::Compile],
        },
        Example {
            recipe: "specialize:set=material.flags=3+hall.fog_density=0+hall.light_count=2+morph_targets=0,\
                     early-discard:texture=float",
            uses: &[Use::Compile],
        },
        Example {
            recipe: "specialize:set=material.flags=3+hall.fog_density=0+hall.light_count=2+morph_targets=0,\
                     hoist:budget=0.02,finite=assumed,jumps=carried",
            uses: &[Use::Compile],
        },
        Example {
            recipe: "specialize:set=material.flags=3+hall.fog_density=0+hall.light_count=2+morph_targets=0,\
                     skip-taps:budget=1",
            uses: &[Use::Compile],
        },
        Example {
            recipe: "specialize:set=material.flags=3+hall.fog_density=0+hall.light_count=2+morph_targets=0,\
                     visibility-buffer:formats=any,budget=1",
            uses: &[Use::Compile],
        },
        Example {
            recipe: "specialize,depth-prepass",
            uses: &[Use::Plan],
        },
        Example {
            recipe: "specialize,hoist",
            uses: &[Use::Plan],
        },
        Example {
            recipe: "specialize,hoist,depth-prepass",
            uses: &[Use::Plan],
        },
        Example {
            recipe: "specialize,visibility-buffer",
            uses: &[Use::Plan],
        },
        Example {
            recipe: "specialize,skip-taps:threshold=0",
            uses: &[Use::Plan],
        },
        Example {
            recipe: "specialize,skip-taps:BUDGET",
            uses: &[Use::PlanWithin],
        },
        Example {
            recipe: "specialize,hoist:BUDGET",
            uses: &[Use::PlanWithin],
        },
        Example {
            recipe: "specialize,hoist:BUDGET,depth-prepass",
            uses: &[Use::PlanWithin],
        },
    ];

    fn misnamed(plan: &Plan, params: &SpecializeParams) -> Option<Misnamed> {
        let (_, program) = examine(plan).ok()?;
        assume::misnamed(program, params.set.as_deref()?)
    }

    fn expected(_params: &SpecializeParams) -> Expected {
        Expected {
            folds_floats: true,
            ..Expected::default()
        }
    }

    fn run(plan: &Plan, facts: &Facts, params: &SpecializeParams) -> Result<Outcome, Refused> {
        let done = Specialized::new(plan, facts, params)?;
        Ok(Outcome {
            change: done.change(),
            plan: done.plan(plan, params),
            left: Vec::new(),
        })
    }
}

fn refusal(code: &RefusalInfo, reason: impl Into<String>, remedy: impl Into<String>) -> Refusal {
    Refusal::new(Specialize::INFO.name, code, reason, remedy)
}

/// A material's main pass, specialised.
pub struct Specialized {
    /// The assumptions, which a host checks.
    pub guard: Guard,
    /// Static cost of vertex and fragment stage, before and after.
    pub cost: [[f64; 2]; 2],
    program: Program,
    key: Site,
    /// Key of the replaced program.
    of: String,
    /// Float operations of the original that were removed.
    roundings: BTreeSet<(FunctionId, Handle<Expression>)>,
    /// Assumptions about implicit inputs of the stages.
    given: Vec<Assumption>,
}

impl Specialized {
    /// Specialises a plan's main pass to the known values in `facts` and `params`.
    ///
    /// # Errors
    /// A refusal: nothing in the stages depends on a known value.
    pub fn new(
        plan: &Plan,
        facts: &Facts,
        params: &SpecializeParams,
    ) -> Result<Self, Box<Refusal>> {
        let (pass, program) = examine(plan)?;
        let assumptions = assumptions(plan, program, facts, params)?;
        let graph = Graph::build(program);
        let folded = folded(&graph, pass, &assumptions, (facts, &plan.material), params);
        if folded.used.is_empty() {
            return Err(Box::new(refusal(
                &refusals::NOTHING_KNOWN,
                match assumptions.values.is_empty() {
                    true => "no value of the material is known to be constant",
                    false => {
                        "no branch, selection or integer depends on a value that is known to be \
                         constant"
                    }
                },
                match params.set {
                    Some(_) => {
                        "set values that a branch, a selection or a loop depends on (`preshade \
                         explain` names them); fold=rounding also folds weights of 0 and 1"
                    }
                    None => {
                        "set values by hand (specialize:set=NAME=NUMBER), or under `values` in a \
                         scene file; fold=rounding also folds weights of 0 and 1"
                    }
                },
            )));
        }
        let set = assumptions.set_overrides();
        let module =
            overrides::resolved(folded.module, set.map(|(handle, value, _)| (handle, value)));
        let program_folded = program.with_module(module).map_err(bug)?;
        // A value that is replaced in the text is an assumption.
        let mut used = folded.used;
        used.extend(assumptions.set_overrides().map(|(_, _, at)| at));
        let guard = assumptions.guard(&used);
        let shrunk =
            shrink::shrink(&program_folded, &pass.vertex, pass.fragment.as_deref()).map_err(bug)?;
        // Both are counted with the same facts.
        let graphs = [
            dynamic_cost::weighed(Graph::build(program), &folded.stages, &folded.records),
            as_drawn(&shrunk.program, pass, &plan.material, facts),
        ];
        let costs = |graph: &Graph<'_>| {
            let of = |stage, name: Option<&str>| {
                name.and_then(|n| graph.program().entry_point(stage, n))
                    .map_or(0.0, |(i, _)| graph.entry_cost(i))
            };
            [
                of(ShaderStage::Vertex, Some(&pass.vertex)),
                of(ShaderStage::Fragment, pass.fragment.as_deref()),
            ]
        };
        let [before, after] = graphs.each_ref().map(costs);
        let mut effects = vec![PassEffect::RemovesInputs, PassEffect::EditsFragmentStage];
        let [text, rest] = graphs.each_ref().map(|g| vertex_text(g, &pass.vertex));
        if text != rest {
            effects.push(PassEffect::EditsVertexStage);
        }
        let inputs = ImplicitInputs::new(plan, pass, &graphs[0]).replaced_by(&shrunk.program);
        let given = inputs
            .examine(Specialize::INFO.name, &effects)
            .map_err(|refusals| Refused::from(refusals).first())?;
        drop(graphs);
        Ok(Self {
            guard,
            cost: [[before[0], after[0]], [before[1], after[1]]],
            key: Site {
                role: Role::Main,
                entry_point: pass.fragment.clone().unwrap_or_else(|| pass.vertex.clone()),
                slice: shrunk.hash,
            },
            program: shrunk.program,
            of: pass.program.clone(),
            roundings: folded.roundings,
            given,
        })
    }

    pub fn program(&self) -> &Program {
        &self.program
    }

    /// A hash of the result. Draws whose values lead to the same stages share it.
    pub fn hash(&self) -> &str {
        &self.key.slice
    }

    fn change(&self) -> Change {
        let [_, [before, after]] = self.cost;
        Change {
            key: self.key.clone(),
            what: self.describe(),
            location: None,
            cost: SiteCost {
                slice: before - after,
                whole: before,
            },
        }
    }

    fn describe(&self) -> String {
        let [[vertex, less], [fragment, left]] = self.cost;
        format!(
            "{}a fragment costs {left:.0} ops instead of {fragment:.0}, a vertex {less:.0} \
             instead of {vertex:.0}",
            Guard::condition(Some(&self.guard))
        )
    }

    fn plan(self, plan: &Plan, params: &SpecializeParams) -> Plan {
        let mut next = plan.clone();
        for pass in &mut next.passes {
            if pass.program == self.of {
                reflect::fill(pass, &self.program);
            }
        }
        let mut given = vec![Assumption::SameContraction];
        next.assume(Some(self.guard.clone()), &mut given);
        if !self.roundings.is_empty() {
            given.push(Assumption::FiniteTaps);
        }
        let before = plan
            .main()
            .and_then(|pass| Some((pass, plan.program(pass)?)));
        let exposed = before.map_or_else(Exposed::default, |(pass, program)| {
            contraction::exposed(program, &self.program, pass, &self.roundings)
        });
        let is_moved = exposed.decides == Some(Surface::Rounded);
        given.extend(self.given.iter().cloned());
        if self.given.contains(&Assumption::UnchangedPosition) && !is_moved {
            next.self_test = self_test::same_position(&next);
        }
        given.sort();
        let contract = match exposed.roundings {
            0 => Contract::Exact { given },
            k => Contract::Rounding {
                k,
                turned: exposed.decides.map(|surface| Turned::on(k, surface)),
                given,
            },
        };
        next.add_step(Specialize::INFO.name, params, &self.change(), contract);
        next.fallback = Some(ORIGINAL.to_owned());
        next.programs.insert(self.of, self.program);
        next
    }
}

/// A hash of everything that a vertex stage computes.
fn vertex_text(graph: &Graph<'_>, vertex: &str) -> Option<String> {
    let (entry, _) = graph.program().entry_point(ShaderStage::Vertex, vertex)?;
    let all = [Criterion::Output(OutputFilter::All)];
    Some(slice::backward(graph, entry, &all).hash(graph))
}

fn bug(what: impl std::fmt::Display) -> Box<Refusal> {
    Box::new(Refusal::bug(Specialize::INFO.name, what))
}

fn examine(plan: &Plan) -> Result<(&GpuPass, &Program), Box<Refusal>> {
    let Some((pass, program)) = plan.main().and_then(|p| Some((p, plan.program(p)?))) else {
        return Err(Box::new(refusal(
            &shared::NO_MAIN_PASS,
            "the plan has no main pass",
            "start from the original plan",
        )));
    };
    if plan.passes.len() > 1 || !plan.compute.is_empty() || !pass.geometry.is_as_given() {
        return Err(Box::new(refusal(
            &shared::NOT_FIRST,
            "another pass of the plan draws the same surface with copies of the stages that would \
             change",
            "specialise first, then apply the other passes",
        )));
    }
    Ok((pass, program))
}

fn assumptions(
    plan: &Plan,
    program: &Program,
    facts: &Facts,
    params: &SpecializeParams,
) -> Result<Assumptions, Box<Refusal>> {
    Assumptions::new(program, &plan.material, facts, params.set.as_deref()).map_err(|e| {
        Box::new(refusal(
            &refusals::UNFIT_VALUES,
            e.to_string(),
            "`set` is `name=number`, joined by `+`; names are those of the shader",
        ))
    })
}

/// The result of folding both stages.
struct Folded {
    module: naga::Module,
    /// Assumptions that the result depends on.
    used: BTreeSet<usize>,
    /// Float operations that were removed.
    roundings: BTreeSet<(FunctionId, Handle<Expression>)>,
    stages: Vec<(&'static str, decision::Record)>,
    records: Vec<decision::Record>,
}

impl Folded {
    /// The draw-uniform decisions of both stages.
    fn decisions(&self, graph: &Graph<'_>) -> Vec<Placed> {
        let mut all = Vec::new();
        for (name, record) in &self.stages {
            decision::of_stage(graph, name, record, &self.records, &mut all);
        }
        all
    }
}

/// Folds both stages of `pass`. `facts` bound the numbers of `material`.
fn folded(
    graph: &Graph<'_>,
    pass: &GpuPass,
    assumptions: &Assumptions,
    (facts, material): (&Facts, &str),
    params: &SpecializeParams,
) -> Folded {
    let (program, module) = (graph.program(), graph.module());
    let entries = pass.stages().into_iter();
    let entries = entries.filter(|_| params.fold == Fold::Rounding);
    let entries = entries.filter_map(|(stage, name)| program.entry_point(stage, name));
    let values = entries.map(|(entry, _)| Values::new(graph, entry));
    // In a stage that is too large, the effect of a zero's sign is unknown.
    let values: Option<Vec<Values<'_, '_>>> = values.map(Result::ok).collect();
    let zeros = values.as_ref().map(|values| {
        let zeros = values.iter().map(|v| Zeros::new(v, facts, material));
        zeros.collect::<Vec<_>>()
    });
    let leaves = |function, e, dropped| {
        let stages = zeros.as_ref();
        stages.is_some_and(|stages| zero::left_out(stages, function, e, dropped).is_ok())
    };
    let mut folder = Folder::new(graph, assumptions, (params.fold, &leaves), params.unroll);
    let mut stages: Vec<(usize, &'static str, FoldedStage)> = Vec::new();
    let mut varyings = Vec::new();
    if let Some((vertex, point)) = program.entry_point(ShaderStage::Vertex, &pass.vertex) {
        let known = |io: &interface::Io| match io.binding {
            Some(Binding::Location { location, .. }) => {
                assumptions.attribute(location, &module.types[io.ty].inner)
            }
            _ => AbstractValue::Unknown,
        };
        let arguments = arguments(module, &point.function, &known);
        let stage = folder.stage(vertex, arguments);
        let outputs = interface::outputs(module, &point.function);
        let is_struct = point
            .function
            .result
            .as_ref()
            .is_some_and(|r| r.binding.is_none());
        varyings = outputs
            .into_iter()
            .enumerate()
            .filter_map(|(i, io)| match io.binding {
                Some(Binding::Location { location, .. }) => {
                    let value = if is_struct {
                        stage.result.part(i)
                    } else {
                        stage.result.clone()
                    };
                    Some((location, value))
                }
                _ => None,
            })
            .collect();
        stages.push((vertex, "vertex", stage));
    }
    let fragment = pass
        .fragment
        .as_deref()
        .and_then(|f| program.entry_point(ShaderStage::Fragment, f));
    if let Some((fragment, point)) = fragment {
        let known = |io: &interface::Io| match io.binding {
            Some(Binding::Location {
                location,
                interpolation,
                ..
            }) => {
                let found = varyings.iter().find(|(l, _)| *l == location);
                let value = found.map(|(_, v)| v.assumed_only()).unwrap_or_default();
                match interpolation {
                    Some(Interpolation::Flat) => value,
                    _ => interpolated(&value),
                }
            }
            _ => AbstractValue::Unknown,
        };
        let arguments = arguments(module, &point.function, &known);
        stages.push((fragment, "fragment", folder.stage(fragment, arguments)));
    }
    let (types, functions, records) = folder.into_parts();
    let (mut used, mut roundings) = (BTreeSet::new(), BTreeSet::new());
    for (_, _, stage) in &stages {
        let (more, left_out) = stage.record.with_callees(&records);
        used.extend(more);
        roundings.extend(left_out);
    }
    let mut module = module.clone();
    (module.types, module.functions) = (types, functions);
    let kept: Vec<usize> = stages.iter().map(|(entry, ..)| *entry).collect();
    let mut notes = Vec::new();
    for (entry, name, stage) in stages {
        module.entry_points[entry].function = stage.function;
        notes.push((name, stage.record));
    }
    // Other entry points call functions that no longer exist.
    let mut index = 0;
    module.entry_points.retain(|_| {
        index += 1;
        kept.contains(&(index - 1))
    });
    Folded {
        module,
        used,
        roundings,
        stages: notes,
        records,
    }
}

/// The abstract values of an entry point's arguments, struct arguments by member.
fn arguments(
    module: &naga::Module,
    function: &naga::Function,
    known: &dyn Fn(&interface::Io) -> AbstractValue,
) -> Vec<AbstractValue> {
    function
        .arguments
        .iter()
        .map(|argument| {
            let members = interface::opened(module, std::slice::from_ref(argument));
            let is_struct = argument.binding.is_none()
                && matches!(
                    module.types[argument.ty].inner,
                    naga::TypeInner::Struct { .. }
                );
            match (is_struct, members.as_slice()) {
                (true, members) => AbstractValue::Parts(members.iter().map(known).collect()),
                (false, [one]) => known(one),
                _ => AbstractValue::Unknown,
            }
        })
        .collect()
}

/// The abstract value between vertices: interpolating equal values does not return them exactly.
fn interpolated(known: &AbstractValue) -> AbstractValue {
    known.clone().map(&|scalar, sources| match scalar {
        Scalar::Number(kind @ naga::ScalarKind::Float, x) => {
            let rounded = Scalar::number(kind, x.rounded(Accuracy::ulps(64.0)));
            rounded.map_or(AbstractValue::Unknown, |s| {
                AbstractValue::Scalar(s, sources)
            })
        }
        _ => AbstractValue::Unknown,
    })
}
