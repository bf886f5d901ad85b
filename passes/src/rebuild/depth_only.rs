//! The depth-only version of a material: the slice of its vertex stage to position, and of its
//! fragment stage to coverage and depth. `rebuild::depth_pass` adds it to a plan.

use naga::{BinaryOperator, Binding, BuiltIn, Expression, Literal, Module, Span, TypeInner};
use naga_edit::interface;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::analysis::implicit_inputs::PassEffect;
use crate::analysis::opaque::Opaque;
use crate::rebuild::color;
use crate::rebuild::place::{self, PositionInvariance};
use crate::rebuild::prologue::Ahead;
use naga_edit::returns;
use naga_edit::writer::FunctionWriter;
use preshade_dataflow::slice::{self, Criterion, OutputFilter, Slice};
use preshade_plan::contract::{Assumption, Contract};
use preshade_plan::pass::{Outcome, Refusal};
use preshade_plan::plan::{Change, Plan, Role, Site, SiteCost, Step};

/// The vertex stage of a depth-only pass.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum VertexStage {
    /// The main pass's entry point in the same module: most likely to be invariant.
    Same,
    /// The slice to position, clip distances, point size and view index, in its own module.
    Sliced,
}

/// Whether to add `@invariant` to positions whose depths are compared for equality.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Invariance {
    /// The author's marking. No bit of the picture changes, and we trust the driver to compile one
    /// vertex entry point alike in both pipelines. The plan's self-test checks this.
    AsWritten,
    /// `@invariant` on both. It forbids contractions that the original may have had, so positions
    /// (and pixels) may differ from the original's in the last bits.
    Add,
}

impl Invariance {
    /// One entry point of one module needs no attribute; two texts do.
    pub fn default_for(stage: VertexStage) -> Self {
        match stage {
            VertexStage::Same => Self::AsWritten,
            VertexStage::Sliced => Self::Add,
        }
    }

    /// The assumptions of an unchanged picture.
    pub fn assumptions(self, opaque: &Opaque) -> Vec<Assumption> {
        let mut given = vec![Assumption::InvariantPosition];
        if self == Self::Add && !opaque.has_invariant_position() {
            given.push(Assumption::InvariantOriginal);
        }
        given
    }

    /// How the pass marks positions.
    pub fn position(self) -> PositionInvariance {
        match self {
            Self::AsWritten => PositionInvariance::AsWritten,
            Self::Add => PositionInvariance::Invariant,
        }
    }

    /// The author's module, with the position marked if needed.
    pub fn apply(self, module: Module, vertex: usize) -> Module {
        match self {
            Self::AsWritten => module,
            Self::Add => interface::with_invariant_position(&module, vertex),
        }
    }
}

/// The slices that make a material depth-only.
#[derive(Clone, Debug)]
pub struct DepthOnly {
    /// The vertex code that rasterisation and the fragment slice need.
    vertex: Slice,
    /// Whether `vertex` or the whole stage is drawn with.
    stage: VertexStage,
    /// The fragment slice; `None` means no fragment stage.
    fragment: Option<Slice>,
    cost: SiteCost,
    span: Option<Span>,
}

/// A depth-only program with its entry points.
#[derive(Clone, Debug)]
pub struct Placed {
    pub module: Module,
    pub vertex: String,
    /// `None`: no fragment stage.
    pub fragment: Option<String>,
}

