//! `preamble`: what only uniforms decide is computed once a draw.
//!
//! Goal: a material normalises its light's direction, takes exponentials of its settings, or walks
//! its lights to sum up their ambient part. All fragments of a draw get the same result.
//!
//! ```text
//! before:  fs(uv):  exposure = exp2(camera.stops);  ..  color * exposure
//!
//! after:   compute, once a draw:  preamble_values.exposure = exp2(camera.stops)
//!          fs(uv):  exposure = preamble_values.exposure;  ..  color * exposure
//! ```
//!
//! A minimum cut chooses the values. They are cut out as `hoist` cuts
//! out its own, but their destination is a compute pass of one invocation for each draw, ahead of
//! the frame's render passes. It has the draw's bindings, and fills a buffer that the main pass
//! reads as a uniform.
//!
//! | value | contract |
//! |---|---|
//! | no compiler fuses it into what reads it (an exponential, an index, a condition's number) | `Exact` |
//! | a compiler may (a product that is read by a sum) | `Rounding`, with `allow=rounding` |
//!
//! Many drivers do this themselves: Mesa's for Adreno and Apple, Arm's and Imagination's.
//! There, a dispatch is added and nothing is saved.
//!
//! Storage buffers stay, because an earlier pass of the frame may write them after the compute pass. A texture read
//! moves if it names its level, its coordinates are the draw's, and the scene or the captured frame shows that no pass
//! writes the texture.
//! Uniforms must be written before the compute pass.
//!
//! A loop may end at a number in a uniform buffer. The plan then has a [guard](../guides/specialize.md#the-guard) for it.

use naga::{
    AddressSpace, Expression, Function, GlobalVariable, Handle, Module, ResourceBinding,
    ShaderStage, Span, Statement, StorageAccess,
};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::analysis::implicit_inputs::{ImplicitInputs, PassEffect};
use crate::analysis::loops::LoopEnds;
use crate::analysis::named::span;
use crate::analysis::simplify::{self, FragmentStage};
use crate::analysis::values::{ValueId, Values};
use crate::analysis::{below, refusals as shared, rounding};
use crate::graph::FunctionId;
use crate::graph::effect::Effect;
use crate::rebuild::outline::{self, Extracted, Failed, Names, Wanted};
use crate::rebuild::place::{self, CodeBuilder, Rewrite};
use crate::rebuild::remainder::{self, Given};
use crate::slice::Termination;
use preshade_plan::contract::{Assumption, Contract};
use preshade_plan::geometry::Geometry;
use preshade_plan::guard::Guard;
use preshade_plan::pass::{
    Change, Example, Facts, Left, MaterialTexture, Outcome, Pass, PassInfo, Refusal, Refused, Site,
    SiteCost, Source, Use,
};
use preshade_plan::plan::{
    BindingKind, BindingSource, BindingUse, ComputePass, DrawBuffer, GeometryPart, ORIGINAL, Plan,
    Role,
};
use preshade_plan::program::Program;
use preshade_plan::reflect;
use preshade_text::refusals::RefusalInfo;

mod values;

use values::{Choice, Class, Judged, Stays, Terms};

/// The pass.
pub struct Preamble;

/// The weakest contract for a moved value.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Allow {
    /// Only values that no compiler fuses into what reads them.
    #[default]
    Exact,
    /// Also values that may round otherwise.
    Rounding,
}

/// Parameters.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
pub struct Params {
    /// The weakest contract for a moved value.
    pub allow: Allow,
    /// Most vectors of four numbers that a draw stores.
    #[schemars(range(min = 1, max = 1024))]
    pub limit: u32,
    /// Least static cost that each fragment must save, in ops.
    #[schemars(range(min = 0.0))]
    pub least: f64,
}

impl Default for Params {
    fn default() -> Self {
        Self {
            allow: Allow::Exact,
            limit: 16,
            least: 8.0,
        }
    }
}

