//! Velocities against the positions that the interpreter gives the author's vertex stage.

use std::collections::{BTreeMap, BTreeSet};
use std::thread;

use naga::{Binding, BuiltIn, ShaderStage};
use naga_edit::interface;
use naga_interp::{Lookup, Number, Shadowed};
use preshade_plan::plan::{GpuPass, Plan};
use preshade_plan::state::{CullMode, FrontFace};

use super::{TOLERANCE, VelocityReport, covered};
use crate::measure::texels;
use crate::measure::vertices::{self, Vertices};
use preshade_draw::render::{ColorImage, DepthImage, Rendered};
use preshade_draw::scene::bind::{self, DrawBindings};
use preshade_draw::scene::{Frame, Scene};

/// Most runs of the vertex stage for each draw and frame.
const MOST_RUNS: u32 = 250_000;

/// A triangle: clip positions of its corners, each before and now.
type Triangle = [[[Shadowed; 4]; 2]; 3];

/// A clip position, or why it is not known.
type Position = Result<[Shadowed; 4], String>;

/// A draw and an instance of it, from 0.
type Instance = (usize, u32);

pub(super) struct Drawn<'a> {
    depth: &'a DepthImage,
    velocities: &'a ColorImage,
    /// Whose surface each covered pixel shows; `None`: that is not known.
    owners: BTreeMap<usize, Option<Instance>>,
}

impl<'a> Drawn<'a> {
    /// `numbers` shows the numbers of draws, from 1, and of instances.
    pub fn new(drawn: &'a Rendered, location: usize, numbers: &Rendered) -> Option<Self> {
        let depth = drawn.depth.as_ref()?;
        let of_numbers = &numbers.depth.as_ref()?.values;
        let numbers = numbers.colors.first()?.as_ref()?;
        let owner = |pixel: usize| {
            let [draw, instance] = *numbers.texel(pixel).as_chunks::<4>().0 else {
                return None;
            };
            let draw = u32::from_le_bytes(draw).checked_sub(1)? as usize;
            // Two programs may round positions differently.
            let is_same = depth.values[pixel] == of_numbers[pixel];
            is_same.then_some((draw, u32::from_le_bytes(instance)))
        };
        let pixels = covered(drawn).enumerate().filter(|(_, is)| *is);
        Some(Self {
            depth,
            velocities: drawn.colors.get(location)?.as_ref()?,
            owners: pixels.map(|(pixel, _)| (pixel, owner(pixel))).collect(),
        })
    }
}

pub struct Positions<'a> {
    /// The frame before, and this one.
    pub scenes: [&'a Scene; 2],
    pub frames: [Frame; 2],
    pub plans: &'a [Plan],
}

impl Positions<'_> {
    /// Compares velocities that were drawn.
    pub fn compare(&self, camera: &str, drawn: Option<&Drawn<'_>>, report: &mut VelocityReport) {
        let Some(drawn) = drawn else { return };
        let mut of_draws: BTreeMap<usize, BTreeMap<u32, BTreeSet<usize>>> = BTreeMap::new();
        for (pixel, owner) in &drawn.owners {
            match owner {
                None => report.left_out += 1,
                Some((draw, instance)) => {
                    let of_draw = of_draws.entry(*draw).or_default();
                    of_draw.entry(*instance).or_default().insert(*pixel);
                }
            }
        }
        for (index, instances) in of_draws {
            let why = match self.draw(index) {
                Ok(draw) => draw.compare(camera, drawn, instances, report),
                Err(why) => {
                    let pixels = instances.values().map(|p| p.len() as u64);
                    report.left_out += pixels.sum::<u64>();
                    Some(why)
                }
            };
            report.not_evaluated = report.not_evaluated.take().or(why);
        }
    }

    /// A draw in both frames.
    fn draw(&self, index: usize) -> Result<DrawPositions<'_>, String> {
        let missing = || "the scene has no such draw".to_owned();
        let draw = self.scenes[1].draws.get(index).ok_or_else(missing)?;
        let plan = self.plans.get(draw.material).ok_or_else(missing)?;
        let pass = plan.main().ok_or("the plan has no main pass")?;
        let bound = |when: usize| {
            let (scene, frame) = (self.scenes[when], &self.frames[when]);
            let draw = scene.draws.get(index).ok_or_else(missing)?;
            let material = scene.materials.get(draw.material).ok_or_else(missing)?;
            bind::draw(scene, material, pass, draw, frame).map_err(|e| e.to_string())
        };
        Ok(DrawPositions {
            plan,
            pass,
            bound: [bound(0)?, bound(1)?],
            viewport: self.scenes[1].viewport,
        })
    }
}

