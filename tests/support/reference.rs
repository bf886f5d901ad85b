//! Compares colours with exact arithmetic: how far the original and a variant are from the
//! unrounded result.
//!
//! Points are random, in random triangles of the scene's meshes. The interpreter runs both stages
//! in `f32` with `f64` beside it ([`Shadowed`]). The reference is the original's `f64` result, with
//! the same attributes, uniforms, texels and derivatives. Interpolation is a sum of three products
//! in each precision. So the figures describe a machine that rounds each operation correctly, fuses
//! none and uses the C library's functions. An adapter may be less exact
//! ([`naga_interp::bound::Accuracy`]).
//!
//! Branches follow the `f32` values. Points at which the `f64` values would branch otherwise are
//! counted and left out.

#![allow(dead_code)] // Each user takes its own part.

use std::collections::BTreeMap;

use naga::{Binding, BuiltIn, ShaderStage};
use naga_edit::interface::Io;
use naga_interp::bound::exactly;
use naga_interp::{Derivative, Environment, Lookup, Number, Scalar, Shadowed, Stuck, Value, ulps};
use preshade_draw::scene::{Draw, Scene, bind};
use preshade_lab::measure::vertices::{self, STEPS, Vertices};
use preshade_plan::plan::Plan;
use preshade_plan::state::Topology;
use preshade_validate::inputs::Random;
use preshade_validate::stage::{At, POSITION, Ran, Slot, Stage, VaryingKind, interpolated};
use serde::Serialize;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Points {
    pub count: u64,
    pub seed: u64,
}

impl Default for Points {
    fn default() -> Self {
        Self {
            count: 2000,
            seed: 1,
        }
    }
}

/// Errors over all points: the worst component of each.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Spread {
    pub median: f64,
    /// 99 in 100 have no more.
    pub p99: f64,
    pub max: f64,
}

impl Spread {
    /// Of numbers; zeros of none.
    fn of(mut errors: Vec<f64>) -> Self {
        errors.sort_by(f64::total_cmp);
        let at = |part: f64| {
            let last = errors.len().saturating_sub(1);
            errors
                .get((part * last as f64).round() as usize)
                .copied()
                .unwrap_or_default()
        };
        Self {
            median: at(0.5),
            p99: at(0.99),
            max: at(1.0),
        }
    }
}

/// Errors of one of the two.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Errors {
    /// In units in the last place of an `f32` as large as the truth.
    pub ulps: Spread,
    /// In steps of 1/255, after clamping to the target's range.
    pub steps: Spread,
}

/// Which of the two is nearer to the truth.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Nearer {
    /// At every point the bits are the same.
    SameBits,
    /// The variant: its 99th percentile, in ULP, is more than a tenth lower.
    Better,
    /// Neither bound.
    AsGood,
    /// The original: the variant's is more than a tenth higher.
    Worse,
}

/// Numbers that a host knows more exactly than the `f32` it uploads, by group and binding, in the
/// order of the type's declaration. All other numbers count as exact.
pub(crate) type Exactly<'a> = &'a dyn Fn(&Draw) -> BTreeMap<(u32, u32), Vec<f64>>;

/// Position error of triangle corners, in pixels. Corners behind the viewer, or farther out than
/// the picture is wide, do not count.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Positions {
    pub original: Spread,
    pub variant: Spread,
}

/// An output of a material's fragment stage, as two programs compute it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Truth {
    pub material: String,
    /// Output, by its location.
    pub output: u32,
    pub points: u64,
    /// Points left out because a rounding changed a branch of the original.
    pub flips: u64,
    /// Points left out because a rounding changed a branch of the variant.
    pub variant_flips: u64,
    /// Points left out because one of the two is discarded or not finite.
    pub left_out: u64,
    pub original: Errors,
    pub variant: Errors,
    /// Which is nearer.
    pub nearer: Nearer,
    /// Where the corners are, of the points that count.
    pub positions: Positions,
}

/// A point of a triangle, and the result of both stages there.
struct RoundedPoint<'a> {
    vertices: &'a Vertices<'static, Shadowed>,
    /// The corners' vertices.
    corners: [u32; 3],
    instance: u32,
    weights: [f32; 3],
    seed: u64,
}

/// How far the colours of `original` and `variant` are from the exact ones, over the triangles of a
/// scene.
///
/// # Errors
///
/// The reason why it is unknown, in a user's words.
pub fn truth(
    scene: &Scene,
    material: usize,
    original: &Plan,
    variant: &Plan,
    points: Points,
) -> Result<Vec<Truth>, String> {
    truth_beyond(scene, material, original, variant, points, &|_| {
        BTreeMap::new()
    })
}

