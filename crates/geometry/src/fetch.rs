//! Our own WGSL that fetches vertices from storage buffers as vertex input does, from any stage.
//!
//! ```text
//! fn NAME_corner(triangle: u32, corner: u32) -> u32                the vertex that a corner of a triangle is, by the draw's indices
//! fn NAME_L(vertex: u32, instance: u32) -> vec3<f32>               the attribute at location L, out of the host's own vertex buffer
//! ```
//!
//! Attributes are fetched and converted as WebGPU's vertex input does it (WebGPU, section
//! 10.3.8.1): missing components are 0, and 1 for the fourth.

use std::fmt::Write;

use preshade_plan::geometry::{FORMATS, Formats};
use preshade_plan::plan::AttributeUse;

/// Prefixes of generated functions and variables.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Names {
    pub function: &'static str,
    /// The uniform buffer of a draw's constants, and the prefix of the buffers' names.
    pub variable: &'static str,
}

/// `NAME_corner(triangle, corner)`, from the index buffer at this binding.
pub(crate) fn corners(names: Names, group: u32, binding: u32) -> String {
    let Names { function, variable } = names;
    format!(
        "@group({group}) @binding({binding}) var<storage, read> {variable}_indices: array<u32>;
fn {function}_corner(triangle: u32, corner: u32) -> u32 {{
    let at = {variable}.first + triangle * 3u + corner;
    switch {variable}.index_bytes {{
        case 2u: {{
            return {variable}.base_vertex + (({variable}_indices[at / 2u] >> (16u * (at % 2u))) & \
                0xffffu);
        }}
        case 4u: {{
            return {variable}.base_vertex + {variable}_indices[at];
        }}
        default: {{
            return at;
        }}
    }}
}}
"
    )
}

/// `NAME_L(vertex, instance)` for each attribute, from the storage buffers bound from `first` on in
/// `group`. The uniform buffer `VARIABLE` holds their layouts in `streams`.
pub(crate) fn attributes(
    names: Names,
    attributes: &[AttributeUse],
    (group, first): (u32, u32),
    formats: Formats,
) -> String {
    match formats {
        Formats::Any => of_any_format(names, attributes, group, first),
        Formats::Declared => as_declared(names, attributes, group, first),
    }
}

/// Reads each attribute's words as numbers of its declared type.
fn as_declared(names: Names, attributes: &[AttributeUse], group: u32, first: u32) -> String {
    let mut out = String::new();
    let Names { function, variable } = names;
    for (index, attribute) in attributes.iter().enumerate() {
        let AttributeUse { location, ty, .. } = attribute;
        let words: Vec<String> = (0..components(ty).len())
            .map(|word| format!("{variable}_stream_{location}_[first + {word}u]"))
            .collect();
        let words = match words.len() {
            1 => words.join(""),
            n => format!("vec{n}<u32>({})", words.join(", ")),
        };
        let value = match AttributeKind::of(attribute) {
            AttributeKind::Uint => words,
            _ => format!("bitcast<{ty}>({words})"),
        };
        let _ = write!(
            out,
            "@group({group}) @binding({binding}) var<storage, read> {variable}_stream_{location}_: \
             array<u32>;
fn {function}_{location}_(vertex: u32, instance: u32) -> {ty} {{
    let stream = {variable}.streams[{index}];
    let first = (stream.x + select(vertex, instance, (stream.w & 256u) != 0u) * stream.y) / 4u;
    return {value};
}}
",
            binding = first + index as u32,
        );
    }
    out
}

