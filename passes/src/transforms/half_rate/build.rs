//! The two stages, one that computes the values and one that reads them, and the plan with both passes.

use naga::{
    Binding, BuiltIn, Expression, Function, FunctionResult, Handle, ImageClass, ImageDimension,
    Literal, Module, SampleLevel, Scalar, ShaderStage, Statement, TypeInner, UnaryOperator,
    VectorSize,
};

use super::{Edges, HalfRate, HalfRateParams, HalvedValues, text, values};
use crate::rebuild::color;
use crate::rebuild::outline::{self, Extracted, Failed, Names};
use crate::rebuild::place::{self, CodeBuilder, Replacement, Rewrite};
use crate::rebuild::remainder::Given;
use crate::rebuild::snippet::{Linked, ours};
use preshade_dataflow::graph::FunctionId;
use preshade_dataflow::slice::Termination;
use preshade_plan::budget::Budget;
use preshade_plan::contract::Contract;
use preshade_plan::pass::{Outcome, Pass};
use preshade_plan::plan::{
    Attachment, BindingKind, BindingSource, BindingUse, Change, Draws, GpuPass, Phase, Plan, Role,
    SiteCost,
};
use preshade_plan::program::Program;
use preshade_plan::reflect;
use preshade_plan::state::ColorTarget;

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
pub(super) struct Built {
    pub main: Program,
    pub half: Program,
    /// Fragment entry point of the half-rate pass.
    pub entry: String,
    /// Group of the targets' bindings, and the first.
    pub at: [u32; 2],
    pub edges: Edges,
}

