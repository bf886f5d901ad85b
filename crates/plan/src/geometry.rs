//! The geometry of a pass: the material's own triangles, subdivided ones, or the whole screen.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::pattern::{self, Pattern};
use crate::state::Topology;

/// The geometry of a pass.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case", tag = "kind")]
pub enum Geometry {
    /// The draw's own primitives.
    #[default]
    AsGiven,
    /// Each triangle divided into smaller ones.
    Subdivided(Subdivision),
    /// The draw's triangles without vertex or index buffers: `draw(3 * triangles, instances, 0,
    /// firstInstance)` with the draw's own `firstInstance`. Vertex `3 * t + c` is corner `c` of
    /// triangle `t`.
    Unindexed,
    /// Three vertices that cover the screen, for each draw: `draw(3, 1)`.
    FullScreen,
    /// An indirect call, `drawIndirect` or `dispatchWorkgroupsIndirect`, with its arguments in a
    /// buffer of the frame at 32 times the draw's number.
    Indirect {
        /// Name of the buffer, which holds `draws`.
        buffer: String,
    },
    /// The draw's instances, in a compute pass.
    Instances,
    /// In a compute pass: the vertices of the draw's vertex buffers, for each instance.
    Vertices,
    /// In a compute pass: the draw itself, `dispatchWorkgroups(1)`.
    Draw,
}

impl Geometry {
    /// Whether the draw's own primitives are drawn.
    pub fn is_as_given(&self) -> bool {
        *self == Self::AsGiven
    }

    /// The subdivision, if there is one.
    pub fn subdivision(&self) -> Option<&Subdivision> {
        match self {
            Self::AsGiven
            | Self::Unindexed
            | Self::FullScreen
            | Self::Indirect { .. }
            | Self::Instances
            | Self::Vertices
            | Self::Draw => None,
            Self::Subdivided(subdivision) => Some(subdivision),
        }
    }
}

/// Where the new vertices are computed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Form {
    /// In the vertex stage, which reads the attributes of a triangle's corners from storage
    /// buffers. It needs no memory, but computes shared vertices once per triangle.
    #[default]
    Pulled,
    /// In a compute pass ahead of the frame, each new vertex once, into a buffer that an indexed
    /// draw reads.
    Shared,
    /// As `shared`, but only for hoisted values, and once when the variant is loaded, if they read
    /// nothing that changes. The vertex stage interpolates the position.
    Static,
}

impl Form {
    /// Whether the whole mesh is subdivided, with vertices on shared edges computed once.
    pub fn is_indexed(self) -> bool {
        match self {
            Self::Pulled => false,
            Self::Shared | Self::Static => true,
        }
    }
}

/// A subdivision and its draw call.
///
/// `pulled`: an index buffer holds `indices` `batch` times, the `i`-th time with `i *
/// vertices.len()` added. For `triangles` in the author's draw and `batches = ceil(triangles /
/// batch)`, the draw is `drawIndexed(batch * indices.len(), batches * instances)`, of a triangle
/// list, without vertex buffers.
///
/// `shared` and `static`: the vertices and triangles of the whole mesh are made once, when it is
/// loaded (`preshade_draw::render::subdivision::subdivide`). The draw is `drawIndexed(3 * triangles,
/// instances)`, of a triangle list, without vertex buffers.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct Subdivision {
    /// How a triangle is divided.
    pub pattern: Pattern,
    /// Segments along each of its edges, 1 to 64.
    pub level: u32,
    /// Where the new vertices are computed.
    pub form: Form,
    /// Topology of the author's draw. For a strip, the host lists the triangles when it loads the
    /// mesh ([`strip_triangles`]) and uses them as 32-bit indices.
    #[serde(default, skip_serializing_if = "is_list")]
    pub given: Topology,
    /// If present, each edge has just enough segments, at most `level`, that none is longer than
    /// this many pixels. If absent, all edges have `level`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub edge_pixels: Option<u32>,
    /// The sum of a vertex's weights.
    pub denominator: u32,
    /// The pattern's vertices, packed. With `edge_pixels`, row and column, 8 bits each. Else three
    /// weights of 8 bits from the lowest, zero weights last, and their three corners, 2 bits each
    /// from bit 24.
    pub vertices: Vec<u32>,
    /// The pattern's triangles, three vertices each.
    pub indices: Vec<u32>,
    /// `pulled`: the author's triangles per instance.
    pub batch: u32,
}

