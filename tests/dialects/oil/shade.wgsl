#import own::lighting::{Light, lambert}

struct Varyings {
    @builtin(position) clip: vec4<f32>,
    @location(0) normal: vec3<f32>,
}

@group(2) @binding(0) var<uniform> light: Light;

@fragment
fn fragment(in: Varyings) -> @location(0) vec4<f32> {
    return vec4<f32>(lambert(normalize(in.normal), light), 1.0);
}
