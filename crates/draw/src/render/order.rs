//! The order of a frame's draws.

use crate::scene::{DrawOrder, Frame, Scene};

/// Indices of the draws in the order in which `frame` issues them.
///
/// Draws are sorted by the distance from the eye to the centre of the object's bounding box. As in
/// an engine, objects are sorted, not triangles.
pub(crate) fn opaque(scene: &Scene, frame: &Frame, order: DrawOrder) -> Vec<usize> {
    let mut draws: Vec<usize> = (0..scene.draws.len()).collect();
    // A captured frame keeps its order.
    let order = match scene.draws.iter().any(|d| d.captured.is_some()) {
        true => DrawOrder::AsGiven,
        false => order,
    };
    match order {
        DrawOrder::AsGiven => {}
        DrawOrder::Shuffled => draws.sort_by_key(|&i| mix(i as u64)),
        DrawOrder::FrontToBack => {
            draws.sort_by(|&a, &b| distance(scene, frame, a).total_cmp(&distance(scene, frame, b)));
        }
        DrawOrder::BackToFront => {
            draws.sort_by(|&a, &b| distance(scene, frame, b).total_cmp(&distance(scene, frame, a)));
        }
    }
    draws
}

/// Blended draws, always farthest first.
pub(crate) fn blended(scene: &Scene, frame: &Frame) -> Vec<usize> {
    opaque(scene, frame, DrawOrder::BackToFront)
}

pub fn name(order: DrawOrder) -> &'static str {
    match order {
        DrawOrder::FrontToBack => "front to back",
        DrawOrder::BackToFront => "back to front",
        DrawOrder::Shuffled => "shuffled",
        DrawOrder::AsGiven => "as given",
    }
}

fn distance(scene: &Scene, frame: &Frame, draw: usize) -> f32 {
    let draw = &scene.draws[draw];
    let [low, high] = scene.meshes[draw.mesh].bounds;
    draw.transform
        .transform_point3((low + high) * 0.5)
        .distance_squared(frame.eye)
}

/// The finaliser of SplitMix64 (Steele, Lea, Flood 2014): a fixed order that looks random.
fn mix(index: u64) -> u64 {
    let mut z = index.wrapping_add(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}