impl Pass for Preamble {
    type Params = Params;

    const INFO: PassInfo = PassInfo {
        name: "preamble",
        summary: "computes what only uniforms decide once a draw, and reads it back as a uniform",
        source: "Mesa's nir_opt_preamble; \
                 the preshaders of Direct3D 9's effect compiler (Microsoft, D3DX)",
        when: "fragments compute what is the same for the whole draw (exponentials of settings, \
               sums over lights), and the driver has no preamble of its own",
        hurts: "where draws are small or many, because each gets a dispatch; and where the driver \
                does the same by itself (Mesa's for Adreno and Apple; Arm's; \
                Imagination's)",
        reads_scene: true,
    };

    const REFUSALS: &'static [RefusalInfo] = &[];

    const EXAMPLES: &'static [Example] = &[
        Example {
            recipe: "preamble",
            uses: &[
                Use::Snapshot,
                Use::Inject,
                Use::Fuzz,
                Use::Plan,
                Use::ExactWhereApplied,
                Use::Page("shaders/studio"),
                Use::Picture {
                    scene: "fixtures/scenes/studio.toml --size 256x144 --frames 1",
                    caption: "exposure, fog and falloff computed once a draw: no pixel differs",
                    rows: 1,
                },
            ],
        },
        Example {
            recipe: "preamble:allow=rounding",
            uses: &[Use::Snapshot],
        },
        Example {
            recipe: "preamble:allow=rounding,limit=1,least=0",
            uses: &[Use::Fuzz, Use::Compile],
        },
    ];

    fn run(plan: &Plan, facts: &Facts, params: &Params) -> Result<Outcome, Refused> {
        let stage = simplify::examine(
            plan,
            Self::INFO.name,
            "take `preamble` ahead of the passes that draw the material again, and behind those \
             that change its fragment stage",
            "there is nothing to compute ahead",
        )?;
        let id = FunctionId::EntryPoint(stage.entry);
        let writes = [Effect::Store, Effect::ImageStore, Effect::Atomic];
        if stage.graph.effects(id).iter().any(|e| writes.contains(e)) {
            return Err(refuse(
                &shared::FRAGMENT_STORES,
                "the fragment stage writes memory, and `preamble` does not follow what it writes",
                "move the writes to a pass of their own",
            )
            .into());
        }
        let values = Values::new(&stage.graph, stage.entry)
            .map_err(|e| refuse(&shared::TOO_LARGE, e.to_string(), "split the shader"))?;
        let found = Found::new(plan, &stage, &values, facts, params)?;
        let built = match found.rebuild() {
            Ok(built) => built,
            Err(why) => return Err((Box::new(failed(why)), found.left).into()),
        };
        let inputs = ImplicitInputs::new(plan, stage.pass, &stage.graph).replaced_by(&built.main);
        inputs.examine(Self::INFO.name, &[PassEffect::RemovesInputs])?;
        Ok(found.outcome(plan, built, params))
    }
}

fn refuse(
    code: &RefusalInfo,
    reason: impl Into<String>,
    remedy: impl Into<String>,
) -> Box<Refusal> {
    Box::new(Refusal::new(Preamble::INFO.name, code, reason, remedy))
}

/// A rebuild that failed.
fn failed(why: Failed) -> Refusal {
    let name = Preamble::INFO.name;
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

impl Params {
    fn terms(&self) -> Terms {
        Terms {
            weakest: match self.allow {
                Allow::Exact => Class::Exact,
                Allow::Rounding => Class::Rounded,
            },
            limit: self.limit,
            least: self.least,
        }
    }
}

/// Values that pay.
struct Found<'v, 'g, 'p> {
    stage: &'v FragmentStage<'p>,
    values: &'v Values<'g, 'p>,
    choice: Choice,
    wanted: Vec<Wanted>,
    left: Vec<Left>,
    /// Whether the ranges of the values' sources are those of a scene.
    has_ranges: bool,
    /// The guard under which its loops end.
    guard: Option<Guard>,
}

