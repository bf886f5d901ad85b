//! `preamble`: once a draw, computes the values that depend on uniforms alone.
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
//! A minimum cut chooses the values. The pass cuts them out as `hoist` cuts out its own. Their
//! destination is a compute pass of one invocation for each draw, ahead of the frame's render passes.
//! It has the draw's bindings, and fills a buffer that the main pass reads as a uniform.
//!
//! | value | contract |
//! |---|---|
//! | no compiler fuses it into its readers (an exponential, an index, a condition's number) | `Exact` |
//! | a compiler may (a product that is read by a sum) | `Rounding`, with `allow=rounding` |
//!
//! Many drivers do this themselves: Mesa's for Adreno and Apple, Arm's and Imagination's.
//! There, a dispatch is added and nothing is saved.
//!
//! Storage buffers stay, because an earlier pass of the frame may write them after the compute pass. A
//! texture read moves if it names its level and its coordinates are the draw's. The scene or the
//! captured frame must also show that no pass writes the texture. Uniforms must be written before the
//! compute pass.
//!
//! A loop may end at a number in a uniform buffer. The plan then has a [guard](../guides/specialize.md#the-guard) for it.

use naga::{
    AddressSpace, Expression, Function, GlobalVariable, Handle, Module, ResourceBinding,
    ShaderStage, Span, Statement, StorageAccess,
};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::analysis::implicit_inputs::{ImplicitInputs, PassEffect};
use crate::analysis::simplify::{self, FragmentStage};
use crate::analysis::values::{ValueId, Values};
use crate::analysis::{refusals as shared, rounding, transitive_cost};
use crate::rebuild::moved::MovedValues;
use crate::rebuild::outline::{self, Extracted, Failed, Names, Wanted};
use crate::rebuild::place::{self, CodeBuilder, Rewrite};
use crate::rebuild::remainder::Given;
use preshade_dataflow::graph::FunctionId;
use preshade_dataflow::slice::Termination;
use preshade_plan::contract::{Assumption, Contract};
use preshade_plan::geometry::Geometry;
use preshade_plan::pass::{
    Example, Facts, Left, MaterialTexture, Outcome, Pass, PassInfo, Refusal, Refused, Use,
};
use preshade_plan::plan::{
    BindingKind, BindingSource, BindingUse, Change, ComputePass, DrawBuffer, GeometryPart, Plan,
    SiteCost,
};
use preshade_plan::program::Program;
use preshade_plan::reflect;
use shader_text::refusals::RefusalInfo;

mod values;

use values::{Class, NotOncePerDraw, StoredValues, Terms, Verdicts};

pub struct Preamble;

/// The weakest contract for a moved value.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Allow {
    /// Only values that no compiler fuses into their readers.
    #[default]
    Exact,
    /// Also values that may round otherwise.
    Rounding,
}

/// Parameters.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
pub struct PreambleParams {
    /// The weakest contract for a moved value.
    pub allow: Allow,
    /// Most vectors of four numbers that a draw stores.
    #[schemars(range(min = 1, max = 1024))]
    pub limit: u32,
    /// Least static cost that each fragment must save, in ops.
    #[schemars(range(min = 0.0))]
    pub least: f64,
}

impl Default for PreambleParams {
    fn default() -> Self {
        Self {
            allow: Allow::Exact,
            limit: 16,
            least: 8.0,
        }
    }
}

impl Pass for Preamble {
    type Params = PreambleParams;

    const INFO: PassInfo = PassInfo {
        name: "preamble",
        summary: "computes what only uniforms decide once a draw, and reads it back as a uniform",
        source: "Mesa's nir_opt_preamble; \
                 the preshaders of Direct3D 9's effect compiler (Microsoft, D3DX)",
        when: "fragments compute values that are the same for the whole draw (exponentials of \
               settings, sums over lights), and the driver has no preamble of its own",
        hurts: "where draws are small or many, because each gets a dispatch; and where the driver \
                does the same by itself (Mesa's for Adreno and Apple; Arm's; Imagination's)",
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

    fn run(plan: &Plan, facts: &Facts, params: &PreambleParams) -> Result<Outcome, Refused> {
        let stage = simplify::examine(
            plan,
            Self::INFO.name,
            "take `preamble` ahead of the passes that draw the material again, and behind those \
             that change its fragment stage",
            "there is nothing to compute ahead",
        )?;
        let values = Values::examine(&stage.graph, stage.entry, Self::INFO.name)?;
        let constants = DrawConstants::new(plan, &stage, &values, facts, params)?;
        let built = constants
            .rebuild()
            .map_err(|why| constants.moved.refused(why.refusal(Self::INFO.name)))?;
        let inputs = ImplicitInputs::new(plan, stage.pass, &stage.graph).replaced_by(&built.main);
        inputs.examine(Self::INFO.name, &[PassEffect::RemovesInputs])?;
        Ok(constants.outcome(plan, built, params))
    }
}

impl PreambleParams {
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

/// The values that are computed once a draw.
struct DrawConstants<'v, 'g, 'p> {
    stage: &'v FragmentStage<'p>,
    moved: MovedValues<'v, 'g, 'p>,
    choice: StoredValues,
    /// Whether the ranges of the values' sources are those of a scene.
    has_ranges: bool,
}

impl<'v, 'g, 'p> DrawConstants<'v, 'g, 'p> {
    fn new(
        plan: &Plan,
        stage: &'v FragmentStage<'p>,
        values: &'v Values<'g, 'p>,
        facts: &Facts,
        params: &PreambleParams,
    ) -> Result<Self, (Box<Refusal>, Vec<Left>)> {
        let known = facts.ranges_of(&plan.material, !plan.steps.is_empty());
        let is_steady = |at: &ResourceBinding| {
            let is_it = |s: &MaterialTexture| {
                s.material == plan.material && (s.group, s.binding) == (at.group, at.binding)
            };
            facts.steady_textures.iter().any(is_it)
        };
        let judged = values::judge(values, &known, rounding::most(stage.pass), &is_steady);
        let weakest = params.terms().weakest;
        let left = transitive_cost::left(values, MOST_LEFT, |id| why(&judged, weakest, id));
        let Some(choice) = values::choose(values, &judged, &params.terms()) else {
            return Err((nothing(values, &judged, params), left));
        };
        Ok(Self {
            stage,
            moved: MovedValues::new(values, choice.moved.clone(), "constant", left),
            choice,
            has_ranges: !known.is_empty(),
        })
    }

