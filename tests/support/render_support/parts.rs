//! A scene whose draws take parts of meshes and of instances, so that nothing that counts from
//! somewhere counts from 0.

use std::collections::BTreeMap;

use glam::{Mat4, Vec3};
use preshade_draw::scene::{Draw, DrawRange, Material, Mesh, Scene, Stream};
use preshade_plan::state::CullMode;

use super::{draw, material, scene};

/// Vertices and instances that their numbers and their attributes colour, seen from both sides.
const SIDES: &str = "
struct Camera { view_proj: mat4x4<f32> }
struct Object { model: mat4x4<f32>, tint: vec4<f32> }
@group(0) @binding(0) var<uniform> camera: Camera;
@group(1) @binding(0) var<uniform> object: Object;
@group(1) @binding(1) var albedo: texture_2d<f32>;
@group(1) @binding(2) var smooth_sampler: sampler;
struct Out {
    @builtin(position) at: vec4<f32>,
    @location(0) uv: vec2<f32>,
    @location(1) shade: vec2<f32>,
    @location(2) @interpolate(flat) number: u32,
}
@vertex fn vs(
    @location(0) position: vec3<f32>, @location(1) uv: vec2<f32>, \
        @location(2) instance_place: vec4<f32>,
    @builtin(vertex_index) vertex: u32, @builtin(instance_index) instance: u32,
) -> Out {
    let world = object.model * vec4(position + instance_place.xyz, 1.0);
    return Out(camera.view_proj * world, uv, vec2(f32(vertex % 7u) * 0.1, instance_place.w), \
        instance);
}
@fragment fn fs(in: Out, @builtin(front_facing) front: bool) -> @location(0) vec4<f32> {
    let base = textureSample(albedo, smooth_sampler, in.uv * 3.0).rgb;
    if length(in.uv - 0.5) < 0.1 { discard; }
    let side = select(0.3, 0.8, front);
    return vec4(base * (0.4 + in.shade.x), 1.0) * object.tint * vec4(side, 1.0, 0.3 + 0.1 * \
        f32(in.number % 5u), 1.0) + 0.1 * in.shade.y;
}
";

/// The same with holes, seen from the front.
const HOLES: &str = "
struct Camera { view_proj: mat4x4<f32> }
struct Object { model: mat4x4<f32>, tint: vec4<f32> }
@group(0) @binding(0) var<uniform> camera: Camera;
@group(1) @binding(0) var<uniform> object: Object;
struct Out { @builtin(position) at: vec4<f32>, @location(0) uv: vec2<f32>, @location(1) \
    @interpolate(linear) bent: f32 }
@vertex fn vs(@location(0) position: vec3<f32>, @location(1) uv: vec2<f32>, \
    @location(2) instance_place: vec4<f32>) -> Out {
    let world = object.model * vec4(position + instance_place.xyz, 1.0);
    return Out(camera.view_proj * world, uv, instance_place.w);
}
@fragment fn fs(in: Out) -> @location(0) vec4<f32> {
    if length(in.uv - 0.5) < 0.2 { discard; }
    return vec4(in.uv, 0.2 + 0.3 * in.bent, 1.0) * object.tint;
}
";

/// Four corners of a square of side 1 around `x`, `y`.
fn square(x: f32, y: f32) -> [[f32; 3]; 4] {
    [(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)].map(|(dx, dy)| [x + dx, y + dy, 0.2 * dx])
}

fn mesh(name: &str, positions: &[[f32; 3]], indices: Option<Vec<u32>>) -> Mesh {
    let stream = |components, data| Stream::Float { components, data };
    let uvs = positions.iter().flat_map(|p| [p[0] + 0.5, p[1] + 0.5]);
    Mesh {
        name: name.to_owned(),
        vertex_count: positions.len() as u32,
        streams: BTreeMap::from([
            ("position".to_owned(), stream(3, positions.concat())),
            ("uv".to_owned(), stream(2, uvs.collect())),
        ]),
        indices,
        bounds: [Vec3::splat(-2.0), Vec3::splat(2.0)],
    }
}

