// Block faces packed into one word each: five bits a coordinate, three for the side. Six vertices a face.
struct View {
    toClip: mat4x4<f32>,
    origin: vec3<f32>,
}

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<storage, read> faces: array<u32>;

struct Varyings {
    @builtin(position) clip: vec4<f32>,
    @location(0) side: f32,
}

@vertex
fn vs(@builtin(vertex_index) number: u32) -> Varyings {
    let word = faces[number / 6u];
    let corner = number % 6u;
    let u = f32(corner == 1u || corner == 2u || corner == 4u);
    let v = f32(corner == 2u || corner == 4u || corner == 5u);
    let block = vec3<f32>(f32(word & 31u), f32((word >> 5u) & 31u), f32((word >> 10u) & 31u));
    let side = (word >> 15u) & 7u;
    var place = block + vec3<f32>(u, v, f32(side & 1u));
    if side >= 4u {
        place = block + vec3<f32>(u, f32(side & 1u), v);
    } else if side >= 2u {
        place = block + vec3<f32>(f32(side & 1u), u, v);
    }
    return Varyings(view.toClip * vec4<f32>(place + view.origin, 1.0), f32(side) / 6.0);
}

@fragment
fn fs(in: Varyings) -> @location(0) vec4<f32> {
    return vec4<f32>(in.side, 0.6, 1.0 - in.side, 1.0);
}
