//! The fixed WGSL of a visibility buffer: ids, corners of triangles, and the position of a pixel in
//! its triangle.
//!
//! Barycentrics come from homogeneous edge functions (Olano and Greer, "Triangle scan conversion
//! using 2D homogeneous coordinates", 1997). With corners `(x, y, w)` and a pixel at `(X, Y)`, the
//! edge function of corner `i` is proportional to its perspective-correct weight, even for a
//! negative or zero `w`. We subtract the pixel first and fuse products with their differences where
//! the device supports it (Kahan's 2x2 determinant), so that cancellation loses little. Edges of
//! twice the precision change hardly a pixel of the fixtures. The remaining difference comes from
//! the rasteriser, which snaps vertices before it interpolates ([`Corners`]).

use std::fmt::Write;

use super::ids::Facing;
use super::legal::{Encoding, Stored};
use crate::fetch::{self, Names};
use preshade_plan::draw_table::Words;
use preshade_plan::geometry::Formats;
use preshade_plan::plan::AttributeUse;
use preshade_plan::rasterizer::Corners;

/// Prefixes of generated functions and variables.
pub(crate) const NAMES: Names = Names {
    function: "visible",
    variable: "visibility",
};

/// Generated bindings from `first` on, in this order: the draw's entry, the ids, the indices, a
/// stream per attribute.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Slots {
    pub group: u32,
    pub first: u32,
}

impl Slots {
    /// The draw's entry in the draw table.
    pub const ENTRY: u32 = 0;
    /// The texture of ids.
    pub const IDS: u32 = 1;
    pub const INDICES: u32 = 2;
    /// The first attribute's stream.
    pub const STREAMS: u32 = 3;
}

/// The draw's entry with this many attributes ([`preshade_plan::draw_table::Entry`]).
pub(crate) fn entry(slots: Slots, attributes: usize) -> String {
    let Slots { group, first } = slots;
    let streams = match attributes {
        0 => String::new(),
        n => format!("\n    streams: array<vec4<u32>, {n}>,"),
    };
    format!(
        "struct Visibility {{
    first_id: u32,
    instances: u32,
    first_instance: u32,
    number: u32,
    first: u32,
    index_bytes: u32,
    base_vertex: u32,
    triangle_bits: u32,
    viewport: vec4<f32>,
    counts: vec4<u32>,{streams}
}}
@group({group}) @binding({}) var<uniform> visibility: Visibility;
",
        first + Slots::ENTRY
    )
}

/// The functions of an id pass: `visible_id_of(instance)` and `visible_written(id)`, which encodes
/// an id for writing; with facing, `visible_written(id, front)`.
pub(crate) fn ids(words: Words, facing: Facing) -> String {
    let bits = "visibility.triangle_bits";
    let (ty, written) = match words {
        Words::Two => ("vec2<u32>", "id".to_owned()),
        Words::One => ("u32", format!("(id.x << {bits}) | id.y")),
    };
    let (argument, written) = match (facing, words) {
        (Facing::Written, Words::Two) => (
            ", front: bool",
            "vec2<u32>(id.x, id.y | select(0x80000000u, 0u, front))".to_owned(),
        ),
        (Facing::Written, Words::One) => (
            ", front: bool",
            format!("{written} | select(1u << ({bits} - 1u), 0u, front)"),
        ),
        _ => ("", written),
    };
    format!(
        "fn visible_id_of(instance: u32) -> u32 {{
    return 1u + visibility.first_id + instance - visibility.first_instance;
}}
fn visible_written(id: vec2<u32>{argument}) -> {ty} {{
    return {written};
}}
"
    )
}

/// Corners of triangles and their attributes.
pub(crate) fn vertices(slots: Slots, attributes: &[AttributeUse], formats: Formats) -> String {
    let Slots { group, first } = slots;
    let mut out = fetch::corners(NAMES, group, first + Slots::INDICES);
    out.push_str(&fetch::attributes(
        NAMES,
        attributes,
        (group, first + Slots::STREAMS),
        formats,
    ));
    out
}

/// The additional functions of a resolve pass: the pixel's id, and its place in the triangle.
/// `widths` are those of the interpolated varyings.
pub(crate) fn resolve(slots: Slots, widths: &[u8], words: Words, corners: Corners) -> String {
    let bits = "visibility.triangle_bits";
    let mut out = texture_of_ids(slots.group, slots.first + Slots::IDS, words, bits);
    out.push_str(NUMBER);
    out.push_str(RESOLVE);
    out.push_str(match corners {
        Corners::AsGiven | Corners::Held => EDGES,
        Corners::Snapped => EDGES_SNAPPED,
    });
    out.push_str(match corners {
        Corners::AsGiven => COVERED_ANYWHERE,
        Corners::Held | Corners::Snapped => COVERED_INSIDE,
    });
    for width in widths {
        let ty = match width {
            1 => "f32".to_owned(),
            n => format!("vec{n}<f32>"),
        };
        // Uses differences to the first value, so that three equal values stay exact.
        let _ = write!(
            out,
            "fn visible_blend_{width}_(weights: vec3<f32>, a: {ty}, b: {ty}, c: {ty}) -> {ty} {{
    return a + (b - a) * weights.y + (c - a) * weights.z;
}}
"
        );
    }
    out
}

