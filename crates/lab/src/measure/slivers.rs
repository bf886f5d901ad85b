//! Whether a broken promise is about triangles thinner than a rasteriser's grid.
//!
//! A rasteriser snaps corners to a grid, of 1/16 of a pixel or finer (Vulkan 1.3,
//! `subPixelPrecisionBits`). A thinner triangle has whatever area the snapping gives it, and
//! interpolation divides by that area. So [`Assumption::FineInterpolation`] does not hold on it:
//! values may be far from those at its corners.

use glam::{Vec2, Vec4, Vec4Swizzles};
use naga::ShaderStage;
use preshade_plan::contract::Assumption;
use preshade_plan::plan::{GpuPass, Plan};
use preshade_plan::state::Topology;

use super::Session;
use super::verdict::Promise;
use super::vertices::{self, Vertices};
use preshade_draw::render::Rendered;
use preshade_draw::scene::{Frame, Scene, bind};

/// The coarsest grid of a rasteriser, in pixels.
const GRID: f32 = 1.0 / 16.0;

/// How far from a sliver's longest edge it may cover the centre of a pixel, in pixels.
const REACH: f32 = 1.0;

/// Most vertices to run. A broken promise of a larger scene stays broken.
const MOST_VERTICES: u64 = 200_000;

/// Whether `picture` keeps the promise wherever no sliver may cover a pixel of this frame. `None`:
/// the contract does not depend on it, or the slivers are not known.
pub(super) fn explain(
    session: &Session<'_>,
    promise: &Promise,
    frame: &Frame,
    [reference, picture]: [&Rendered; 2],
) -> Option<String> {
    if !promise
        .contract
        .given()
        .contains(&Assumption::FineInterpolation)
    {
        return None;
    }
    let size = reference.colors.iter().flatten().next()?.size;
    let edges = edges(session, frame, size)?;
    let mut elsewhere = picture.clone();
    for (image, original) in elsewhere.colors.iter_mut().zip(&reference.colors) {
        let (Some(image), Some(original)) = (image, original) else {
            continue;
        };
        let [width, height] = image.size;
        let texel = image.bytes.len() / (width as usize * height as usize).max(1);
        for edge in &edges {
            for [x, y] in edge.pixels(image.size) {
                let start = (y as usize * width as usize + x as usize) * texel;
                let range = start..start + texel;
                image.bytes[range.clone()].copy_from_slice(&original.bytes[range]);
            }
        }
    }
    let error = super::error::compare(reference, &elsewhere).ok()?;
    promise.broken(&error).is_none().then(|| {
        format!(
            "its promise is about triangles that a rasteriser resolves (`fine-interpolation`), and \
             {} here are thinner than 1/16 of a pixel",
            edges.len()
        )
    })
}

/// The longest edge of a sliver, in pixels.
struct Edge([Vec2; 2]);

impl Edge {
    /// The pixels that the sliver may cover.
    fn pixels(&self, [width, height]: [u32; 2]) -> impl Iterator<Item = [u32; 2]> {
        let Self([a, b]) = *self;
        let last = Vec2::new(width as f32, height as f32);
        let low = (a.min(b) - REACH).clamp(Vec2::ZERO, last).as_uvec2();
        let high = (a.max(b) + REACH).clamp(Vec2::ZERO, last).as_uvec2();
        let along = (b - a).normalize_or_zero();
        let near = move |[x, y]: &[u32; 2]| {
            let centre = Vec2::new(*x as f32 + 0.5, *y as f32 + 0.5);
            let t = (centre - a).dot(along).clamp(0.0, a.distance(b));
            centre.distance(a + along * t) <= REACH
        };
        let rows = low.y..(high.y + 1).min(height);
        let columns = low.x..(high.x + 1).min(width);
        rows.flat_map(move |y| columns.clone().map(move |x| [x, y]))
            .filter(near)
    }
}

