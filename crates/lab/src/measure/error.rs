//! The error ladder between two pictures: bits, then the largest difference, then the visible
//! difference.

use preshade_plan::budget::{Difference, or_infinite, unmeasured};
use serde::{Deserialize, Serialize};

use super::flip::flip;
use preshade_draw::render::{DepthImage, Rendered};

/// One step of 8 bits.
const STEP: f64 = 1.0 / 255.0;

/// The difference between an original and a variant of one view.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ErrorLadder {
    /// Pixels where any colour target's bits differ, alpha included.
    pub changed_pixels: u64,
    /// Pixels where alpha alone differs.
    pub changed_alpha: u64,
    /// Pixels (samples with MSAA) whose depth bits differ.
    pub changed_depth: u64,
    /// Largest difference of a channel in the target's units, 0..1 for unorm formats.
    /// Infinite if exactly one side is NaN; JSON then has `null`.
    #[serde(deserialize_with = "or_infinite")]
    pub max_abs: f64,
    /// Largest difference of a colour channel in steps. A step is 1/255, or the spacing of the
    /// target's format if that is larger.
    #[serde(default, deserialize_with = "or_infinite")]
    pub max_steps: f64,
    /// Pixels in which a channel differs by more than one step, which rounding alone does not
    /// explain.
    #[serde(default)]
    pub beyond_step: u64,
    #[serde(default)]
    pub pixels: u64,
    /// Mean of the FLIP error map, 0..1 (Andersson et al. 2020): the largest over all colour
    /// targets, of their colours and of their alpha. Float values outside of 0..1 are displayed by
    /// exposures and a tone map. A pixel counts 1 where integers differ, or a value that is not
    /// finite.
    pub flip_mean: f64,
    /// 99th percentile of FLIP, likewise.
    pub flip_p99: f64,
    /// Largest mean of FLIP over a tile of 16 x 16 pixels, fewer at the right and lower edge, likewise.
    /// Infinite in a record of an older version, which did not measure it.
    #[serde(default = "unmeasured", deserialize_with = "or_infinite")]
    pub flip_tile: f64,
    /// Pixels with a NaN or an infinity in the variant where the original has none.
    pub nan_pixels: u64,
    /// Largest distance of two depths, in steps between neighbouring 32-bit floats.
    pub depth_max_ulp: u64,
    /// Column and row of the first pixel that differs in colour or depth, row by row.
    pub first_difference: Option<[u32; 2]>,
}

/// `1 pixel`, `2 pixels`.
pub(crate) fn counted(n: u64, one: &str) -> String {
    match n {
        1 => format!("1 {one}"),
        _ => format!("{n} {one}s"),
    }
}

impl Difference for ErrorLadder {
    fn by_metric(&self) -> [f64; 4] {
        [self.flip_mean, self.flip_p99, self.flip_tile, self.max_abs]
    }
}

impl ErrorLadder {
    /// The worst difference of pictures from their references.
    pub fn worst_of(references: &[Rendered], drawn: &[Rendered]) -> Result<Self, Mismatch> {
        let mut worst = Self::default();
        for (a, b) in references.iter().zip(drawn) {
            worst = worst.worst(&compare(a, b)?);
        }
        Ok(worst)
    }

    /// Whether not one bit differs.
    pub fn is_exact(&self) -> bool {
        self.changed_pixels == 0 && self.changed_depth == 0
    }

    /// The worse of both, rung by rung.
    #[must_use]
    pub fn worst(&self, other: &Self) -> Self {
        Self {
            changed_pixels: self.changed_pixels.max(other.changed_pixels),
            changed_alpha: self.changed_alpha.max(other.changed_alpha),
            changed_depth: self.changed_depth.max(other.changed_depth),
            max_abs: self.max_abs.max(other.max_abs),
            max_steps: self.max_steps.max(other.max_steps),
            beyond_step: self.beyond_step.max(other.beyond_step),
            pixels: self.pixels.max(other.pixels),
            flip_mean: self.flip_mean.max(other.flip_mean),
            flip_p99: self.flip_p99.max(other.flip_p99),
            flip_tile: self.flip_tile.max(other.flip_tile),
            nan_pixels: self.nan_pixels.max(other.nan_pixels),
            depth_max_ulp: self.depth_max_ulp.max(other.depth_max_ulp),
            first_difference: self.first_difference.or(other.first_difference),
        }
    }
}