/// The vertex stage of a full-screen pass at the depth that stands for its draw.
pub(crate) const SCREEN: &str = "@vertex
fn vs_visible(@builtin(vertex_index) vertex: u32) -> @builtin(position) vec4<f32> {
    let depth = visible_number(visibility.number);
    return vec4<f32>(f32(vertex & 1u) * 4.0 - 1.0, f32(vertex >> 1u) * 4.0 - 1.0, depth, 1.0);
}
";

/// The sRGB transfer function (IEC 61966-2-1) for colours in 0..1.
const SRGB: &str = "fn visible_srgb(color: vec4<f32>) -> vec4<f32> {
    let linear = clamp(color.rgb, vec3<f32>(), vec3<f32>(1.0));
    let curved = 1.055 * pow(linear, vec3<f32>(1.0 / 2.4)) - 0.055;
    return vec4<f32>(select(curved, 12.92 * linear, linear <= vec3<f32>(0.0031308)), color.a);
}
";

/// A render target with a normalised format converts NaN to 0 (Direct3D 11.3, 3.2.3.6); a storage
/// texture leaves it to the driver. We test the bits because compilers may fold a comparison with
/// itself.
const NORMALIZED: &str = "fn visible_number_of(color: vec4<f32>) -> vec4<f32> {
    let magnitude = bitcast<vec4<u32>>(color) & vec4<u32>(0x7fffffffu);
    return select(color, vec4<f32>(), magnitude > vec4<u32>(0x7f800000u));
}
";

/// The additional code of a compute resolve: pixels, and the colours to write, bound from `first`
/// on.
pub(crate) fn compute(group: u32, first: u32, targets: &[Stored]) -> String {
    let mut out = "fn visible_outside(id: vec3<u32>) -> bool {
    let size = textureDimensions(visibility_ids);
    return id.x >= size.x || id.y >= size.y;
}
fn visible_pixel(id: vec3<u32>) -> vec4<f32> {
    return vec4<f32>(vec2<f32>(id.xy) + 0.5, 0.0, 1.0);
}
"
    .to_owned();
    if targets.iter().any(|t| t.encoding == Encoding::Srgb) {
        out.push_str(SRGB);
    }
    if targets.iter().any(Stored::is_normalized) {
        out.push_str(NORMALIZED);
    }
    for (binding, target) in (first..).zip(targets) {
        let Stored {
            location, format, ..
        } = target;
        let color = match (target.encoding, target.is_normalized()) {
            (Encoding::Linear, false) => "color",
            (Encoding::Linear, true) => "visible_number_of(color)",
            (Encoding::Srgb, _) => "visible_srgb(visible_number_of(color))",
        };
        let _ = write!(
            out,
            "@group({group}) @binding({binding}) var visibility_target_{location}_: \
             texture_storage_2d<{format}, write>;
fn visible_store_{location}_(id: vec3<u32>, color: vec4<f32>) {{
    textureStore(visibility_target_{location}_, vec2<i32>(id.xy), {color});
}}
"
        );
    }
    out
}

/// The pass that clears the scene's colour by drawing a triangle outside of the view.
pub(crate) fn clear(locations: &[u32]) -> String {
    let members: String = locations
        .iter()
        .map(|l| format!("    @location({l}) color_{l}_: vec4<f32>,\n"))
        .collect();
    format!(
        "struct VisibleCleared {{
{members}}}
@vertex
fn vs_clear() -> @builtin(position) vec4<f32> {{
    return vec4<f32>(2.0, 2.0, 0.0, 1.0);
}}
@fragment
fn fs_clear() -> VisibleCleared {{
    return VisibleCleared();
}}
"
    )
}

/// The pass that counts the pixels of a draw.
pub(crate) fn count(words: Words) -> String {
    let slots = Slots { group: 0, first: 0 };
    let mut out = entry(slots, 0);
    out.push_str(&resolve(slots, &[], words, Corners::AsGiven));
    out.push_str(SCREEN);
    out.push_str(
        "@fragment
fn fs_count(@builtin(position) at: vec4<f32>) -> @location(0) vec4<f32> {
    if (!visible_is_ours(visible_id(at))) {
        discard;
    }
    return vec4<f32>(1.0);
}
",
    );
    out
}

