//! Proofs for every input: both stages have one canonical slice, or end in the same terms.

use super::compare::{self, Colors, Stores};
use super::environment::{self, PassStages, TestPoint, World};
use super::inputs::{self, Inputs};
use super::promise::Pair;
use super::stage::Stage;
use super::term;
use preshade_dataflow::graph::{FunctionId, Graph};
use preshade_dataflow::slice::{self, Criterion, OutputFilter};
use preshade_passes::rebuild::place::{self, PositionInvariance};
use preshade_plan::guard::Place as Assumed;
use preshade_plan::program::Program;

impl Pair<'_> {
    /// Whether a promise has equal slices in both: of the fragment stage, and of its inputs in the
    /// vertex stage.
    pub(super) fn slices_are_same(&self, place: TestPoint, colors: Colors) -> bool {
        slices_are_same(self.original, self.other, place, colors, self.stores())
    }

    /// The number of paths over which both give the same results for every input, if proved.
    pub(super) fn proved(&self, place: TestPoint, colors: Colors) -> Option<u64> {
        // No term stands for the draw's buffers.
        if self.reads_draw {
            return None;
        }
        if !self.attachments.is_empty() && place != TestPoint::Vertex {
            return None;
        }
        let module = self.original.vertex.module();
        let inputs = Inputs::new(module, self.variant.guard.as_ref(), self.effort.seed);
        let (rule, _) = self.rule(place, colors, None);
        term::proved(self.effort.paths, || {
            let mut world = environment::symbolic(module, &inputs);
            for assumed in self.variant.guard.iter().flat_map(|g| &g.values) {
                fix(module, &mut world, assumed);
            }
            let original = world.run(self.original, place, self.effort.steps, None)?;
            let variant = world.run(self.other, place, 4 * self.effort.steps, None)?;
            Ok(compare::difference(rule, &original, &variant).is_none())
        })
    }
}

/// Slicing criteria of a fragment, as far as colours are promised.
pub(super) fn of_fragment(colors: Colors) -> Vec<Criterion> {
    let mut wanted = match colors {
        Colors::Bits | Colors::Numbers | Colors::Within(_) => {
            vec![Criterion::Output(OutputFilter::All)]
        }
        Colors::Alpha => vec![
            Criterion::Output(OutputFilter::FragDepth),
            Criterion::Component(OutputFilter::Location(0), 3),
        ],
        Colors::Ignored => vec![Criterion::Output(OutputFilter::FragDepth)],
    };
    let mask = naga::Binding::BuiltIn(naga::BuiltIn::SampleMask);
    wanted.push(Criterion::Output(OutputFilter::Binding(mask)));
    wanted.push(Criterion::Discard);
    wanted
}

/// Whether two materials have equal slices at a place: of the fragment stage, and of its inputs in
/// the vertex stage.
pub(super) fn slices_are_same(
    original: PassStages<'_>,
    other: PassStages<'_>,
    place: TestPoint,
    colors: Colors,
    compared: Stores,
) -> bool {
    let mut vertex = vec![Criterion::Output(OutputFilter::Rasterization)];
    if place != TestPoint::Vertex {
        let (Some(a), Some(b)) = (original.fragment, other.fragment) else {
            return false;
        };
        // A slice of outputs excludes stores.
        if compared == Stores::Same && (stores(a) || stores(b)) {
            return false;
        }
        let wanted = of_fragment(colors);
        let (Some(first), Some(second)) = (normal(a, &wanted), normal(b, &wanted)) else {
            return false;
        };
        if first != second {
            return false;
        }
        vertex = locations(&first.read);
        if place == TestPoint::Anywhere || vertex.is_empty() {
            return true;
        }
        vertex.push(Criterion::Output(OutputFilter::Rasterization));
    }
    let found = normal(original.vertex, &vertex);
    found.is_some() && found == normal(other.vertex, &vertex)
}

/// The outputs of a vertex stage at the locations of these bindings.
pub(super) fn locations(read: &[naga::Binding]) -> Vec<Criterion> {
    let locations = read.iter().filter_map(|binding| match binding {
        naga::Binding::Location { location, .. } => Some(*location),
        naga::Binding::BuiltIn(_) => None,
    });
    locations
        .map(|l| Criterion::Output(OutputFilter::Location(l)))
        .collect()
}

/// Writes a number that a guard fixes into a buffer of terms.
fn fix(
    module: &naga::Module,
    world: &mut World<'_, term::Symbolic>,
    assumed: &preshade_plan::guard::Assumed,
) {
    use naga_interp::{Number, Scalar};
    use preshade_plan::guard::ScalarType;
    let Assumed::Uniform {
        group,
        binding,
        offset,
    } = assumed.place
    else {
        return;
    };
    let at = (group, binding);
    let number = match assumed.ty {
        ScalarType::F32 => Scalar::F32(term::Symbolic::of(assumed.bounds.low as f32)),
        ScalarType::I32 => Scalar::I32(assumed.bounds.low as i32),
        ScalarType::U32 => Scalar::U32(assumed.bounds.low as u32),
    };
    let global = module.global_variables.iter().find(|(_, g)| {
        g.binding
            .as_ref()
            .is_some_and(|b| (b.group, b.binding) == at)
    });
    let resources = std::sync::Arc::make_mut(&mut world.resources);
    if let (Some((_, global)), Some(value)) = (global, resources.get_mut(&at)) {
        inputs::set(module, global.ty, value, offset, number);
    }
}

/// Whether a stage writes memory.
fn stores(stage: Stage<'_>) -> bool {
    Graph::build(stage.program).writes_memory(FunctionId::EntryPoint(stage.entry))
}

/// A slice, independent of its program.
#[derive(PartialEq)]
struct Normal {
    hash: String,
    /// Bindings and interpolation of its inputs.
    read: Vec<naga::Binding>,
}

/// Name of the entry point of [`placed`].
pub(super) const SLICE: &str = "preshade_slice";

/// A slice of a stage as a program of its own, with the entry point [`SLICE`].
pub(super) fn placed(
    graph: &Graph<'_>,
    stage: Stage<'_>,
    criteria: &[Criterion],
) -> Option<Program> {
    let slice = slice::backward(graph, stage.entry, criteria);
    let module = place::entry_point(
        graph,
        &slice,
        stage.module(),
        SLICE,
        "slice",
        PositionInvariance::AsWritten,
    );
    let kind = stage.module().entry_points[stage.entry].stage;
    let module = place::retain(&module, &[(kind, SLICE)]);
    stage.program.with_module(module).ok()
}

/// The slice of a stage. It is placed and sliced again, which removes all traces of its program.
fn normal(stage: Stage<'_>, criteria: &[Criterion]) -> Option<Normal> {
    let kind = stage.module().entry_points[stage.entry].stage;
    let placed = placed(&Graph::build(stage.program), stage, criteria)?;
    let stage = Stage::new(&placed, kind, SLICE)?;
    let graph = Graph::build(&placed);
    Some(Normal {
        hash: slice::backward(&graph, stage.entry, criteria).hash(&graph),
        read: stage
            .inputs()
            .into_iter()
            .filter_map(|io| io.binding)
            .collect(),
    })
}