/// A draw of some of 301 instances: the first five and the last are in sight.
fn part(name: &str, place: [f32; 3], turn: f32, range: DrawRange, instances: u32) -> Draw {
    let transform = Mat4::from_translation(place.into()) * Mat4::from_rotation_y(turn);
    let mut draw = draw(name, transform, [0.9, 0.8, 0.7, 0.3]);
    let places = (0..301).flat_map(|i| match i as f32 {
        i if i < 5.0 => [0.5 * i - 1.0, 0.25 * i, 0.3 * i, 0.2 * i],
        300.0 => [-0.3, -1.1, 0.4, 0.5],
        _ => [90.0, 90.0, 90.0, 0.0],
    });
    let places = Stream::Float {
        components: 4,
        data: places.collect(),
    };
    draw.instance_streams = BTreeMap::from([("instance_place".to_owned(), places)]);
    (draw.range, draw.instances) = (range, instances);
    draw
}

fn sided(name: &str, source: &str, cull: CullMode) -> Material {
    let mut material = material(name, source);
    material.state.primitive.cull = cull;
    material
}

/// Six draws of two materials, in a part of the target: of indices of 16 and of 32 bits and of
/// none, from a first index, vertex and instance on, with vertices added to and taken from each
/// index.
pub fn parts() -> Scene {
    let two = [0, 1, 2, 0, 2, 3];
    let squares: Vec<[f32; 3]> = (0..3).flat_map(|i| square(0.1 * i as f32, 0.0)).collect();
    // What no draw takes is one far-off point.
    let mut far: Vec<[f32; 3]> = vec![[5.0, 5.0, 5.0]; 66_000];
    far.extend(square(0.0, 0.0));
    let moved = 66_000 + 3;
    let unindexed: Vec<[f32; 3]> = (0..3)
        .flat_map(|i| two.map(|v| square(0.1 * i as f32, 0.2)[v as usize]))
        .collect();
    let range = |first, count, base_vertex, first_instance| DrawRange {
        first,
        count: Some(count),
        base_vertex,
        first_instance,
    };
    let mut draws = vec![
        part("first", [0.9, -0.7, 0.1], 0.4, range(6, 6, 4, 2), 3),
        part("whole", [-1.2, -0.6, 0.0], -0.5, DrawRange::default(), 1),
        part("odd", [-0.5, 0.6, -0.2], -0.2, range(9, 3, 5, 0), 301),
        // Seen from behind.
        part("wide", [0.2, 0.5, 0.3], 3.3, range(3, 6, -3, 1), 2),
        part("unindexed", [1.3, 0.6, -0.4], 0.6, range(6, 9, 0, 3), 2),
        part("behind", [0.1, -0.2, -1.5], 0.0, range(0, 12, 8, 1), 1),
    ];
    for (draw, (mesh, material)) in
        draws
            .iter_mut()
            .zip([(0, 1), (0, 0), (0, 0), (1, 0), (2, 1), (0, 0)])
    {
        (draw.mesh, draw.material) = (mesh, material);
    }
    let materials = vec![
        sided("sides", SIDES, CullMode::None),
        sided("holes", HOLES, CullMode::Back),
    ];
    let mut scene = scene([96, 80], materials, draws);
    scene.viewport = Some([5, 3, 86, 70]);
    let short = [two.to_vec(), two.to_vec()].concat();
    let long = [vec![0; 3], two.map(|i| i + moved).to_vec(), vec![1; 3]].concat();
    scene.meshes = vec![
        mesh("squares", &squares, Some(short)),
        mesh("far", &far, Some(long)),
        mesh("unindexed", &unindexed, None),
    ];
    let frame = &mut scene.cameras[0].frames[0];
    let eye = Vec3::new(0.3, 0.4, 3.4);
    frame.view = Mat4::look_at_rh(eye, Vec3::ZERO, Vec3::Y);
    frame.projection = Mat4::perspective_rh(0.9, 86.0 / 70.0, 0.1, 50.0);
    frame.eye = eye;
    scene
}

/// [`parts`] with a draw that pierces the near plane, all of one material.
pub fn parts_of_one() -> Scene {
    let mut scene = parts();
    scene.materials.truncate(1);
    for draw in &mut scene.draws {
        draw.material = 0;
    }
    let mut near = part("near", [0.32, 0.4, 3.3], 1.2, DrawRange::default(), 1);
    near.transform *= Mat4::from_scale(Vec3::splat(0.15)) * Mat4::from_translation(Vec3::X);
    scene.draws.push(near);
    scene
}
