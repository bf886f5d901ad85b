//! Scenes: meshes, drawn with materials and values, and the cameras on them.
//!
//! A [`Scene`] is plain data on the CPU, with every mesh and every texture decoded. [`bind`] turns
//! one of its draws into the bytes that a GPU pass of a plan needs.

pub mod error;
pub mod globals;
pub mod layout;
mod light;
pub mod material;
pub mod noise;
pub mod range;
pub mod semantic;
mod setup;
pub mod value_path;

pub mod bind;
pub mod codes;
pub mod image;

pub use error::SceneError;
pub use light::Light;
pub use semantic::Semantic;

use std::collections::BTreeMap;
use std::sync::Arc;

use glam::{Mat4, Vec3};
use preshade_plan::plan::Plan;
use preshade_plan::program::Program;
use preshade_plan::state::{CompareFunction, DepthDirection, DepthFormat, MaterialState};

/// All data of a scene, on the CPU.
#[derive(Clone, Debug)]
pub struct Scene {
    /// Name, from the file or the shader.
    pub name: String,
    /// Width and height of the colour target, in pixels.
    pub size: [u32; 2],
    /// Viewport in pixels: x, y, width, height. `None` is the whole target.
    pub viewport: Option<[u32; 4]>,
    /// Depth format of the frame.
    pub depth_format: DepthFormat,
    pub depth_direction: DepthDirection,
    /// Samples a pixel: 1 or 4.
    pub samples: u32,
    /// Background, linear RGBA.
    pub clear_color: [f64; 4],
    /// Initial contents of the attachments.
    pub initial: Initial,
    /// Row order in the scene's targets. Pictures are upright either way.
    pub rows: Rows,
    pub materials: Vec<Material>,
    pub meshes: Vec<Mesh>,
    /// Draws, in the order of the file.
    pub draws: Vec<Draw>,
    /// The first camera is the headline one.
    pub cameras: Vec<Camera>,
    /// Draw orders to measure. The first is the headline one.
    pub orders: Vec<DrawOrder>,
    /// The directional light and the extent of its shadow map.
    pub light: Light,
    /// Full paths of the files that the scene was read from, without the scene file. Empty for a
    /// made-up scene.
    pub files: Vec<std::path::PathBuf>,
    /// Whether preshade made up the whole scene for a bare shader. No contract depends on its
    /// values.
    pub is_made_up: bool,
    /// The size before [`Scene::resized`], in pixels. `None` if it was not resized.
    pub own_size: Option<[u32; 2]>,
    /// For a captured frame, the part of it in this scene: `render pass 2 (4 % of the frame)`.
    pub part: Option<String>,
    /// Notes for users of the files: the glTF values behind bindings, and parts that are not drawn.
    pub notes: Vec<String>,
}

/// Order of the opaque draws of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum DrawOrder {
    /// Nearest first, by the centre of the object, as a good engine draws.
    FrontToBack,
    /// Farthest first: the worst case for overdraw.
    BackToFront,
    /// A fixed pseudo-random order.
    Shuffled,
    /// The order of the file, as one merged mesh would draw.
    AsGiven,
}

#[derive(Clone, Debug)]
pub struct Material {
    /// Name, and prefix of the emitted files.
    pub name: String,
    /// Full path of the first shader file; `None` for a made-up material.
    pub file: Option<std::path::PathBuf>,
    pub program: Program,
    pub vertex: String,
    pub fragment: Option<String>,
    /// Preprocessor definitions for its GLSL, by name.
    pub defines: BTreeMap<String, String>,
    /// Pipeline state, with the scene's depth settings applied.
    pub state: MaterialState,
    /// Values by variable name or `variable.member`. The module `bind` fills the rest by
    /// convention.
    pub values: BTreeMap<String, Value>,
    /// Textures by variable name.
    pub textures: BTreeMap<String, Arc<Image>>,
    /// Samplers by variable name. The default is trilinear and repeating; comparison samplers
    /// compare with LessEqual.
    pub samplers: BTreeMap<String, Sampler>,
    /// Mesh stream by attribute name, where the names differ.
    pub attributes: BTreeMap<String, String>,
    /// Mesh stream by attribute name, from the attribute's use in the shader. A stream with the
    /// attribute's name takes precedence.
    pub attribute_roles: BTreeMap<String, String>,
    /// The renderer's values by path, from their use in the shader. The scene and the name take
    /// precedence.
    pub value_roles: BTreeMap<String, Semantic>,
    /// Name of the scene's material, if this one stands for only some of its draws.
    pub part_of: Option<String>,
}

