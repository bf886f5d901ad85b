//! The TOML entries of a scene. `docs/reference/scenes.md` documents them for users.

use std::collections::BTreeMap;
use std::fmt;
use std::path::PathBuf;

use glam::{EulerRot, Mat4, Quat, Vec3};
use preshade_plan::state::{DepthDirection, DepthFormat, MaterialState};
use serde::Deserialize;
use serde::de::IntoDeserializer;
use serde::de::value::{Error as Mismatch, StrDeserializer};
use toml::Spanned;

use super::variables::{Setting, Variable, Variables, get};
use crate::asset::mesh::Gltf;
use crate::camera::Orbit;
use crate::mesh::{
    Arch, Cards, Column, Cuboid, Curtain, Morph, Plane, Skin, Sphere, Stairs, Teapot, Vertices,
    WireSphere,
};
use preshade_draw::scene::image::Recipe;
use preshade_draw::scene::{DrawOrder, Sampler, SceneError, Value};
use shader_text::options::ClipSpace;

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct SceneFile {
    pub name: Option<String>,
    pub size: Option<Spanned<[u32; 2]>>,
    pub viewport: Option<Spanned<[u32; 4]>>,
    pub samples: Option<Spanned<u32>>,
    #[serde(default)]
    pub depth: DepthEntry,
    #[serde(default = "sky")]
    pub clear: [f64; 4],
    pub targets: Option<Spanned<Vec<String>>>,
    #[serde(default)]
    pub light: Light,
    pub orders: Option<Vec<DrawOrder>>,
    /// Values that entries refer to as `"$name"` and that the command line sets.
    #[serde(default)]
    pub variables: BTreeMap<String, Variable>,
    #[serde(default)]
    pub materials: BTreeMap<String, Spanned<MaterialEntry>>,
    #[serde(default)]
    pub meshes: BTreeMap<String, Spanned<MeshEntry>>,
    #[serde(default)]
    pub draws: Vec<Spanned<DrawEntry>>,
    #[serde(default)]
    pub cameras: Vec<Spanned<CameraEntry>>,
}

fn sky() -> [f64; 4] {
    [0.05, 0.07, 0.1, 1.0]
}

#[derive(Debug, Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(super) struct DepthEntry {
    pub format: DepthFormat,
    pub direction: DepthDirection,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(super) struct Light {
    pub direction: Option<Spanned<[f32; 3]>>,
    pub color: Option<[f32; 3]>,
    pub center: Option<[f32; 3]>,
    pub extent: Option<Spanned<[f32; 3]>>,
    pub map: Option<Spanned<u32>>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct MaterialEntry {
    pub shader: Option<Spanned<String>>,
    pub vertex: Option<Spanned<String>>,
    pub fragment: Option<Spanned<String>>,
    /// Folders for GLSL's `#include`.
    #[serde(default)]
    pub include: Vec<PathBuf>,
    pub clip: Option<ClipSpace>,
    #[serde(default)]
    pub entry: Entry,
    #[serde(default)]
    pub defines: BTreeMap<String, Definition>,
    #[serde(default)]
    pub state: MaterialState,
    pub blend: Option<BlendName>,
    #[serde(default)]
    pub values: BTreeMap<String, Spanned<RawValue>>,
    #[serde(default)]
    pub textures: BTreeMap<String, Spanned<Recipe>>,
    #[serde(default)]
    pub samplers: BTreeMap<String, Spanned<Sampler>>,
    #[serde(default)]
    pub attributes: BTreeMap<String, Spanned<String>>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(super) struct Entry {
    pub vertex: Option<String>,
    pub fragment: Option<String>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum BlendName {
    Alpha,
    Add,
}

/// The replacement text of a preprocessor definition.
#[derive(Clone, Debug, Deserialize)]
#[serde(untagged, expecting = "a text, a number, true or false")]
pub(super) enum Definition {
    Integer(i64),
    Float(f64),
    Truth(bool),
    Text(String),
}

impl fmt::Display for Definition {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Integer(number) => write!(f, "{number}"),
            // GLSL needs the decimal point: 1.0, not 1.
            Self::Float(number) => write!(f, "{number:?}"),
            Self::Truth(truth) => write!(f, "{truth}"),
            Self::Text(text) => f.write_str(text),
        }
    }
}

/// A number, lists of numbers to any depth, or `"$semantic"`.
#[derive(Clone, Debug, Deserialize)]
#[serde(untagged, expecting = "a number, an array of numbers, or a \"$name\"")]
pub(super) enum RawValue {
    Integer(i64),
    Float(f64),
    Name(String),
    List(Vec<RawValue>),
}

/// A mesh entry has exactly one of these shapes.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(super) struct MeshEntry {
    #[serde(rename = "box")]
    pub cuboid: Option<Cuboid>,
    pub plane: Option<Plane>,
    pub sphere: Option<Sphere>,
    pub teapot: Option<Teapot>,
    pub stairs: Option<Stairs>,
    pub arch: Option<Arch>,
    pub column: Option<Column>,
    pub curtain: Option<Curtain>,
    pub cards: Option<Cards>,
    pub wire_sphere: Option<WireSphere>,
    pub vertices: Option<Vertices>,
    pub gltf: Option<Spanned<Gltf>>,
    pub merge: Option<Vec<Spanned<MergedMesh>>>,
    pub skin: Option<Skin>,
    pub morph: Option<Morph>,
}

