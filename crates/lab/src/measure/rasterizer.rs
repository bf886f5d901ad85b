//! Finds out, in two frames of 16 by 16 pixels, how the adapter rasterises where the specification
//! leaves a choice.

use std::collections::BTreeMap;
use std::sync::Arc;

use glam::Vec3;
use preshade_plan::rasterizer::{Corners, Neighbours, Rasterizer};
use preshade_plan::state::{ColorTarget, CullMode, MaterialState, PrimitiveState};

use super::{Session, handmade};
use preshade_compiler::front;
use preshade_draw::render::{ColorImage, Error, Gpu};
use preshade_draw::scene::{DrawOrder, Image, Material, Mesh, Scene, Stream};
use preshade_scenes::ShaderForm;
use shader_text::options;

/// Width and height in pixels.
const SIZE: u32 = 16;
/// Difference between the texels of two neighbouring mip levels, of 255.
const STEP: u8 = 30;

/// Values with a different slope in each row of a quad, so that a gradient names its row. The
/// second pixel of an odd row is eight texels from the first; of an even row, one.
const NEIGHBOURS: &str = "
@group(0) @binding(0) var flat_levels: texture_2d<f32>;
@group(0) @binding(1) var cube_levels: texture_cube<f32>;
@group(0) @binding(2) var trilinear: sampler;
@vertex fn vs(@location(0) position: vec3<f32>) -> @builtin(position) vec4<f32> { \
    return vec4(position, 1.0); }
@fragment fn fs(@builtin(position) at: vec4<f32>) -> @location(0) vec4<f32> {
    let pixel = floor(at.xy);
    let product = pixel.x * pixel.y;
    let odd = vec2<u32>(at.xy) & vec2(1u);
    let along = f32(odd.x) * select(1.0, 8.0, odd.y == 1u) / 64.0;
    let level = textureSample(flat_levels, trilinear, vec2(0.5 + along, 0.5)).r;
    let of_cube = textureSample(cube_levels, trilinear, vec3(1.0, 0.1, 0.1 + 2.0 * along)).r;
    return vec4(dpdx(product) - pixel.y, dpdxCoarse(product) - pixel.y, level, of_cube);
}";

/// A number interpolated over a triangle.
const CORNERS: &str = "
struct Out { @builtin(position) at: vec4<f32>, @location(0) value: f32 }
@vertex fn vs(@location(0) position: vec3<f32>) -> Out { \
    return Out(vec4(position.xy, 0.5, 1.0), position.z); }
@fragment fn fs(in: Out) -> @location(0) vec4<f32> { return vec4(in.value, 0.0, 0.0, 1.0); }";

/// Draws and reads the pictures.
///
/// # Errors
///
/// The adapter's own, for example that it cannot draw to `rgba32float`.
pub fn rasterizer(gpu: &Gpu) -> Result<Rasterizer, Error> {
    let screen = [[-1.0, -1.0, 0.5], [3.0, -1.0, 0.5], [-1.0, 3.0, 0.5]];
    let picture = drawn(gpu, NEIGHBOURS, &screen)?;
    // The first pixel of an odd row of a quad.
    let [derivative, coarse, level, of_cube] = picture.rgba((5 * SIZE + 4) as usize);
    let of_difference = |difference: f32| match difference < -0.5 {
        true => Neighbours::Quad,
        false => Neighbours::Own,
    };
    // Level 0, or level 3.
    let of_level = |level: f32| match level * 255.0 < 1.5 * f32::from(STEP) {
        true => Neighbours::Quad,
        false => Neighbours::Own,
    };
    Ok(Rasterizer {
        corners: corners(gpu)?,
        derivatives: of_difference(derivative),
        coarse: of_difference(coarse),
        samples: of_level(level),
        cubes: of_level(of_cube),
    })
}

