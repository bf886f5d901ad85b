//! Requirements of a primitive, its material and its node on a draw.

use glam::{Mat4, Quat, Vec3};
use gltf::material::AlphaMode;
use gltf::mesh::Mode;
use naga::Binding;
use preshade_plan::state::{Blend, ColorTarget, CullMode, FrontFace, MaterialState, Topology};

use super::accessors;
use super::built_in::Words;
use super::file::Asset;
use super::material::{Look, Use};
use super::primitive::{self, floats};
use preshade_draw::scene::bind::{is_instance_data, known_stream};
use preshade_draw::scene::globals::globals;
use preshade_draw::scene::{Material, Mesh, SceneError};

/// The kinds of vertex data that a material's vertex stage reads.
#[derive(Clone, Copy)]
pub(crate) struct Reads {
    pub joints: bool,
    pub morphs: bool,
    pub instances: bool,
}

impl Reads {
    pub const BUILT_IN: Self = Self {
        joints: true,
        morphs: false,
        instances: true,
    };

    pub fn of(material: &Material) -> Self {
        let module = material.program.module();
        let entry = material
            .program
            .entry_point(naga::ShaderStage::Vertex, &material.vertex);
        let inputs = entry
            .map(|(_, e)| naga_edit::interface::inputs(module, &e.function))
            .unwrap_or_default();
        let located = inputs
            .iter()
            .filter(|io| matches!(io.binding, Some(Binding::Location { .. })));
        let names: Vec<&str> = located.filter_map(|io| io.name.as_deref()).collect();
        let stream = |name: &str| {
            let said = material.attributes.get(name);
            let said = said.or_else(|| material.attribute_roles.get(name));
            said.map_or(known_stream(name), |s| known_stream(s))
        };
        let reads = |of: &str| names.iter().any(|name| stream(name) == Some(of));
        let buffers = globals(&material.program).filter(|g| g.is_storage);
        Self {
            joints: reads("joints"),
            morphs: reads("morph"),
            instances: names.iter().any(|name| is_instance_data(name))
                || buffers
                    .map(|g| g.name.to_owned())
                    .any(|name| is_instance_data(&name)),
        }
    }
}

/// Properties of a primitive and its node that the material must support.
#[derive(Clone, Copy)]
pub(crate) struct Drawn {
    /// Whether the primitive has a second set of texture coordinates.
    pub has_second: bool,
    pub mode: Mode,
    pub has_color: bool,
    pub has_normal: bool,
    pub is_skinned: bool,
    pub is_instanced: bool,
    pub is_mirrored: bool,
}

impl Drawn {
    /// The words of the built-in material's version, and those of the textures that use the second
    /// set of texture coordinates.
    pub fn words(&self, look: &Look) -> (Words, Words) {
        let mut words = Words::new();
        let mut second = Words::new();
        let is_lit = !look.is_unlit && (primitive::is_triangles(self.mode) || self.has_normal);
        for (of, slot) in &look.slots {
            if !is_lit && *of != Use::BaseColor {
                continue;
            }
            words.insert(match of {
                Use::BaseColor => "BASE_COLOR_TEXTURE",
                Use::MetallicRoughness => "METALLIC_ROUGHNESS_TEXTURE",
                Use::Normal => "NORMAL_TEXTURE",
                Use::Occlusion => "OCCLUSION_TEXTURE",
                Use::Emissive => "EMISSIVE_TEXTURE",
            });
            if slot.uv == 1 && self.has_second {
                second.insert(of.word());
                words.insert("UV1");
            } else {
                words.insert("UV");
            }
            if slot.transform.is_some() {
                words.insert("TRANSFORM");
            }
        }
        for (word, is_in) in [
            ("LIT", is_lit),
            ("COLOR", self.has_color),
            ("SKIN", self.is_skinned),
            ("INSTANCES", self.is_instanced),
            ("TWO_SIDED", look.is_two_sided),
            ("MASK", look.alpha == AlphaMode::Mask),
            ("BLEND", look.alpha == AlphaMode::Blend),
        ] {
            if is_in {
                words.insert(word);
            }
        }
        (words, second)
    }
}

