// A quad out of the vertex number alone, turned by an angle.
struct Card {
    angle: f32,
    paint: vec4<f32>,
}

@group(0) @binding(0) var<uniform> card: Card;

@vertex
fn vs(@builtin(vertex_index) v: u32) -> @builtin(position) vec4<f32> {
    let right = (0x32u >> v) & 1u;
    let up = (0x2cu >> v) & 1u;
    let corner = vec2<f32>(f32(right), f32(up)) - 0.5;
    let c = cos(card.angle);
    let s = sin(card.angle);
    return vec4<f32>(corner.x * c - corner.y * s, corner.x * s + corner.y * c, 0.5, 1.0);
}

@fragment
fn fs() -> @location(0) vec4<f32> {
    return card.paint;
}
