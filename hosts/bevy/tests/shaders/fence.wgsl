// The mesh's own vertex stage, and a fragment stage that cuts though the material counts as opaque.
#import bevy_pbr::{
    forward_io::VertexOutput,
}

struct Values { amount: f32, cutoff: f32, rate: f32, unused: f32 }
@group(#{MATERIAL_BIND_GROUP}) @binding(0) var<uniform> values: Values;

@fragment
fn fragment(in: VertexOutput) -> @location(0) vec4<f32> {
    let bar = abs(fract(in.uv * 8.0) - 0.5);
    if max(bar.x, bar.y) < 0.3 {
        discard;
    }
    let light = max(dot(normalize(in.world_normal), vec3(0.3, 0.9, 0.3)), 0.1);
    return vec4(vec3(light) * values.amount, 1.0);
}
