//! Depths as a picture, for the README.

use std::path::Path;

use super::read::Texels;

/// Width and height of a column, and the space between two.
const SIDE: u32 = 160;
const GAP: u32 = 4;

/// Saves the first layers beside each other, each group cut to what it shows. What is nearest is
/// brightest, and nothing is black.
pub fn save(groups: &[[Texels; 3]], path: &Path) {
    let columns = 3 * groups.len() as u32;
    let mut picture = image::GrayImage::new(columns * (SIDE + GAP) - GAP, SIDE);
    let mut left = 0;
    for group in groups {
        let (corner, side) = shown(group);
        for texels in group {
            column(&mut picture, left, texels, (corner, side));
            left += SIDE + GAP;
        }
    }
    picture.save(path).unwrap();
}

fn layer(texels: &Texels) -> (u32, &[[f32; 4]]) {
    let [width, height, _] = texels.size;
    (width, &texels.values[..(width * height) as usize])
}

/// The corner and side of a square around all that a group shows.
fn shown(group: &[Texels; 3]) -> ([u32; 2], u32) {
    let (mut low, mut high) = ([u32::MAX; 2], [0; 2]);
    for texels in group {
        let (width, layer) = layer(texels);
        for (at, _) in (0..).zip(layer).filter(|(_, v)| v[0] != 0.0) {
            for (axis, at) in [at % width, at / width].into_iter().enumerate() {
                low[axis] = low[axis].min(at);
                high[axis] = high[axis].max(at);
            }
        }
    }
    let side = (high[0] - low[0]).max(high[1] - low[1]) + 3;
    let corner = [0, 1].map(|axis| {
        (low[axis] + high[axis])
            .div_ceil(2)
            .saturating_sub(side / 2)
    });
    (corner, side)
}

fn column(
    picture: &mut image::GrayImage,
    left: u32,
    texels: &Texels,
    (corner, side): ([u32; 2], u32),
) {
    let (width, layer) = layer(texels);
    let drawn = layer.iter().map(|v| v[0]).filter(|v| *v != 0.0);
    let (low, high) = drawn.fold((f32::MAX, f32::MIN), |(low, high), v| {
        (low.min(v), high.max(v))
    });
    for (x, y) in (0..SIDE).flat_map(|y| (0..SIDE).map(move |x| (x, y))) {
        let [across, down] = [corner[0] + x * side / SIDE, corner[1] + y * side / SIDE];
        let value = layer
            .get((down * width + across) as usize)
            .map_or(0.0, |v| v[0]);
        let shade = match value == 0.0 || across >= width {
            true => 0,
            false => 70 + ((value - low) / (high - low).max(1e-9) * 185.0) as u8,
        };
        picture.put_pixel(left + x, y, image::Luma([shade]));
    }
}
