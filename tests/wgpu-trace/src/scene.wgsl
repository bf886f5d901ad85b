// All stages of the recorded frames.

struct Placed {
    // Turns about z, moves, and scales.
    turn: vec2f,
    move_by: vec2f,
    scale: f32,
    depth: f32,
}

@group(0) @binding(0) var<uniform> placed: Placed;

fn place(at: vec2f, offset: vec2f) -> vec4f {
    let turned = vec2f(at.x * placed.turn.x - at.y * placed.turn.y, at.x * placed.turn.y + at.y * placed.turn.x);
    return vec4f(turned * placed.scale + placed.move_by + offset, placed.depth, 1.0);
}

// The shadow map is the scene as the light sees it: a little to the left.
@vertex
fn shadow(@location(0) at: vec2f, @location(1) offset: vec4f) -> @builtin(position) vec4f {
    return place(at, offset.xy + vec2f(0.25, 0.25));
}

struct Shown {
    @builtin(position) position: vec4f,
    @location(0) uv: vec2f,
}

@vertex
fn shown(@location(0) at: vec2f, @location(1) offset: vec4f) -> Shown {
    return Shown(place(at, offset.xy), at * 2.0 + 0.5);
}

@group(1) @binding(0) var bricks: texture_2d<f32>;
@group(1) @binding(1) var smooth_sampler: sampler;
@group(1) @binding(2) var shadows: texture_depth_2d;
@group(1) @binding(3) var trail: texture_2d<f32>;

@fragment
fn lit(in: Shown) -> @location(0) vec4f {
    let texel = textureSample(bricks, smooth_sampler, in.uv);
    let seen = vec2u(in.position.xy) / vec2u(2u, 2u);
    let nearest = textureLoad(shadows, min(seen, textureDimensions(shadows) - 1u), 0);
    let is_lit = select(0.4, 1.0, nearest >= in.position.z);
    let glow = textureLoad(trail, vec2u(0u, 0u), 0).r;
    return vec4f(texel.rgb * is_lit + vec3f(glow, 0.0, 0.0), 1.0);
}

// A triangle over the whole target.
@vertex
fn everywhere(@builtin(vertex_index) index: u32) -> @builtin(position) vec4f {
    let corner = vec2f(f32(index & 1u), f32(index >> 1u)) * 4.0 - 1.0;
    return vec4f(corner, 0.0, 1.0);
}

@group(0) @binding(0) var finer: texture_2d<f32>;

// The mean of four texels of the finer level.
@fragment
fn halved(@builtin(position) position: vec4f) -> @location(0) vec4f {
    let at = vec2u(position.xy) * 2u;
    let upper = textureLoad(finer, at, 0) + textureLoad(finer, at + vec2u(1u, 0u), 0);
    let lower = textureLoad(finer, at + vec2u(0u, 1u), 0) + textureLoad(finer, at + vec2u(1u, 1u), 0);
    return (upper + lower) / 4.0;
}

// Each frame adds to what the frames before it left.
@fragment
fn added() -> @location(0) vec4f {
    return vec4f(0.125);
}

@group(0) @binding(0) var<storage, read_write> offsets: array<vec4f>;

@compute @workgroup_size(4)
fn spread(@builtin(global_invocation_id) id: vec3u) {
    if id.x < arrayLength(&offsets) {
        offsets[id.x] = vec4f(f32(id.x) * 0.5 - 0.5, 0.0, 0.0, 0.0);
    }
}
