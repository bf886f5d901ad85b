//! FLIP (Andersson et al. 2020, 2021) of everything that a pass writes.
//!
//! Each target has a map of its colours and a map of its alpha, which is a channel like the others:
//! a host may blend by it, or keep a roughness in it. A value between 0 and 1 counts as it is
//! displayed. If a float target has values outside of 0..1, both pictures are also displayed by
//! exposures and a tone map, as in FLIP's variant for HDR; negative values are displayed as their
//! magnitudes. The exposures come from the original. A pixel counts as fully wrong where integers
//! differ, or where a value that is not finite does.

use preshade_draw::render::ColorImage;
use preshade_draw::render::picture::srgb_encode;

/// Width and height of a tile, in pixels: a quarter of a degree at FLIP's viewing distance.
pub(super) const TILE: usize = 16;

/// The most exposures that display a target. Between two neighbours lie at most four stops of the
/// 20 below the brightest value.
const MOST_EXPOSURES: u32 = 6;

/// Values this far below the brightest are not exposed for.
const DARKEST: f32 = 1.0 / (1 << 20) as f32;

/// Mean, 99th percentile and worst tile of FLIP at its default viewing distance (67 pixels a degree):
/// of the target's colours or of its alpha, whichever is larger.
pub(super) fn flip(original: &ColorImage, variant: &ColorImage) -> [f64; 3] {
    let width = original.size[0] as usize;
    let maps = maps(original, variant);
    let each = maps.into_iter().map(|map| summary(map, width));
    each.fold([0.0; 3], |worst, one| {
        std::array::from_fn(|i| worst[i].max(one[i]))
    })
}

/// The maps of a target, row by row. One that is missing is 0 everywhere.
fn maps(original: &ColorImage, variant: &ColorImage) -> Vec<Vec<f32>> {
    if original.bytes == variant.bytes {
        return Vec::new();
    }
    let pixels = 0..original.size[0] as usize * original.size[1] as usize;
    if original.integers(0).is_some() {
        let differs = |i| original.texel(i) != variant.texel(i);
        return vec![pixels.map(|i| f32::from(u8::from(differs(i)))).collect()];
    }
    let read = |image: &ColorImage| pixels.clone().map(|i| image.rgba(i)).collect::<Vec<_>>();
    let (a, b) = (read(original), read(variant));
    let is_float = original.is_float();
    let is_grey = original.channels() == 1;
    let colors = |[r, g, b, _]: &[f32; 4]| if is_grey { [*r; 3] } else { [*r, *g, *b] };
    let alpha = |[.., a]: &[f32; 4]| [*a; 3];
    let map = |part: &dyn Fn(&[f32; 4]) -> Rgb, is_linear: bool| {
        let [a, b] = [&a, &b].map(|all| all.iter().map(part).collect::<Vec<_>>());
        map(original.size, &a, &b, is_linear)
    };
    let mut maps: Vec<_> = map(&colors, is_float).into_iter().collect();
    if original.channels() == 4 {
        // Blending reads alpha as it is stored.
        maps.extend(map(&alpha, false));
    }
    maps
}

type Rgb = [f32; 3];

/// The map of two pictures; `None`: there is no visible difference. `is_linear`: whether values
/// between 0 and 1 are encoded before they are displayed.
fn map(size: [u32; 2], a: &[Rgb], b: &[Rgb], is_linear: bool) -> Option<Vec<f32>> {
    let mut map: Option<Vec<f32>> = None;
    for look in looks(a, b, is_linear) {
        let [left, right] = [a, b].map(|picture| look.picture(picture));
        if left == right {
            continue;
        }
        let [left, right] =
            [left, right].map(|p| nv_flip::FlipImageRgb8::with_data(size[0], size[1], &p));
        let seen = nv_flip::flip(left, right, nv_flip::DEFAULT_PIXELS_PER_DEGREE).to_vec();
        match &mut map {
            None => map = Some(seen),
            Some(map) => map
                .iter_mut()
                .zip(&seen)
                .for_each(|(worst, one)| *worst = worst.max(*one)),
        }
    }
    for (i, (p, q)) in a.iter().zip(b).enumerate() {
        if (0..3).any(|c| is_torn(p[c], q[c])) {
            map.get_or_insert_with(|| vec![0.0; a.len()])[i] = 1.0;
        }
    }
    map
}

