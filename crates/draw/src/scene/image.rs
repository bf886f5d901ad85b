//! Textures: generated patterns, image files, and their mip levels.

pub mod blocks;
mod texels;

use serde::Deserialize;

pub use texels::Texels;
use texels::srgb_to_linear;

use super::Image;
use super::noise::{fractal, random};

/// A generated pattern. Each is a height in `[0, 1]` and an alpha over the unit square, and tiles.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Pattern {
    /// One colour, the first.
    Solid,
    /// Two colours in alternation.
    #[default]
    Checker,
    /// Five octaves of value noise.
    Noise,
    /// Running bond with mortar; each brick has its own shade.
    Bricks,
    /// Rounded stones of varying shade in a jittered grid.
    Stones,
    /// From the first colour at the top to the second at the bottom.
    Gradient,
    /// Leaves: opaque ellipses on a transparent background.
    Leaf,
    /// Chain links: opaque rings on a transparent background.
    Chain,
    /// Lace: cloth with round holes.
    Lace,
    /// Blades of grass on the lower edge, with varying height and lean, on a transparent
    /// background.
    Blades,
}

/// A texture entry of a scene file.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(
    default,
    deny_unknown_fields,
    expecting = "a table: { pattern = \"checker\" } or { file = \"albedo.png\" } say"
)]
pub struct Recipe {
    /// A pattern to generate, if there is no `file`.
    pub pattern: Option<Pattern>,
    /// An image file, relative to the scene's folder.
    pub file: Option<String>,
    /// Width and height of a generated pattern, 1 to 4096.
    pub size: u32,
    /// Cells of the pattern across the texture, 1 to 4096.
    pub scale: u32,
    pub seed: u32,
    /// Colours for heights 0 and 1, as stored (that is sRGB-encoded when `srgb`), 0 to 1.
    pub colors: [[f32; 3]; 2],
    /// Generates a normal map of this strength from the pattern's height, instead of a colour.
    pub normal: Option<f32>,
    /// Whether texels are sRGB-encoded. Default: no for patterns, yes for files.
    pub srgb: Option<bool>,
    /// Whether to generate mip levels.
    pub mips: bool,
}

impl Default for Recipe {
    fn default() -> Self {
        Self {
            pattern: None,
            file: None,
            size: 256,
            scale: 8,
            seed: 1,
            colors: [[0.25, 0.22, 0.2], [0.85, 0.8, 0.72]],
            normal: None,
            srgb: None,
            mips: true,
        }
    }
}

/// Largest side of a generated texture and largest number of cells. More cells than texels would
/// not be visible.
pub const MAX_SIDE: u32 = 4096;

impl Recipe {
    pub fn generate(&self) -> Image {
        let pattern = self.pattern.unwrap_or_default();
        let n = self.size.clamp(1, MAX_SIDE);
        let scale = self.scale.clamp(1, MAX_SIDE);
        let mut samples = Vec::with_capacity((n * n) as usize);
        for y in 0..n {
            for x in 0..n {
                let (u, v) = ((x as f32 + 0.5) / n as f32, (y as f32 + 0.5) / n as f32);
                samples.push(pattern.sample(u, v, scale, self.seed));
            }
        }
        let at = |x: u32, y: u32| samples[((y % n) * n + x % n) as usize].0;
        let mut texels = Vec::with_capacity((n * n * 4) as usize);
        for y in 0..n {
            for x in 0..n {
                let (height, alpha) = samples[(y * n + x) as usize];
                let rgb = match self.normal {
                    Some(strength) => {
                        let dx = at(x + n - 1, y) - at(x + 1, y);
                        let dy = at(x, y + n - 1) - at(x, y + 1);
                        let v = glam::Vec3::new(dx * strength, dy * strength, 1.0).normalize();
                        (v * 0.5 + 0.5).to_array()
                    }
                    None => std::array::from_fn(|c| {
                        let [low, high] = [self.colors[0][c], self.colors[1][c]];
                        low + (high - low) * height
                    }),
                };
                texels.extend(rgb.map(to_byte));
                texels.push(to_byte(alpha));
            }
        }
        finish([n, n], texels, self.srgb.unwrap_or(false), self.mips)
    }
}