impl<'v, 'g, 'p> Found<'v, 'g, 'p> {
    fn new(
        plan: &Plan,
        stage: &'v FragmentStage<'p>,
        values: &'v Values<'g, 'p>,
        facts: &Facts,
        params: &Params,
    ) -> Result<Self, (Box<Refusal>, Vec<Left>)> {
        // Locations and bindings are the author's; an earlier step may have reassigned locations.
        let is_rebuilt = !plan.steps.is_empty();
        let known: Vec<_> = facts
            .ranges
            .iter()
            .filter(|r| r.material == plan.material)
            .filter(|r| !is_rebuilt || !matches!(r.source, Source::Varying { .. }))
            .cloned()
            .collect();
        let is_steady = |at: &ResourceBinding| {
            let is_it = |s: &MaterialTexture| {
                s.material == plan.material && (s.group, s.binding) == (at.group, at.binding)
            };
            facts.steady_textures.iter().any(is_it)
        };
        let judged = values::judge(values, &known, rounding::most(stage.pass), &is_steady);
        let weakest = params.terms().weakest;
        let left = below::left(values, MOST_LEFT, |id| why(&judged, weakest, id));
        let Some(choice) = values::choose(values, &judged, &params.terms()) else {
            return Err((nothing(values, &judged, params), left));
        };
        let wanted = outline::wanted(values, choice.moved.iter().copied(), "constant");
        let is_moved = |l: &Left| wanted.iter().any(|w| w.name == l.name);
        Ok(Self {
            stage,
            values,
            left: left.into_iter().filter(|l| !is_moved(l)).collect(),
            guard: LoopEnds::new(values).guard(values, &choice.moved),
            choice,
            wanted,
            has_ranges: !known.is_empty(),
        })
    }

    fn rebuild(&self) -> Result<Built, Failed> {
        let program = self.stage.graph.program();
        let pass = self.stage.pass;
        let fragment = pass.fragment.as_deref().unwrap_or_default();
        let extracted = outline::extract(program, self.values, &self.wanted, &NAMES)?;
        // The slice reads what the values do not depend on: a decision of the fragment stage.
        if !extracted.arguments.is_empty() {
            return Err(Failed::NotSeparable);
        }
        let Extracted {
            mut module,
            function,
            ..
        } = extracted;
        let result = module.functions[function].result.as_ref().map(|r| r.ty);
        let ty = result.ok_or_else(|| Failed::Built("it returns nothing".to_owned()))?;
        let (group, binding) = reflect::free_binding(program.module());
        let stored = Stored {
            size: module.types[ty].inner.size(module.to_ctx()),
            variable: GlobalVariable {
                name: Some(free_name(&module)),
                space: AddressSpace::Uniform,
                binding: Some(ResourceBinding { group, binding }),
                ty,
                init: None,
                memory_decorations: Default::default(),
            },
            members: self.wanted.len() as u32,
        };
        let entry = format!("{fragment}_preamble");
        let compute = stored.computed(module.clone(), function, &entry);
        let compute = place::retain(&compute, &[(ShaderStage::Compute, &entry)]);
        let global = module
            .global_variables
            .append(stored.variable.clone(), Span::UNDEFINED);
        let read = &mut |build: &mut CodeBuilder<'_>| stored.read(build, global, &self.wanted);
        let kept = Termination::under(self.guard.as_ref());
        let main = remainder::rebuild(program, &module, self.values, &self.wanted, kept, read)?;
        let entries = [
            (ShaderStage::Vertex, pass.vertex.as_str()),
            (ShaderStage::Fragment, fragment),
        ];
        Ok(Built {
            main: program.with_module(place::retain(&main, &entries))?,
            compute: program.with_module(compute)?,
            entry,
            at: [group, binding],
            size: stored.size,
        })
    }