/// `visible_number(draw)`: the depth that stands for a draw. It lies a quarter of a 16-bit step
/// beyond the exact step, so that truncation and rounding give the same step.
const NUMBER: &str = "fn visible_number(draw: u32) -> f32 {
    return (f32(draw) + 1.25) / 65535.0;
}
";

/// The ids and `visible_id(at)`. `bits` is an expression for the number of triangle bits in
/// one-word ids.
fn texture_of_ids(group: u32, binding: u32, words: Words, bits: &str) -> String {
    let read = match words {
        Words::Two => "return texel.xy;".to_owned(),
        Words::One => format!(
            "let bits = {bits} - 1u;
    let triangle = texel.x & ((1u << bits) - 1u);
    let side = ((texel.x >> bits) & 1u) << 31u;
    return vec2<u32>(texel.x >> (bits + 1u), triangle | side);"
        ),
    };
    format!(
        "@group({group}) @binding({binding}) var visibility_ids: texture_2d<u32>;
fn visible_id(at: vec4<f32>) -> vec2<u32> {{
    let texel = textureLoad(visibility_ids, vec2<i32>(at.xy), 0);
    {read}
}}
"
    )
}

/// Binding of the ids in the pass that separates draws.
pub(crate) const CLASSIFY_IDS: u32 = 0;
/// Binding of the draw table in the pass that separates draws.
pub(crate) const CLASSIFY_TABLE: u32 = 1;

/// The ids, the draw table, and `visible_draw(id)`: the number of the last draw whose first id is
/// not beyond the pixel's.
pub(crate) fn drawn(words: Words) -> String {
    let mut out = format!(
        "@group(0) @binding({CLASSIFY_TABLE}) var<storage, read> visibility_table: array<u32>;\n"
    );
    out.push_str(&texture_of_ids(
        0,
        CLASSIFY_IDS,
        words,
        "visibility_table[0]",
    ));
    out.push_str(
        "fn visible_draw(id: u32) -> u32 {
    var first = 0u;
    var count = arrayLength(&visibility_table) - 1u;
    while (count > 1u) {
        let half = count / 2u;
        if (visibility_table[1u + first + half] < id) {
            first += half;
            count -= half;
        } else {
            count = half;
        }
    }
    return first;
}
",
    );
    out
}

/// The pass that separates draws: it writes the number of each pixel's draw as depth.
pub(crate) fn classify(words: Words) -> String {
    let mut out = drawn(words);
    out.push_str(NUMBER);
    let _ = write!(
        out,
        "@vertex
fn vs_classify(@builtin(vertex_index) vertex: u32) -> @builtin(position) vec4<f32> {{
    return vec4<f32>(f32(vertex & 1u) * 4.0 - 1.0, f32(vertex >> 1u) * 4.0 - 1.0, 0.0, 1.0);
}}
@fragment
fn fs_classify(@builtin(position) at: vec4<f32>) -> @builtin(frag_depth) f32 {{
    let id = visible_id(at).x;
    if (id == 0u) {{
        discard;
    }}
    return visible_number(visible_draw(id));
}}
"
    );
    out
}