/// Whether two values differ and at least one of them is not finite.
fn is_torn(p: f32, q: f32) -> bool {
    let is_same = p == q || (p.is_nan() && q.is_nan());
    !(is_same || p.is_finite() && q.is_finite())
}

/// How values become a displayed picture.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Look {
    /// 1, or -1 to display negative values.
    sign: f32,
    tone: Tone,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Tone {
    /// Values between 0 and 1 are displayed as they are.
    Stored,
    /// Values between 0 and 1 are encoded.
    Encoded,
    /// Values are multiplied, mapped and encoded.
    Mapped { exposure: f32 },
}

impl Look {
    fn picture(self, values: &[Rgb]) -> Vec<u8> {
        let byte = |v: f32| {
            let v = if v.is_finite() { v * self.sign } else { 0.0 };
            let v = match self.tone {
                Tone::Stored => v.clamp(0.0, 1.0),
                Tone::Encoded => srgb_encode(v.clamp(0.0, 1.0)),
                Tone::Mapped { exposure } => srgb_encode(tone_map(v.max(0.0) * exposure)),
            };
            (v * 255.0).round() as u8
        };
        values.iter().flatten().map(|v| byte(*v)).collect()
    }
}

/// Every way to display a picture and its variant.
fn looks(original: &[Rgb], variant: &[Rgb], is_linear: bool) -> Vec<Look> {
    let all = || original.iter().chain(variant).flatten();
    let finite = || all().filter(|v| v.is_finite());
    let mut tones = vec![match is_linear {
        true => Tone::Encoded,
        false => Tone::Stored,
    }];
    if finite().any(|v| !(0.0..=1.0).contains(v)) {
        let exposures = exposures(original).or_else(|| exposures(variant));
        let mapped = exposures.into_iter().flatten();
        tones.extend(mapped.map(|exposure| Tone::Mapped { exposure }));
    }
    let signs = match finite().any(|v| *v < 0.0) {
        true => &[1.0, -1.0][..],
        false => &[1.0],
    };
    let of = |tone: Tone| signs.iter().map(move |sign| Look { sign: *sign, tone });
    tones.into_iter().flat_map(of).collect()
}

/// The exposures of FLIP for HDR: from one at which the largest magnitude is nearly white to one at
/// which the median is, of the channel with the smallest. `None`: all is 0.
fn exposures(picture: &[Rgb]) -> Option<Vec<f32>> {
    let mut medians = Vec::new();
    let mut largest = 0.0_f32;
    for c in 0..3 {
        let magnitudes = picture.iter().map(|p| p[c].abs());
        let mut seen: Vec<f32> = magnitudes.filter(|v| v.is_finite() && *v > 0.0).collect();
        if seen.is_empty() {
            continue;
        }
        let middle = seen.len() / 2;
        medians.push(*seen.select_nth_unstable_by(middle, f32::total_cmp).1);
        largest = seen.into_iter().fold(largest, f32::max);
    }
    let median = medians.into_iter().reduce(f32::min)?;
    let median = median.max(largest * DARKEST);
    let [first, last] = [largest, median].map(|v| (NEARLY_WHITE / v).log2());
    let count = ((last - first).ceil() as u32 + 1).clamp(1, MOST_EXPOSURES);
    let at = |i: u32| first + (last - first) * i as f32 / (count - 1).max(1) as f32;
    let exposures = (0..count).map(|i| at(i).exp2());
    // A subnormal has none.
    Some(exposures.filter(|e| e.is_finite()).collect())
}

/// The value that [`tone_map`] maps to 0.85.
const NEARLY_WHITE: f32 = 2.117;

/// The filmic curve that FLIP uses (Narkowicz 2016, exposed by 0.6), of a value from 0.
fn tone_map(v: f32) -> f32 {
    let v = 0.6 * v.min(1e6);
    let mapped = v * (2.51 * v + 0.03) / (v * (2.43 * v + 0.59) + 0.14);
    mapped.min(1.0)
}

