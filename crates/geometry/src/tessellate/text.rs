//! The fixed WGSL of a subdivided vertex stage: the place of a new vertex and the attributes of its
//! corners.
//!
//! ```text
//! fn tessellated_place(vertex: u32, instance: u32) -> TessellatedPlace     pulled: which corners, with which weights
//! fn tessellated_L(vertex: u32, instance: u32) -> vec3<f32>                the attribute at location L, out of the host's own vertex buffer
//! fn tessellated_precedes(a: vec4<f32>, b: vec4<f32>) -> bool              an order of an edge's ends that does not depend on the triangle
//! fn tessellated_blend_N(weights: vec3<f32>, swap: bool, a, b, c) -> vecN<f32>
//! ```
//!
//! Attributes are fetched and converted as WebGPU's vertex input does it (WebGPU, section
//! 10.3.8.1): missing components are 0, and 1 for the fourth.

use std::fmt::Write;

use super::{Slots, adaptive};
use crate::fetch::{self, Names};
use preshade_plan::geometry::Formats;
use preshade_plan::plan::AttributeUse;

/// Prefixes of generated functions and variables.
const NAMES: Names = Names {
    function: "tessellated",
    variable: "tessellation",
};

/// The options of the text.
pub(crate) struct Text<'a> {
    /// The author's attributes, in the order of the streams in the constants.
    pub attributes: &'a [AttributeUse],
    /// Widths of the interpolated varyings, 1 to 4, including the position's 4.
    pub widths: &'a [u8],
    pub slots: Slots,
    /// How a vertex finds its place.
    pub place: VertexPlace,
    /// Use of the buffer of new vertices, and the vector widths in it. `None` without a buffer.
    pub points: Option<(Points, &'a [u8])>,
    /// Order of an edge's ends.
    pub order: Order,
}

/// Order of an edge's ends. Points on the edge are computed in this order on both sides.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Order {
    /// By the bits of the clip position, which agree across a seam of vertices.
    ByPosition,
    /// By index. It reads no position; across a seam the two sides may round differently.
    AsRecorded,
}

/// How a new vertex finds its place.
#[derive(Clone, Copy)]
pub enum VertexPlace {
    /// From the pattern and the triangle of this instance.
    Pattern {
        /// Vertices per pattern.
        vertices: u32,
        /// Triangles per instance.
        batch: u32,
        /// Sum of the weights.
        denominator: u32,
    },
    /// From the pattern of the highest level and the lengths of the triangle's edges on the screen.
    Adaptive {
        /// Vertices per pattern.
        vertices: u32,
        /// Triangles per instance.
        batch: u32,
        /// Pixels per segment.
        edge_pixels: u32,
        most: u32,
    },
    /// From its own record.
    Record {
        /// Sum of the weights.
        denominator: u32,
    },
}

/// Workgroup size of the compute pass.
pub(crate) const WORKGROUP: u32 = 64;

/// Access to the buffer of new vertices: `tessellated_store_N(at, value)` in a compute stage,
/// `tessellated_load_N(at)` in the vertex stage.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Points {
    Stored,
    Loaded,
}

