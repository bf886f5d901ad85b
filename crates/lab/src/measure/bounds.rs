//! Proved bounds on the interpolation error of a value, over the triangles of a scene.

use naga_interp::Value;
use naga_interp::bound::{self, Affine, Distance};
use preshade_passes::transforms::hoist::Computed;
use preshade_plan::pass::Bound;
use preshade_plan::plan::Plan;
use preshade_plan::state::Topology;
use std::collections::{BTreeMap, HashMap};

use super::vertices::{self, Vertices, said};
use super::view::choosing;
use preshade_draw::scene::Scene;
use preshade_draw::scene::bind::{self, DrawBindings};

/// Steps of the interpreter for one value over all its triangles. If all triangles take more, fewer
/// are checked.
const MOST_STEPS: u64 = 1_500_000;
/// Squared, the number of parts a triangle is split into. One part comes first. More parts follow
/// if one gives no bound, or the largest.
const PARTS: [u32; 3] = [1, 4, 8];
/// Triangles that are split into more parts.
const REFINED: usize = 256;

/// Bounds a value, given the functions that compute it by material index. `None`: there are no
/// triangles.
pub fn bound(scene: &Scene, plans: &[Plan], computed: &BTreeMap<usize, Computed>) -> Option<Bound> {
    let frames = choosing(scene);
    let mut drawn = Vec::new();
    for (material, computed) in computed {
        let pass = plans[*material].main()?;
        if pass.primitive.topology != Topology::TriangleList {
            return None;
        }
        let draws = scene.draws.iter().filter(|d| d.material == *material);
        for draw in draws {
            for frame in &frames {
                let material = &scene.materials[*material];
                let bound = bind::draw(scene, material, pass, draw, frame).ok()?;
                drawn.push(MaterialTriangles::new(computed.clone(), bound));
            }
        }
    }
    match over(&mut drawn) {
        Ok(Some((distance, triangles))) => Some(Bound::Proved {
            max: distance.max,
            roundings: distance.roundings,
            triangles,
            of: drawn.iter().map(|d| d.triangles).sum(),
            frames: frames.len() as u64,
        }),
        Ok(None) => None,
        Err(why) => Some(Bound::Unbounded { why }),
    }
}

/// The largest distance over the triangles of all draws, and the number of triangles checked.
/// `None`: there are none.
fn over(draws: &mut [MaterialTriangles]) -> Result<Option<(Distance, u64)>, String> {
    let of: u64 = draws.iter().map(|d| d.triangles).sum();
    let Some(first) = draws.iter_mut().find(|d| d.triangles > 0) else {
        return Ok(None);
    };
    let triangles = (MOST_STEPS / first.steps()?.max(1)).clamp(1, of);
    let mut bounds = Vec::new();
    for i in 0..triangles {
        let mut at = i * of / triangles;
        for (draw, drawn) in draws.iter_mut().enumerate() {
            if at < drawn.triangles {
                // If one part gives no bound, several may.
                let bound = drawn.bound(at, PARTS[0]).unwrap_or(Distance::UNBOUNDED);
                bounds.push((bound, draw, at));
                break;
            }
            at -= drawn.triangles;
        }
    }
    // Split the worst triangle into more parts until it is still the worst, or enough are done.
    bounds.sort_by(|a, b| b.0.max.total_cmp(&a.0.max));
    let mut worst = NONE;
    for (i, (coarse, draw, at)) in bounds.iter().enumerate() {
        if worst.max >= coarse.max || (i >= REFINED && coarse.max.is_finite()) {
            let rest = bounds[i..].iter().map(|(bound, ..)| *bound);
            worst = rest.fold(worst, Distance::or);
            break;
        }
        let drawn = &mut draws[*draw];
        let fine = drawn.bound(*at, PARTS[1]);
        let fine = match fine {
            Ok(fine) if fine.max.is_finite() => fine,
            _ => drawn.bound(*at, PARTS[2])?,
        };
        if fine.max.is_infinite() {
            return Err("an operation may leave every bound within a triangle".to_owned());
        }
        // The rounding term belongs to the bound it was computed with.
        worst = worst.or(if fine.max < coarse.max { fine } else { *coarse });
    }
    Ok(Some((worst, triangles)))
}