impl Subdivision {
    /// Divides each triangle into a pattern.
    pub fn new(pattern: Pattern, level: u32, form: Form) -> Self {
        let divided = pattern::divide(pattern, level);
        let vertices: Vec<u32> = divided.vertices.iter().map(|v| pack(*v)).collect();
        let batch = (BATCH_VERTICES / vertices.len() as u32).max(1);
        Self {
            pattern,
            level,
            form,
            given: Topology::TriangleList,
            edge_pixels: None,
            denominator: divided.denominator,
            vertices,
            indices: divided.triangles.into_iter().flatten().collect(),
            batch,
        }
    }
}

impl Subdivision {
    /// Divides each edge into segments of about `edge_pixels`, at most `level` of them. It is
    /// always rows of similar triangles, pulled.
    pub fn adaptive(level: u32, edge_pixels: u32) -> Self {
        let (vertices, triangles) = pattern::from_corner(level);
        Self {
            edge_pixels: Some(edge_pixels),
            indices: triangles.into_iter().flatten().collect(),
            batch: (BATCH_VERTICES / vertices.len() as u32).max(1),
            vertices,
            ..Self::new(Pattern::Uniform, level, Form::Pulled)
        }
    }
}

fn is_list(topology: &Topology) -> bool {
    *topology == Topology::TriangleList
}

/// The triangles of a strip, each with its provoking vertex first and the winding of the first one
/// (WebGPU, section 10.3.7); `None` is a restart.
pub fn strip_triangles(indices: impl IntoIterator<Item = Option<u32>>) -> Vec<[u32; 3]> {
    let mut triangles = Vec::new();
    let mut run: Vec<u32> = Vec::new();
    for index in indices {
        let Some(index) = index else {
            run.clear();
            continue;
        };
        run.push(index);
        if let [.., a, b, c] = run[..] {
            triangles.push(match run.len() % 2 {
                1 => [a, b, c],
                _ => [a, c, b],
            });
        }
    }
    triangles
}

/// New vertices per instance to aim at: instances of a few vertices leave most of a wave idle.
const BATCH_VERTICES: u32 = 192;

/// A packed vertex for the vertex stage: its weights and their corners, zero weights last.
pub fn pack(weights: [u32; 3]) -> u32 {
    let mut order = [0, 1, 2];
    order.sort_by_key(|corner| weights[*corner] == 0);
    let packed = |place: usize, corner: usize| {
        weights[corner] << (8 * place) | (corner as u32) << (24 + 2 * place)
    };
    (0..3).fold(0, |all, place| all | packed(place, order[place]))
}

/// The vertex formats that a shader accepts when it fetches attributes itself.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Formats {
    /// Only the format that stores the declared type directly: `float32x3` for `vec3<f32>`. The
    /// shader just loads its words.
    #[default]
    Declared,
    /// Any of WebGPU's. The draw's constants name it, and the shader branches on it for each value.
    Any,
}

/// The format that stores a 32-bit scalar or vector type of WGSL directly.
pub fn declared_format(ty: &str) -> String {
    let scalar = ty.trim_end_matches('>').rsplit('<').next().unwrap_or(ty);
    let base = match scalar {
        "u32" => "uint32",
        "i32" => "sint32",
        _ => "float32",
    };
    match ty.strip_prefix("vec").and_then(|t| t.chars().next()) {
        Some(n) => format!("{base}x{n}"),
        None => base.to_owned(),
    }
}

/// WebGPU's vertex formats in the order of its `GPUVertexFormat`. A subdivision's constants refer
/// to them by index.
pub const FORMATS: [&str; 41] = [
    "uint8",
    "uint8x2",
    "uint8x4",
    "sint8",
    "sint8x2",
    "sint8x4",
    "unorm8",
    "unorm8x2",
    "unorm8x4",
    "snorm8",
    "snorm8x2",
    "snorm8x4",
    "uint16",
    "uint16x2",
    "uint16x4",
    "sint16",
    "sint16x2",
    "sint16x4",
    "unorm16",
    "unorm16x2",
    "unorm16x4",
    "snorm16",
    "snorm16x2",
    "snorm16x4",
    "float16",
    "float16x2",
    "float16x4",
    "float32",
    "float32x2",
    "float32x3",
    "float32x4",
    "uint32",
    "uint32x2",
    "uint32x3",
    "uint32x4",
    "sint32",
    "sint32x2",
    "sint32x3",
    "sint32x4",
    "unorm10-10-10-2",
    "unorm8x4-bgra",
];

/// Layout of an attribute in the host's vertex buffer.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Stream {
    /// In bytes.
    pub offset: u32,
    /// Bytes from one vertex or instance to the next.
    pub stride: u32,
    pub format: String,
    /// Whether it steps by instance.
    pub by_instance: bool,
}

