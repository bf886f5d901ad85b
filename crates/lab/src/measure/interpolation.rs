//! Measures how far a value is from its interpolation over the scene's triangles. The adapter
//! evaluates it without drawing.
//!
//! The hoisted material is tessellated, and its compute pass evaluates the value at the corners of
//! every triangle and at points between them. The values between are compared with the interpolated
//! corners. Every triangle counts equally, whether a camera sees it or not.

use std::collections::{BTreeMap, HashMap};

use naga_edit::interface;
use preshade_geometry::tessellate::{self, Tessellate};
use preshade_plan::geometry;
use preshade_plan::pass::{Facts, Interpolation, Pass};
use preshade_plan::pattern::Pattern;
use preshade_plan::plan::Plan;

use super::view::choosing;
use super::{Error, Session};
use preshade_draw::render::ComputedVertices;

/// How many points between the corners are evaluated.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Points {
    /// 3 a triangle: for choosing among many values.
    Few,
    /// 12, or 3 where there are many triangles, for a table.
    Many,
}

impl Points {
    /// Segments of an edge, by triangles at most.
    fn levels(self) -> &'static [(u32, u64)] {
        match self {
            Self::Few => &[(2, 500_000)],
            Self::Many => &[(4, 20_000), (2, 2_000_000)],
        }
    }
}

/// Measures a value. `alone` has, by material index, the plans that interpolate this value only.
/// `None`: no plan can be tessellated (a flat varying, say), or there are too many triangles.
pub fn interpolation(
    session: &Session<'_>,
    alone: &BTreeMap<usize, Plan>,
    points: Points,
) -> Result<Option<Interpolation>, Error> {
    let (scene, inputs, plans) = (session.scene(), session.inputs(), session.originals());
    let draws = scene.draws.iter().enumerate();
    let triangles: u64 = draws
        .filter(|(_, draw)| alone.contains_key(&draw.material))
        .map(|(index, _)| inputs.triangles(index))
        .sum();
    let levels = points.levels();
    let Some(&(level, _)) = levels.iter().find(|(_, most)| triangles <= *most) else {
        return Ok(None);
    };
    let mut computing = Vec::new();
    let mut components = HashMap::new();
    let mut denominator = 1;
    for (material, alone) in alone {
        let Some((mut plan, wide, sum)) = tessellated(&plans[*material], alone, level) else {
            continue;
        };
        // Only its compute pass runs.
        plan.passes.clear();
        computing.push(plan);
        components.insert(*material, wide);
        denominator = sum;
    }
    if components.is_empty() {
        return Ok(None);
    }
    let prepared = session.prepare(&computing)?;
    let mut measured: Option<Measured> = None;
    for frame in choosing(scene) {
        inputs.set_frame(frame)?;
        for vertices in prepared.computed_vertices()? {
            let Some(draw) = scene.draws.get(vertices.draw) else {
                continue;
            };
            if let Some(of) = components.get(&draw.material) {
                measured
                    .get_or_insert_with(Measured::default)
                    .add(&vertices, of, denominator);
            }
        }
    }
    Ok(measured.and_then(Measured::worst))
}

/// Which words of a vertex are floats of the value, which are interpolated.
type Components = Vec<bool>;

/// The plan that computes the value at new vertices, and which words of a new vertex are the value's.
fn tessellated(original: &Plan, alone: &Plan, level: u32) -> Option<(Plan, Components, u32)> {
    let components = components(original, alone)?;
    let params = tessellate::TessellateParams {
        level,
        pattern: Pattern::Uniform,
        form: geometry::Form::Shared,
        ..tessellate::TessellateParams::default()
    };
    let plan = Tessellate::run(alone, &Facts::default(), &params)
        .ok()?
        .plan;
    let denominator = plan.main()?.geometry.subdivision()?.denominator;
    Some((plan, components, denominator))
}

/// The outputs of the vertex stage.
fn outputs(plan: &Plan) -> Option<(&naga::Module, Vec<interface::Io>)> {
    let main = plan.main()?;
    let program = plan.program(main)?;
    let (_, entry) = program.entry_point(naga::ShaderStage::Vertex, &main.vertex)?;
    let module = program.module();
    Some((module, interface::outputs(module, &entry.function)))
}