/// The slivers of a frame; `None`: too many vertices, or a vertex stage that cannot be run.
fn edges(session: &Session<'_>, frame: &Frame, size: [u32; 2]) -> Option<Vec<Edge>> {
    let scene = session.scene();
    let mut found = Vec::new();
    let mut left = MOST_VERTICES;
    for (index, plan) in session.originals().iter().enumerate() {
        let pass = plan.main()?;
        let is_list = pass.primitive.topology == Topology::TriangleList;
        let draws = scene.draws.iter().filter(|d| d.material == index);
        for draw in draws.filter(|_| is_list) {
            let material = &scene.materials[index];
            let bound = bind::draw(scene, material, pass, draw, frame).ok()?;
            let corners = u64::from(bound.call.count) * u64::from(bound.instances);
            left = left.checked_sub(corners)?;
            slivers(scene, (plan, pass), bound, size, &mut found)?;
        }
    }
    Some(found)
}

/// Adds the slivers of one draw.
fn slivers(
    scene: &Scene,
    (plan, pass): (&Plan, &GpuPass),
    bound: bind::DrawBindings,
    size: [u32; 2],
    found: &mut Vec<Edge>,
) -> Option<()> {
    let program = plan.program(pass)?;
    let (entry, _) = program.entry_point(ShaderStage::Vertex, &pass.vertex)?;
    let module = program.module();
    let vertices = Vertices::new(module, bound, |_| true);
    let [x, y, width, height] = scene.viewport.unwrap_or([0, 0, size[0], size[1]]);
    let (origin, extent) = (
        Vec2::new(x as f32, y as f32),
        Vec2::new(width as f32, height as f32),
    );
    for instance in 0..vertices.bound.instances {
        for first in (0..vertices.of_instance() / 3 * 3).step_by(3) {
            let mut corners = [Vec2::ZERO; 3];
            let mut is_ahead = true;
            for (at, corner) in (first..).zip(&mut corners) {
                let vertex = vertices::index(&vertices.bound, at)?;
                let clip = vertices.position(module, entry, vertex, instance).ok()?;
                let clip = Vec4::from_array(clip);
                is_ahead &= clip.w > 0.0;
                let ndc = clip.xy() / clip.w;
                *corner = origin + (ndc * Vec2::new(0.5, -0.5) + 0.5) * extent;
            }
            found.extend(is_ahead.then(|| sliver(corners)).flatten());
        }
    }
    Some(())
}

/// The longest edge of a triangle that is thinner than the grid, unless it is a point or a line,
/// which covers nothing.
fn sliver([a, b, c]: [Vec2; 3]) -> Option<Edge> {
    let edges = [[a, b], [b, c], [c, a]];
    let length = |[a, b]: &[Vec2; 2]| a.distance(*b);
    let longest = edges
        .into_iter()
        .max_by(|a, b| length(a).total_cmp(&length(b)))?;
    let doubled_area = (b - a).perp_dot(c - a).abs();
    let is_drawn = a != b && b != c && c != a;
    (is_drawn && doubled_area < GRID * length(&longest)).then_some(Edge(longest))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_what_is_thinner_than_the_grid_is_a_sliver() {
        let triangle = |height: f32| {
            let corners = [[2.0, 2.0], [10.0, 2.0], [6.0, 2.0 + height]];
            sliver(corners.map(Vec2::from_array))
        };
        assert!(triangle(1.0).is_none() && triangle(0.07).is_none());
        let edge = triangle(0.0).expect("a sliver");
        let pixels: Vec<[u32; 2]> = edge.pixels([16, 16]).collect();
        assert!(pixels.contains(&[2, 1]) && pixels.contains(&[9, 2]));
        assert!(
            pixels
                .iter()
                .all(|[x, y]| (1..=10).contains(x) && (1..=2).contains(y))
        );
        let point = Vec2::splat(3.0);
        assert!(sliver([point, point, Vec2::ONE]).is_none());
    }
}