    fn outcome(self, plan: &Plan, built: Built, params: &Params) -> Outcome {
        let mut next = plan.clone();
        let values = built.binding();
        let mut bindings = self.stage.pass.bindings.clone();
        bindings.push(values.clone());
        let compute = ComputePass {
            bindings,
            ..ComputePass::new(COMPUTE, built.entry, 1, Geometry::Draw)
        };
        next.add_compute(compute, built.compute);
        for pass in &mut next.passes {
            pass.bindings.push(values.clone());
            reflect::fill(pass, &built.main);
        }
        next.draw_buffers.push(DrawBuffer {
            name: VALUES.to_owned(),
            size: built.size,
        });
        let program = self.stage.pass.program.clone();
        next.programs.insert(program, built.main);
        let mut given = self.given();
        next.assume(self.guard.clone(), &mut given);
        let contract = self.contract(given);
        let change = self.change();
        next.add_step(Preamble::INFO.name, params, &change, contract);
        for name in values::textures(self.values, &self.choice.moved) {
            next.notes.push(format!(
                "`{name}` is read at the start of the frame: if a pass writes it before the draw, take the original"
            ));
        }
        next.fallback = Some(ORIGINAL.to_owned());
        Outcome {
            plan: next,
            change,
            left: self.left,
        }
    }

    fn given(&self) -> Vec<Assumption> {
        let mut given = self.stage.given.clone();
        given.push(Assumption::StagesAgree);
        if !values::textures(self.values, &self.choice.moved).is_empty() {
            given.push(Assumption::SteadyTextures);
        }
        if self.choice.class == Class::Rounded {
            given.push(match self.has_ranges {
                true => Assumption::NumbersOfTheScene,
                false => Assumption::OrdinaryNumbers,
            });
        }
        given
    }

    fn contract(&self, given: Vec<Assumption>) -> Contract {
        match self.choice.class {
            Class::Exact => Contract::Exact { given },
            Class::Rounded => Contract::Rounding {
                k: self.choice.roundings,
                turned: None,
                given,
            },
        }
    }

