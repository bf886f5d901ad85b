//! Draws WebGL's points as squares of two triangles: WebGPU's points have a size of one pixel and
//! no coordinate.

use naga::{Binding, Interpolation, ShaderStage};
use naga_edit::interface;
use preshade_plan::program::Program;

use super::reader::Reader;
use preshade_draw::scene::bind::{Data, VertexAttribute, VertexBuffer};

/// The varying for the fragment's coordinate in its point, or for the inputs of [`EXACT`].
const AT: &str = "preshade_point";
/// `gl_PointCoord` as SwiftShader computes it: from the point's centre on a grid of 1/16 pixel, and
/// from the inverse of its size. In the replay row 0 is the bottom row, while the coordinate starts
/// at the top.
const EXACT: &str = "#define preshade_from_top (0.5 + preshade_point.z * ((gl_FragCoord.xy - 0.5) - preshade_point.xy))
#define preshade_coord vec2(preshade_from_top.x, 0.5 - (preshade_from_top.y - 0.5))
";
/// Vertex input that selects the corner of the square.
pub(super) const CORNER: &str = "preshade_corner";
/// Vertex input in the replay: the viewport's origin in pixels.
pub(super) const ORIGIN: &str = "preshade_origin";
const CORNERS: [[f32; 2]; 6] = [
    [-1.0, -1.0],
    [1.0, -1.0],
    [1.0, 1.0],
    [-1.0, -1.0],
    [1.0, 1.0],
    [-1.0, 1.0],
];

/// Whether a WebGL vertex stage sets the size of its points.
pub(super) fn are_sized(vertex: &str) -> bool {
    vertex.contains("gl_PointSize")
}

/// Makes a vertex stage move each position to a corner of its point.
pub(super) fn vertex(text: &str, reader: Reader) -> String {
    let [input, output] = match is_300(text) {
        true => ["in", "out"],
        false => ["attribute", "varying"],
    };
    let flat = flat(text);
    let declared = match reader {
        Reader::Author | Reader::Scene => {
            format!("{input} highp vec3 {CORNER}; {output} highp vec2 {AT};\n")
        }
        Reader::Replay => format!(
            "{input} highp vec3 {CORNER}; {input} highp vec2 {ORIGIN}; {flat}{output} highp vec3 {AT};\n"
        ),
    };
    let text = text.replace("gl_VertexID", &format!("int({CORNER}.z)"));
    let at = match reader {
        Reader::Author | Reader::Scene => {
            format!("{AT} = vec2(0.5) + vec2(0.5, -0.5) * sign({CORNER}.xy);")
        }
        Reader::Replay => format!(
            "highp vec2 sixteenths = floor(1.0 / abs({CORNER}.xy) + 0.5) * 8.0; {AT}.xy = {ORIGIN} + \
             floor((sixteenths - 8.0) + (gl_Position.xy * (1.0 / gl_Position.w)) * sixteenths + 0.5) / 16.0; \
             {AT}.z = 1.0 / max(gl_PointSize, 1.0);"
        ),
    };
    // SwiftShader uses the same order of operations.
    let moved =
        format!("{at} gl_Position.xy += (max(gl_PointSize, 1.0) * gl_Position.w) * {CORNER}.xy;");
    after_main(&declare(&text, &declared), "preshade_point_main", &moved)
}

/// Makes a fragment stage read its coordinate from [`vertex`].
pub(super) fn fragment(text: &str, reader: Reader) -> String {
    let input = if is_300(text) { "in" } else { "varying" };
    let (declared, coordinate) = match reader {
        Reader::Author | Reader::Scene => (format!("{input} highp vec2 {AT};\n"), AT),
        Reader::Replay => {
            let flat = flat(text);
            let declared = format!("{EXACT}{flat}{input} highp vec3 {AT};\n");
            (declared, "preshade_coord")
        }
    };
    declare(&text.replace("gl_PointCoord", coordinate), &declared)
}

/// The program with flat varyings, except for the fragment's place in its point. All fragments of a
/// point have the same values, because it has one vertex (OpenGL ES 3.0.6, section 3.4).
/// Interpolation between the equal corners of our square would round them.
pub(super) fn with_flat_varyings(program: &Program) -> Result<Program, String> {
    let mut module = program.module().clone();
    for index in 0..module.entry_points.len() {
        let entry = &mut module.entry_points[index];
        if entry.stage == ShaderStage::Vertex {
            interface::edit_outputs(&mut module, index, |name, _, binding| {
                flatten(name, binding)
            });
            continue;
        }
        for argument in &mut entry.function.arguments {
            flatten(argument.name.as_deref(), &mut argument.binding);
        }
    }
    program.with_module(module).map_err(|e| e.to_string())
}

