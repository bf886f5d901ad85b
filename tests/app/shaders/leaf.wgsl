// A leaf that sways and is cut out of its texture; lit by four octaves of noise, so that shading it twice is dear.

struct Frame {
    view_projection: mat4x4<f32>,
    time: f32,
}

@group(0) @binding(0) var<uniform> frame: Frame;
@group(1) @binding(0) var leaf: texture_2d<f32>;
@group(1) @binding(1) var leaf_sampler: sampler;

struct VertexOut {
    @builtin(position) position: vec4<f32>,
    @location(0) world: vec3<f32>,
    @location(1) uv: vec2<f32>,
}

@vertex
fn vs_main(@location(0) position: vec3<f32>, @location(1) uv: vec2<f32>) -> VertexOut {
    var world = position;
    // Still air at the start.
    if (frame.time > 0.0) {
        world.x += 0.05 * sin(frame.time + position.z * 3.0) * (1.0 - uv.y);
    }
    var out: VertexOut;
    out.position = frame.view_projection * vec4<f32>(world, 1.0);
    out.world = world;
    out.uv = uv;
    return out;
}

fn noise(p: vec3<f32>) -> f32 {
    var sum = 0.0;
    var scale = 1.0;
    var q = p;
    for (var octave = 0; octave < 4; octave++) {
        sum += scale * sin(q.x + sin(q.y * 1.3 + sin(q.z * 1.7)));
        q = q * 2.03 + 1.1;
        scale *= 0.5;
    }
    return sum;
}

@fragment
fn fs_main(in: VertexOut) -> @location(0) vec4<f32> {
    let texel = textureSample(leaf, leaf_sampler, in.uv);
    if (texel.a < 0.5) {
        discard;
    }
    let light = 0.6 + 0.2 * noise(in.world * 4.0);
    return vec4<f32>(texel.rgb * light, 1.0);
}
