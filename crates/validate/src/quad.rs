//! Runs a fragment stage at the four pixels of a quad, with what a rasteriser provides: varyings
//! interpolated with exact weights, and derivatives as differences between the pixels.
//!
//! Stages run one after the other, and a derivative needs its operand at all four pixels. So each
//! run records the operands of its derivatives in order, and the next round of runs uses them. A
//! round that records the same operands as the one before has used the right ones.

use std::cell::{Cell, RefCell};
use std::collections::BTreeMap;
use std::sync::Arc;

use naga::{
    BuiltIn, DerivativeAxis, DerivativeControl, Expression, ImageDimension, Interpolation, Literal,
    SampleLevel, TypeInner,
};

use super::arithmetic::exp2;
use super::inputs::{Inputs, Random};
use super::made_up_draw::Drawn;
use super::stage::{At, POSITION, Ran, Slot, Stage, VaryingKind, interpolated};
use naga_edit::interface::Io;
use naga_interp::{Derivative, Environment, Lookup, Number, Scalar, Stuck, Value};
use preshade_plan::rasterizer::{Corners, Neighbours, Rasterizer};

/// A float that is one number.
pub(super) trait Float: Number {
    fn exactly(self) -> f64;
    fn rounded(number: f64) -> Self;
}

impl Float for f32 {
    fn exactly(self) -> f64 {
        f64::from(self)
    }

    fn rounded(number: f64) -> Self {
        number as Self
    }
}

impl Float for f64 {
    fn exactly(self) -> f64 {
        self
    }

    fn rounded(number: f64) -> Self {
        number
    }
}

/// A triangle in clip space, over a viewport.
pub(super) struct Triangle {
    /// Clip-space positions.
    pub(super) corners: [[f64; 4]; 3],
    /// x, y, width and height in pixels.
    pub(super) viewport: [f32; 4],
    /// Where the rasteriser has the corners.
    pub(super) place: Corners,
}

/// The weights of the corners at a pixel.
struct Weights {
    perspective: [f64; 3],
    linear: [f64; 3],
}

impl Triangle {
    /// The weights at a place, by Cramer's rule: the place in clip space is the sum of the corners
    /// `(x, y, w)` with the perspective weights, up to a factor.
    fn weights(&self, at: [f64; 2]) -> Weights {
        let [x, y, width, height] = self.viewport.map(f64::from);
        let clip = [
            (at[0] - x) / width * 2.0 - 1.0,
            1.0 - (at[1] - y) / height * 2.0,
            1.0,
        ];
        let w = self.corners.map(|corner| corner[3]);
        if let Some(corners) = self.snapped() {
            let [a, b, c] = corners.map(|[x, y]| [x, y, 1.0]);
            let at = [at[0], at[1], 1.0];
            let linear = unit([
                determinant(at, b, c),
                determinant(a, at, c),
                determinant(a, b, at),
            ]);
            return Weights {
                perspective: unit([0, 1, 2].map(|i| linear[i] / w[i])),
                linear,
            };
        }
        let [a, b, c] = self.corners.map(|[x, y, _, w]| [x, y, w]);
        let perspective = unit([
            determinant(clip, b, c),
            determinant(a, clip, c),
            determinant(a, b, clip),
        ]);
        Weights {
            perspective,
            linear: unit([0, 1, 2].map(|i| perspective[i] * w[i])),
        }
    }

    /// The corners in pixels on the rasteriser's grid, if it has them there.
    fn snapped(&self) -> Option<[[f64; 2]; 3]> {
        let [x, y, width, height] = self.viewport.map(f64::from);
        let is_whole = |[_, _, z, w]: &[f64; 4]| *w > 0.0 && *z >= 0.0 && z <= w;
        if self.place != Corners::Snapped || !self.corners.iter().all(is_whole) {
            return None;
        }
        let grid = |at: f64| (at * 256.0).round_ties_even() / 256.0;
        Some(self.corners.map(|[cx, cy, _, w]| {
            let inside = [cx / w * 0.5 + 0.5, 0.5 - cy / w * 0.5];
            [grid(inside[0] * width + x), grid(inside[1] * height + y)]
        }))
    }