impl HalvedValues<'_, '_, '_> {
    /// The programs of both passes.
    ///
    /// # Errors
    /// [`Failed`].
    pub(super) fn rebuild(&self) -> Result<Built, Failed> {
        let program = self.stage.graph.program();
        let pass = self.stage.pass;
        let fragment = pass.fragment.as_deref().unwrap_or_default();
        let computed = Called::new(outline::extract(
            program,
            self.moved.values,
            &self.moved.wanted,
            &NAMES,
        )?);
        let mut module = computed.module;
        let computed = computed.part;
        let mut guide = None;
        if !self.guides.is_empty() {
            let with = program.with_module(module)?;
            let found = Called::new(outline::extract(
                &with,
                self.moved.values,
                &self.guides,
                &GUIDE,
            )?);
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
        // The half-rate pass runs the loops that decided.
        let loops = Termination::Assumed;
        let read = &mut |build: &mut CodeBuilder<'_>| {
            self.read(build, read, &computed, guide.as_ref(), edges)
        };
        let main = self.moved.remainder(&module, loops, read)?;
        Ok(Built {
            main: program.with_module(place::retain(&main, &pass.stages()))?,
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
        computed: &PartCall,
        guide: Option<&PartCall>,
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
            let mut values = computed.called(build, self.moved.wanted.len(), Some(pixel), &mut at);
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
        computed: &PartCall,
        guide: Option<&PartCall>,
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
        let count = self.moved.wanted.len();
        if edges == Edges::Blended {
            return (self.moved.wanted.iter().enumerate())
                .map(|(i, wanted)| {
                    let value = member(build, i);
                    build.name(value, &wanted.name);
                    (i, value)
                })
                .collect();
        }
        let mut pointers = Vec::new();
        for (i, wanted) in self.moved.wanted.iter().enumerate() {
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
        let loaded = pointers.iter().zip(&self.moved.wanted).enumerate();
        loaded
            .map(|(i, (pointer, wanted))| {
                let value = build.named(&wanted.name, Expression::Load { pointer: *pointer });
                (i, value)
            })
            .collect()
    }
}

/// A function cut out of the fragment stage, and its inputs.
struct Called {
    module: Module,
    part: PartCall,
}

struct PartCall {
    function: Handle<Function>,
    arguments: Vec<Vec<Binding>>,
}

impl Called {
    fn new(extracted: Extracted) -> Self {
        Self {
            module: extracted.module,
            part: PartCall {
                function: extracted.function,
                arguments: extracted.arguments,
            },
        }
    }
}

impl PartCall {
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
        let implicit = of(|e| {
            let level = match e {
                Expression::ImageSample { level, .. } => level,
                _ => return false,
            };
            matches!(level, SampleLevel::Auto | SampleLevel::Bias(_))
        });
        if derivatives.is_empty() && implicit.is_empty() {
            continue;
        }
        any = true;
        let samples: Vec<_> = implicit
            .into_iter()
            .filter(|e| takes_bias(&module, id, *e))
            .collect();
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

/// Whether WGSL has a sample of the same image with a bias: not of depths, nor in one dimension. Those keep their level.
fn takes_bias(module: &Module, id: FunctionId, sample: Handle<Expression>) -> bool {
    let function = match id {
        FunctionId::Function(function) => &module.functions[function],
        FunctionId::EntryPoint(entry) => &module.entry_points[entry].function,
    };
    let Expression::ImageSample { image, .. } = function.expressions[sample] else {
        return false;
    };
    let ty = match function.expressions[image] {
        Expression::GlobalVariable(global) => module.global_variables[global].ty,
        Expression::FunctionArgument(argument) => function.arguments[argument as usize].ty,
        // An element of an array of bindings.
        _ => return false,
    };
    matches!(
        module.types[ty].inner,
        TypeInner::Image {
            dim: ImageDimension::D2 | ImageDimension::D3 | ImageDimension::Cube,
            class: ImageClass::Sampled { .. },
            ..
        }
    )
}

impl HalvedValues<'_, '_, '_> {
    pub(super) fn outcome(
        self,
        plan: &Plan,
        built: Built,
        params: &HalfRateParams,
        budget: Budget,
    ) -> Outcome {
        let mut next = plan.clone();
        let main = self.stage.pass;
        let names: Vec<String> = (0..self.layout.targets())
            .map(|i| match i {
                0 => format!("half-rate-{}", plan.material),
                _ => format!("half-rate-{}-more", plan.material),
            })
            .collect();
        next.attachments.extend(names.iter().map(|name| Attachment {
            divisor: 2,
            ..Attachment::color(name, FORMAT, [0.0; 4])
        }));
        let mut half = GpuPass {
            role: Role::HalfRate,
            phase: Phase::HalfRate,
            program: Role::HalfRate.name().to_owned(),
            fragment: Some(built.entry.clone()),
            depth: None,
            stencil: None,
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
        let (given, change) = (self.stage.given.clone(), self.change(built.edges));
        let step = (HalfRate::INFO.name, params);
        let contract = |given| Contract::Approximate { budget, given };
        self.moved.outcome(next, step, change, given, contract)
    }

    fn change(&self, edges: Edges) -> Change {
        let guides = self.choice.guides.iter();
        let guides: Vec<String> = guides
            .map(|id| format!("`{}`", values::guide_name(self.moved.values, *id)))
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
        let choice = &self.choice;
        let what = format!(
            "computes {} for one pixel of each 2x2 ({:.0} ops); {guided}, and {alone}; a pixel \
             costs {:.0} ops instead of {:.0}",
            self.moved.names(),
            choice.half,
            choice.after,
            choice.before
        );
        let cost = SiteCost {
            slice: choice.saved(),
            whole: choice.before,
        };
        self.moved.change(self.stage.pass, &what, cost)
    }
}

impl Built {
    /// The targets' bindings with their sources, for [`reflect::fill`].
    fn bindings(&self, names: &[String]) -> Vec<BindingUse> {
        let [group, first] = self.at;
        let all = names.iter().enumerate();
        all.map(|(i, name)| {
            let source = BindingSource::Attachment { name: name.clone() };
            BindingUse::new([group, first + i as u32], BindingKind::Texture, source)
        })
        .collect()
    }
}