/// Mean, 99th percentile and worst tile of a map with rows of `width`.
fn summary(mut map: Vec<f32>, width: usize) -> [f64; 3] {
    let tile = worst_tile(&map, width);
    let mean = map.iter().map(|v| f64::from(*v)).sum::<f64>() / map.len().max(1) as f64;
    // The percentile is of pixels, not weighted by error.
    let rank = (map.len() * 99 / 100).min(map.len().saturating_sub(1));
    let p99 = match map.is_empty() {
        true => 0.0,
        false => f64::from(*map.select_nth_unstable_by(rank, f32::total_cmp).1),
    };
    [mean, p99, tile]
}

/// The largest mean over a tile of a map with rows of `width`. A tile at an edge counts the pixels that
/// it has.
fn worst_tile(map: &[f32], width: usize) -> f64 {
    let width = width.max(1);
    let mut worst = 0.0_f64;
    for band in map.chunks(width * TILE) {
        let mut tiles = vec![(0.0_f64, 0_u32); width.div_ceil(TILE)];
        for (i, value) in band.iter().enumerate() {
            let (sum, pixels) = &mut tiles[i % width / TILE];
            *sum += f64::from(*value);
            *pixels += 1;
        }
        let means = tiles.iter().map(|(sum, n)| sum / f64::from(*n));
        worst = means.fold(worst, f64::max);
    }
    worst
}

#[cfg(test)]
#[allow(clippy::unwrap_used, clippy::panic)]
mod tests {
    use wgpu::TextureFormat as Format;

    use super::{NEARLY_WHITE, flip, tone_map, worst_tile};
    use preshade_draw::render::ColorImage;

    #[test]
    fn a_tile_at_the_edge_counts_its_own_pixels() {
        // 20 x 18 pixels: the last tile has 4 x 2.
        let mut map = vec![0.0; 20 * 18];
        map[17 * 20 + 19] = 1.0;
        assert_eq!(worst_tile(&map, 20), 1.0 / 8.0);
        map.fill(0.0);
        map[0] = 1.0;
        assert_eq!(worst_tile(&map, 20), 1.0 / 256.0);
        assert_eq!(worst_tile(&[], 0), 0.0);
    }

    const SIZE: [u32; 2] = [32, 32];

    /// A picture of a format, by pixel.
    fn picture(format: Format, value: impl Fn(usize) -> [f32; 4]) -> ColorImage {
        let pixels = (0..(SIZE[0] * SIZE[1]) as usize).map(value);
        let bytes: Vec<u8> = match format {
            Format::Rgba32Float => pixels.flatten().flat_map(f32::to_le_bytes).collect(),
            Format::Rgba8Unorm => pixels
                .flatten()
                .map(|v| (v * 255.0).round() as u8)
                .collect(),
            Format::R32Uint => pixels
                .flat_map(|[r, ..]| r.to_bits().to_le_bytes())
                .collect(),
            Format::R32Float => pixels.flat_map(|[r, ..]| r.to_le_bytes()).collect(),
            other => panic!("{other:?}"),
        };
        ColorImage {
            size: SIZE,
            format,
            bytes,
        }
    }

    /// A ramp from 0 to 1 over the pixels.
    fn ramp(i: usize) -> f32 {
        i as f32 / 1024.0
    }

    /// A number with the bits of an integer, for integer targets.
    fn bits(n: u32) -> f32 {
        f32::from_bits(n)
    }