impl Pattern {
    /// Height and alpha at a point of the unit square.
    fn sample(self, u: f32, v: f32, scale: u32, seed: u32) -> (f32, f32) {
        let s = scale as f32;
        let (cu, cv) = ((u * s).floor(), (v * s).floor());
        let (fu, fv) = (u * s - cu - 0.5, v * s - cv - 0.5);
        let inside = |d: f32| if d <= 0.0 { 1.0 } else { 0.0 };
        match self {
            Self::Solid => (0.0, 1.0),
            Self::Checker => ((cu + cv).rem_euclid(2.0), 1.0),
            Self::Noise => (fractal(u, v, scale, seed), 1.0),
            Self::Gradient => (v, 1.0),
            Self::Bricks => {
                // Bricks are twice as wide as high; every other row is shifted by half.
                let shift = if cv.rem_euclid(2.0) == 1.0 { 0.5 } else { 0.0 };
                let bu = u * s / 2.0 + shift;
                let brick = bu.floor().rem_euclid((s / 2.0).max(1.0));
                let (du, dv) = ((bu - bu.floor() - 0.5).abs() * 2.0, fv.abs() * 2.0);
                let mortar = ((du - 0.94) / 0.04).max((dv - 0.88) / 0.08).clamp(0.0, 1.0);
                let shade = 0.55 + 0.35 * random(brick as u32, cv as u32, seed);
                let grain = 0.2 * (fractal(u, v, scale * 4, seed) - 0.5);
                ((shade + grain) * (1.0 - mortar) + 0.08 * mortar, 1.0)
            }
            Self::Stones => {
                let (mut nearest, mut second, mut shade) = (9.0_f32, 9.0_f32, 0.0);
                for dv in -1..=1 {
                    for du in -1..=1 {
                        let wrap = |c: f32, d: i32| (c as i32 + d).rem_euclid(scale as i32) as u32;
                        let (x, y) = (wrap(cu, du), wrap(cv, dv));
                        let px = du as f32 + random(x, y, seed) * 0.8 - 0.4 - fu;
                        let py = dv as f32 + random(x, y, seed ^ 77) * 0.8 - 0.4 - fv;
                        let d = px.hypot(py);
                        if d < nearest {
                            (second, nearest) = (nearest, d);
                            shade = random(x, y, seed ^ 991);
                        } else {
                            second = second.min(d);
                        }
                    }
                }
                let edge = ((second - nearest) * 5.0).min(1.0);
                let grain = 0.25 * (fractal(u, v, scale * 2, seed) - 0.5);
                (edge * (0.5 + 0.4 * shade + grain), 1.0)
            }
            Self::Leaf => {
                let turn = random(cu as u32, cv as u32, seed) * std::f32::consts::TAU;
                let (x, y) = (
                    fu * turn.cos() - fv * turn.sin(),
                    fu * turn.sin() + fv * turn.cos(),
                );
                let d = (x / 0.22).powi(2) + (y / 0.46).powi(2) - 1.0;
                let vein = 1.0 - (x.abs() * 12.0).min(1.0);
                (0.45 + 0.4 * vein + 0.3 * y, inside(d))
            }
            Self::Chain => {
                let d = ((fu / 0.3).hypot(fv / 0.52) - 0.82).abs() - 0.18;
                (0.6 - d, inside(d))
            }
            Self::Blades => {
                let up = 1.0 - v;
                // A blade may lean into the cells beside its own.
                let blade = |side: i32| {
                    let cell = (cu as i32 + side).rem_euclid(scale as i32) as u32;
                    let tall = 0.6 + 0.4 * random(cell, 0, seed);
                    let lean = 1.2 * (random(cell, 1, seed) - 0.5);
                    let across = fu - side as f32 - lean * up * up;
                    let width = 0.38 * (1.0 - up / tall).max(0.0).sqrt();
                    (width - across.abs(), tall)
                };
                let (inside_by, tall) = (-1..=1)
                    .map(blade)
                    .max_by(|a, b| a.0.total_cmp(&b.0))
                    .unwrap_or((-1.0, 1.0));
                (0.25 + 0.75 * (up / tall).min(1.0), inside(-inside_by))
            }
            Self::Lace => {
                let hole = 0.34 - fu.hypot(fv);
                let small = 0.12 - (0.5 - fu.abs()).hypot(0.5 - fv.abs());
                (0.8 - 0.5 * hole.max(0.0), inside(hole.max(small)))
            }
        }
    }
}

fn to_byte(v: f32) -> u8 {
    (v.clamp(0.0, 1.0) * 255.0 + 0.5) as u8
}

fn finish(size: [u32; 2], texels: Vec<u8>, srgb: bool, mips: bool) -> Image {
    let levels = match mips {
        true => mip_chain(size, texels, srgb),
        false => vec![texels],
    };
    Image::rgba8(size, 1, srgb, levels)
}

/// All mip levels of one layer, each the box-filtered half of the one before: in linear light when
/// `srgb`, and the last row or column of an odd size counted into its neighbour.
pub fn mip_chain(size: [u32; 2], level0: Vec<u8>, srgb: bool) -> Vec<Vec<u8>> {
    let decode = |b: u8, channel: usize| {
        let v = f32::from(b) / 255.0;
        if srgb && channel < 3 {
            srgb_to_linear(v)
        } else {
            v
        }
    };
    let table: [Vec<f32>; 2] = [0, 3].map(|c| (0..=255).map(|b| decode(b, c)).collect());
    let (mut w, mut h) = (size[0].max(1) as usize, size[1].max(1) as usize);
    let mut levels = vec![level0];
    while w > 1 || h > 1 {
        let (nw, nh) = ((w / 2).max(1), (h / 2).max(1));
        let above = &levels[levels.len() - 1];
        let mut next = Vec::with_capacity(nw * nh * 4);
        for y in 0..nh {
            for x in 0..nw {
                let columns = (x * w / nw)..((x + 1) * w / nw);
                let rows = (y * h / nh)..((y + 1) * h / nh);
                for c in 0..4 {
                    let mut sum = 0.0;
                    for r in rows.clone() {
                        for k in columns.clone() {
                            sum +=
                                table[usize::from(c == 3)][usize::from(above[(r * w + k) * 4 + c])];
                        }
                    }
                    let mean = sum / (rows.len() * columns.len()) as f32;
                    next.push(to_byte(if srgb && c < 3 {
                        linear_to_srgb(mean)
                    } else {
                        mean
                    }));
                }
            }
        }
        levels.push(next);
        (w, h) = (nw, nh);
    }
    levels
}

/// IEC 61966-2-1.
fn linear_to_srgb(v: f32) -> f32 {
    if v <= 0.003_130_8 {
        v * 12.92
    } else {
        1.055 * v.powf(1.0 / 2.4) - 0.055
    }
}