/// The author's own varyings do not count: no choice changes them.
fn components(original: &Plan, alone: &Plan) -> Option<Components> {
    let (_, own) = outputs(original)?;
    let (module, outputs) = outputs(alone)?;
    let mut components = Vec::new();
    for output in outputs {
        let (count, kind) = match module.types[output.ty].inner {
            naga::TypeInner::Scalar(s) => (1, s.kind),
            naga::TypeInner::Vector { size, scalar } => (size as usize, scalar.kind),
            _ => return None,
        };
        let smooth = matches!(
            output.binding,
            Some(naga::Binding::Location { interpolation, .. })
                if interpolation != Some(naga::Interpolation::Flat)
        );
        let is_own = own
            .iter()
            .any(|o| (&o.name, &o.binding) == (&output.name, &output.binding));
        let is_value = smooth && kind == naga::ScalarKind::Float && !is_own;
        components.extend(std::iter::repeat_n(is_value, count));
    }
    Some(components)
}

/// One component over all points.
#[derive(Clone, Copy)]
struct Component {
    max: f64,
    sum: f64,
    least: f64,
    most: f64,
}

#[derive(Default)]
struct Measured {
    components: Vec<Component>,
    points: u64,
    not_finite: u64,
}

impl Measured {
    fn add(&mut self, vertices: &ComputedVertices, wide: &Components, denominator: u32) {
        let count = wide.iter().filter(|is_value| **is_value).count();
        let unseen = Component {
            max: 0.0,
            sum: 0.0,
            least: f64::INFINITY,
            most: f64::NEG_INFINITY,
        };
        if self.components.len() < count {
            self.components.resize(count, unseen);
        }
        // Where the author's own vertices are among the new ones.
        let mut corners = HashMap::new();
        for (at, point) in vertices.points.iter().enumerate() {
            let [(corner, weight), ..] = made_of(point);
            if weight == denominator {
                corners.insert(corner, at);
            }
        }
        let instance = vertices.points.len() * wide.len();
        for words in vertices.words.chunks_exact(instance.max(1)) {
            let values = |at: usize| {
                let vertex = &words[at * wide.len()..][..wide.len()];
                let of_value = vertex.iter().zip(wide).filter(|(_, of_value)| **of_value);
                of_value.map(|(word, _)| f64::from(f32::from_bits(*word)))
            };
            for (at, point) in vertices.points.iter().enumerate() {
                let of = made_of(point);
                let mut interpolated = vec![0.0; count];
                for (corner, weight) in of.into_iter().filter(|(_, weight)| *weight > 0) {
                    let Some(corner) = corners.get(&corner) else {
                        continue;
                    };
                    let share = f64::from(weight) / f64::from(denominator);
                    for (sum, value) in interpolated.iter_mut().zip(values(*corner)) {
                        *sum += share * value;
                    }
                }
                let is_between = of[0].1 != denominator;
                self.points += u64::from(is_between);
                let mut is_finite = true;
                let seen = self.components.iter_mut().zip(interpolated).zip(values(at));
                for ((component, interpolated), value) in seen {
                    let difference = (value - interpolated).abs();
                    if !difference.is_finite() {
                        is_finite = false;
                        continue;
                    }
                    component.max = component.max.max(difference);
                    component.sum += difference;
                    component.least = component.least.min(value);
                    component.most = component.most.max(value);
                }
                self.not_finite += u64::from(!is_finite);
            }
        }
    }

    /// The measurement of the component with the largest error.
    fn worst(self) -> Option<Interpolation> {
        let worst = self
            .components
            .iter()
            .max_by(|a, b| a.max.total_cmp(&b.max))?;
        Some(Interpolation {
            max: worst.max,
            mean: worst.sum / (self.points.max(1) as f64),
            range: (worst.most - worst.least).max(0.0),
            not_finite: self.not_finite,
            points: self.points,
        })
    }
}

/// The author's vertices that a new one is made of, each with its weight, the heaviest of a corner first.
fn made_of(point: &[u32; 4]) -> [(u32, u32); 3] {
    let packed = point[3];
    [0, 1, 2].map(|place| {
        let corner = (packed >> (24 + 2 * place)) & 3;
        let weight = (packed >> (8 * place)) & 255;
        (point[corner as usize], weight)
    })
}
