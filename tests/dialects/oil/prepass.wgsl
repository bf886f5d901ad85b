#define_import_path own::prepass

// Of another pipeline, so at a place that the main pass has for something else.
@group(2) @binding(0) var<uniform> previous: mat4x4<f32>;

fn motion(at: vec4<f32>) -> vec4<f32> {
    return previous * at;
}
