// Sprites in pixels from the upper left, a rectangle for each instance.
struct Sprite {
    corner: vec2<f32>,
    extent: vec2<f32>,
    paint: vec4<f32>,
}

struct Window {
    pixels: vec2<f32>,
}

@group(0) @binding(0) var<uniform> window: Window;
@group(0) @binding(1) var<storage, read> sprites: array<Sprite>;

struct Varyings {
    @builtin(position) clip: vec4<f32>,
    @location(0) paint: vec4<f32>,
}

@vertex
fn vs(@builtin(vertex_index) v: u32, @builtin(instance_index) i: u32) -> Varyings {
    let sprite = sprites[i];
    let unit = vec2<f32>(f32((v >> 1u) & 1u), f32(v & 1u));
    let at = (sprite.corner + unit * sprite.extent) / window.pixels;
    return Varyings(vec4<f32>(at.x * 2.0 - 1.0, 1.0 - at.y * 2.0, 0.0, 1.0), sprite.paint);
}

@fragment
fn fs(in: Varyings) -> @location(0) vec4<f32> {
    return in.paint;
}