/// Slices a material to the code that decides position, coverage and depth, and to `outputs` of its
/// fragment stage.
pub fn slice(opaque: &Opaque, stage: VertexStage, outputs: &[OutputFilter]) -> DepthOnly {
    let graph = &opaque.graph;
    let fragment = opaque
        .fragment
        .filter(|_| opaque.decides.anything() || !outputs.is_empty())
        .map(|entry| {
            let mut criteria = opaque.decides.criteria();
            criteria.extend(outputs.iter().cloned().map(Criterion::Output));
            slice::backward(graph, entry, &criteria)
        });
    let mut criteria = vec![Criterion::Output(OutputFilter::Rasterization)];
    if let Some(fragment) = &fragment {
        let entry = &opaque.program.module().entry_points[fragment.entry];
        let inputs = interface::inputs(opaque.program.module(), &entry.function);
        let location = |i: &usize| match inputs.get(*i)?.binding {
            Some(Binding::Location { location, .. }) => {
                Some(Criterion::Output(OutputFilter::Location(location)))
            }
            _ => None,
        };
        criteria.extend(fragment.inputs.iter().filter_map(location));
    }
    let vertex = slice::backward(graph, opaque.vertex, &criteria);
    let whole_vertex = graph.entry_cost(opaque.vertex);
    let cost = SiteCost {
        slice: match stage {
            VertexStage::Same => whole_vertex,
            VertexStage::Sliced => vertex.cost,
        } + fragment.as_ref().map_or(0.0, |s| s.cost),
        whole: whole_vertex + opaque.fragment.map_or(0.0, |f| graph.entry_cost(f)),
    };
    let drawn = (stage == VertexStage::Sliced).then_some(&vertex);
    let span = [fragment.as_ref(), drawn]
        .into_iter()
        .flatten()
        .find_map(|s| s.first_span(graph));
    DepthOnly {
        vertex,
        stage,
        fragment,
        cost,
        span,
    }
}

impl DepthOnly {
    /// Stable name of the code that was sliced.
    pub fn key(&self, opaque: &Opaque) -> Site {
        let graph = &opaque.graph;
        let hash = |s: Option<&Slice>| s.map_or("-".repeat(16), |s| s.hash(graph));
        Site {
            role: Role::Main,
            entry_point: opaque.pass.vertex.clone(),
            slice: format!(
                "{}{}",
                hash(self.drawn_vertex()),
                hash(self.fragment.as_ref())
            ),
        }
    }

    /// The change that a pass makes with these slices.
    pub fn change(&self, opaque: &Opaque, what: String) -> Change {
        Change {
            key: self.key(opaque),
            what,
            location: self.span.and_then(|s| opaque.program.sources().locate(s)),
            cost: self.cost,
        }
    }

    /// A plan that was made with these slices.
    pub fn outcome(&self, opaque: &Opaque, what: String, plan: Plan) -> Outcome {
        Outcome {
            plan,
            change: self.change(opaque, what),
            left: Vec::new(),
        }
    }

    /// The assumptions of the pass `name`, which changes implicit inputs of the author's stages.
    ///
    /// # Errors
    /// See [`Opaque::assumptions`].
    pub fn assumptions(
        &self,
        opaque: &Opaque,
        plan: &Plan,
        name: &'static str,
        effects: &[PassEffect],
    ) -> Result<Vec<Assumption>, Vec<Refusal>> {
        // A driver also drops from the whole stage the outputs that the fragment slice does not
        // read.
        let slices = [self.fragment.as_ref(), Some(&self.vertex)];
        opaque.assumptions(plan, name, slices, effects)
    }

    /// The slice that is drawn with; `None`: the whole vertex stage.
    fn drawn_vertex(&self) -> Option<&Slice> {
        (self.stage == VertexStage::Sliced).then_some(&self.vertex)
    }

    /// The step of the pass `name` with these slices.
    pub fn step(
        &self,
        opaque: &Opaque,
        name: &str,
        params: &impl Serialize,
        contract: Contract,
    ) -> Step {
        Step {
            pass: name.to_owned(),
            site: self.key(opaque),
            params: serde_json::to_value(params).unwrap_or_default(),
            contract,
        }
    }