struct DrawPositions<'a> {
    plan: &'a Plan,
    pass: &'a GpuPass,
    bound: [DrawBindings; 2],
    /// Left, upper, width and height in pixels; `None`: all of the picture.
    viewport: Option<[u32; 4]>,
}

impl DrawPositions<'_> {
    /// Compares the pixels of some instances, those with most pixels first. Returns why the first
    /// one that is not known is not.
    fn compare(
        &self,
        camera: &str,
        drawn: &Drawn<'_>,
        instances: BTreeMap<u32, BTreeSet<usize>>,
        report: &mut VelocityReport,
    ) -> Option<String> {
        let mut instances: Vec<_> = instances.into_iter().collect();
        instances.sort_by_key(|(_, pixels)| std::cmp::Reverse(pixels.len()));
        let most = (MOST_RUNS / self.bound[1].vertex_count.max(1)).max(1);
        let rest = instances.split_off(instances.len().min(most as usize));
        report.left_out += rest
            .iter()
            .map(|(_, pixels)| pixels.len() as u64)
            .sum::<u64>();
        let mut why = (!rest.is_empty()).then(|| "a draw has too many instances".to_owned());
        let evaluated = self.evaluated(&instances);
        for ((_, pixels), (triangles, unknown)) in instances.into_iter().zip(evaluated) {
            why = why.or(unknown);
            let mut hits: BTreeMap<usize, Vec<Hit>> = BTreeMap::new();
            for triangle in &triangles {
                self.rasterise(triangle, drawn, &pixels, &mut hits);
            }
            for pixel in pixels {
                let hits = hits.get(&pixel).map_or(&[][..], |hits| hits);
                match chosen(hits, drawn.depth.size) {
                    Some(hit) => report.add(camera, drawn.velocities, pixel, &hit),
                    None => report.left_out += 1,
                }
            }
        }
        why
    }

    /// The triangles of each instance, on all cores.
    fn evaluated<P: Sync>(&self, instances: &[(u32, P)]) -> Vec<(Vec<Triangle>, Option<String>)> {
        let threads = thread::available_parallelism().map_or(1, usize::from);
        let size = instances.len().div_ceil(threads).max(1);
        thread::scope(|scope| {
            let part = |part: &'_ [(u32, P)]| -> Vec<_> {
                part.iter().map(|(i, _)| self.triangles(*i)).collect()
            };
            let running: Vec<_> = instances
                .chunks(size)
                .map(|instances| scope.spawn(move || part(instances)))
                .collect();
            let done = running.into_iter().map(thread::ScopedJoinHandle::join);
            done.flat_map(|part| part.unwrap_or_else(|panic| std::panic::resume_unwind(panic)))
                .collect()
        })
    }

    /// The triangles of an instance, and why the first position that is not known is not.
    fn triangles(&self, instance: u32) -> (Vec<Triangle>, Option<String>) {
        let [before, now] = match [0, 1].map(|when| self.corners(instance, when)) {
            [Ok(before), Ok(now)] => [before, now],
            [Err(error), _] | [_, Err(error)] => return (Vec::new(), Some(error)),
        };
        let mut why = None;
        let mut both = Vec::new();
        for corner in before.into_iter().zip(now) {
            both.push(match corner {
                (Ok(before), Ok(now)) => Some([before, now]),
                (Err(error), _) | (_, Err(error)) => {
                    why = why.or(Some(error));
                    None
                }
            });
        }
        let triangles = both.as_chunks::<3>().0.iter();
        let triangles = triangles.filter_map(|[a, b, c]| Some([(*a)?, (*b)?, (*c)?]));
        (triangles.collect(), why)
    }

    /// The position of each corner of an instance, in one of the frames.
    fn corners(&self, instance: u32, when: usize) -> Result<Vec<Position>, String> {
        let bound = &self.bound[when];
        let program = self.plan.program(self.pass);
        let program = program.ok_or("the main pass has no program")?;
        let entry = program.entry_point(ShaderStage::Vertex, &self.pass.vertex);
        let (entry, _) = entry.ok_or("the main pass has no vertex stage")?;
        let module = program.module();
        let texture = |lookup: &Lookup<'_, Shadowed>| {
            let [coordinates, footprint] = [lookup.coordinates, lookup.footprint]
                .map(|all| all.iter().map(|x| x.value).collect::<Vec<f32>>());
            let lookup = Lookup {
                binding: lookup.binding,
                coordinates: &coordinates,
                footprint: &footprint,
                sampling: lookup.sampling,
            };
            texels::texel(bound, &lookup).map(Shadowed::of)
        };
        let mut vertices = Vertices::<Shadowed>::new(module, bound.clone(), |_| true);
        vertices.add_arrays(module);
        vertices.environment.texture = &texture;
        // The interpreter counts from the first instance of the draw.
        let instance = instance.saturating_sub(bound.call.first_instance);
        let mut known: BTreeMap<u32, Position> = BTreeMap::new();
        let mut positions = Vec::new();
        for corner in 0..bound.call.count {
            let vertex = vertices::index(bound, corner).ok_or("an index is out of bounds")?;
            let run = || vertices.position(module, entry, vertex, instance);
            positions.push(known.entry(vertex).or_insert_with(run).clone());
        }
        Ok(positions)
    }

    /// Adds the hits of a triangle at `pixels`. One that is culled has none.
    fn rasterise(
        &self,
        triangle: &Triangle,
        drawn: &Drawn<'_>,
        pixels: &BTreeSet<usize>,
        hits: &mut BTreeMap<usize, Vec<Hit>>,
    ) {
        // A depth that the fragment stage writes is that of no triangle.
        let has_depth = !writes_depth(self.plan);
        let size = drawn.depth.size;
        let viewport = self.viewport.unwrap_or([0, 0, size[0], size[1]]);
        let program = self.plan.program(self.pass);
        let said = self
            .plan
            .steps
            .iter()
            .find_map(|s| s.params.get("y")?.as_str());
        let of_language = program.is_some_and(|p| p.declared().y_down);
        let is_down = said.map_or(of_language, |y| y == "down");
        let parts = in_front(triangle).into_iter();
        let parts = parts.filter_map(|corners| OnScreen::new(corners, size, viewport, is_down));
        for on_screen in parts.filter(|part| !part.is_culled(self.pass)) {
            on_screen.each_pixel(&mut |pixel, hit: Point| {
                if !pixels.contains(&pixel) {
                    return;
                }
                let depth = f64::from(drawn.depth.values[pixel]);
                let apart = (hit.depth - depth).abs();
                hits.entry(pixel).or_default().push(Hit {
                    apart: if has_depth { apart } else { 0.0 },
                    velocity: hit.velocity,
                    slack: hit.slack,
                });
            });
        }
    }
}