/// Draws a triangle whose corners are off the grid of 1/256 pixel, and finds out which corners it
/// interpolates between.
fn corners(gpu: &Gpu) -> Result<Corners, Error> {
    // In pixels, with the value there.
    let snapped = [[2.0, 3.0, 0.0], [14.0, 2.0, 1.0], [5.0, 14.0, 0.0]];
    let off = 0.4 / 256.0;
    let moved = [[off, -off], [-off, -off], [off, off]];
    let given: [[f64; 3]; 3] = std::array::from_fn(|i| {
        let ([x, y, value], [dx, dy]) = (snapped[i], moved[i]);
        [x + dx, y + dy, value]
    });
    let half = f64::from(SIZE) / 2.0;
    let in_clip = given.map(|[x, y, value]| {
        [
            (x / half - 1.0) as f32,
            (1.0 - y / half) as f32,
            value as f32,
        ]
    });
    let picture = drawn(gpu, CORNERS, &in_clip)?;
    let (mut from_given, mut from_snapped) = (0.0, 0.0);
    // All of these pixels are well within the triangle.
    for (x, y) in [(6_u32, 5_u32), (9, 4), (6, 9), (8, 6), (7, 7)] {
        let [value, ..] = picture.rgba((y * SIZE + x) as usize);
        let pixel = [f64::from(x) + 0.5, f64::from(y) + 0.5];
        let far = |corners: &[[f64; 3]; 3]| (interpolated(corners, pixel) - f64::from(value)).abs();
        from_given += far(&given);
        from_snapped += far(&snapped);
    }
    Ok(match from_snapped < from_given {
        true => Corners::Snapped,
        false => Corners::AsGiven,
    })
}

fn interpolated([a, b, c]: &[[f64; 3]; 3], [x, y]: [f64; 2]) -> f64 {
    let edge = |p: &[f64; 3], q: &[f64; 3]| (p[0] - x) * (q[1] - y) - (p[1] - y) * (q[0] - x);
    let (of_a, of_b, of_c) = (edge(b, c), edge(c, a), edge(a, b));
    (of_a * a[2] + of_b * b[2] + of_c * c[2]) / (of_a + of_b + of_c)
}

/// A picture of one triangle.
fn drawn(gpu: &Gpu, source: &str, triangle: &[[f32; 3]; 3]) -> Result<ColorImage, Error> {
    let failed = |message: String| Error::Scene {
        draw: "what shows how the adapter rasterises".to_owned(),
        message,
    };
    let text = front::Source::new("rasterizer.wgsl", source);
    let parsed = front::parse(&[text], &options::Options::default());
    let parsed = parsed.map_err(|e| failed(e.to_string()))?;
    let state = MaterialState {
        primitive: PrimitiveState {
            cull: CullMode::None,
            ..PrimitiveState::default()
        },
        targets: vec![Some(ColorTarget::opaque("rgba32float"))],
        ..MaterialState::default()
    };
    let material = Material {
        textures: BTreeMap::from([
            ("flat_levels".to_owned(), levels(1)),
            ("cube_levels".to_owned(), levels(6)),
        ]),
        ..handmade::material("rasterizer", parsed, state)
    };
    let scene = scene(material, triangle);
    let session = Session::new(gpu, &scene, ShaderForm::Text)?;
    let mut prepared = session.prepare(session.originals())?;
    let (frame, order) = (&scene.cameras[0].frames[0], DrawOrder::AsGiven);
    let mut colors = session
        .draw(&mut prepared, frame, order)?
        .colors
        .into_iter();
    let color = colors.next().flatten();
    color.ok_or_else(|| failed("it draws to no colour".to_owned()))
}

/// A texture whose mip levels have different colours.
fn levels(layers: u32) -> Arc<Image> {
    let size = 64_u32;
    let levels = (0..=size.ilog2()).map(|level| {
        let texels = (size >> level) * (size >> level) * layers;
        [STEP * level as u8, 0, 0, 255].repeat(texels as usize)
    });
    Arc::new(Image::rgba8([size; 2], layers, false, levels.collect()))
}

fn scene(material: Material, triangle: &[[f32; 3]; 3]) -> Scene {
    let positions = Stream::Float {
        components: 3,
        data: triangle.concat(),
    };
    let mesh = Mesh {
        name: "triangle".to_owned(),
        vertex_count: 3,
        streams: BTreeMap::from([("position".to_owned(), positions)]),
        indices: None,
        bounds: [Vec3::splat(-1.0), Vec3::ONE],
    };
    let draws = vec![handmade::draw("triangle", 1)];
    Scene {
        clear_color: [0.0; 4],
        ..handmade::scene("rasterizer", [SIZE; 2], material, mesh, draws)
    }
}