/// The functions that access the buffer of new vertices, bound at `first + 2`, in vectors of these
/// widths, and the vertex index of an invocation in it.
pub(crate) fn points(slots: Slots, points: Points, widths: &[u8]) -> String {
    let Slots { group, first } = slots;
    let access = match points {
        Points::Stored => "read_write",
        Points::Loaded => "read",
    };
    let mut out = format!(
        "@group({group}) @binding({}) var<storage, {access}> tessellation_points: array<u32>;\n",
        first + 2
    );
    let _ = match points {
        Points::Stored => write!(
            out,
            "fn tessellated_index(id: vec3<u32>, groups: vec3<u32>) -> u32 {{
    return id.y * groups.x * {WORKGROUP}u + id.x;
}}
fn tessellated_is_one(index: u32) -> bool {{
    return index < tessellation.vertices * tessellation.instances;
}}
fn tessellated_vertex_of(index: u32) -> u32 {{
    return index % tessellation.vertices;
}}
fn tessellated_instance_of(index: u32) -> u32 {{
    return index / tessellation.vertices;
}}
"
        ),
        Points::Loaded => write!(
            out,
            "fn tessellated_index(vertex: u32, instance: u32) -> u32 {{
    return instance * tessellation.vertices + vertex;
}}
"
        ),
    };
    for width in widths {
        let ty = match width {
            1 => "u32".to_owned(),
            n => format!("vec{n}<u32>"),
        };
        let letters = ["x", "y", "z", "w"];
        let component = |i: usize| match width {
            1 => "value".to_owned(),
            _ => format!("value.{}", letters[i]),
        };
        let _ = match points {
            Points::Stored => {
                let stores: String = (0..usize::from(*width))
                    .map(|i| format!("    tessellation_points[at + {i}u] = {};\n", component(i)))
                    .collect();
                write!(
                    out,
                    "fn tessellated_store_{width}_(at: u32, value: {ty}) {{\n{stores}}}\n"
                )
            }
            Points::Loaded => {
                let loads: Vec<String> = (0..*width)
                    .map(|i| format!("tessellation_points[at + {i}u]"))
                    .collect();
                write!(
                    out,
                    "fn tessellated_load_{width}_(at: u32) -> {ty} {{\n    return {ty}({});\n}}\n",
                    loads.join(", ")
                )
            }
        };
    }
    out
}

/// The uniform buffer of a draw's constants, with this many attributes, and the place's constants
/// before them.
pub(crate) fn constants(slots: Slots, attributes: usize, place: Option<VertexPlace>) -> String {
    let Slots { group, first } = slots;
    let viewport = match place {
        Some(VertexPlace::Adaptive { .. }) => "\n    viewport: vec4<u32>,",
        Some(VertexPlace::Pattern { .. } | VertexPlace::Record { .. }) | None => "",
    };
    let streams = match attributes {
        0 => String::new(),
        n => format!("\n    streams: array<vec4<u32>, {n}>,"),
    };
    format!(
        "struct Tessellation {{
    triangles: u32,
    batches: u32,
    first: u32,
    index_bytes: u32,
    base_vertex: u32,
    first_instance: u32,
    vertices: u32,
    instances: u32,{viewport}{streams}
}}
@group({group}) @binding({first}) var<uniform> tessellation: Tessellation;
"
    )
}