/// Whether the main pass has a depth of its own.
fn writes_depth(plan: &Plan) -> bool {
    let main = plan
        .main()
        .and_then(|pass| Some((pass, plan.program(pass)?)));
    let Some((pass, program)) = main else {
        return false;
    };
    let name = pass.fragment.as_deref().unwrap_or_default();
    let Some((index, _)) = program.entry_point(ShaderStage::Fragment, name) else {
        return false;
    };
    let module = program.module();
    let outputs = interface::outputs(module, &module.entry_points[index].function);
    let depth = Some(Binding::BuiltIn(BuiltIn::FragDepth));
    outputs.iter().any(|output| output.binding == depth)
}

/// A triangle of the drawn instance at a pixel.
#[derive(Clone, Copy)]
struct Hit {
    /// How far its depth is from the one drawn.
    apart: f64,
    /// Its velocity, in parts of the picture.
    velocity: [f64; 2],
    /// The part of it that an adapter may compute differently.
    slack: [f64; 2],
}

/// Depths that count as equal: an adapter interpolates in 32-bit floats.
const SAME_DEPTH: f64 = 4e-6;

/// The most pixels by which an adapter may compute a velocity differently. A pixel with more is not
/// compared.
const MOST_SLACK: f64 = 0.125;

/// The triangle that a pixel shows: of those that cover it, the one nearest to the depth drawn. `None`: that is not known.
fn chosen(hits: &[Hit], size: [u32; 2]) -> Option<Hit> {
    let best = hits.iter().min_by(|a, b| a.apart.total_cmp(&b.apart))?;
    let differs = |hit: &Hit| {
        let mut axes = hit.velocity.iter().zip(&best.velocity).zip(size);
        // NaN differs from all.
        !axes.all(|((a, b), size)| (a - b).abs() * f64::from(size) <= TOLERANCE)
    };
    let is_near = |hit: &Hit| hit.apart <= SAME_DEPTH;
    let is_known = best.apart <= SAME_DEPTH && !hits.iter().any(|hit| is_near(hit) && differs(hit));
    let mut slack = best.slack.iter().zip(size);
    let is_sure = slack.all(|(slack, size)| slack * f64::from(size) <= MOST_SLACK);
    (is_known && is_sure).then_some(*best)
}

