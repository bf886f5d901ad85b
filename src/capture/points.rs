//! WebGL's points as squares of two triangles: WebGPU's points are one pixel large and have no coordinate.

use super::webgl::CORNER;
use crate::scene::bind::{Data, VertexAttribute, VertexBuffer};

/// The coordinate in the point, in place of `gl_PointCoord`.
const AT: &str = "preshade_point";
const CORNERS: [[f32; 2]; 6] = [
    [-1.0, -1.0],
    [1.0, -1.0],
    [1.0, 1.0],
    [-1.0, -1.0],
    [1.0, 1.0],
    [-1.0, 1.0],
];

/// Whether a vertex stage of WebGL says how large its points are.
pub(super) fn are_sized(vertex: &str) -> bool {
    vertex.contains("gl_PointSize")
}

/// A vertex stage that moves each position to a corner of its point.
pub(super) fn vertex(text: &str) -> String {
    let [input, output] = match is_300(text) {
        true => ["in", "out"],
        false => ["attribute", "varying"],
    };
    let declared = format!("{input} highp vec3 {CORNER}; {output} highp vec2 {AT};\n");
    let text = text.replace("gl_VertexID", &format!("int({CORNER}.z)"));
    let moved = format!(
        "gl_Position.xy += {CORNER}.xy * max(gl_PointSize, 1.0) * gl_Position.w; \
         {AT} = vec2(0.5) + vec2(0.5, -0.5) * sign({CORNER}.xy);"
    );
    after_main(&declare(&text, &declared), "preshade_point_main", &moved)
}

/// A fragment stage that reads the coordinate from [`vertex`].
pub(super) fn fragment(text: &str) -> String {
    let input = if is_300(text) { "in" } else { "varying" };
    let declared = format!("{input} highp vec2 {AT};\n");
    declare(&text.replace("gl_PointCoord", AT), &declared)
}

fn is_300(text: &str) -> bool {
    text.trim_start().starts_with("#version 300")
}

/// Puts a declaration after `#version`.
fn declare(text: &str, declared: &str) -> String {
    let start = text.len() - text.trim_start().len();
    let end = match text[start..].starts_with("#version") {
        true => text[start..]
            .find('\n')
            .map_or(text.len(), |n| start + n + 1),
        false => start,
    };
    format!("{}{declared}{}", &text[..end], &text[end..])
}

/// A stage whose `main` does more at its end. `own` becomes the name of the author's.
pub(super) fn after_main(text: &str, own: &str, more: &str) -> String {
    let mut out = String::with_capacity(text.len() + 100);
    let mut rest = text;
    while let Some(at) = rest.find("main") {
        let (before, found) = rest.split_at(at);
        let after = &found["main".len()..];
        let is_word = before.ends_with(char::is_whitespace) && before.trim_end().ends_with("void");
        let is_call = after.trim_start().starts_with('(');
        out += before;
        out += if is_word && is_call { own } else { "main" };
        rest = after;
    }
    out += rest;
    out += &format!("\nvoid main() {{ {own}(); {more} }}\n");
    out
}

/// The vertices of points: six of each of `numbers`, with the corner at `location` as three floats: x and
/// y over the viewport's size in pixels, and the point's number.
pub(super) fn spread(
    points: Option<VertexBuffer>,
    numbers: &[u32],
    [width, height]: [f32; 2],
    location: u32,
) -> VertexBuffer {
    let (stride, mut attributes, data) = match &points {
        Some(p) => (p.stride as usize, p.attributes.clone(), &p.data.bytes[..]),
        None => (0, Vec::new(), &[][..]),
    };
    attributes.push(VertexAttribute {
        location,
        format: wgpu::VertexFormat::Float32x3,
        offset: stride as u64,
        is_invented: true,
    });
    let zero = vec![0; stride];
    let mut bytes = Vec::with_capacity(numbers.len() * CORNERS.len() * (stride + 12));
    for number in numbers {
        let from = *number as usize * stride;
        let own = data.get(from..from + stride).unwrap_or(&zero);
        for [x, y] in CORNERS {
            bytes.extend_from_slice(own);
            for n in [x / width, y / height, *number as f32] {
                bytes.extend_from_slice(&n.to_le_bytes());
            }
        }
    }
    VertexBuffer {
        stride: stride as u64 + 12,
        step: wgpu::VertexStepMode::Vertex,
        attributes,
        data: Data::new(bytes),
    }
}
