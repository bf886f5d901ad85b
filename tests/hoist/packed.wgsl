// The distance to a lamp, packed into the four bytes of a colour, as a shadow map is where there are no depth textures: each channel but the first jumps from 1 to 0 again and again.

struct Camera {
    view_proj: mat4x4<f32>,
}

@group(0) @binding(0) var<uniform> camera: Camera;
@group(2) @binding(0) var<uniform> model: mat4x4<f32>;

struct VertexOut {
    @builtin(position) clip: vec4<f32>,
    @location(0) world: vec3<f32>,
}

@vertex
fn vs_main(@location(0) position: vec3<f32>) -> VertexOut {
    let world = model * vec4<f32>(position, 1.0);
    return VertexOut(camera.view_proj * world, world.xyz);
}

@fragment
fn fs_main(in: VertexOut) -> @location(0) vec4<f32> {
    let away = in.world - vec3<f32>(1.0, 4.0, 2.0);
    let depth = exp(-0.125 * sqrt(dot(away, away)));
    let parts = fract(depth * vec4<f32>(1.0, 16.0, 256.0, 4096.0));
    let packed = parts - parts.yzww * vec4<f32>(1.0 / 16.0, 1.0 / 16.0, 1.0 / 16.0, 0.0);
    return vec4<f32>(packed.xyz, 1.0);
}