const RESOLVE: &str = "fn visible_is_ours(id: vec2<u32>) -> bool {
    return id.x - 1u - visibility.first_id < visibility.instances;
}
fn visible_triangle(id: vec2<u32>) -> u32 {
    return id.y & 0x7fffffffu;
}
fn visible_is_front(id: vec2<u32>) -> bool {
    return (id.y >> 31u) == 0u;
}
fn visible_instance(id: vec2<u32>) -> u32 {
    return visibility.first_instance + id.x - 1u - visibility.first_id;
}
fn visible_cross(a: vec2<f32>, b: vec2<f32>) -> f32 {
    let second = a.y * b.x;
    let lost = fma(-a.y, b.x, second);
    return fma(a.x, b.y, -second) + lost;
}
fn visible_homogeneous(at: vec2<f32>, a: vec4<f32>, b: vec4<f32>, c: vec4<f32>) -> vec3<f32> {
    let inside = (at - visibility.viewport.xy) / visibility.viewport.zw;
    let clip = vec2<f32>(inside.x * 2.0 - 1.0, 1.0 - inside.y * 2.0);
    let p = fma(-clip, vec2<f32>(a.w), a.xy);
    let q = fma(-clip, vec2<f32>(b.w), b.xy);
    let r = fma(-clip, vec2<f32>(c.w), c.xy);
    return vec3<f32>(visible_cross(q, r), visible_cross(r, p), visible_cross(p, q));
}
fn visible_normalised(edges: vec3<f32>) -> vec3<f32> {
    let sum = edges.x + edges.y + edges.z;
    return select(edges / sum, vec3<f32>(1.0 / 3.0), sum == 0.0);
}
fn visible_linear(edges: vec3<f32>, a: vec4<f32>, b: vec4<f32>, c: vec4<f32>) -> vec3<f32> {
    return visible_normalised(edges * vec3<f32>(a.w, b.w, c.w));
}
fn visible_position(at: vec2<f32>, weights: vec3<f32>, a: vec4<f32>, b: vec4<f32>, c: vec4<f32>) \
    -> vec4<f32> {
    let w = dot(weights, vec3<f32>(a.w, b.w, c.w));
    return vec4<f32>(at, dot(weights, vec3<f32>(a.z, b.z, c.z)) / w, 1.0 / w);
}
fn visible_in_quad(at: vec2<f32>, x: u32, y: u32) -> vec2<f32> {
    return vec2<f32>((vec2<u32>(at) & vec2<u32>(0xfffffffeu)) + vec2<u32>(x, y)) + 0.5;
}
fn visible_beside(at: vec2<f32>, x: u32, y: u32) -> vec2<f32> {
    return vec2<f32>(vec2<u32>(at) ^ vec2<u32>(x, y)) + 0.5;
}
fn visible_away(at: vec2<f32>) -> vec2<f32> {
    return 1.0 - 2.0 * vec2<f32>(vec2<u32>(at) & vec2<u32>(1u));
}
";

const EDGES: &str =
    "fn visible_edges(at: vec2<f32>, a: vec4<f32>, b: vec4<f32>, c: vec4<f32>) -> vec3<f32> {
    return visible_homogeneous(at, a, b, c);
}
";

/// The centre of a covered pixel is inside the triangle, up to rounding.
const COVERED_INSIDE: &str = "fn visible_covered(edges: vec3<f32>) -> vec3<f32> {
    let turned = select(edges, -edges, edges.x + edges.y + edges.z < 0.0);
    return max(turned, vec3<f32>());
}
";

/// The centre may be outside of the unsnapped triangle; the rasteriser then extrapolates.
const COVERED_ANYWHERE: &str = "fn visible_covered(edges: vec3<f32>) -> vec3<f32> {
    return edges;
}
";

/// Clipped triangles have other corners, and a triangle far outside of the viewport may be clipped
/// too; those use their given corners. The distance in pixels was measured on an H200: on triangles
/// that reach 65,536 to 131,072 pixels out, its pixels are nearer to the snapped corners'. Beyond
/// that a step of 1/256 is below the last bit of an `f32`. The sign is that of the homogeneous
/// edges.
///
/// Near the midpoint between two grid points, the last bits of a corner decide. An H200 scales,
/// multiplies by the reciprocal of w, and adds, rounding each time, and breaks ties to even. Of up
/// to 1,200 corners within four last bits of a midpoint, in each of the groups drawn, none
/// differed; with other orders of operations 1 to 10 % did. The sum must not be fused: the first
/// addition is of a 0 that no compiler knows.
const EDGES_SNAPPED: &str = "fn visible_snapped(at: vec2<f32>, corner: vec4<f32>) -> vec2<f32> {
    let half = visibility.viewport.zw * vec2<f32>(0.5, -0.5);
    let middle = visibility.viewport.xy + 0.5 * visibility.viewport.zw;
    let scaled = corner.xy * half;
    let place = fma(scaled, vec2<f32>(1.0 / corner.w), min(at, vec2<f32>())) + middle;
    return round(place * 256.0) / 256.0 - at;
}
fn visible_is_whole(corner: vec4<f32>) -> bool {
    return corner.w > 0.0 && corner.z >= 0.0 && corner.z <= corner.w;
}
fn visible_edges(at: vec2<f32>, a: vec4<f32>, b: vec4<f32>, c: vec4<f32>) -> vec3<f32> {
    if (!visible_is_whole(a) || !visible_is_whole(b) || !visible_is_whole(c)) {
        return visible_homogeneous(at, a, b, c);
    }
    let p = visible_snapped(at, a);
    let q = visible_snapped(at, b);
    let r = visible_snapped(at, c);
    let farthest = max(max(abs(p), abs(q)), abs(r));
    if (max(farthest.x, farthest.y) > 131072.0) {
        return visible_homogeneous(at, a, b, c);
    }
    return vec3<f32>(visible_cross(r, q), visible_cross(p, r), visible_cross(q, p)) / \
        vec3<f32>(a.w, b.w, c.w);
}
";