/// A mesh placed in a merged one.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct MergedMesh {
    pub mesh: Spanned<String>,
    #[serde(default)]
    pub translate: [f32; 3],
    #[serde(default)]
    pub rotate: [f32; 3],
    pub scale: Option<Scale>,
    pub field: Option<Spanned<Field>>,
}

/// Copies on a grid, with jitter, rotation and scale from a seed.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Field {
    /// Copies along x, y and z, `spacing` apart.
    pub count: Option<[u32; 3]>,
    pub spacing: Option<[f32; 3]>,
    /// Alternative to `count` and `spacing`: this many copies over `area`, along x and z.
    pub copies: Option<Setting<u32>>,
    pub area: Option<[f32; 2]>,
    /// Jitter of the copies, as a fraction of their spacing.
    #[serde(default)]
    pub jitter: [f32; 3],
    #[serde(default)]
    pub order: Setting<FieldOrder>,
    /// Largest random rotation around y, in degrees.
    #[serde(default)]
    pub turn: f32,
    #[serde(default = "one_to_one")]
    pub scale: [f32; 2],
    #[serde(default)]
    pub seed: u32,
    #[serde(default, rename = "as")]
    pub kind: FieldKind,
}

fn one_to_one() -> [f32; 2] {
    [1.0, 1.0]
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum FieldOrder {
    /// Along x, then y, then z.
    #[default]
    Ascending,
    /// The reverse order.
    Descending,
    /// In random order from the seed.
    Shuffled,
}

/// How the copies of a field are drawn.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum FieldKind {
    /// One instanced draw.
    #[default]
    Instances,
    /// One draw per copy.
    Draws,
}

#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(untagged, expecting = "a number or three numbers")]
pub(super) enum Scale {
    Uniform(f32),
    Axes([f32; 3]),
}

/// A draw of a mesh, or of a glTF file or a part of it.
#[derive(Debug, Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(super) struct DrawEntry {
    pub name: Option<String>,
    pub mesh: Option<Spanned<String>>,
    pub gltf: Option<Spanned<Gltf>>,
    pub material: Option<Spanned<String>>,
    /// Materials by the name of a material of the glTF file; `"*"` for all others.
    pub materials: BTreeMap<String, Spanned<String>>,
    pub translate: [f32; 3],
    /// Degrees around x, then y, then z.
    pub rotate: [f32; 3],
    pub scale: Option<Scale>,
    pub field: Option<Spanned<Field>>,
    pub range: Option<Spanned<RangeEntry>>,
    pub morph_weights: Option<Vec<f32>>,
    pub values: BTreeMap<String, Spanned<RawValue>>,
}

