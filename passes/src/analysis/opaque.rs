//! Preconditions for drawing a material's depth first: the checks that all depth transforms share.
//!
//! Each is a bug that some engine has shipped: blended objects in a pre-pass (a portal in
//! Primozic's article on fragment culling), an alpha test in one pass only, stores that run twice,
//! a forced early test on an alpha-tested draw.

use naga::{Binding, BuiltIn, EntryPoint, ShaderStage, Span};
use naga_edit::interface;

use crate::analysis::coverage::{self, Decides};
use crate::analysis::implicit_inputs::{self, ImplicitInputs, PassEffect};
use crate::analysis::{effects, refusals};
use preshade_dataflow::graph::effect::Effect;
use preshade_dataflow::graph::{FunctionId, Graph};
use preshade_dataflow::slice::Slice;
use preshade_plan::channels;
use preshade_plan::contract::Assumption;
use preshade_plan::pass::{Facts, Refusal};
use preshade_plan::plan::{ClearValue, GpuPass, Phase, Plan, Role};
use preshade_plan::program::Program;
use preshade_plan::state::{Blend, CompareFunction, DepthDirection, DepthState};
use shader_text::refusals::RefusalInfo;

/// The main pass of a material whose depth may be drawn first, with the properties that the
/// transforms need.
#[derive(Debug)]
pub struct Opaque<'a> {
    pub pass: &'a GpuPass,
    pub program: &'a Program,
    pub graph: Graph<'a>,
    pub depth: &'a DepthState,
    pub direction: DepthDirection,
    /// Index of the vertex entry point.
    pub vertex: usize,
    /// Index of the fragment entry point.
    pub fragment: Option<usize>,
    /// How the fragment stage decides coverage and depth.
    pub decides: Decides,
}

impl<'a> Opaque<'a> {
    /// The assumptions under which `effects` leave the picture as it was. The slices of the fragment
    /// and the vertex stage decide coverage and depth in another pass.
    ///
    /// # Errors
    /// An implicit input that the pass changes and no assumption covers: see
    /// `analysis::implicit_inputs`.
    pub fn assumptions(
        &self,
        plan: &Plan,
        name: &'static str,
        [fragment, vertex]: [Option<&Slice>; 2],
        effects: &[PassEffect],
    ) -> Result<Vec<Assumption>, Vec<Refusal>> {
        let stages = ImplicitInputs::new(plan, self.pass, &self.graph).sliced(fragment, vertex);
        let mut given = stages.examine(name, effects)?;
        if !channels::writes_all(self.program, self.pass) {
            given.push(Assumption::LeftChannelsUnwritten);
        }
        Ok(given)
    }

    /// Whether the author marked the position `@invariant`.
    pub fn has_invariant_position(&self) -> bool {
        implicit_inputs::has_invariant_position(self.program, self.vertex)
    }

    /// Whether the code that decides coverage or depth reads the rasteriser's depth
    /// ([`coverage::reads_rasterised_depth`]).
    pub fn reads_rasterised_depth(&self) -> bool {
        let deciding = self.fragment.filter(|_| self.decides.anything());
        deciding.is_some_and(|fragment| {
            let slice = self.decides.slice(&self.graph, fragment);
            coverage::reads_rasterised_depth(self.program, &slice)
        })
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
        let mut found = Examination {
            name,
            refusals: Vec::new(),
        };
        let Some((pass, program)) = plan.main().and_then(|p| Some((p, plan.program(p)?))) else {
            found.refuse(
                &refusals::NO_MAIN_PASS,
                "the plan has no main pass",
                "start from the original plan",
            );
            return Err(found.refusals);
        };
        let depth_and_direction = found.state(plan, pass);
        let vertex = program.entry_point(ShaderStage::Vertex, &pass.vertex);
        let vertex = vertex.map(|(index, _)| index);
        let fragment = pass.fragment.as_deref();
        let fragment = fragment.and_then(|f| program.entry_point(ShaderStage::Fragment, f));
        let graph = Graph::build(program);
        found.stores(&graph, vertex, fragment.map(|(index, _)| index));
        let decides = fragment.map_or_else(Decides::default, |(index, entry)| {
            found.coverage(Decides::of(&graph, program, index, pass), program, entry)
        });
        let fragment = fragment.map(|(index, _)| index);
        if let Some((reason, remedy)) = coverage::refuse_alpha(program, fragment, pass) {
            found.refuse(&refusals::ALPHA_TO_COVERAGE, &reason, remedy);
        }
        if vertex.is_none() {
            found.refuse(
                &refusals::NO_VERTEX_STAGE,
                "the main pass names no vertex entry point of its program",
                "name one",
            );
        }
        match (depth_and_direction, vertex) {
            (Some((depth, direction)), Some(vertex)) if found.refusals.is_empty() => Ok(Self {
                pass,
                program,
                graph,
                depth,
                direction,
                vertex,
                fragment,
                decides,
            }),
            _ => Err(found.refusals),
        }
    }
}