/// Two results that cannot be compared: their targets differ in number, size or format.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the pictures cannot be compared: {0}")]
pub struct Mismatch(String);

/// Compares a variant's result with the original's.
///
/// # Errors
/// [`Mismatch`] when the two have different targets.
pub fn compare(original: &Rendered, variant: &Rendered) -> Result<ErrorLadder, Mismatch> {
    if original.colors.len() != variant.colors.len() {
        return Err(Mismatch(format!(
            "{} colour targets against {}",
            original.colors.len(),
            variant.colors.len()
        )));
    }
    let size = size_of(original).unwrap_or([0, 0]);
    let pixels = size[0] as usize * size[1] as usize;
    let mut out = ErrorLadder {
        pixels: pixels as u64,
        ..ErrorLadder::default()
    };
    let mut beyond = vec![false; pixels];
    let mut changed = vec![false; pixels];
    let mut alpha_only = vec![true; pixels];
    let mut non_finite = vec![false; pixels];
    for pair in original.colors.iter().zip(&variant.colors) {
        let (a, b) = match pair {
            (None, None) => continue,
            (Some(a), Some(b)) if a.size == b.size && a.format == b.format => (a, b),
            _ => return Err(Mismatch("a colour target differs in kind".to_owned())),
        };
        if a.bytes == b.bytes {
            continue;
        }
        let [mean, p99, tile] = flip(a, b);
        out.flip_mean = out.flip_mean.max(mean);
        out.flip_p99 = out.flip_p99.max(p99);
        out.flip_tile = out.flip_tile.max(tile);
        for i in 0..pixels {
            if a.texel(i) == b.texel(i) {
                continue;
            }
            changed[i] = true;
            if let (Some(p), Some(q)) = (a.integers(i), b.integers(i)) {
                alpha_only[i] &= p[..3] == q[..3];
                beyond[i] = true;
                let distances = p.iter().zip(q).map(|(p, q)| p.abs_diff(q) as f64);
                let distance = distances.fold(0.0, f64::max);
                out.max_abs = out.max_abs.max(distance);
                out.max_steps = out.max_steps.max(distance / STEP);
                continue;
            }
            let (p, q) = (a.rgba(i), b.rgba(i));
            let differs =
                |c: usize| p[c].to_bits() != q[c].to_bits() && !(p[c].is_nan() && q[c].is_nan());
            alpha_only[i] &= !(0..3).any(differs);
            for c in (0..4).filter(|c| differs(*c)) {
                let distance = f64::from((p[c] - q[c]).abs());
                let distance = match distance.is_nan() {
                    true => f64::INFINITY,
                    false => distance,
                };
                out.max_abs = out.max_abs.max(distance);
                let step = step(a.format, p[c].abs().max(q[c].abs()));
                out.max_steps = out.max_steps.max(distance / step);
                beyond[i] |= distance > step + 1e-6;
            }
            let finite = |v: [f32; 4]| v.iter().all(|c| c.is_finite());
            non_finite[i] |= finite(p) && !finite(q);
        }
    }
    out.changed_pixels = count(&changed);
    out.changed_alpha = changed
        .iter()
        .zip(&alpha_only)
        .filter(|(c, a)| **c && **a)
        .count() as u64;
    out.nan_pixels = count(&non_finite);
    out.beyond_step = count(&beyond);
    match (&original.depth, &variant.depth) {
        (None, None) => {}
        (Some(a), Some(b)) if a.size == b.size && a.samples == b.samples => {
            compare_depth(a, b, &mut out, &mut changed);
        }
        _ => return Err(Mismatch("the depth differs in kind".to_owned())),
    }
    out.first_difference = changed
        .iter()
        .position(|c| *c)
        .map(|i| [i as u32 % size[0], i as u32 / size[0]]);
    Ok(out)
}

/// The size of the last bit of a channel of that value, at least 1/255.
fn step(format: wgpu::TextureFormat, magnitude: f32) -> f64 {
    use wgpu::TextureFormat::{R16Float, Rg11b10Ufloat, Rg16Float, Rgb9e5Ufloat, Rgba16Float};
    // Bits of the significand after the first.
    let bits = match format {
        R16Float | Rg16Float | Rgba16Float => 10,
        Rgb9e5Ufloat => 8,
        // The bits of blue, which are the fewest.
        Rg11b10Ufloat => 5,
        _ => return STEP,
    };
    let exponent = f64::from(magnitude.max(f32::MIN_POSITIVE)).log2().floor();
    STEP.max((exponent - f64::from(bits)).exp2())
}