/// The same, with the host's exact numbers as the reference: rounding them to `f32` is an error
/// too.
///
/// # Errors
///
/// The reason why it is unknown, in a user's words.
pub fn truth_beyond(
    scene: &Scene,
    material: usize,
    original: &Plan,
    variant: &Plan,
    points: Points,
    exactly: Exactly<'_>,
) -> Result<Vec<Truth>, String> {
    let pass = original.main().ok_or("the material has no main pass")?;
    let other = variant.main().ok_or("the variant has no main pass")?;
    if pass.primitive.topology != Topology::TriangleList || !other.geometry.is_as_given() {
        return Err("it is not drawn as the list of triangles that its mesh is".to_owned());
    }
    let stages = |plan: &'_ Plan| -> Option<(preshade_plan::program::Program, String, String)> {
        let main = plan.main()?;
        Some((
            plan.program(main)?.clone(),
            main.vertex.clone(),
            main.fragment.clone()?,
        ))
    };
    let (own, own_vertex, own_fragment) = stages(original).ok_or("it has no fragment stage")?;
    let (new, new_vertex, new_fragment) = stages(variant).ok_or("it has no fragment stage")?;
    let stage = |program, kind, name: &str| {
        Stage::new(program, kind, name).ok_or_else(|| format!("there is no `{name}`"))
    };
    let own = [
        stage(&own, ShaderStage::Vertex, &own_vertex)?,
        stage(&own, ShaderStage::Fragment, &own_fragment)?,
    ];
    let new = [
        stage(&new, ShaderStage::Vertex, &new_vertex)?,
        stage(&new, ShaderStage::Fragment, &new_fragment)?,
    ];
    let module = own[0].module();
    let (_, frame) = scene.frames().next().ok_or("the scene has no frame")?;
    let mut draws = Vec::new();
    for draw in scene.draws.iter().filter(|d| d.material == material) {
        let bound = bind::draw(scene, &scene.materials[material], pass, draw, frame)
            .map_err(|e| e.to_string())?;
        let mut resources = vertices::resources(module, &bound);
        resources.extend(vertices::of_any_length(module, &bound));
        for (at, numbers) in exactly(draw) {
            let resource = resources.get_mut(&at);
            let resource = resource.ok_or("a uniform is named that there is not")?;
            let mut numbers = numbers.into_iter();
            *resource = exact(resource, &mut numbers).ok_or("there are too few numbers")?;
        }
        draws.push(Vertices {
            environment: Environment {
                resources: resources.into(),
                texture: &|_: &Lookup<'_, Shadowed>| [Shadowed::of(0.0); 4],
                derivative: None,
                trace: None,
                steps: STEPS,
            },
            bound,
        });
    }
    draws.retain(|d| d.bound.call.count >= 3 && d.bound.instances > 0);
    if draws.is_empty() {
        return Err("no triangle of it is drawn".to_owned());
    }
    let mut found: BTreeMap<u32, Seen> = BTreeMap::new();
    for n in 0..points.count {
        let mut random = Random::new(points.seed, &format!("point {n}"));
        let vertices = &draws[random.below(draws.len())];
        let first = 3 * random.below((vertices.bound.call.count / 3) as usize) as u32;
        let corner = |c| vertices::index(&vertices.bound, first + c);
        let corners = [corner(0), corner(1), corner(2)];
        let [Some(a), Some(b), Some(c)] = corners else {
            return Err("the mesh is too short".to_owned());
        };
        let (u, v) = (random.unit(), random.unit());
        let (u, v) = if u + v > 1.0 {
            (1.0 - u, 1.0 - v)
        } else {
            (u, v)
        };
        let point = RoundedPoint {
            vertices,
            corners: [a, b, c],
            instance: vertices.bound.call.first_instance
                + random.below(vertices.bound.instances as usize) as u32,
            weights: [1.0 - u - v, u, v],
            seed: points.seed.wrapping_add(n),
        };
        let (own_corners, of_original) = point.run(own).map_err(vertices::said)?;
        let (new_corners, of_variant) = point.run(new).map_err(vertices::said)?;
        for (slot, value) in &of_original.outputs {
            let Slot::Location(location, None) = slot else {
                continue;
            };
            let format = pass
                .targets
                .get(*location as usize)
                .and_then(|t| t.as_ref())
                .map_or("", |t| t.format.as_str());
            let seen = found.entry(*location).or_default();
            let counts = seen.add(
                (&of_original, value),
                (&of_variant, of_variant.outputs.get(slot)),
                format.contains("unorm"),
            );
            if counts {
                for (pixels, corners) in [(0, &own_corners), (1, &new_corners)] {
                    seen.pixels[pixels].extend(corners.iter().filter_map(|c| off(c, scene.size)));
                }
            }
        }
    }
    let name = &original.material;
    if found.values().all(|seen| seen.points == 0) {
        return Err("there is no point at which both are kept, finite and of one path".to_owned());
    }
    Ok(found
        .into_iter()
        .map(|(output, seen)| seen.told(name, output))
        .collect())
}