/// The part of a mesh and of a field that is drawn.
#[derive(Clone, Copy, Debug, Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(super) struct RangeEntry {
    pub first: u32,
    pub count: Option<u32>,
    pub base_vertex: i32,
    pub first_instance: u32,
    pub instances: Option<u32>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct CameraEntry {
    pub name: Option<String>,
    pub eye: Option<[f32; 3]>,
    pub target: Option<[f32; 3]>,
    /// Alternative to eye and target.
    pub orbit: Option<Orbit>,
    #[serde(default = "up")]
    pub up: [f32; 3],
    #[serde(default = "fov")]
    pub fov: f32,
    #[serde(default = "near")]
    pub near: f32,
    #[serde(default = "far")]
    pub far: f32,
    #[serde(default)]
    pub time: f32,
    pub path: Option<PathEntry>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct PathEntry {
    pub frames: u32,
    pub keys: Vec<PathKey>,
}

#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct PathKey {
    pub eye: Option<[f32; 3]>,
    pub target: Option<[f32; 3]>,
    /// Alternative to eye and target.
    pub orbit: Option<Orbit>,
    pub fov: Option<f32>,
    pub time: Option<f32>,
}

fn up() -> [f32; 3] {
    [0.0, 1.0, 0.0]
}

fn fov() -> f32 {
    60.0
}

fn near() -> f32 {
    0.1
}

fn far() -> f32 {
    100.0
}

/// Scales, then rotates around x, y and z in degrees, then translates.
pub(super) fn transform(translate: [f32; 3], rotate: [f32; 3], scale: Option<&Scale>) -> Mat4 {
    let scale = match scale {
        None => Vec3::ONE,
        Some(Scale::Uniform(s)) => Vec3::splat(*s),
        Some(Scale::Axes(s)) => Vec3::from(*s),
    };
    let [x, y, z] = rotate.map(f32::to_radians);
    Mat4::from_scale_rotation_translation(
        scale,
        Quat::from_euler(EulerRot::ZYX, z, y, x),
        Vec3::from(translate),
    )
}

pub(super) fn values(raw: &BTreeMap<String, Spanned<RawValue>>) -> BTreeMap<String, Value> {
    fn flatten(raw: &RawValue, out: &mut Vec<f64>) {
        match raw {
            RawValue::Integer(n) => out.push(*n as f64),
            RawValue::Float(n) => out.push(*n),
            RawValue::List(items) => items.iter().for_each(|i| flatten(i, out)),
            RawValue::Name(_) => {}
        }
    }
    raw.iter()
        .map(|(name, raw)| {
            let value = match raw.get_ref() {
                RawValue::Name(n) => Value::Semantic(n.trim_start_matches('$').to_owned()),
                other => {
                    let mut numbers = Vec::new();
                    flatten(other, &mut numbers);
                    Value::Numbers(numbers)
                }
            };
            (name.clone(), value)
        })
        .collect()
}

impl Setting<FieldOrder> {
    pub(super) fn order(&self, variables: &Variables) -> Result<FieldOrder, SceneError> {
        let name = match self {
            Self::Value(value) => return Ok(*value),
            Self::Variable(name) => name,
        };
        let read = |text: &str| {
            let words: StrDeserializer<'_, Mismatch> = text.into_deserializer();
            FieldOrder::deserialize(words).map_err(|_| {
                SceneError::new(format!("`{text}` is no order of copies"))
                    .help("ascending, descending and shuffled are")
            })
        };
        match get(variables, name)? {
            Variable::Name(text) => read(text),
            Variable::Number(number) => read(&number.to_string()),
        }
    }
}
