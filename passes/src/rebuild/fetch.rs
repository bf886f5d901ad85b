//! Fetches vertices from storage buffers as vertex input does, to call the author's vertex stage on
//! any vertex of a draw, from any stage.
//!
//! ```text
//! fn NAME_corner(triangle: u32, corner: u32) -> u32                the vertex that a corner of a triangle is, by the draw's indices
//! fn NAME_L(vertex: u32, instance: u32) -> vec3<f32>               the attribute at location L, out of the host's own vertex buffer
//! fn vs_corner(vertex: u32, instance: u32) -> VertexOutput         the author's stage on those attributes
//! ```
//!
//! Attributes are fetched and converted as WebGPU's vertex input does it (WebGPU, section
//! 10.3.8.1): missing components are 0, and 1 for the fourth.

use std::collections::BTreeMap;
use std::fmt::Write;

use naga::{
    Binding, BuiltIn, Expression, Function, FunctionArgument, FunctionResult, Handle, Module,
    Scalar, Span, Statement, Type, TypeInner,
};

use crate::core::geometry::{FORMATS, Formats};
use crate::core::link;
use crate::core::plan::AttributeUse;
use crate::graph::FunctionId;
use crate::rebuild::place::{self, Builder, Rewrite};

/// A source offset beyond every file: our own text has no place in the author's.
const NOWHERE: u32 = u32::MAX / 2;

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
            return {variable}.base_vertex + (({variable}_indices[at / 2u] >> (16u * (at % 2u))) & 0xffffu);
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
/// `group`. The uniform buffer `VARIABLE` has their layouts in `streams`.
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
        let value = match Kind::of(attribute) {
            Kind::Uint => words,
            _ => format!("bitcast<{ty}>({words})"),
        };
        let _ = write!(
            out,
            "@group({group}) @binding({binding}) var<storage, read> {variable}_stream_{location}_: array<u32>;
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
        (Kind::Float, decode_float(names)),
        (Kind::Uint, decode_uint(names)),
        (Kind::Sint, decode_sint(names)),
    ] {
        if attributes.iter().any(|a| Kind::of(a) == kind) {
            out.push_str(&text);
        }
    }
    for (index, attribute) in attributes.iter().enumerate() {
        let AttributeUse { location, ty, .. } = attribute;
        let kind = Kind::of(attribute);
        let _ = write!(
                &mut out,
                "@group({group}) @binding({binding}) var<storage, read> {variable}_stream_{location}_: array<u32>;
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
enum Kind {
    Float,
    Uint,
    Sint,
}

impl Kind {
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

/// Number of a vertex format in the constants.
fn code(name: &str) -> usize {
    FORMATS
        .iter()
        .position(|f| *f == name)
        .unwrap_or(FORMATS.len())
}

/// A decoder to one scalar kind, with a case for each format that WebGPU lets a shader read as that
/// kind.
fn decoder(names: Names, kind: Kind, prelude: &str, cases: &[(&str, String)]) -> String {
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
        "vec4<f32>(vec4<u32>(words.x, words.x >> 10u, words.x >> 20u, words.x >> 30u) & vec4<u32>(1023u)) / vec4<f32>(1023.0, 1023.0, 1023.0, 3.0)"
            .to_owned(),
    ));
    cases.push(("unorm8x4-bgra", "unpack4x8unorm(words.x).zyxw".to_owned()));
    decoder(
        names,
        Kind::Float,
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
        Kind::Uint,
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
        Kind::Sint,
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

/// A module with our own functions.
pub(crate) struct Linked {
    pub(crate) module: Module,
    pub(crate) ours: BTreeMap<String, Handle<Function>>,
}

impl Linked {
    /// Adds `wgsl` to `module`.
    pub(crate) fn new(module: Module, wgsl: &str) -> Result<Self, String> {
        let snippet = naga::front::wgsl::parse_str(wgsl)
            .map_err(|e| format!("our own text does not parse: {}", e.message()))?;
        let linked =
            link::link(module, &snippet, NOWHERE, "preshade").map_err(|e| e.message.clone())?;
        let names = snippet.functions.iter().map(|(_, f)| f.name.clone());
        let named = names.zip(&linked.functions);
        Ok(Self {
            ours: named.filter_map(|(n, h)| Some((n?, *h))).collect(),
            module: linked.module,
        })
    }
}

/// One of our own functions.
pub(crate) fn ours(
    functions: &BTreeMap<String, Handle<Function>>,
    name: &str,
) -> Result<Handle<Function>, String> {
    let found = functions.get(name).copied();
    found.ok_or_else(|| format!("our own text has no `{name}`"))
}

/// Defines a function `NAME_SUFFIX` whose body `build` writes.
pub(crate) fn define(
    mut module: Module,
    (name, suffix): (&str, &str),
    arguments: &[(&str, Handle<Type>)],
    result: Handle<Type>,
    build: impl FnOnce(&mut Builder<'_>, &[Handle<Expression>]),
) -> (Module, Handle<Function>) {
    let function = Function {
        name: Some(place::free_name(&module, name, suffix)),
        arguments: arguments
            .iter()
            .map(|(name, ty)| FunctionArgument {
                name: Some((*name).to_owned()),
                ty: *ty,
                binding: None,
            })
            .collect(),
        result: Some(FunctionResult {
            ty: result,
            binding: None,
        }),
        ..Function::default()
    };
    let handle = module.functions.append(function, Span::UNDEFINED);
    let module = place::rewritten(&module, FunctionId::Function(handle), |builder| {
        let passed: Vec<_> = (0..arguments.len() as u32)
            .map(|i| builder.expression(Expression::FunctionArgument(i)))
            .collect();
        build(builder, &passed);
        Rewrite::default()
    });
    (module, handle)
}

/// A `u32` type.
pub(crate) fn word(module: &mut Module) -> Handle<Type> {
    let inner = TypeInner::Scalar(Scalar::U32);
    module
        .types
        .insert(Type { name: None, inner }, Span::UNDEFINED)
}

/// The author's vertex stage, as a function.
pub(crate) struct Author<'a> {
    pub function: Handle<Function>,
    /// Its result type.
    pub given: Handle<Type>,
    /// The entry point's arguments.
    pub inputs: &'a [FunctionArgument],
}

/// The author's stage for one vertex, as `NAME_corner`. `fetch` has the function of each attribute,
/// by location.
///
/// # Errors
/// A message: an input that no vertex has.
pub(crate) fn corner(
    mut module: Module,
    name: &str,
    author: &Author<'_>,
    fetch: &[(u32, Handle<Function>)],
) -> Result<(Module, Handle<Function>), String> {
    let word = word(&mut module);
    let mut failed = None;
    let (module, handle) = define(
        module,
        (name, "corner"),
        &[("vertex", word), ("instance", word)],
        author.given,
        |build, passed| {
            let one = |build: &mut Builder<'_>, binding: Option<&Binding>| match binding {
                Some(Binding::BuiltIn(BuiltIn::VertexIndex)) => Some(passed[0]),
                Some(Binding::BuiltIn(BuiltIn::InstanceIndex)) => Some(passed[1]),
                Some(Binding::Location { location, .. }) => {
                    let of = fetch.iter().find(|(l, _)| l == location);
                    of.and_then(|(_, f)| build.call(*f, passed.to_vec()))
                }
                _ => None,
            };
            let mut arguments = Vec::new();
            for input in author.inputs {
                let members = match (&input.binding, &build.module().types[input.ty].inner) {
                    (None, TypeInner::Struct { members, .. }) => Some(members.clone()),
                    _ => None,
                };
                let value = match members {
                    None => one(build, input.binding.as_ref()),
                    Some(members) => members
                        .iter()
                        .map(|m| one(build, m.binding.as_ref()))
                        .collect::<Option<Vec<_>>>()
                        .map(|components| {
                            build.expression(Expression::Compose {
                                ty: input.ty,
                                components,
                            })
                        }),
                };
                match value {
                    Some(value) => arguments.push(value),
                    None => failed = Some(input.name.clone().unwrap_or_default()),
                }
            }
            if failed.is_none() {
                let value = build.call(author.function, arguments);
                build.statement(Statement::Return { value });
            }
        },
    );
    match failed {
        None => Ok((module, handle)),
        Some(input) => Err(format!("the input `{input}` has no source")),
    }
}