    /// A viewport in which the triangle covers the centre of a pixel; `None` if it is behind the
    /// viewer, or so thin that nothing can be computed from its corners.
    pub(super) fn covering(
        corners: [[f64; 4]; 3],
        place: Corners,
        center: [f32; 2],
        is_linear: bool,
        random: &mut Random,
    ) -> Option<Self> {
        let [a, b, c] = corners.map(|[x, y, _, w]| [x, y, w]);
        let length = |v: [f64; 3]| v.iter().map(|x| x * x).sum::<f64>().sqrt();
        let volume = determinant(a, b, c).abs() / (length(a) * length(b) * length(c));
        // Behind the viewer, only perspective interpolation is defined.
        let is_behind = corners.iter().any(|corner| corner[3] <= 0.0);
        if volume.is_nan() || volume < 1e-5 || (is_linear && is_behind) {
            return None;
        }
        let largest = corners.iter().fold(0.0_f64, |most, c| most.max(c[3].abs()));
        for _ in 0..8 {
            let (u, v) = (f64::from(random.unit()), f64::from(random.unit()));
            let (u, v) = if u + v > 1.0 {
                (1.0 - u, 1.0 - v)
            } else {
                (u, v)
            };
            let weights = [1.0 - u - v, u, v].map(|weight| 0.05 + 0.85 * weight);
            let sum = |i: usize| (0..3).map(|c| weights[c] * corners[c][i]).sum::<f64>();
            let w = sum(3);
            let clip = [sum(0) / w, sum(1) / w];
            if w < 0.1 * largest || clip.iter().any(|at| at.abs() > 64.0) {
                continue;
            }
            let [width, height] = [0, 1].map(|axis| {
                let pixels = (8 + random.below(56)) as f64;
                pixels * 2.0 / extent(corners, axis)
            });
            let [x, y] = center.map(f64::from);
            let viewport = [
                x - width * (clip[0] + 1.0) / 2.0,
                y - height * (1.0 - clip[1]) / 2.0,
                width,
                height,
            ];
            let this = Self {
                corners,
                viewport: viewport.map(|v| v as f32),
                place,
            };
            let weights = this.weights([x, y]).perspective;
            if weights.iter().all(|weight| *weight > 0.01) {
                return Some(this);
            }
        }
        None
    }
}

/// The extent of a triangle on the screen along an axis, from 1/64 to 2, the whole of it.
fn extent(corners: [[f64; 4]; 3], axis: usize) -> f64 {
    let at = corners.map(|corner| corner[axis] / corner[3]);
    let (low, high) = (f64::min, f64::max);
    match corners.iter().all(|corner| corner[3] > 0.0) {
        true => {
            at.iter().copied().fold(f64::NEG_INFINITY, high)
                - at.iter().copied().fold(f64::INFINITY, low)
        }
        false => 2.0,
    }
    .clamp(1.0 / 64.0, 2.0)
}

/// The volume of three vectors.
fn determinant(a: [f64; 3], b: [f64; 3], c: [f64; 3]) -> f64 {
    let cross = [
        b[1] * c[2] - b[2] * c[1],
        b[2] * c[0] - b[0] * c[2],
        b[0] * c[1] - b[1] * c[0],
    ];
    a[0] * cross[0] + a[1] * cross[1] + a[2] * cross[2]
}

/// The numbers scaled so that their sum is 1.
fn unit(numbers: [f64; 3]) -> [f64; 3] {
    let sum: f64 = numbers.iter().sum();
    numbers.map(|number| number / sum)
}

/// A weighted sum. Of three equal numbers, it is exactly that number.
fn blend([a, b, c]: [f64; 3], weights: [f64; 3]) -> f64 {
    a + (b - a) * weights[1] + (c - a) * weights[2]
}

/// A fragment stage over a triangle.
pub struct Quad<'a, F> {
    pub(super) stage: Stage<'a>,
    pub(super) triangle: &'a Triangle,
    /// The results of the vertex stage.
    pub(super) corners: [&'a Ran<F>; 3],
    pub(super) drawn: &'a Drawn<'a>,
    pub(super) inputs: &'a Inputs,
    pub(super) resources: Arc<BTreeMap<(u32, u32), Value<F>>>,
    pub(super) like: Rasterizer,
    pub(super) steps: u64,
}

