// Two variables at one binding: each stage uses one of them, and the larger decides the layout.
struct Turned {
    mvp: mat4x4<f32>,
}
struct Lit {
    mvp: mat4x4<f32>,
    color: vec4<f32>,
    speed: f32,
    phase: f32,
}
@group(0) @binding(0) var<uniform> turned: Turned;
@group(0) @binding(0) var<uniform> lit: Lit;

struct Varyings {
    @builtin(position) position: vec4<f32>,
    @location(0) uv: vec2<f32>,
    @location(1) normal: vec3<f32>,
}

@vertex
fn vs(
    @location(0) position: vec3<f32>,
    @location(1) normal: vec3<f32>,
    @location(2) uv: vec2<f32>,
) -> Varyings {
    return Varyings(turned.mvp * vec4<f32>(position, 1.0), uv, normal);
}

@fragment
fn fs(v: Varyings) -> @location(0) vec4<f32> {
    let bright = sin(lit.speed) * cos(lit.phase) + 0.5;
    if v.uv.x < 0.1 * bright {
        discard;
    }
    return vec4<f32>(v.normal * 0.5 + 0.5, 1.0) * bright * lit.color;
}
