// A second material, which nothing is asked for: its variants are those that need no scene.

@group(0) @binding(0) var<uniform> view_projection: mat4x4<f32>;

struct VertexOut {
    @builtin(position) position: vec4<f32>,
    @location(0) world: vec2<f32>,
}

@vertex
fn vs_main(@location(0) position: vec3<f32>) -> VertexOut {
    return VertexOut(view_projection * vec4<f32>(position, 1.0), position.xz);
}

@fragment
fn fs_main(in: VertexOut) -> @location(0) vec4<f32> {
    let tile = abs(fract(in.world) - 0.5);
    return vec4<f32>(vec3<f32>(0.2 + max(tile.x, tile.y)), 1.0);
}