/// The distance of no triangles.
const NONE: Distance = Distance {
    max: 0.0,
    roundings: 0.0,
};

/// A draw in one frame.
struct MaterialTriangles {
    computed: Computed,
    vertices: Arguments,
    triangles: u64,
    corners: u32,
}

impl MaterialTriangles {
    fn new(computed: Computed, bound: DrawBindings) -> Self {
        let corners = bound.call.count / 3 * 3;
        Self {
            triangles: u64::from(corners / 3) * u64::from(bound.instances),
            corners,
            vertices: Arguments::new(&computed, bound),
            computed,
        }
    }

    fn bound(&mut self, triangle: u64, parts: u32) -> Result<Distance, String> {
        let [a, b, c] = self.arguments(triangle)?;
        let Computed {
            module, function, ..
        } = &self.computed;
        let function = &module.functions[*function];
        let bounds = bound::over_triangle(
            module,
            function,
            [&a, &b, &c],
            &self.vertices.vertices.environment,
            parts,
        );
        let bounds = bounds.map_err(said)?;
        Ok(bounds.into_iter().fold(NONE, Distance::or))
    }

    /// The arguments of the value's function at the corners of a triangle.
    fn arguments(&mut self, triangle: u64) -> Result<[Vec<Value<Affine>>; 3], String> {
        let each = u64::from(self.corners / 3).max(1);
        let (instance, first) = ((triangle / each) as u32, (triangle % each) as u32 * 3);
        let mut corner = |c: u32| {
            let vertex = vertices::index(&self.vertices.vertices.bound, first + c)
                .ok_or("the mesh is too short")?;
            self.vertices.at(&self.computed, vertex, instance)
        };
        Ok([corner(0)?, corner(1)?, corner(2)?])
    }

    /// Steps that one triangle takes, its vertices included.
    fn steps(&mut self) -> Result<u64, String> {
        let [a, ..] = self.arguments(0)?;
        let Computed {
            module, function, ..
        } = &self.computed;
        let outcome = naga_interp::run(
            module,
            &module.functions[*function],
            &a,
            &self.vertices.vertices.environment,
        );
        Ok(outcome.map_err(said)?.steps)
    }
}

/// The varyings at vertices, as arguments of the value's function, with the errors an adapter may
/// make. Each vertex runs once.
struct Arguments {
    vertices: Vertices<'static, Affine>,
    known: HashMap<(u32, u32), Vec<Value<Affine>>>,
}

impl Arguments {
    fn new(computed: &Computed, bound: DrawBindings) -> Self {
        let resources = vertices::resources(&computed.module, &bound);
        Self {
            vertices: Vertices {
                bound,
                environment: bound::environment(resources),
            },
            known: HashMap::new(),
        }
    }

    fn at(
        &mut self,
        computed: &Computed,
        vertex: u32,
        instance: u32,
    ) -> Result<Vec<Value<Affine>>, String> {
        if let Some(known) = self.known.get(&(vertex, instance)) {
            return Ok(known.clone());
        }
        let found = self.run(computed, vertex, instance)?;
        self.known.insert((vertex, instance), found.clone());
        Ok(found)
    }

    fn run(
        &self,
        computed: &Computed,
        vertex: u32,
        instance: u32,
    ) -> Result<Vec<Value<Affine>>, String> {
        let module = &computed.module;
        let run = self.vertices.run(module, computed.vertex, vertex, instance);
        let (by_location, _) = run?;
        let own = &module.functions[computed.function];
        own.arguments
            .iter()
            .zip(&computed.arguments)
            .map(|(argument, locations)| {
                let values = locations.iter().map(|l| by_location.get(l).cloned());
                let values = values.collect::<Option<Vec<_>>>()?;
                match module.types[argument.ty].inner {
                    naga::TypeInner::Struct { .. } => Some(Value::Composite(values)),
                    _ => values.into_iter().next(),
                }
            })
            .collect::<Option<Vec<_>>>()
            .ok_or_else(|| "a varying is missing".to_owned())
    }
}
