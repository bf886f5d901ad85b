#import own::lighting::{Light, lambert}

struct Vertex {
    @location(0) position: vec3<f32>,
    @location(1) normal: vec3<f32>,
}

struct Varyings {
    @builtin(position) clip: vec4<f32>,
    @location(0) normal: vec3<f32>,
}

@group(#{GROUP}) @binding(0) var<uniform> light: Light;

@vertex
fn vertex(in: Vertex) -> Varyings {
    return Varyings(vec4<f32>(in.position, 1.0), in.normal);
}

@fragment
fn fragment(in: Varyings) -> @location(0) vec4<f32> {
    var color = lambert(normalize(in.normal), light);
#ifdef DIM
    color *= 0.5;
#endif
    return vec4<f32>(color, 1.0);
}
