// Fills a part of the targets.

struct Fill { color: vec4f, depth: f32 }

@group(0) @binding(0) var<uniform> fill: Fill;

@vertex
fn everywhere(@builtin(vertex_index) i: u32) -> @builtin(position) vec4f {
    return vec4f(f32(i & 1u) * 4.0 - 1.0, f32(i >> 1u) * 4.0 - 1.0, fill.depth, 1.0);
}

struct Colors {
    @location(0) a: vec4f, @location(1) b: vec4f, @location(2) c: vec4f, @location(3) d: vec4f,
    @location(4) e: vec4f, @location(5) f: vec4f, @location(6) g: vec4f, @location(7) h: vec4f,
}

@fragment
fn filled() -> Colors {
    let c = fill.color;
    return Colors(c, c, c, c, c, c, c, c);
}