    fn change(&self) -> Change {
        let moved = || self.choice.moved.iter().copied();
        let sources = self.stage.graph.program().sources();
        let names: Vec<String> = self
            .wanted
            .iter()
            .map(|w| format!("`{}`", w.name))
            .collect();
        Change {
            key: Site {
                role: Role::Main,
                entry_point: self.stage.pass.fragment.clone().unwrap_or_default(),
                slice: outline::hash(self.values, moved()),
            },
            what: format!(
                "{}computes {} once a draw ({:.0} ops); a fragment costs {:.0} ops instead of {:.0}",
                Guard::condition(self.guard.as_ref()),
                names.join(", "),
                self.choice.once,
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

const NAMES: Names = Names {
    function: "preamble",
    values: "Preamble",
};

/// Key of the compute pass's program.
const COMPUTE: &str = "preamble";

/// Name of the buffer between it and the main pass.
const VALUES: &str = "preamble";

/// The programs of both passes.
struct Built {
    main: Program,
    compute: Program,
    /// Entry point of the compute pass.
    entry: String,
    /// Group and binding of the values.
    at: [u32; 2],
    /// Bytes of the values.
    size: u32,
}

impl Built {
    /// The values' binding with its source, for [`reflect::fill`].
    fn binding(&self) -> BindingUse {
        let part = GeometryPart::Values {
            buffer: VALUES.to_owned(),
        };
        let source = BindingSource::Geometry { part };
        BindingUse::new(self.at, BindingKind::Uniform, source)
    }
}

/// The variable that holds the values.
struct Stored {
    /// As the main pass declares it.
    variable: GlobalVariable,
    size: u32,
    /// Number of values. Several are members of a struct.
    members: u32,
}

impl Stored {
    /// The module with a compute entry point that stores what `function` returns.
    fn computed(&self, mut module: Module, function: Handle<Function>, name: &str) -> Module {
        let access = StorageAccess::LOAD | StorageAccess::STORE;
        let variable = GlobalVariable {
            space: AddressSpace::Storage { access },
            ..self.variable.clone()
        };
        let variable = module.global_variables.append(variable, Span::UNDEFINED);
        module.entry_points.push(naga::EntryPoint {
            name: name.to_owned(),
            stage: ShaderStage::Compute,
            early_depth_test: None,
            workgroup_size: [1; 3],
            workgroup_size_overrides: None,
            function: Function {
                name: Some(name.to_owned()),
                ..Function::default()
            },
            mesh_info: None,
            task_payload: None,
            incoming_ray_payload: None,
        });
        let entry = FunctionId::EntryPoint(module.entry_points.len() - 1);
        place::rewritten(&module, entry, |build| {
            let pointer = build.expression(Expression::GlobalVariable(variable));
            let Some(value) = build.call(function, Vec::new()) else {
                return Rewrite::default();
            };
            if self.members == 1 {
                build.statement(Statement::Store { pointer, value });
                return Rewrite::default();
            }
            // GLSL's block is no struct that takes a whole one.
            for index in 0..self.members {
                let of = |base| Expression::AccessIndex { base, index };
                let (pointer, value) = (build.expression(of(pointer)), build.expression(of(value)));
                build.statement(Statement::Store { pointer, value });
            }
            Rewrite::default()
        })
    }

    /// Reads the values.
    fn read(
        &self,
        build: &mut CodeBuilder<'_>,
        variable: Handle<GlobalVariable>,
        wanted: &[Wanted],
    ) -> Given {
        let base = build.expression(Expression::GlobalVariable(variable));
        let mut given = Given::new();
        for (i, value) in wanted.iter().enumerate() {
            let pointer = match self.members > 1 {
                true => build.expression(Expression::AccessIndex {
                    base,
                    index: i as u32,
                }),
                false => base,
            };
            let value = build.named(&value.name, Expression::Load { pointer });
            given.insert(i, value);
        }
        given
    }
}

/// A name that no variable or function has.
fn free_name(module: &Module) -> String {
    let variables = module.global_variables.iter();
    let variables: Vec<_> = variables.filter_map(|(_, v)| v.name.as_deref()).collect();
    let mut name = place::free_name(module, NAMES.function, "values");
    while variables.contains(&name.as_str()) {
        name.push_str("_of_draw");
    }
    name
}

/// The refusal if nothing pays, with the one parameter that would help.
fn nothing(values: &Values<'_, '_>, judged: &Judged, params: &Params) -> Box<Refusal> {
    let pays = |params: &Params| values::choose(values, judged, &params.terms()).is_some();
    let rounding = Params {
        allow: Allow::Rounding,
        ..params.clone()
    };
    let all = Params {
        least: 1.0,
        ..rounding.clone()
    };
    let remedy = match () {
        () if pays(&rounding) => {
            "give `allow=rounding`: values would move that a compiler may fuse into what reads them"
        }
        () if pays(&all) => "give `least=1`, and `allow=rounding` if that alone does not help",
        () => "leave it as it is",
    };
    refuse(
        &shared::NOTHING_PAYS,
        format!(
            "no value of the fragment stage that only the draw decides saves {} ops",
            params.least
        ),
        remedy,
    )
}

/// Why a value that only the draw decides is not moved; `None`: something else decides it, or it is
/// not worth a word.
fn why(judged: &Judged, weakest: Class, id: ValueId) -> Option<String> {
    match judged.verdicts[id] {
        Ok(class) if class <= weakest => Some("it saves too little".to_owned()),
        Ok(_) => {
            Some("a compiler may fuse it into what reads it: `allow=rounding` moves it".to_owned())
        }
        Err(Stays::NotOfDraw | Stays::NotWorth) => None,
        Err(stays) => Some(stays.to_string()),
    }
}

/// Most values to report.
const MOST_LEFT: usize = 100;