impl VelocityReport {
    fn add(&mut self, camera: &str, drawn: &ColorImage, pixel: usize, hit: &Hit) {
        self.pixels += 1;
        let half = drawn.texel_bytes() == 4;
        let values = drawn.rgba(pixel).map(f64::from);
        let known = hit.velocity.into_iter().zip(hit.slack);
        for ((value, (expected, slack)), size) in values.into_iter().zip(known).zip(drawn.size) {
            let size = f64::from(size);
            // A step of 11 bits: adapters round to either neighbour.
            let rounding = if half { expected.abs() / 1024.0 } else { 0.0 };
            let error = ((value - expected).abs() - rounding - slack).max(0.0) * size;
            self.longest = self.longest.max(expected.abs() * size);
            if error.is_nan() || error > self.worst {
                self.worst = error;
                let pixel = pixel as u32;
                let at = [pixel % drawn.size[0], pixel / drawn.size[0]];
                self.at = Some((camera.to_owned(), at));
            }
        }
    }
}

/// Clip positions of a corner, before and now, as an adapter rounds them; and both unrounded.
type Corner = [[f64; 4]; 4];

/// The least w that counts as in front of the camera.
const IN_FRONT: f64 = 1e-3;

/// The part of a triangle that is in front of the camera now, as triangles. Clip positions are
/// linear along an edge.
fn in_front(triangle: &Triangle) -> Vec<[Corner; 3]> {
    let corners: [Corner; 3] = triangle.map(|[before, now]| {
        let rounded = [before, now].map(|clip| clip.map(|x| f64::from(x.value)));
        let unrounded = [before, now].map(|clip| clip.map(|x| x.truth));
        [rounded[0], rounded[1], unrounded[0], unrounded[1]]
    });
    if corners.iter().flatten().flatten().any(|n| n.is_nan()) {
        return Vec::new();
    }
    let mut kept: Vec<Corner> = Vec::new();
    for (i, a) in corners.into_iter().enumerate() {
        let b = corners[(i + 1) % 3];
        let [of_a, of_b] = [a, b].map(|corner| corner[1][3] - IN_FRONT);
        if of_a >= 0.0 {
            kept.push(a);
        }
        if (of_a < 0.0) != (of_b < 0.0) {
            let share = of_a / (of_a - of_b);
            kept.push(std::array::from_fn(|when| {
                std::array::from_fn(|n| a[when][n] + (b[when][n] - a[when][n]) * share)
            }));
        }
    }
    let fan = (1..kept.len().saturating_sub(1)).map(|i| [kept[0], kept[i], kept[i + 1]]);
    fan.collect()
}

/// A triangle on the screen.
struct OnScreen {
    corners: [Corner; 3],
    /// Column, row and depth of each corner now, in pixels from the upper left corner.
    screen: [[f64; 3]; 3],
    /// Twice its area. Negative: its corners run counterclockwise.
    area: f64,
    size: [u32; 2],
    /// Whether y of clip space points down.
    is_down: bool,
}

/// A point of a triangle at the centre of a pixel.
struct Point {
    depth: f64,
    velocity: [f64; 2],
    slack: [f64; 2],
}

/// An adapter snaps corners to this part of a pixel.
const SNAP: f64 = 1.0 / 256.0;

/// An adapter may round positions differently from the interpreter, by this many of its errors.
const ROUNDINGS: f64 = 4.0;

/// How far beyond an edge a triangle may still cover a pixel, in pixels: an adapter snaps corners
/// to 1/256 of a pixel.
const BESIDE: f64 = 2.0 * SNAP;

