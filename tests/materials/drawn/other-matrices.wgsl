// Matrices whose names no list has.
struct PerFrame {
    eyeFromWorld: mat4x4<f32>,
    lens: mat4x4<f32>,
}

struct PerThing {
    placement: mat4x4<f32>,
    paint: vec4<f32>,
}

@group(0) @binding(0) var<uniform> frame: PerFrame;
@group(1) @binding(0) var<uniform> thing: PerThing;

struct Varyings {
    @builtin(position) clip: vec4<f32>,
    @location(0) chart: vec2<f32>,
}

@vertex
fn vs(@location(0) vtx: vec3<f32>, @location(1) vertexTexCoord: vec2<f32>) -> Varyings {
    let eye = frame.eyeFromWorld * thing.placement * vec4<f32>(vtx, 1.0);
    return Varyings(frame.lens * eye, vertexTexCoord);
}

@fragment
fn fs(in: Varyings) -> @location(0) vec4<f32> {
    return vec4<f32>(thing.paint.rgb * (0.5 + 0.5 * fract(in.chart.x * 8.0)), 1.0);
}