fn count(flags: &[bool]) -> u64 {
    flags.iter().filter(|f| **f).count() as u64
}

fn size_of(rendered: &Rendered) -> Option<[u32; 2]> {
    let color = rendered.colors.iter().flatten().next().map(|c| c.size);
    color.or(rendered.depth.as_ref().map(|d| d.size))
}

fn compare_depth(a: &DepthImage, b: &DepthImage, out: &mut ErrorLadder, changed: &mut [bool]) {
    for (i, (p, q)) in a.values.iter().zip(&b.values).enumerate() {
        if p.to_bits() == q.to_bits() {
            continue;
        }
        out.changed_depth += 1;
        out.depth_max_ulp = out.depth_max_ulp.max(ulps(*p, *q));
        if let Some(flag) = changed.get_mut(i / a.samples.max(1) as usize) {
            *flag = true;
        }
    }
}

/// Floats between two floats: their distance in the order of all floats, with both zeros as one.
pub fn ulps(a: f32, b: f32) -> u64 {
    let key = |v: f32| {
        let bits = i64::from(v.to_bits() & 0x7fff_ffff);
        if v.is_sign_negative() { -bits } else { bits }
    };
    key(a).abs_diff(key(b))
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use preshade_plan::budget::Budget;

    use super::super::flip::TILE;
    use super::{ErrorLadder, compare};
    use preshade_draw::render::{ColorImage, Rendered};

    /// A grey picture with a black square at `at`.
    fn picture(size: [u32; 2], at: Option<[u32; 2]>) -> Rendered {
        let is_black = |x: u32, y: u32| {
            at.is_some_and(|[left, top]| {
                let tile = TILE as u32;
                (left..left + tile).contains(&x) && (top..top + tile).contains(&y)
            })
        };
        let rows = (0..size[1]).flat_map(|y| (0..size[0]).map(move |x| (x, y)));
        let texels = rows.flat_map(|(x, y)| match is_black(x, y) {
            true => [0, 0, 0, 255],
            false => [128, 128, 128, 255],
        });
        let image = ColorImage {
            size,
            format: wgpu::TextureFormat::Rgba8Unorm,
            bytes: texels.collect(),
        };
        Rendered {
            colors: vec![Some(image)],
            depth: None,
        }
    }

    #[test]
    fn one_bad_tile_among_many_is_seen() {
        let size = [320, 320];
        let error = compare(&picture(size, None), &picture(size, Some([64, 96]))).unwrap();
        assert!(error.flip_tile > 0.3, "{error:?}");
        // A tile of 400: the mean hides it, and so does the 99th percentile.
        assert!(
            error.flip_mean < 0.01 && error.flip_p99 < error.flip_tile,
            "{error:?}"
        );
        let allows = |budget: &str| Budget::parse(budget).unwrap().allows(&error);
        assert!(allows("flip_mean=0.02") && !allows("flip_tile=0.02"));
    }

    #[test]
    fn a_record_without_tiles_is_within_no_budget_of_them() {
        let json = serde_json::to_value(ErrorLadder::default()).unwrap();
        let mut old = json.as_object().unwrap().clone();
        old.remove("flip_tile");
        let old: ErrorLadder = serde_json::from_value(old.into()).unwrap();
        assert!(!Budget::parse("flip_tile=1").unwrap().allows(&old));
        // It stays so when it is written again.
        let json = serde_json::to_string(&old).unwrap();
        assert_eq!(serde_json::from_str::<ErrorLadder>(&json).unwrap(), old);
    }

    #[test]
    fn an_infinite_difference_is_read_back() {
        let error = ErrorLadder {
            max_abs: f64::INFINITY,
            nan_pixels: 3,
            ..ErrorLadder::default()
        };
        let json = serde_json::to_string(&error).unwrap();
        assert!(json.contains("\"max_abs\":null"), "{json}");
        assert_eq!(serde_json::from_str::<ErrorLadder>(&json).unwrap(), error);
    }
}