/// The refusals found so far.
struct Examination {
    name: &'static str,
    refusals: Vec<Refusal>,
}

impl Examination {
    fn refuse(&mut self, code: &RefusalInfo, reason: &str, remedy: &str) {
        let refusal = Refusal::new(self.name, code, reason, remedy);
        self.refusals.push(refusal);
    }

    fn refuse_at(
        &mut self,
        program: &Program,
        span: Span,
        (code, reason, remedy): (&RefusalInfo, &str, &str),
    ) {
        let refusal = Refusal::new(self.name, code, reason, remedy);
        self.refusals.push(refusal.at(program.sources(), span));
    }

    /// Checks the pipeline state: blending, depth and stencil.
    fn state<'p>(
        &mut self,
        plan: &'p Plan,
        pass: &'p GpuPass,
    ) -> Option<(&'p DepthState, DepthDirection)> {
        if plan.passes.iter().any(|p| p.role == Role::Prepass) {
            self.refuse(
                &refusals::HAS_PREPASS,
                "the plan already draws this material's depth ahead of it",
                "take one of the two recipes",
            );
        }
        if pass.phase == Phase::Blended || pass.targets.iter().flatten().any(|t| t.is_blended()) {
            let blended = pass.targets.iter().flatten().filter(|t| t.is_blended());
            let mut colors = blended.filter_map(|t| Some(t.blend?.color)).peekable();
            let is_alpha_alone =
                colors.peek().is_some() && colors.all(|c| c == Blend::REPLACE.color);
            let (reason, remedy) = match is_alpha_alone {
                true => (
                    "the material blends alpha: the alpha of what lies behind it becomes part of \
                     its own, so its depth must not hide anything",
                    "draw it without blending, if nothing reads its alpha",
                ),
                false => (
                    "the material is blended: what lies behind it shows through, so its depth must \
                     not hide anything",
                    "keep blended materials out of the pre-pass (they are drawn last, as they are), \
                     or draw it opaque",
                ),
            };
            self.refuse(&refusals::BLENDED, reason, remedy);
        }
        let depth = self.depth(plan, pass);
        if let Some(stencil) = &pass.stencil {
            match stencil.writes() {
                true => self.refuse(
                    &refusals::STENCIL_WRITE,
                    "the material writes stencil, which drawing it twice would do twice",
                    "move the stencil write to a pass of its own",
                ),
                false => self.refuse(
                    &refusals::STENCIL_TEST,
                    "the material is masked by stencil, whose contents at the time of a pre-pass \
                     are not known",
                    "mask by discard, or draw it in the main phase only",
                ),
            }
        }
        depth
    }

    fn depth<'p>(
        &mut self,
        plan: &'p Plan,
        pass: &'p GpuPass,
    ) -> Option<(&'p DepthState, DepthDirection)> {
        let Some(depth) = &pass.depth else {
            self.refuse(
                &refusals::NO_DEPTH,
                "the material binds no depth attachment",
                "give it a depth state",
            );
            return None;
        };
        if !depth.write {
            self.refuse(
                &refusals::DEPTH_WRITE_OFF,
                "the material does not write depth, so nothing of it hides anything",
                "turn depth writes on if it is opaque",
            );
        }
        let Some(direction) = depth.compare.direction() else {
            let reason = format!(
                "depth compare is {:?}, which does not let the nearest fragment win",
                depth.compare
            );
            self.refuse(
                &refusals::COMPARE,
                &reason,
                "use less, less-equal, greater or greater-equal",
            );
            return None;
        };
        // The attachment is cleared to the far plane.
        if let Some(ClearValue::Depth(clear)) = plan.attachment(&depth.attachment).map(|a| a.clear)
            && clear != direction.clear_depth()
        {
            let reason = format!(
                "depth is cleared to {clear}, against which {:?} lets nothing pass",
                depth.compare
            );
            self.refuse(
                &refusals::COMPARE_DIRECTION,
                &reason,
                "say which way depth grows (--reversed-z, depth_direction), or compare the other \
                 way",
            );
        }
        Some((depth, direction))
    }

    fn stores(&mut self, graph: &Graph, vertex: Option<usize>, fragment: Option<usize>) {
        let program = graph.program();
        let store = |entry: Option<usize>| {
            effects::find(graph, FunctionId::EntryPoint(entry?), &Effect::WRITES)
        };
        if let Some(span) = store(vertex) {
            let refusal = (
                &refusals::VERTEX_STORE,
                "the vertex stage stores to memory, which drawing it twice would do twice",
                "move the store to a compute pass",
            );
            self.refuse_at(program, span, refusal);
        }
        if let Some(span) = store(fragment) {
            let refusal = (
                &refusals::FRAGMENT_STORE,
                "the fragment stage stores to memory: fragments that are hidden in the end are \
                 part of what it does",
                "move the store to a pass of its own",
            );
            self.refuse_at(program, span, refusal);
        }
    }

    /// Checks how the fragment entry point decides coverage.
    fn coverage(&mut self, decides: Decides, program: &Program, entry: &EntryPoint) -> Decides {
        let mask = Some(Binding::BuiltIn(BuiltIn::SampleMask));
        let outputs = interface::outputs(program.module(), &entry.function);
        if outputs.iter().any(|o| o.binding == mask) {
            self.refuse(
                &refusals::SAMPLE_MASK,
                "the fragment stage writes the sample mask, so coverage is decided there sample by \
                 sample",
                "decide coverage by discard",
            );
        }
        if decides.is_forced && (decides.discards || decides.depth) {
            self.refuse(
                &refusals::FORCED_EARLY_TEST,
                "the fragment stage forces the early depth test and discards: a discarded fragment \
                 still writes depth, which no slice reproduces",
                "remove @early_depth_test(force)",
            );
        }
        decides
    }
}

/// Whether a stage of a pass stores to memory.
pub(crate) fn stores(graph: &Graph, program: &Program, pass: &GpuPass) -> bool {
    let mut stages = pass.stages().into_iter();
    stages.any(|(stage, name)| {
        let entry = program.entry_point(stage, name);
        entry.is_some_and(|(index, _)| graph.writes_memory(FunctionId::EntryPoint(index)))
    })
}

/// The refusal of a form that needs the absence of ties, if ties were measured.
pub(crate) fn refuse_ties(name: &'static str, facts: &Facts, remedy: &str) -> Option<Refusal> {
    facts.depth_ties.filter(|n| *n > 0).map(|n| {
        Refusal::new(
            name,
            &refusals::DEPTH_TIES,
            format!(
                "several surfaces were measured to share the nearest depth, or one to have that of \
                 the cleared buffer (pixels: {n}): once it is in the buffer all of them pass, and \
                 the last one wins"
            ),
            remedy,
        )
    })
}
