// Terrain: a flat grid lifted by a height map, in world space.
struct World {
    pv: mat4x4<f32>,
    lift: f32,
    cell: f32,
}

@group(0) @binding(0) var<uniform> world: World;
@group(0) @binding(1) var heights: texture_2d<f32>;

struct Varyings {
    @builtin(position) clip: vec4<f32>,
    @location(0) height: f32,
}

@vertex
fn vs(@location(0) ground: vec2<f32>) -> Varyings {
    let size = vec2<f32>(textureDimensions(heights));
    let texel = vec2<i32>(fract(ground * world.cell) * size);
    let height = textureLoad(heights, texel, 0).r;
    return Varyings(world.pv * vec4<f32>(ground.x, height * world.lift, ground.y, 1.0), height);
}

@fragment
fn fs(in: Varyings) -> @location(0) vec4<f32> {
    return vec4<f32>(mix(vec3<f32>(0.2, 0.4, 0.1), vec3<f32>(1.0), in.height), 1.0);
}