    /// Whatever a pass writes counts: each row is a picture and one that is clearly another.
    #[test]
    fn a_clear_difference_is_never_free() {
        type Value = fn(usize) -> [f32; 4];
        let cases: [(&str, Format, Value, Value); 14] = [
            (
                "alpha alone",
                Format::Rgba8Unorm,
                |i| [0.5, 0.5, 0.5, ramp(i)],
                |_| [0.5, 0.5, 0.5, 0.5],
            ),
            (
                "alpha of a float target",
                Format::Rgba32Float,
                |i| [0.5, 0.5, 0.5, 40.0 * ramp(i)],
                |_| [0.5, 0.5, 0.5, 20.0],
            ),
            (
                "HDR",
                Format::Rgba32Float,
                |i| [25.0 + 10.0 * ramp(i); 4],
                |_| [30.0; 4],
            ),
            (
                "HDR that only the variant has",
                Format::Rgba32Float,
                |_| [1.0; 4],
                |i| [1.0 + 4.0 * ramp(i), 1.0, 1.0, 1.0],
            ),
            (
                "a sun beside a dark floor",
                Format::Rgba32Float,
                |i| {
                    if i < 8 {
                        [60_000.0; 4]
                    } else {
                        [1.0 + ramp(i); 4]
                    }
                },
                |i| if i < 8 { [60_000.0; 4] } else { [1.5; 4] },
            ),
            (
                "the sun itself",
                Format::Rgba32Float,
                |i| if i < 64 { [60_000.0; 4] } else { [1.0; 4] },
                |i| if i < 64 { [30_000.0; 4] } else { [1.0; 4] },
            ),
            (
                "less than 1 where the rest is bright or nothing",
                Format::Rgba32Float,
                |i| if i < 512 { [60_000.0; 4] } else { [0.0; 4] },
                |i| if i < 512 { [60_000.0; 4] } else { [0.6; 4] },
            ),
            (
                "a small channel beside a large one",
                Format::Rgba32Float,
                |i| [1_000.0, 1.0 + ramp(i), 0.0, 1.0],
                |_| [1_000.0, 1.5, 0.0, 1.0],
            ),
            (
                "negative normals",
                Format::Rgba32Float,
                |i| [-ramp(i), 0.0, 0.0, 1.0],
                |_| [-0.5, 0.0, 0.0, 1.0],
            ),
            (
                "the sign of a normal",
                Format::Rgba32Float,
                |_| [0.7, 0.7, 0.0, 1.0],
                |_| [-0.7, 0.7, 0.0, 1.0],
            ),
            (
                "nothing but negative",
                Format::R32Float,
                |i| [-30.0 - ramp(i), 0.0, 0.0, 1.0],
                |_| [-45.0, 0.0, 0.0, 1.0],
            ),
            (
                "NaN",
                Format::Rgba32Float,
                |_| [0.0; 4],
                |i| {
                    if i < 100 {
                        [f32::NAN, 0.0, 0.0, 0.0]
                    } else {
                        [0.0; 4]
                    }
                },
            ),
            (
                "one infinity for the other",
                Format::R32Float,
                |_| [f32::INFINITY, 0.0, 0.0, 1.0],
                |_| [f32::NEG_INFINITY, 0.0, 0.0, 1.0],
            ),
            (
                "an id",
                Format::R32Uint,
                |_| [bits(70_000_001), 0.0, 0.0, 0.0],
                |i| [bits(70_000_001 + u32::from(i < 200)), 0.0, 0.0, 0.0],
            ),
        ];
        for (what, format, original, variant) in cases {
            let (a, b) = (picture(format, original), picture(format, variant));
            let [mean, p99, tile] = flip(&a, &b);
            assert!(
                mean > 0.005 && p99 > 0.02 && tile > 0.02,
                "{what}: {mean} {p99} {tile}"
            );
            assert!([mean, p99, tile].iter().all(|v| *v <= 1.0), "{what}");
            assert_eq!(flip(&a, &a), [0.0; 3], "{what}");
        }
    }

    #[test]
    fn equal_values_that_are_not_finite_are_no_difference() {
        let value = |alpha: f32| move |_| [f32::NAN, f32::INFINITY, 0.2, alpha];
        let a = picture(Format::Rgba32Float, value(0.5));
        // Only alpha differs, and by less than a display shows.
        let b = picture(Format::Rgba32Float, value(0.500_01));
        assert_eq!(flip(&a, &b), [0.0; 3]);
    }

    #[test]
    fn the_tone_map_meets_its_white() {
        assert!((tone_map(NEARLY_WHITE) - 0.85).abs() < 1e-3);
        assert_eq!(tone_map(f32::MAX), 1.0);
    }
}