/// A value with the truths of its floats put in their place; `None`: there are not enough.
fn exact(
    value: &Value<Shadowed>,
    numbers: &mut impl Iterator<Item = f64>,
) -> Option<Value<Shadowed>> {
    Some(match value {
        Value::Scalar(Scalar::F32(float)) => Value::Scalar(Scalar::F32(Shadowed {
            truth: numbers.next()?,
            ..*float
        })),
        Value::Composite(parts) => {
            let parts = parts.iter().map(|p| exact(p, &mut *numbers));
            Value::Composite(parts.collect::<Option<_>>()?)
        }
        other => other.clone(),
    })
}

/// How many pixels a clip position is from its truth.
fn off(clip: &[Shadowed; 4], size: [u32; 2]) -> Option<f64> {
    let [x, y, _, w] = clip;
    let is_seen =
        w.truth > 0.0 && w.value > 0.0 && x.truth.abs().max(y.truth.abs()) < 3.0 * w.truth;
    let along = |of: &Shadowed, pixels: u32| {
        let apart = f64::from(of.value) / f64::from(w.value) - of.truth / w.truth;
        0.5 * f64::from(pixels) * apart
    };
    is_seen.then(|| along(x, size[0]).hypot(along(y, size[1])))
}

impl RoundedPoint<'_> {
    /// The positions of the corners, and the result of the fragment stage at the point.
    fn run(
        &self,
        [vertex, fragment]: [Stage<'_>; 2],
    ) -> Result<(Vec<[Shadowed; 4]>, Ran<Shadowed>), Stuck> {
        let texel = |lookup: &Lookup<'_, Shadowed>| {
            let mut random = Random::new(self.seed, &format!("texel {:?}", lookup.binding));
            // The values of an 8-bit texture.
            [0; 4].map(|_| Shadowed::of(random.below(256) as f32 / 255.0))
        };
        let derivative = |d: Derivative<Shadowed>| Shadowed {
            value: d.of.value * DERIVATIVE,
            truth: d.of.truth * f64::from(DERIVATIVE),
        };
        let environment = || Environment {
            resources: self.vertices.environment.resources.clone(),
            texture: &texel,
            derivative: Some(&derivative),
            trace: None,
            steps: STEPS,
        };
        let at = |corner: u32| {
            let input = |io: &Io| {
                let module = vertex.module();
                let value = self.vertices.input(
                    module,
                    io.ty,
                    io.binding.as_ref(),
                    corner,
                    self.instance,
                )?;
                Some(exactly(&value))
            };
            vertex.run(&input, &environment())
        };
        let [a, b, c] = self.corners;
        let corners = [at(a)?, at(b)?, at(c)?];
        // One point for all: the rasteriser's choice of a point is no error of the material.
        let between = |_: VaryingKind, corners: [Shadowed; 3]| self.between(corners);
        let input = |io: &Io| match &io.binding {
            Some(Binding::Location { .. }) => {
                interpolated(io, corners.each_ref(), &At::Inside(&between))
            }
            Some(binding @ Binding::BuiltIn(builtin)) => match builtin {
                _ if Slot::of(binding) == POSITION => Some(Value::composite(&self.pixel())),
                BuiltIn::FrontFacing => Some(Value::Scalar(Scalar::Bool(true))),
                BuiltIn::SampleIndex => Some(Value::u32(0)),
                BuiltIn::SampleMask => Some(Value::u32(1)),
                _ => None,
            },
            None => None,
        };
        let clips = corners.iter().filter_map(|corner| {
            let clip = corner.outputs.get(&POSITION)?.floats().ok()?;
            <[Shadowed; 4]>::try_from(clip).ok()
        });
        Ok((clips.collect(), fragment.run(&input, &environment())?))
    }

    /// Weights that do not quite add up to 1, as a rasteriser's, and such as do.
    fn between(&self, corners: [Shadowed; 3]) -> Shadowed {
        let value = corners.iter().zip(self.weights);
        let value = value.fold(0.0, |sum, (corner, weight)| sum + corner.value * weight);
        let weights = self.weights.map(f64::from);
        let whole: f64 = weights.iter().sum();
        let truth = corners.iter().zip(weights);
        let truth = truth
            .map(|(corner, weight)| corner.truth * weight)
            .sum::<f64>()
            / whole;
        Shadowed { value, truth }
    }

    /// Some pixel: where it is on the screen is an input.
    fn pixel(&self) -> [Shadowed; 4] {
        let mut random = Random::new(self.seed, "pixel");
        let mut at = |most: usize| Shadowed::of(random.below(most) as f32 + 0.5);
        [at(640), at(360), Shadowed::of(0.5), Shadowed::of(1.0)]
    }
}