    fn rebuild(&self) -> Result<Built, Failed> {
        let (program, wanted) = (self.stage.graph.program(), &self.moved.wanted);
        let pass = self.stage.pass;
        let fragment = pass.fragment.as_deref().unwrap_or_default();
        let extracted = outline::extract(program, self.moved.values, wanted, &NAMES)?;
        // The slice reads a decision of the fragment stage that the values do not depend on.
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
            members: wanted.len() as u32,
        };
        let entry = format!("{fragment}_preamble");
        let compute = stored.computed(module.clone(), function, &entry);
        let compute = place::retain(&compute, &[(ShaderStage::Compute, &entry)]);
        let global = module
            .global_variables
            .append(stored.variable.clone(), Span::UNDEFINED);
        let read = &mut |build: &mut CodeBuilder<'_>| stored.read(build, global, wanted);
        let loops = Termination::under(self.moved.guard.as_ref());
        let main = self.moved.remainder(&module, loops, read)?;
        Ok(Built {
            main: program.with_module(place::retain(&main, &pass.stages()))?,
            compute: program.with_module(compute)?,
            entry,
            at: [group, binding],
            size: stored.size,
        })
    }

    fn outcome(self, plan: &Plan, built: Built, params: &PreambleParams) -> Outcome {
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
        let textures = values::textures(self.moved.values, &self.moved.ids);
        let given = self.given(!textures.is_empty());
        let change = self.change();
        let choice = self.choice;
        let step = (Preamble::INFO.name, params);
        let mut outcome = self
            .moved
            .outcome(next, step, change, given, |given| choice.contract(given));
        outcome.plan.notes.extend(textures.iter().map(|name| {
            format!(
                "`{name}` is read at the start of the frame: if a pass writes it before the draw, \
                 take the original"
            )
        }));
        outcome
    }

    fn given(&self, reads_textures: bool) -> Vec<Assumption> {
        let mut given = self.stage.given.clone();
        given.push(Assumption::StagesAgree);
        given.extend(reads_textures.then_some(Assumption::SteadyTextures));
        if self.choice.class == Class::Rounded {
            given.push(match self.has_ranges {
                true => Assumption::NumbersOfTheScene,
                false => Assumption::OrdinaryNumbers,
            });
        }
        given
    }

    fn change(&self) -> Change {
        let choice = &self.choice;
        let what = format!(
            "computes {} once a draw ({:.0} ops); a fragment costs {:.0} ops instead of {:.0}",
            self.moved.names(),
            choice.once,
            choice.after,
            choice.before
        );
        let cost = SiteCost {
            slice: choice.before - choice.after,
            whole: choice.before,
        };
        self.moved.change(self.stage.pass, &what, cost)
    }
}

impl StoredValues {
    fn contract(&self, given: Vec<Assumption>) -> Contract {
        match self.class {
            Class::Exact => Contract::Exact { given },
            Class::Rounded => Contract::Rounding {
                k: self.roundings,
                turned: None,
                given,
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
    /// Size of the values in bytes.
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
    /// The module with a compute entry point that stores the result of `function`.
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
fn nothing(values: &Values<'_, '_>, judged: &Verdicts, params: &PreambleParams) -> Box<Refusal> {
    let pays = |params: &PreambleParams| values::choose(values, judged, &params.terms()).is_some();
    let rounding = PreambleParams {
        allow: Allow::Rounding,
        ..params.clone()
    };
    let all = PreambleParams {
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
    let reason = format!(
        "no value of the fragment stage that only the draw decides saves {} ops",
        params.least
    );
    let (name, code) = (Preamble::INFO.name, &shared::NOTHING_PAYS);
    Box::new(Refusal::new(name, code, reason, remedy))
}

/// Why a value that only the draw decides is not moved; `None`: something else decides it, or it is
/// not worth a word.
fn why(judged: &Verdicts, weakest: Class, id: ValueId) -> Option<String> {
    match judged.verdicts[id] {
        Ok(class) if class <= weakest => Some("it saves too little".to_owned()),
        Ok(_) => {
            Some("a compiler may fuse it into what reads it: `allow=rounding` moves it".to_owned())
        }
        Err(NotOncePerDraw::NotOfDraw | NotOncePerDraw::NotWorth) => None,
        Err(stays) => Some(stays.to_string()),
    }
}

/// Most values to report.
const MOST_LEFT: usize = 100;