/// A value for a uniform, a member of one, or a storage buffer.
#[derive(Clone, Debug, PartialEq)]
pub enum Value {
    /// Components or elements, in order.
    Numbers(Vec<f64>),
    /// A semantic without its dollar sign, for example `view_proj`.
    Semantic(String),
}

/// How a texture is sampled.
#[derive(Clone, Copy, Debug, PartialEq, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Sampler {
    /// Magnification, minification and mip filter.
    pub filter: Filter,
    /// Minification filter, if different.
    pub min_filter: Option<Filter>,
    /// Filter between mip levels, if different.
    pub mip_filter: Option<Filter>,
    /// Addressing outside of 0..1.
    pub address: Address,
    /// Addressing along v, if different.
    pub address_v: Option<Address>,
    /// Addressing along w, if different.
    pub address_w: Option<Address>,
    /// Smallest and largest level of detail. `None`: no limits.
    pub lod: Option<[f32; 2]>,
    /// Largest anisotropy, 1 to 16. Above 1 the filter must be linear.
    pub anisotropy: u16,
    /// Comparison function of a comparison sampler.
    pub compare: Option<CompareFunction>,
}

impl Default for Sampler {
    fn default() -> Self {
        Self {
            filter: Filter::Linear,
            min_filter: None,
            mip_filter: None,
            address: Address::Repeat,
            address_v: None,
            address_w: None,
            lod: None,
            anisotropy: 1,
            compare: None,
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
#[allow(missing_docs)]
pub enum Filter {
    Nearest,
    Linear,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
#[allow(missing_docs)]
pub enum Address {
    Repeat,
    MirrorRepeat,
    ClampToEdge,
}

/// Row order of a target.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Rows {
    /// Row 0 is the top row, as in WebGPU.
    #[default]
    FromTop,
    /// Row 0 is the bottom row, as in WebGL.
    FromBottom,
}

/// Contents of the attachments before the first draw. Images come from earlier passes of the host's
/// frame. They have the attachments' size and one sample; multisampled attachments are always
/// cleared.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Initial {
    /// Clear values of colours by location. Further locations use the scene's.
    pub clear_colors: Vec<[f64; 4]>,
    /// Colours by location, in the attachments' formats.
    pub colors: Vec<Option<Arc<Image>>>,
    pub depth: Option<Arc<Image>>,
    pub clear_stencil: u32,
    /// Stencil values, `R8Uint`.
    pub stencil: Option<Arc<Image>>,
}

/// The content of a texture with all its mip levels, in any WebGPU format with a defined texel
/// layout. [`image::Texels`] reads it.
#[derive(Clone, Debug, PartialEq)]
pub struct Image {
    /// Width and height of level 0.
    pub size: [u32; 2],
    /// Layers (6 for each cube), or the depth of level 0 of a volume.
    pub layers: u32,
    /// Flat, or a volume ([`D3`](wgpu::TextureDimension::D3)). The shader decides whether a flat
    /// one is an array or a cube.
    pub dimension: wgpu::TextureDimension,
    /// Texel format. A depth format stores its values as plain numbers.
    pub format: wgpu::TextureFormat,
    /// Bytes of each level in the format's own layout: rows of blocks without padding, and layers
    /// one after the other.
    pub levels: Vec<Vec<u8>>,
}

/// A mesh: named streams of vertex data, and indices.
#[derive(Clone, Debug)]
pub struct Mesh {
    pub name: String,
    pub vertex_count: u32,
    /// Streams by name, for example `position`, `normal`, `tangent`, `uv`, `color`, `joints`,
    /// `weights`, `morph_position_0`.
    pub streams: BTreeMap<String, Stream>,
    /// `None` draws the vertices in order.
    pub indices: Option<Vec<u32>>,
    pub bounds: [Vec3; 2],
}

/// One stream of vertex or instance data.
#[derive(Clone, Debug, PartialEq)]
pub enum Stream {
    /// `components` floats per vertex.
    Float {
        /// 1 to 4, or 16 for a matrix.
        components: u32,
        data: Vec<f32>,
    },
    /// `components` unsigned integers per vertex.
    Uint {
        /// 1 to 4.
        components: u32,
        data: Vec<u32>,
    },
}

#[derive(Clone, Debug)]
pub struct Draw {
    /// Used in messages.
    pub name: String,
    /// Index in [`Scene::meshes`].
    pub mesh: usize,
    /// Index in [`Scene::materials`].
    pub material: usize,
    /// Object to world.
    pub transform: Mat4,
    pub range: DrawRange,
    pub instances: u32,
    /// Per-instance streams by name, for example `instance_transform` (16), `instance_color` (4).
    /// Index 0 is the first instance of the range.
    pub instance_streams: BTreeMap<String, Stream>,
    /// Joint matrices of a skinned mesh, with the inverse bind pose applied. Draws of one mesh
    /// share them.
    pub joints: Arc<[Mat4]>,
    /// Weights of the morph targets.
    pub morph_weights: Vec<f32>,
    /// Values that only this draw has.
    pub values: BTreeMap<String, Value>,
    /// The captured bindings of a draw. If set, nothing is derived from names, and mesh, values and
    /// transform are ignored.
    pub captured: Option<Arc<bind::DrawBindings>>,
}

/// The arguments of `drawIndexed` or `draw`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct DrawRange {
    /// First index, or first vertex of an unindexed mesh.
    pub first: u32,
    /// Number of indices or vertices; `None` draws to the end.
    pub count: Option<u32>,
    /// Added to each index; ignored without indices.
    pub base_vertex: i32,
    /// First value of `instance_index`.
    pub first_instance: u32,
}

/// A camera with one or more frames.
#[derive(Clone, Debug)]
pub struct Camera {
    pub name: String,
    /// One frame for a still, several for a path.
    pub frames: Vec<Frame>,
}

/// One view of the scene at one time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Frame {
    /// World to view.
    pub view: Mat4,
    /// View to clip, reversed if the scene's depth is.
    pub projection: Mat4,
    /// Eye in world space.
    pub eye: Vec3,
    /// In seconds.
    pub time: f32,
}

