//! Deterministic pseudo-random numbers and tiling noise for generated textures and fields.

/// A 32-bit integer hash (two rounds of multiply and xor-shift).
pub fn hash(mut x: u32) -> u32 {
    x ^= x >> 16;
    x = x.wrapping_mul(0x7feb_352d);
    x ^= x >> 15;
    x = x.wrapping_mul(0x846c_a68b);
    x ^ (x >> 16)
}

/// A number in `[0, 1)` for three integers.
pub fn random(x: u32, y: u32, seed: u32) -> f32 {
    let h = hash(x ^ hash(y ^ hash(seed)));
    (h >> 8) as f32 / (1 << 24) as f32
}

/// Value noise in `[0, 1]` with a period of `period` cells.
pub(super) fn value(u: f32, v: f32, period: u32, seed: u32) -> f32 {
    let (cell_u, cell_v) = (u.floor(), v.floor());
    let smooth = |t: f32| t * t * (3.0 - 2.0 * t);
    let (fu, fv) = (smooth(u - cell_u), smooth(v - cell_v));
    let at = |du: i64, dv: i64| {
        let wrap = |c: f32, d: i64| (c as i64 + d).rem_euclid(i64::from(period.max(1))) as u32;
        random(wrap(cell_u, du), wrap(cell_v, dv), seed)
    };
    let mix = |a: f32, b: f32, t: f32| a + (b - a) * t;
    mix(mix(at(0, 0), at(1, 0), fu), mix(at(0, 1), at(1, 1), fu), fv)
}

/// Five octaves of [`value`] in `[0, 1]`, tiling over the unit square at `period` cells in the first.
pub(super) fn fractal(u: f32, v: f32, period: u32, seed: u32) -> f32 {
    let (mut sum, mut weight, mut total, mut p) = (0.0, 0.5, 0.0, period.max(1));
    for octave in 0..5 {
        sum += weight * value(u * p as f32, v * p as f32, p, seed.wrapping_add(octave));
        total += weight;
        weight *= 0.5;
        p *= 2;
    }
    sum / total
}