/// Converts each attribute from its stream's format.
fn of_any_format(names: Names, attributes: &[AttributeUse], group: u32, first: u32) -> String {
    let mut out = String::new();
    let Names { function, variable } = names;
    for (kind, text) in [
        (AttributeKind::Float, decode_float(names)),
        (AttributeKind::Uint, decode_uint(names)),
        (AttributeKind::Sint, decode_sint(names)),
    ] {
        if attributes.iter().any(|a| AttributeKind::of(a) == kind) {
            out.push_str(&text);
        }
    }
    for (index, attribute) in attributes.iter().enumerate() {
        let AttributeUse { location, ty, .. } = attribute;
        let kind = AttributeKind::of(attribute);
        let _ = write!(
            &mut out,
            "@group({group}) @binding({binding}) var<storage, read> {variable}_stream_{location}_: \
             array<u32>;
fn {function}_{location}_(vertex: u32, instance: u32) -> {ty} {{
    let stream = {variable}.streams[{index}];
    let at = stream.x + select(vertex, instance, (stream.w & 256u) != 0u) * stream.y;
    let first = at / 4u;
    var words = vec4<u32>({variable}_stream_{location}_[first], 0u, 0u, 0u);
    switch stream.w & 255u {{
        case 1u: {{}}
        case 2u: {{
            words.y = {variable}_stream_{location}_[first + 1u];
        }}
        case 3u: {{
            words.y = {variable}_stream_{location}_[first + 1u];
            words.z = {variable}_stream_{location}_[first + 2u];
        }}
        default: {{
            words.y = {variable}_stream_{location}_[first + 1u];
            words.z = {variable}_stream_{location}_[first + 2u];
            words.w = {variable}_stream_{location}_[first + 3u];
        }}
    }}
    return {decoder}(words, (at % 4u) * 8u, stream.z).{components};
}}
",
            binding = first + index as u32,
            decoder = kind.decoder(names),
            components = components(ty),
        );
    }
    out
}

/// Scalar kind of a decoded attribute.
#[derive(Clone, Copy, PartialEq, Eq)]
enum AttributeKind {
    Float,
    Uint,
    Sint,
}

impl AttributeKind {
    fn of(attribute: &AttributeUse) -> Self {
        match attribute.ty.trim_end_matches('>').rsplit('<').next() {
            Some("u32") => Self::Uint,
            Some("i32") => Self::Sint,
            _ => Self::Float,
        }
    }

    fn scalar(self) -> &'static str {
        match self {
            Self::Float => "f32",
            Self::Uint => "u32",
            Self::Sint => "i32",
        }
    }

    fn name(self) -> &'static str {
        match self {
            Self::Float => "float",
            Self::Uint => "uint",
            Self::Sint => "sint",
        }
    }

    fn decoder(self, names: Names) -> String {
        format!("{}_{}", names.function, self.name())
    }
}

/// `x`, `xy`, `xyz` or `xyzw` for a scalar or a vector type.
fn components(ty: &str) -> &'static str {
    match ty.as_bytes().get(..4) {
        Some(b"vec2") => "xy",
        Some(b"vec3") => "xyz",
        Some(b"vec4") => "xyzw",
        _ => "x",
    }
}

/// The number of a vertex format in the constants.
fn code(name: &str) -> usize {
    FORMATS
        .iter()
        .position(|f| *f == name)
        .unwrap_or(FORMATS.len())
}

/// A decoder to one scalar kind, with a case for each format that WebGPU lets a shader read as that
/// kind.
fn decoder(names: Names, kind: AttributeKind, prelude: &str, cases: &[(&str, String)]) -> String {
    let (name, scalar) = (kind.decoder(names), kind.scalar());
    let mut out =
        format!("fn {name}(words: vec4<u32>, shift: u32, format: u32) -> vec4<{scalar}> {{\n");
    out.push_str(prelude);
    out.push_str("    switch format {\n");
    for (format, value) in cases {
        let code = code(format);
        let _ = write!(
            out,
            "        case {code}u: {{ // {format}\n            return {value};\n        }}\n"
        );
    }
    let _ = write!(
        out,
        "        default: {{\n            return vec4<{scalar}>();\n        }}\n    }}\n}}\n"
    );
    out
}

/// Pads one to four components to a vector with WebGPU's defaults.
fn padded(scalar: &str, given: &[&str]) -> String {
    let missing = ["0", "0", "0", "1"];
    let all = given.iter().chain(&missing[given.len()..]);
    let all: Vec<String> = all.map(|c| format!("{scalar}({c})")).collect();
    format!("vec4<{scalar}>({})", all.join(", "))
}

