#import own::lighting::Light
#import own::prepass

struct Vertex {
    @location(0) position: vec3<f32>,
    @location(1) normal: vec3<f32>,
}

struct Varyings {
    @builtin(position) clip: vec4<f32>,
    @location(0) normal: vec3<f32>,
}

@vertex
fn vertex(in: Vertex) -> Varyings {
    return Varyings(vec4<f32>(in.position, 1.0), in.normal);
}

// What is drawn where a material has no fragment stage of its own.
@fragment
fn fragment() -> @location(0) vec4<f32> {
    return vec4<f32>(1.0, 0.0, 1.0, 1.0);
}