impl OnScreen {
    fn new(
        corners: [Corner; 3],
        size: [u32; 2],
        viewport: [u32; 4],
        is_down: bool,
    ) -> Option<Self> {
        let [left, upper, wide, high] = viewport.map(f64::from);
        let screen = corners.map(|[_, [x, y, z, w], ..]| {
            let (x, y) = (x / w, y / w);
            [
                left + (x * 0.5 + 0.5) * wide,
                upper + (0.5 - y * 0.5) * high,
                z / w,
            ]
        });
        let [a, b, c] = screen;
        let area = (b[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (b[1] - a[1]);
        (area != 0.0 && area.is_finite()).then_some(Self {
            corners,
            screen,
            area,
            size,
            is_down,
        })
    }

    fn is_culled(&self, pass: &GpuPass) -> bool {
        let is_ccw = self.area < 0.0;
        let is_front = is_ccw == (pass.primitive.front_face == FrontFace::Ccw);
        match pass.primitive.cull {
            CullMode::None => false,
            CullMode::Front => is_front,
            CullMode::Back => !is_front,
        }
    }

    /// Calls `hit` with each pixel whose centre it covers.
    fn each_pixel(&self, hit: &mut dyn FnMut(usize, Point)) {
        let bounds = |axis: usize| {
            let all = self.screen.map(|s| s[axis]);
            let low = all.iter().copied().fold(f64::INFINITY, f64::min);
            let high = all.iter().copied().fold(f64::NEG_INFINITY, f64::max);
            let most = f64::from(self.size[axis]);
            (low - BESIDE).clamp(0.0, most) as usize
                ..(high + BESIDE).clamp(0.0, most).ceil() as usize
        };
        for row in bounds(1) {
            for column in bounds(0) {
                let (x, y) = (column as f64 + 0.5, row as f64 + 0.5);
                let edges = self.edges([x, y]);
                if edges.iter().all(|e| e[1] >= -BESIDE) {
                    let pixel = row * self.size[0] as usize + column;
                    hit(pixel, self.point([x, y], edges.map(|e| e[0])));
                }
            }
        }
    }

    /// The share of each corner at a place, and how many pixels inside the edge opposite to it the
    /// place is.
    fn edges(&self, [x, y]: [f64; 2]) -> [[f64; 2]; 3] {
        let [a, b, c] = self.screen;
        [(b, c), (c, a), (a, b)].map(|(p, q)| {
            let (along, down) = (q[0] - p[0], q[1] - p[1]);
            let share = (along * (y - p[1]) - (x - p[0]) * down) / self.area;
            [share, share * self.area.abs() / along.hypot(down)]
        })
    }

    /// The point at a place where corners have these shares. If it was behind the camera, its velocity
    /// is no number.
    fn point(&self, [x, y]: [f64; 2], weights: [f64; 3]) -> Point {
        let depth = weights
            .iter()
            .zip(&self.screen)
            .map(|(w, s)| w * s[2])
            .sum();
        let clips = self.clips(weights);
        let velocity = self.velocity(&clips);
        let beside = [[x + SNAP, y], [x, y + SNAP]]
            .map(|place| self.velocity(&self.clips(self.edges(place).map(|e| e[0]))));
        let slack = std::array::from_fn(|axis| {
            let snapped = beside.map(|v| (v[axis] - velocity[axis]).abs());
            let rounded = [0, 1].map(|when| {
                let worst = |axis: usize| {
                    let apart = self
                        .corners
                        .iter()
                        .map(|c| (c[when][axis] - c[when + 2][axis]).abs());
                    apart.fold(0.0, f64::max)
                };
                let [place, w] = [clips[when][axis], clips[when][3]];
                (worst(axis) + (place / w).abs() * worst(3)) / w.abs() * 0.5
            });
            snapped.iter().sum::<f64>() + ROUNDINGS * rounded.iter().sum::<f64>()
        });
        Point {
            depth,
            velocity,
            slack,
        }
    }

    /// The clip positions, before and now, where corners have these shares on the screen.
    fn clips(&self, weights: [f64; 3]) -> [[f64; 4]; 2] {
        let shares: [f64; 3] = std::array::from_fn(|i| weights[i] / self.corners[i][1][3]);
        let total: f64 = shares.iter().sum();
        std::array::from_fn(|when| {
            std::array::from_fn(|axis| {
                let terms = shares.iter().zip(&self.corners);
                terms.map(|(s, corner)| s * corner[when][axis]).sum::<f64>() / total
            })
        })
    }

    /// In parts of the picture, where y points down.
    fn velocity(&self, [before, now]: &[[f64; 4]; 2]) -> [f64; 2] {
        let moved = |axis: usize| now[axis] / now[3] - before[axis] / before[3];
        let down = if self.is_down { 0.5 } else { -0.5 };
        let velocity = [moved(0) * 0.5, moved(1) * down];
        velocity.map(|v| if before[3] > 0.0 { v } else { f64::NAN })
    }
}