impl Text<'_> {
    pub fn wgsl(&self) -> String {
        let mut out = constants(self.slots, self.attributes.len(), Some(self.place));
        self.places(&mut out);
        let first = self.slots.stream(0);
        out.push_str(&fetch::attributes(
            NAMES,
            self.attributes,
            (self.slots.group, first),
            Formats::Any,
        ));
        if self.order == Order::ByPosition {
            out.push_str(PRECEDES);
        }
        for width in self.widths {
            blend(&mut out, *width);
            if let VertexPlace::Adaptive { .. } = self.place {
                pick(&mut out, *width);
            }
        }
        if let Some((access, widths)) = self.points {
            out.push_str(&points(self.slots, access, widths));
        }
        out
    }

    fn places(&self, out: &mut String) {
        let Slots { group, first } = self.slots;
        let _ = writeln!(
            out,
            "@group({group}) @binding({}) var<storage, read> tessellation_pattern: array<u32>;",
            first + 1
        );
        if let VertexPlace::Pattern { denominator, .. } | VertexPlace::Record { denominator } =
            self.place
        {
            let _ = write!(
                out,
                "struct TessellatedPlace {{
    corners: vec3<u32>,
    weights: vec3<f32>,
    provoking: u32,
    instance: u32,
}}
fn tessellated_weights(packed: u32) -> vec3<f32> {{
    return vec3<f32>(vec3<u32>(packed, packed >> 8u, packed >> 16u) & vec3<u32>(255u)) / \
        {denominator}.0;
}}
"
            );
        }
        if let VertexPlace::Pattern { .. } | VertexPlace::Adaptive { .. } = self.place {
            out.push_str(&fetch::corners(NAMES, group, first + 2));
        }
        match self.place {
            VertexPlace::Pattern {
                vertices,
                batch,
                denominator,
            } => {
                let _ = write!(
                    out,
                    "fn tessellated_place(vertex: u32, instance: u32) -> TessellatedPlace {{
    let drawn = (instance % tessellation.batches) * {batch}u + vertex / {vertices}u;
    let triangle = min(drawn, tessellation.triangles - 1u);
    let at_first_corner = {denominator}u;
    let packed = select(at_first_corner, tessellation_pattern[vertex % {vertices}u], drawn < \
        tessellation.triangles);
    let first = tessellated_corner(triangle, 0u);
    let all = vec3<u32>(first, tessellated_corner(triangle, 1u), tessellated_corner(triangle, 2u));
    let order = vec3<u32>(packed >> 24u, packed >> 26u, packed >> 28u) & vec3<u32>(3u);
    return TessellatedPlace(
        vec3<u32>(
            select(select(all.x, all.y, order.x == 1u), all.z, order.x == 2u),
            select(select(all.x, all.y, order.y == 1u), all.z, order.y == 2u),
            select(select(all.x, all.y, order.z == 1u), all.z, order.z == 2u),
        ),
        tessellated_weights(packed),
        first,
        tessellation.first_instance + instance / tessellation.batches,
    );
}}
"
                );
            }
            VertexPlace::Adaptive {
                vertices,
                batch,
                edge_pixels,
                most,
            } => {
                let _ = write!(
                    out,
                    "struct TessellatedPlace {{
    corners: vec3<u32>,
    packed: u32,
    instance: u32,
}}
fn tessellated_place(vertex: u32, instance: u32) -> TessellatedPlace {{
    let drawn = (instance % tessellation.batches) * {batch}u + vertex / {vertices}u;
    let triangle = min(drawn, tessellation.triangles - 1u);
    let beyond_all_rows = 255u;
    return TessellatedPlace(
        vec3<u32>(tessellated_corner(triangle, 0u), tessellated_corner(triangle, 1u), \
            tessellated_corner(triangle, 2u)),
        select(beyond_all_rows, tessellation_pattern[vertex % {vertices}u], drawn < \
            tessellation.triangles),
        tessellation.first_instance + instance / tessellation.batches,
    );
}}
{}",
                    adaptive::text(edge_pixels, most)
                );
            }
            VertexPlace::Record { .. } => {
                let _ = write!(
                    out,
                    "fn tessellated_place(vertex: u32, instance: u32) -> TessellatedPlace {{
    let at = vertex * 4u;
    let corners = vec3<u32>(tessellation_pattern[at], tessellation_pattern[at + 1u], \
        tessellation_pattern[at + 2u]);
    return TessellatedPlace(
        corners + vec3<u32>(tessellation.base_vertex),
        tessellated_weights(tessellation_pattern[at + 3u]),
        corners.x + tessellation.base_vertex,
        tessellation.first_instance + instance,
    );
}}
"
                );
            }
        }
    }
}

/// Compares bits: ends with equal positions are equal, however their vertices are numbered.
const PRECEDES: &str = "fn tessellated_precedes(a: vec4<f32>, b: vec4<f32>) -> bool {
    let p = bitcast<vec4<u32>>(a);
    let q = bitcast<vec4<u32>>(b);
    if (p.x != q.x) {
        return p.x < q.x;
    }
    if (p.y != q.y) {
        return p.y < q.y;
    }
    if (p.z != q.z) {
        return p.z < q.z;
    }
    return p.w < q.w;
}
";

/// Uses differences to the first value, so that three equal values stay exact.
fn blend(out: &mut String, width: u8) {
    let ty = match width {
        1 => "f32".to_owned(),
        n => format!("vec{n}<f32>"),
    };
    let _ = write!(
        out,
        "fn tessellated_blend_{width}_(weights: vec3<f32>, swap: bool, a: {ty}, b: {ty}, c: {ty}) \
         -> {ty} {{
    let first = select(a, b, swap);
    let second = select(b, a, swap);
    return first + (second - first) * weights.y + (c - first) * weights.z;
}}
"
    );
}

/// Selects one of three by number.
fn pick(out: &mut String, width: u8) {
    let ty = match width {
        1 => "f32".to_owned(),
        n => format!("vec{n}<f32>"),
    };
    let _ = write!(
        out,
        "fn tessellated_pick_{width}_(which: u32, a: {ty}, b: {ty}, c: {ty}) -> {ty} {{
    return select(select(a, b, which == 1u), c, which == 2u);
}}
"
    );
}
