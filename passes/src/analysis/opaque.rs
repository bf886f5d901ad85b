//! Preconditions for drawing a material's depth first: the checks that all depth transforms share.
//!
//! Each is a bug that some engine has shipped: blended objects in a pre-pass (a portal in
//! Primozic's article on fragment culling), an alpha test in one pass only, stores that run twice,
//! a forced early test on an alpha-tested draw.

use naga::{Binding, BuiltIn, EarlyDepthTest, ShaderStage, Span, Statement};

use crate::analysis::coverage::{self, Decides};
use crate::analysis::refusals;
use crate::core::channels;
use crate::core::contract::Assumption;
use crate::core::pass::{Facts, Refusal};
use crate::core::plan::{ClearValue, GpuPass, Phase, Plan, Role};
use crate::core::program::Program;
use crate::core::reflect;
use crate::core::refusals::RefusalInfo;
use crate::core::state::{CompareFunction, DepthDirection, DepthState};
use crate::graph::effect::{self, Effect};
use crate::graph::{FunctionId, Graph};

/// The main pass of a material whose depth may be drawn first, with the properties that the
/// transforms need.
#[derive(Debug)]
pub struct Opaque<'a> {
    /// The main pass.
    pub pass: &'a GpuPass,
    /// Its program.
    pub program: &'a Program,
    /// The program's dataflow graph.
    pub graph: Graph<'a>,
    /// Its depth state.
    pub depth: &'a DepthState,
    /// Forward or reversed depth.
    pub direction: DepthDirection,
    /// Index of the vertex entry point.
    pub vertex: usize,
    /// Index of the fragment entry point.
    pub fragment: Option<usize>,
    /// How the fragment stage decides coverage and depth.
    pub decides: Decides,
}

impl<'a> Opaque<'a> {
    /// Assumptions of a contract beyond depth: coverage must agree in two passes, and channels
    /// without writes must not show.
    pub fn assumptions(&self) -> Vec<Assumption> {
        let mut given = Vec::new();
        if !channels::writes_all(self.program, self.pass) {
            given.push(Assumption::LeftChannelsUnwritten);
        }
        if self.decides.anything() {
            given.push(Assumption::InvariantDiscard);
        }
        if self.decides.alpha {
            given.push(Assumption::SameAlphaCoverage);
        }
        given
    }

    /// Whether the author marked the position `@invariant`.
    pub fn has_invariant_position(&self) -> bool {
        let entry = &self.program.module().entry_points[self.vertex];
        reflect::outputs(self.program.module(), &entry.function)
            .iter()
            .any(|o| o.binding == Some(Binding::BuiltIn(BuiltIn::Position { invariant: true })))
    }

    /// The strict comparison for the depth direction.
    pub fn strict(&self) -> CompareFunction {
        match self.direction {
            DepthDirection::Forward => CompareFunction::Less,
            DepthDirection::Reversed => CompareFunction::Greater,
        }
    }

