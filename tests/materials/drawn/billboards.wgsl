// Particles that face the eye: four corners each, along the camera's axes.
struct Eye {
    clip_from_world: mat4x4<f32>,
    right: vec3<f32>,
    up: vec3<f32>,
}

struct Particle {
    centre: vec3<f32>,
    radius: f32,
}

@group(0) @binding(0) var<uniform> eye: Eye;
@group(0) @binding(1) var<storage, read> particles: array<Particle>;

struct Varyings {
    @builtin(position) clip: vec4<f32>,
    @location(0) corner: vec2<f32>,
}

const CORNERS = array<vec2<f32>, 6>(
    vec2<f32>(-1.0, -1.0), vec2<f32>(1.0, -1.0), vec2<f32>(-1.0, 1.0),
    vec2<f32>(-1.0, 1.0), vec2<f32>(1.0, -1.0), vec2<f32>(1.0, 1.0),
);

@vertex
fn vs(@builtin(vertex_index) v: u32) -> Varyings {
    let particle = particles[v / 6u];
    var corners = CORNERS;
    let corner = corners[v % 6u];
    let world = particle.centre + (eye.right * corner.x + eye.up * corner.y) * particle.radius;
    return Varyings(eye.clip_from_world * vec4<f32>(world, 1.0), corner);
}

@fragment
fn fs(in: Varyings) -> @location(0) vec4<f32> {
    if dot(in.corner, in.corner) > 1.0 {
        discard;
    }
    return vec4<f32>(0.5 + 0.5 * in.corner, 0.8, 1.0);
}