impl Material {
    /// The plan of the unmodified material.
    pub fn plan(&self) -> Plan {
        Plan::original(
            &self.name,
            self.program.clone(),
            &self.vertex,
            self.fragment.as_deref(),
            &self.state,
        )
    }
}

impl Scene {
    /// The scene at another resolution. The viewport and the initial contents scale too, and
    /// cameras keep their vertical field of view.
    #[must_use]
    pub fn resized(mut self, size: [u32; 2]) -> Self {
        let before = self.aspect();
        if let Some(viewport) = &mut self.viewport {
            for (i, v) in viewport.iter_mut().enumerate() {
                let (from, to) = (u64::from(self.size[i % 2]), u64::from(size[i % 2]));
                *v = (u64::from(*v) * to / from.max(1)) as u32;
            }
        }
        self.own_size.get_or_insert(self.size);
        self.size = size;
        let of = &mut self.initial;
        let planes = [&mut of.depth, &mut of.stencil];
        for image in of.colors.iter_mut().chain(planes).flatten() {
            if let Some(resampled) = image.resampled(size) {
                *image = Arc::new(resampled);
            }
        }
        let scale = before / self.aspect();
        for frame in self.cameras.iter_mut().flat_map(|c| &mut c.frames) {
            frame.projection.x_axis *= scale;
        }
        self
    }

    /// Aspect ratio of the viewport.
    pub fn aspect(&self) -> f32 {
        let [w, h] = self.viewport.map_or(self.size, |[_, _, w, h]| [w, h]);
        w as f32 / h.max(1) as f32
    }

    /// Every frame of every camera.
    pub fn frames(&self) -> impl Iterator<Item = (&Camera, &Frame)> {
        self.cameras
            .iter()
            .flat_map(|c| c.frames.iter().map(move |f| (c, f)))
    }
}
