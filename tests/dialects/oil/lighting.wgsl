#define_import_path own::lighting

struct Light {
    direction: vec3<f32>,
    color: vec3<f32>,
}

fn lambert(normal: vec3<f32>, light: Light) -> vec3<f32> {
    return light.color * max(dot(normal, light.direction), 0.0);
}