fn flatten(name: Option<&str>, binding: &mut Option<Binding>) {
    if let Some(Binding::Location {
        interpolation,
        sampling,
        ..
    }) = binding
        && name != Some(AT)
    {
        (*interpolation, *sampling) = (Some(Interpolation::Flat), None);
    }
}

/// The qualifier for a varying with one value per point. WebGL 1 has none, and interpolates equal
/// values.
fn flat(text: &str) -> &'static str {
    if is_300(text) { "flat " } else { "" }
}

fn is_300(text: &str) -> bool {
    text.trim_start().starts_with("#version 300")
}

/// Inserts a declaration after `#version`.
pub(super) fn declare(text: &str, declared: &str) -> String {
    let start = text.len() - text.trim_start().len();
    let end = match text[start..].starts_with("#version") {
        true => text[start..]
            .find('\n')
            .map_or(text.len(), |n| start + n + 1),
        false => start,
    };
    format!("{}{declared}{}", &text[..end], &text[end..])
}

/// Appends statements to a stage's `main`. `own` becomes the name of the author's function.
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

/// Inputs of a points' vertex stage in addition to the author's attributes.
pub(super) struct Corners {
    /// Location of the corner, three floats: x and y divided by the viewport's size in pixels, and
    /// the point's number.
    pub(super) corner: u32,
    /// Location of [`ORIGIN`], if the stage reads it.
    pub(super) origin: Option<u32>,
    /// x, y, width and height, in pixels.
    pub(super) viewport: [f32; 4],
}

/// Six vertices for each point in `numbers`.
pub(super) fn spread(
    points: Option<VertexBuffer>,
    numbers: &[u32],
    corners: &Corners,
) -> VertexBuffer {
    let [left, bottom, width, height] = corners.viewport;
    let (stride, mut attributes, data) = match &points {
        Some(p) => (p.stride as usize, p.attributes.clone(), &p.data.bytes[..]),
        None => (0, Vec::new(), &[][..]),
    };
    attributes.push(VertexAttribute {
        location: corners.corner,
        format: wgpu::VertexFormat::Float32x3,
        offset: stride as u64,
        is_invented: true,
    });
    attributes.extend(corners.origin.map(|location| VertexAttribute {
        location,
        format: wgpu::VertexFormat::Float32x2,
        offset: stride as u64 + 12,
        is_invented: true,
    }));
    let zero = vec![0; stride];
    let mut bytes = Vec::with_capacity(numbers.len() * CORNERS.len() * (stride + 20));
    for number in numbers {
        let from = *number as usize * stride;
        let own = data.get(from..from + stride).unwrap_or(&zero);
        for [x, y] in CORNERS {
            bytes.extend_from_slice(own);
            for n in [x / width, y / height, *number as f32, left, bottom] {
                bytes.extend_from_slice(&n.to_le_bytes());
            }
        }
    }
    VertexBuffer {
        stride: stride as u64 + 20,
        step: wgpu::VertexStepMode::Vertex,
        attributes,
        data: Data::new(bytes),
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;
    use preshade_compiler::front::{self, Source};

    #[test]
    fn fragments_of_a_point_have_equal_varyings_but_where_they_are() {
        let stages = [
            (
                "points.vert",
                vertex(
                    "#version 300 es\nin vec3 at; out vec3 shade; void main() { gl_PointSize = 3.0; \
                     gl_Position = vec4(at, 1.0); shade = at; }",
                    Reader::Scene,
                ),
            ),
            (
                "points.frag",
                fragment(
                    "#version 300 es\nprecision highp float; in vec3 shade; out vec4 color; \
                     void main() { color = vec4(shade.xy, gl_PointCoord); }",
                    Reader::Scene,
                ),
            ),
        ];
        let sources = stages.map(|(name, text)| Source::from_bytes(name, text.into()).unwrap());
        let parsed = front::parse(&sources, &shader_text::options::Options::default()).unwrap();
        let flat = with_flat_varyings(&parsed.program).unwrap();
        let module = flat.module();
        for entry in &module.entry_points {
            let varyings = match entry.stage {
                ShaderStage::Vertex => interface::outputs(module, &entry.function),
                _ => interface::inputs(module, &entry.function),
            };
            for varying in varyings {
                if let Some(Binding::Location { interpolation, .. }) = varying.binding {
                    let is_flat = interpolation == Some(Interpolation::Flat);
                    assert_eq!(is_flat, varying.name.as_deref() != Some(AT), "{varying:?}");
                }
            }
        }
    }
}