    /// Adds the slices to the author's module, next to the author's entry points. `suffix` ends the
    /// names of new items. `shader_bias` is added to a depth that the fragment stage writes.
    pub fn place(
        &self,
        opaque: &Opaque,
        suffix: &str,
        invariance: PositionInvariance,
        shader_bias: Option<f32>,
    ) -> Placed {
        let program = opaque.program;
        let graph = &opaque.graph;
        let mut module = program.module().clone();
        let fragment = self.fragment.as_ref().map(|slice| {
            let entry = &program.module().entry_points[slice.entry];
            let name = free_entry(program.module(), &entry.name, suffix);
            module = place::entry_point(
                graph,
                slice,
                &module,
                &name,
                suffix,
                PositionInvariance::AsWritten,
            );
            if let (Some(bias), true) = (shader_bias, opaque.decides.depth) {
                bias_depth(&mut module, bias);
            }
            name
        });
        // SwiftShader clips by distances in the fragment stage, even an empty one.
        let fragment = fragment.or_else(|| {
            writes_clip_distances(opaque).then(|| {
                let name = free_entry(program.module(), "clipped", suffix);
                module.entry_points.push(color::empty_fragment(&name));
                name
            })
        });
        let Some(slice) = self.drawn_vertex() else {
            if invariance == PositionInvariance::Invariant {
                module = interface::with_invariant_position(&module, opaque.vertex);
            }
            return Placed {
                module,
                vertex: opaque.pass.vertex.clone(),
                fragment,
            };
        };
        let vertex = free_entry(program.module(), &opaque.pass.vertex, suffix);
        module = place::entry_point(graph, slice, &module, &vertex, suffix, invariance);
        Placed {
            module,
            vertex,
            fragment,
        }
    }

    /// Adds to `module` a function that computes the material's depth from the fragment stage's
    /// inputs.
    pub fn depth_function(&self, opaque: &Opaque, module: &Module) -> Option<(Module, Ahead)> {
        let graph = &opaque.graph;
        // Only the depth: the author's own code still discards.
        let slice = slice::backward(
            graph,
            self.fragment.as_ref()?.entry,
            &[Criterion::Output(OutputFilter::FragDepth)],
        );
        Ahead::add(graph, &slice, module, "prepass_own_depth", "own_depth")
    }
}

fn writes_clip_distances(opaque: &Opaque) -> bool {
    let module = opaque.program.module();
    let vertex = &module.entry_points[opaque.vertex].function;
    let outputs = interface::outputs(module, vertex);
    let clip = Some(Binding::BuiltIn(naga::BuiltIn::ClipDistances));
    outputs.iter().any(|output| output.binding == clip)
}

/// A free entry point name: `{name}_{suffix}`, repeating the suffix if it is taken.
fn free_entry(module: &Module, name: &str, suffix: &str) -> String {
    let mut free = format!("{name}_{suffix}");
    while module.entry_points.iter().any(|e| e.name == free) {
        free = format!("{free}_{suffix}");
    }
    free
}

/// Adds `bias` to every depth that the last entry point of `module` returns.
fn bias_depth(module: &mut Module, bias: f32) {
    let Some(entry) = module.entry_points.last_mut() else {
        return;
    };
    // The bias breaks a guarantee about the depth's side.
    entry.early_depth_test = None;
    let Some(result) = entry.function.result.clone() else {
        return;
    };
    let members = match &module.types[result.ty].inner {
        TypeInner::Struct { members, .. } => Some(members),
        _ => None,
    };
    returns::rewrite(&mut entry.function, &mut |writer, value| {
        let value = value?;
        let bias = writer.expression(Expression::Literal(Literal::F32(bias)));
        let pushed = |writer: &mut FunctionWriter, depth| {
            writer.expression(Expression::Binary {
                op: BinaryOperator::Add,
                left: depth,
                right: bias,
            })
        };
        let Some(members) = members else {
            return Some(pushed(writer, value));
        };
        let components = (0..)
            .zip(members)
            .map(|(index, member)| {
                let part = writer.expression(Expression::AccessIndex { base: value, index });
                match member.binding {
                    Some(Binding::BuiltIn(BuiltIn::FragDepth)) => pushed(writer, part),
                    _ => part,
                }
            })
            .collect();
        Some(writer.expression(Expression::Compose {
            ty: result.ty,
            components,
        }))
    });
}