impl Stream {
    /// Its four words in the constants: offset, stride, format index, and word count with bit 8 for
    /// a step by instance. `None` for a format that is not WebGPU's.
    pub fn words(&self) -> Option<[u32; 4]> {
        let code = FORMATS.iter().position(|f| *f == self.format)?;
        let words = match self.format.split_once("32") {
            Some((_, "x2")) => 2,
            Some((_, "x3")) => 3,
            Some((_, "x4")) => 4,
            _ if self.format.ends_with("16x4") => 2,
            _ => 1,
        };
        let step = u32::from(self.by_instance) << 8;
        Some([self.offset, self.stride, code as u32, words | step])
    }
}

/// The constants of one draw: the words of [`crate::plan::GeometryPart::Constants`].
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Constants {
    /// Triangles of one instance of the author's draw.
    pub triangles: u32,
    /// Instances to draw: `ceil(triangles / batch)`.
    pub batches: u32,
    /// First index of the author's draw, or first vertex without indices.
    pub first: u32,
    /// Bytes of an index: 2, 4, or 0 without indices.
    pub index_bytes: u32,
    /// `baseVertex` of the author's draw.
    pub base_vertex: i32,
    /// `firstInstance` of the author's draw.
    pub first_instance: u32,
    /// `shared`: new vertices of one instance.
    pub vertices: u32,
    /// `shared`: instances.
    pub instances: u32,
    /// With [`Subdivision::edge_pixels`], width and height of the target in pixels. The host
    /// updates it when the size changes.
    pub viewport: Option<[u32; 2]>,
    /// The attributes, in the order of the binding's locations.
    pub streams: Vec<Stream>,
}

impl Constants {
    /// The words. `None` for a format that is not WebGPU's.
    pub fn words(&self) -> Option<Vec<u32>> {
        let mut words = vec![
            self.triangles,
            self.batches,
            self.first,
            self.index_bytes,
            self.base_vertex as u32,
            self.first_instance,
            self.vertices,
            self.instances,
        ];
        if let Some([width, height]) = self.viewport {
            words.extend([width, height, 0, 0]);
        }
        for stream in &self.streams {
            words.extend(stream.words()?);
        }
        Some(words)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weightless_corners_come_last() {
        let unpack = |packed: u32| {
            let weights = [0, 8, 16].map(|s| (packed >> s) & 255);
            let corners = [24, 26, 28].map(|s| (packed >> s) & 3);
            (weights, corners)
        };
        assert_eq!(unpack(pack([192, 0, 0])), ([192, 0, 0], [0, 1, 2]));
        assert_eq!(unpack(pack([0, 0, 9])), ([9, 0, 0], [2, 0, 1]));
        assert_eq!(unpack(pack([0, 4, 5])), ([4, 5, 0], [1, 2, 0]));
        assert_eq!(unpack(pack([3, 0, 6])), ([3, 6, 0], [0, 2, 1]));
        assert_eq!(unpack(pack([3, 4, 2])), ([3, 4, 2], [0, 1, 2]));
    }

    #[test]
    fn the_declared_format_has_the_types_numbers() {
        assert_eq!(declared_format("f32"), "float32");
        assert_eq!(declared_format("vec3<f32>"), "float32x3");
        assert_eq!(declared_format("vec4<u32>"), "uint32x4");
        assert_eq!(declared_format("vec2<i32>"), "sint32x2");
    }

    #[test]
    fn a_strip_turns_every_other_triangle_and_starts_anew() {
        let strip = [
            Some(0),
            Some(1),
            Some(2),
            Some(3),
            None,
            Some(4),
            Some(5),
            None,
            Some(6),
            Some(7),
            Some(8),
        ];
        assert_eq!(strip_triangles(strip), [[0, 1, 2], [1, 3, 2], [6, 7, 8]]);
    }

    #[test]
    fn words_to_read_are_those_of_the_format() {
        let words = |format: &str| {
            let stream = Stream {
                offset: 4,
                stride: 32,
                format: format.to_owned(),
                by_instance: true,
            };
            stream.words().map(|w| w[3])
        };
        let expected = [
            ("uint8x4", 1),
            ("snorm16x2", 1),
            ("float16x4", 2),
            ("float32", 1),
            ("float32x3", 3),
            ("uint32x4", 4),
            ("unorm10-10-10-2", 1),
        ];
        for (format, count) in expected {
            assert_eq!(words(format), Some(256 + count), "{format}");
        }
        assert_eq!(words("float64"), None);
    }
}