/// Operands of the derivatives of a run, in order. The coordinates of implicit samples are among
/// them.
type Operands<F> = Vec<Vec<F>>;

/// The pixels of a quad.
const LANES: [[usize; 2]; 4] = [[0, 0], [1, 0], [0, 1], [1, 1]];

/// Most rounds: one more than derivatives depend on one another.
const MOST_ROUNDS: usize = 8;

impl<F: Float> Quad<'_, F> {
    /// The result at the drawn pixel.
    ///
    /// # Errors
    ///
    /// [`Stuck`].
    pub(super) fn run(&self) -> Result<Ran<F>, Stuck> {
        let own = self.drawn.pixel.map(|at| at as usize % 2);
        let (ran, operands) = self.lane(own, None)?;
        if operands.is_empty() {
            return Ok(ran);
        }
        let mut known: Vec<Operands<F>> = Vec::new();
        for lane in LANES {
            known.push(self.lane(lane, None)?.1);
        }
        for _ in 0..MOST_ROUNDS {
            let (mut result, mut next) = (None, Vec::new());
            for lane in LANES {
                let (ran, operands) = self.lane(lane, Some(&known))?;
                next.push(operands);
                if lane == own {
                    result = Some(ran);
                }
            }
            if is_same(&known, &next)
                && let Some(result) = result
            {
                return Ok(result);
            }
            known = next;
        }
        let why = "derivatives that depend on one another";
        Err(Stuck::Unsupported(why.to_owned()))
    }

    /// A run at a pixel of the quad. Derivatives are 0 if `known` has no operands yet.
    fn lane(
        &self,
        lane: [usize; 2],
        known: Option<&[Operands<F>]>,
    ) -> Result<(Ran<F>, Operands<F>), Stuck> {
        let operands: RefCell<Operands<F>> = RefCell::default();
        let is_uniform = Cell::new(true);
        let slopes = |of: &[F], neighbours: Neighbours| {
            let n = operands.borrow().len();
            operands.borrow_mut().push(of.to_vec());
            let Some(known) = known else {
                return [0, 1].map(|_| vec![F::of(0.0); of.len()]);
            };
            differences(known, n, lane, neighbours)
                .filter(|[x, _]| x.len() == of.len())
                .unwrap_or_else(|| {
                    is_uniform.set(false);
                    [of.to_vec(), of.to_vec()]
                })
        };
        let derivative = |d: Derivative<F>| {
            let neighbours = match d.control {
                DerivativeControl::None => self.like.derivatives,
                DerivativeControl::Coarse => self.like.coarse,
                DerivativeControl::Fine => Neighbours::Own,
            };
            let [x, y] = slopes(&[d.of], neighbours).map(|slope| slope[0]);
            match d.axis {
                DerivativeAxis::X => x,
                DerivativeAxis::Y => y,
                DerivativeAxis::Width => F::rounded(x.exactly().abs() + y.exactly().abs()),
            }
        };
        let texture = |lookup: &Lookup<'_, F>| {
            if !lookup.sampling.implicit {
                return self.inputs.texel(lookup);
            }
            let neighbours = match self.is_cube(lookup.binding) {
                true => self.like.cubes,
                false => self.like.samples,
            };
            let axes = &lookup.coordinates[..lookup.sampling.axes];
            let bias = lookup.footprint.first().copied();
            let scale = bias.map_or(1.0, |bias| match self.is_written(bias) {
                // The factor of a bias in the text is written in 32 bits.
                true => f64::from(exp2(bias).exactly() as f32),
                false => exp2(bias).exactly(),
            });
            let slopes = slopes(axes, neighbours).concat();
            let scaled = slopes.iter().map(|s| F::rounded(s.exactly() * scale));
            let footprint: Vec<F> = scaled.collect();
            self.inputs.texel(&Lookup {
                footprint: &footprint,
                ..lookup.clone()
            })
        };
        let environment = Environment {
            resources: Arc::clone(&self.resources),
            texture: &texture,
            derivative: Some(&derivative),
            trace: None,
            steps: self.steps,
        };
        let at = [0, 1].map(|i| {
            let first = self.drawn.pixel[i] & !1;
            f64::from(first) + lane[i] as f64 + 0.5
        });
        let ran = self.stage.run(&self.input(at), &environment);
        if !is_uniform.get() {
            let why = "a derivative in control flow that differs within a quad";
            return Err(Stuck::Unsupported(why.to_owned()));
        }
        let ran = ran?;
        Ok((ran, operands.into_inner()))
    }

    /// The inputs at a place.
    fn input(&self, at: [f64; 2]) -> impl Fn(&Io) -> Option<Value<F>> {
        let weights = self.triangle.weights(at);
        let component = |i: usize| {
            let corners = self.triangle.corners.map(|corner| corner[i]);
            blend(corners, weights.perspective)
        };
        let (z, w) = (component(2), component(3));
        let position = [at[0], at[1], z / w, 1.0 / w].map(F::rounded);
        move |io: &Io| {
            let inside = |kind: VaryingKind, corners: [F; 3]| {
                let weights = match kind.0 {
                    Interpolation::Linear => weights.linear,
                    _ => weights.perspective,
                };
                F::rounded(blend(corners.map(F::exactly), weights))
            };
            match Slot::of(io.binding.as_ref()?) {
                POSITION => Some(Value::composite(&position)),
                Slot::BuiltIn(BuiltIn::FrontFacing) => {
                    Some(Value::Scalar(Scalar::Bool(self.drawn.is_front)))
                }
                Slot::BuiltIn(BuiltIn::PrimitiveIndex) => Some(Value::u32(self.drawn.triangle)),
                Slot::BuiltIn(_) => None,
                Slot::Location(..) => interpolated(io, self.corners, &At::Inside(&inside)),
            }
        }
    }

    /// Whether a sample has this bias as a literal.
    fn is_written(&self, bias: F) -> bool {
        let module = self.stage.module();
        let functions = module.functions.iter().map(|(_, f)| f);
        let entries = module.entry_points.iter().map(|e| &e.function);
        functions.chain(entries).any(|function| {
            let mut all = function.expressions.iter();
            all.any(|(_, expression)| match expression {
                Expression::ImageSample {
                    level: SampleLevel::Bias(level),
                    ..
                } => match function.expressions[*level] {
                    Expression::Literal(Literal::F32(x)) => f64::from(x) == bias.exactly(),
                    _ => false,
                },
                _ => false,
            })
        })
    }

    fn is_cube(&self, texture: Option<(u32, u32)>) -> bool {
        let module = self.stage.module();
        let mut globals = module.global_variables.iter();
        let found = globals.find(|(_, g)| texture.is_some() && naga_interp::place(g) == texture);
        found.is_some_and(|(_, global)| {
            let cube = ImageDimension::Cube;
            matches!(module.types[global.ty].inner, TypeInner::Image { dim, .. } if dim == cube)
        })
    }
}

/// The differences of the n-th operands along x and y; `None` if a pixel has no such operand.
fn differences<F: Float>(
    known: &[Operands<F>],
    n: usize,
    [x, y]: [usize; 2],
    neighbours: Neighbours,
) -> Option<[Vec<F>; 2]> {
    let of = |x: usize, y: usize| known[x + 2 * y].get(n);
    let between = |to: &[F], from: &[F]| {
        let pairs = to.iter().zip(from);
        let apart = pairs.map(|(a, b)| F::binary(naga::BinaryOperator::Subtract, *a, *b));
        apart.collect::<Option<Vec<F>>>()
    };
    let [x, y] = match neighbours {
        Neighbours::Quad => [0, 0],
        Neighbours::Own => [x, y],
    };
    Some([
        between(of(1, y)?, of(0, y)?)?,
        between(of(x, 1)?, of(x, 0)?)?,
    ])
}

fn is_same<F: Float>(a: &[Operands<F>], b: &[Operands<F>]) -> bool {
    let flat = |all: &[Operands<F>]| -> Vec<F> { all.concat().concat() };
    let (a, b) = (flat(a), flat(b));
    a.len() == b.len() && a.iter().zip(&b).all(|(a, b)| a.is_same(*b))
}