/// A derivative is a linear function of its operand, in both precisions. The real one needs two
/// fragments.
const DERIVATIVE: f32 = 1.0 / 64.0;

#[derive(Default)]
struct Seen {
    points: u64,
    flips: u64,
    variant_flips: u64,
    left_out: u64,
    differing: u64,
    original: [Vec<f64>; 2],
    variant: [Vec<f64>; 2],
    pixels: [Vec<f64>; 2],
}

impl Seen {
    fn add(
        &mut self,
        (original, own): (&Ran<Shadowed>, &Value<Shadowed>),
        (variant, new): (&Ran<Shadowed>, Option<&Value<Shadowed>>),
        is_clamped: bool,
    ) -> bool {
        let numbers = |value: &Value<Shadowed>| value.floats().ok();
        let (Some(own), Some(new)) = (numbers(own), new.and_then(numbers)) else {
            self.left_out += 1;
            return false;
        };
        let is_finite = |x: &Shadowed| x.value.is_finite() && x.truth.is_finite();
        let is_seen = !original.discarded && !variant.discarded;
        if !is_seen || !own.iter().chain(&new).all(is_finite) {
            self.left_out += 1;
            return false;
        }
        if original.flips > 0 {
            self.flips += 1;
            return false;
        }
        if variant.flips > 0 {
            self.variant_flips += 1;
            return false;
        }
        self.points += 1;
        let is_same = |(a, b): (&Shadowed, &Shadowed)| a.value.to_bits() == b.value.to_bits();
        self.differing += u64::from(!own.iter().zip(&new).all(is_same));
        let clamped = |x: f64| if is_clamped { x.clamp(0.0, 1.0) } else { x };
        let worst = |values: &[Shadowed], error: &dyn Fn(f64, f64) -> f64| {
            let errors = values.iter().zip(&own);
            let errors = errors.map(|(value, own)| error(f64::from(value.value), own.truth));
            errors.fold(0.0, f64::max)
        };
        let steps = |value: f64, truth: f64| (clamped(value) - clamped(truth)).abs() * 255.0;
        for (errors, values) in [(&mut self.original, &own), (&mut self.variant, &new)] {
            errors[0].push(worst(values, &ulps));
            errors[1].push(worst(values, &steps));
        }
        true
    }

    fn told(self, material: &str, output: u32) -> Truth {
        let errors = |[ulps, steps]: [Vec<f64>; 2]| Errors {
            ulps: Spread::of(ulps),
            steps: Spread::of(steps),
        };
        let (original, variant) = (errors(self.original), errors(self.variant));
        let [of_original, of_variant] = self.pixels.map(Spread::of);
        let (before, after) = (original.ulps.p99, variant.ulps.p99);
        let nearer = match () {
            () if self.differing == 0 => Nearer::SameBits,
            () if after < 0.9 * before => Nearer::Better,
            () if after > 1.1 * before => Nearer::Worse,
            () => Nearer::AsGood,
        };
        Truth {
            material: material.to_owned(),
            output,
            points: self.points,
            flips: self.flips,
            variant_flips: self.variant_flips,
            left_out: self.left_out,
            original,
            variant,
            nearer,
            positions: Positions {
                original: of_original,
                variant: of_variant,
            },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::Spread;

    #[test]
    fn percentiles_are_of_the_sorted() {
        let spread = Spread::of((0..=100).rev().map(f64::from).collect());
        assert_eq!((spread.median, spread.p99, spread.max), (50.0, 99.0, 100.0));
        assert_eq!(Spread::of(Vec::new()), Spread::default());
    }
}