fn decode_float(names: Names) -> String {
    let mut cases: Vec<(&str, String)> = Vec::new();
    let first = |format, value: &str, count| match count {
        1 => (format, format!("vec4<f32>({value}.x, 0.0, 0.0, 1.0)")),
        2 => (format, format!("vec4<f32>({value}.xy, 0.0, 1.0)")),
        _ => (format, value.to_owned()),
    };
    for (sign, unpack) in [("unorm8", "unpack4x8unorm"), ("snorm8", "unpack4x8snorm")] {
        for count in [1, 2, 4] {
            let format = format_name(sign, count);
            cases.push(first(format, &format!("{unpack}(word)"), count));
        }
    }
    for (sign, unpack) in [
        ("unorm16", "unpack2x16unorm"),
        ("snorm16", "unpack2x16snorm"),
        ("float16", "unpack2x16float"),
    ] {
        for count in [1, 2] {
            let format = format_name(sign, count);
            cases.push(first(format, &format!("{unpack}(word)"), count));
        }
        let four = format!("vec4<f32>({unpack}(words.x), {unpack}(words.y))");
        cases.push((format_name(sign, 4), four));
    }
    for count in 1..=4 {
        let bits = "bitcast<vec4<f32>>(words)";
        let value = match count {
            3 => format!("vec4<f32>({bits}.xyz, 1.0)"),
            _ => first("", bits, count).1,
        };
        cases.push((format_name("float32", count), value));
    }
    cases.push((
        "unorm10-10-10-2",
        "vec4<f32>(vec4<u32>(words.x, words.x >> 10u, words.x >> 20u, words.x >> 30u) & \
         vec4<u32>(1023u)) / vec4<f32>(1023.0, 1023.0, 1023.0, 3.0)"
            .to_owned(),
    ));
    cases.push(("unorm8x4-bgra", "unpack4x8unorm(words.x).zyxw".to_owned()));
    decoder(
        names,
        AttributeKind::Float,
        "    let word = words.x >> shift;\n",
        &cases,
    )
}

fn decode_uint(names: Names) -> String {
    let mut cases: Vec<(&str, String)> = Vec::new();
    let byte = [
        "word & 255u",
        "(word >> 8u) & 255u",
        "(word >> 16u) & 255u",
        "word >> 24u",
    ];
    let half = [
        "word & 65535u",
        "word >> 16u",
        "words.y & 65535u",
        "words.y >> 16u",
    ];
    for count in [1, 2, 4] {
        cases.push((format_name("uint8", count), padded("u32", &byte[..count])));
        cases.push((format_name("uint16", count), padded("u32", &half[..count])));
    }
    let all = ["words.x", "words.y", "words.z", "words.w"];
    for count in 1..=4 {
        cases.push((format_name("uint32", count), padded("u32", &all[..count])));
    }
    decoder(
        names,
        AttributeKind::Uint,
        "    let word = words.x >> shift;\n",
        &cases,
    )
}

fn decode_sint(names: Names) -> String {
    let mut cases: Vec<(&str, String)> = Vec::new();
    let byte = [
        "(word << 24u) >> 24u",
        "(word << 16u) >> 24u",
        "(word << 8u) >> 24u",
        "word >> 24u",
    ];
    let half = [
        "(word << 16u) >> 16u",
        "word >> 16u",
        "(bitcast<i32>(words.y) << 16u) >> 16u",
        "bitcast<i32>(words.y) >> 16u",
    ];
    for count in [1, 2, 4] {
        cases.push((format_name("sint8", count), padded("i32", &byte[..count])));
        cases.push((format_name("sint16", count), padded("i32", &half[..count])));
    }
    let all = ["words.x", "words.y", "words.z", "words.w"];
    let all = all.map(|w| format!("bitcast<i32>({w})"));
    let all: Vec<&str> = all.iter().map(String::as_str).collect();
    for count in 1..=4 {
        cases.push((format_name("sint32", count), padded("i32", &all[..count])));
    }
    decoder(
        names,
        AttributeKind::Sint,
        "    let word = bitcast<i32>(words.x >> shift);\n",
        &cases,
    )
}

/// WebGPU's name of a format with this many components.
fn format_name(base: &str, count: usize) -> &'static str {
    let name = match count {
        1 => base.to_owned(),
        n => format!("{base}x{n}"),
    };
    FORMATS.iter().find(|f| **f == name).copied().unwrap_or("")
}