/// Applies the render state of a glTF material.
pub(crate) fn state(
    state: &mut MaterialState,
    look: &Look,
    topology: Topology,
    is_mirrored: bool,
    targets: &[String],
) {
    state.primitive.topology = topology;
    if look.is_two_sided {
        state.primitive.cull = CullMode::None;
    }
    if is_mirrored {
        state.primitive.front_face = match state.primitive.front_face {
            FrontFace::Ccw => FrontFace::Cw,
            FrontFace::Cw => FrontFace::Ccw,
        };
    }
    if look.alpha == AlphaMode::Blend {
        if state.targets.is_empty() {
            state.targets = targets
                .iter()
                .map(|f| Some(ColorTarget::opaque(f)))
                .collect();
        }
        for target in state.targets.iter_mut().flatten() {
            target.blend.get_or_insert(Blend::ALPHA);
        }
        state.depth_write = false;
    }
}

/// Applies the parts of a pose that the shader does not apply itself. The mesh's bounds are always
/// those of the pose.
pub(crate) fn posed(mesh: &mut Mesh, reads: Reads, weights: &[f32], joints: &[Mat4]) {
    let mut moved = mesh.clone();
    primitive::morphed(&mut moved, weights);
    if !reads.morphs {
        *mesh = moved.clone();
    }
    if !joints.is_empty() {
        primitive::skinned(&mut moved, joints);
        if !reads.joints {
            *mesh = moved.clone();
        }
    }
    mesh.bounds = moved.bounds;
}

/// The transforms of a node's instances (EXT_mesh_gpu_instancing). `None` without instances.
pub(crate) fn instances(
    asset: &Asset,
    node: &gltf::Node<'_>,
) -> Result<Option<Vec<Mat4>>, SceneError> {
    use gltf::accessor::{DataType, Dimensions};
    let Some(extension) = node.extension_value("EXT_mesh_gpu_instancing") else {
        return Ok(None);
    };
    let lengths = asset.lengths();
    let read = |name: &str, shape: Dimensions| -> Result<Option<Vec<f32>>, SceneError> {
        let index = extension.get("attributes").and_then(|a| a.get(name));
        let Some(index) = index.and_then(serde_json::Value::as_u64) else {
            return Ok(None);
        };
        let accessor = asset.document.accessors().nth(index as usize);
        let accessor = accessor.ok_or_else(|| asset.wrong(format!("no accessor {index}")))?;
        let types = [DataType::F32, DataType::I8, DataType::I16];
        accessors::check(&accessor, &types, &[shape], &lengths).map_err(|e| asset.wrong(e))?;
        Ok(floats(asset, &accessor))
    };
    let places = read("TRANSLATION", Dimensions::Vec3)?;
    let turns = read("ROTATION", Dimensions::Vec4)?;
    let scales = read("SCALE", Dimensions::Vec3)?;
    let three = |data: &Option<Vec<f32>>| data.as_ref().map_or(0, |d| d.len() / 3);
    let count = three(&places).max(three(&scales));
    let count = count.max(turns.as_ref().map_or(0, |d| d.len() / 4));
    let vec3 = |data: &Option<Vec<f32>>, i: usize, default: Vec3| {
        let chunk = data.as_ref().and_then(|d| d.as_chunks::<3>().0.get(i));
        chunk.map_or(default, |c| Vec3::from(*c))
    };
    let all = (0..count).map(|i| {
        let turn = turns.as_ref().and_then(|d| d.as_chunks::<4>().0.get(i));
        let turn = turn.map_or(Quat::IDENTITY, |q| Quat::from_array(*q).normalize());
        Mat4::from_scale_rotation_translation(
            vec3(&scales, i, Vec3::ONE),
            turn,
            vec3(&places, i, Vec3::ZERO),
        )
    });
    Ok((count > 0).then(|| all.collect()))
}