    /// Examines the main pass of `plan`.
    ///
    /// # Errors
    /// Every reason not to, not just the first.
    pub fn examine(plan: &'a Plan, name: &'static str) -> Result<Self, Vec<Refusal>> {
        let refuse = |code: &RefusalInfo, reason: &str, remedy: &str| {
            Refusal::new(name, code, reason, remedy)
        };
        let Some((pass, program)) = plan.main().and_then(|p| Some((p, plan.program(p)?))) else {
            return Err(vec![refuse(
                &refusals::NO_MAIN_PASS,
                "the plan has no main pass",
                "start from the original plan",
            )]);
        };
        let mut refusals = Vec::new();
        if plan.passes.iter().any(|p| p.role == Role::Prepass) {
            refusals.push(refuse(
                &refusals::HAS_PREPASS,
                "the plan already draws this material's depth ahead of it",
                "take one of the two recipes",
            ));
        }
        if pass.phase == Phase::Blended || pass.targets.iter().flatten().any(|t| t.is_blended()) {
            refusals.push(refuse(
                &refusals::BLENDED,
                "the material is blended: what lies behind it shows through, so its depth must not hide anything",
                "keep blended materials out of the pre-pass (they are drawn last, as they are), or draw it opaque",
            ));
        }
        let depth_and_direction = match &pass.depth {
            None => {
                refusals.push(refuse(
                    &refusals::NO_DEPTH,
                    "the material binds no depth attachment",
                    "give it a depth state",
                ));
                None
            }
            Some(depth) => {
                if !depth.write {
                    refusals.push(refuse(
                        &refusals::DEPTH_WRITE_OFF,
                        "the material does not write depth, so nothing of it hides anything",
                        "turn depth writes on if it is opaque",
                    ));
                }
                let direction = depth.compare.direction();
                if direction.is_none() {
                    refusals.push(refuse(
                        &refusals::COMPARE,
                        &format!(
                            "depth compare is {:?}, which does not let the nearest fragment win",
                            depth.compare
                        ),
                        "use less, less-equal, greater or greater-equal",
                    ));
                }
                // The attachment is cleared to the far plane.
                let cleared = plan.attachment(&depth.attachment).map(|a| a.clear);
                if let (Some(d), Some(ClearValue::Depth(clear))) = (direction, cleared)
                    && clear != d.clear_depth()
                {
                    refusals.push(refuse(
                        &refusals::COMPARE_DIRECTION,
                        &format!("depth is cleared to {clear}, against which {:?} lets nothing pass", depth.compare),
                        "say which way depth grows (--reversed-z, depth_direction), or compare the other way",
                    ));
                }
                direction.map(|d| (depth, d))
            }
        };
        if let Some(stencil) = &pass.stencil {
            refusals.push(if stencil.writes() {
                refuse(&refusals::STENCIL_WRITE, "the material writes stencil, which drawing it twice would do twice", "move the stencil write to a pass of its own")
            } else {
                refuse(
                    &refusals::STENCIL_TEST,
                    "the material is masked by stencil, whose contents at the time of a pre-pass are not known",
                    "mask by discard, or draw it in the main phase only",
                )
            });
        }
        let vertex = program.entry_point(ShaderStage::Vertex, &pass.vertex);
        let fragment = pass
            .fragment
            .as_deref()
            .and_then(|f| program.entry_point(ShaderStage::Fragment, f));
        let graph = Graph::build(program);
        if let Some((index, _)) = vertex
            && let Some(span) = find(&graph, FunctionId::EntryPoint(index), &STORES)
        {
            refusals.push(
                refuse(
                    &refusals::VERTEX_STORE,
                    "the vertex stage stores to memory, which drawing it twice would do twice",
                    "move the store to a compute pass",
                )
                .at(program.sources(), span),
            );
        }
        let mut decides = Decides::default();
        if let Some((index, entry)) = fragment {
            if let Some(span) = find(&graph, FunctionId::EntryPoint(index), &STORES) {
                refusals.push(
                    refuse(
                        &refusals::FRAGMENT_STORE,
                        "the fragment stage stores to memory: fragments that are hidden in the end are part of what it does",
                        "move the store to a pass of its own",
                    )
                    .at(program.sources(), span),
                );
            }
            decides = Decides::of(&graph, program, index, pass);
            if reflect::outputs(program.module(), &entry.function)
                .iter()
                .any(|o| o.binding == Some(Binding::BuiltIn(BuiltIn::SampleMask)))
            {
                refusals.push(refuse(
                    &refusals::SAMPLE_MASK,
                    "the fragment stage writes the sample mask, so coverage is decided there sample by sample",
                    "decide coverage by discard",
                ));
            }
            if entry.early_depth_test == Some(EarlyDepthTest::Force)
                && (decides.discards || decides.depth)
            {
                refusals.push(refuse(
                    &refusals::FORCED_EARLY_TEST,
                    "the fragment stage forces the early depth test and discards: a discarded fragment still writes depth, which no slice reproduces",
                    "remove @early_depth_test(force)",
                ));
            }
        }
        if let Some((reason, remedy)) =
            coverage::refuse_alpha(program, fragment.map(|(i, _)| i), pass)
        {
            refusals.push(refuse(&refusals::ALPHA_TO_COVERAGE, &reason, remedy));
        }
        match (depth_and_direction, vertex) {
            (Some((depth, direction)), Some((vertex, _))) if refusals.is_empty() => Ok(Self {
                pass,
                program,
                graph,
                depth,
                direction,
                vertex,
                fragment: fragment.map(|(i, _)| i),
                decides,
            }),
            (_, None) => {
                refusals.push(refuse(
                    &refusals::NO_VERTEX_STAGE,
                    "the main pass names no vertex entry point of its program",
                    "name one",
                ));
                Err(refusals)
            }
            _ => Err(refusals),
        }
    }
}

/// Effects that change if a surface is drawn twice, or not at all where it is hidden.
const STORES: [Effect; 3] = [Effect::Store, Effect::ImageStore, Effect::Atomic];

/// Whether a stage of a pass stores to memory.
pub fn stores(graph: &Graph, program: &Program, pass: &GpuPass) -> bool {
    let stages = [
        (ShaderStage::Vertex, Some(pass.vertex.as_str())),
        (ShaderStage::Fragment, pass.fragment.as_deref()),
    ];
    stages.into_iter().any(|(stage, name)| {
        let entry = name.and_then(|n| program.entry_point(stage, n));
        entry
            .is_some_and(|(index, _)| find(graph, FunctionId::EntryPoint(index), &STORES).is_some())
    })
}

/// Effects that read neighbours in the quad.
const DERIVATIVES: [Effect; 2] = [Effect::Derivative, Effect::ImplicitLod];

/// Where a function or one of its callees first takes a derivative, explicitly or by an implicit
/// level of detail.
pub fn derivative(graph: &Graph, function: FunctionId) -> Option<Span> {
    find(graph, function, &DERIVATIVES)
}

/// The first node of a function with one of these effects. A call stands for a callee without a
/// source span.
fn find(graph: &Graph, id: FunctionId, wanted: &[Effect]) -> Option<Span> {
    if graph.effects(id).iter().all(|e| !wanted.contains(e)) {
        return None;
    }
    let f = graph.function(id);
    let is_wanted = |e: Option<Effect>| e.is_some_and(|e| wanted.contains(&e));
    for (at, node) in f.statements.iter() {
        if is_wanted(effect::of_statement(graph.module(), f, at)) {
            return Some(node.span);
        }
        let found = match node.statement {
            Statement::Emit(range) => range
                .clone()
                .find(|e| is_wanted(effect::of_expression(&f.function.expressions[*e])))
                .map(|e| f.function.expressions.get_span(e)),
            Statement::Call { function, .. } => {
                find(graph, FunctionId::Function(*function), wanted)
            }
            _ => None,
        };
        if found.is_some() {
            return found;
        }
    }
    None
}

/// The refusal of a form that needs the absence of ties, if ties were measured.
pub fn refuse_ties(name: &'static str, facts: &Facts, remedy: &str) -> Option<Refusal> {
    facts.depth_ties.filter(|n| *n > 0).map(|n| {
        Refusal::new(
            name,
            &refusals::DEPTH_TIES,
            format!("several surfaces were measured to share the nearest depth, or one to have that of the cleared buffer (pixels: {n}): once it is in the buffer all of them pass, and the last one wins"),
            remedy,
        )
    })
}
