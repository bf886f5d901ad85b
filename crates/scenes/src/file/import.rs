//! Turns a part of a glTF file into draws.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use glam::{Mat4, Vec3};
use gltf::mesh::Mode;
use preshade_plan::state::{ColorTarget, MaterialState, Topology};

use super::loader::Loader;
use super::size;
use crate::asset::built_in::{self, Words};
use crate::asset::cameras_and_lights::{self, Lit, MOST_LIGHTS, Seen};
use crate::asset::file::{Asset, Below, Nodes, Read};
use crate::asset::mapping::{self, Mapped};
use crate::asset::material::{Look, Pictures};
use crate::asset::mesh::{Gltf, Placed, Rigged};
use crate::asset::primitive::{self, Missing};
use crate::asset::requirements::{Drawn, Reads, instances, posed, state};
use crate::file::entries::{DrawEntry, transform, values};
use crate::mesh::bounds;
use preshade_draw::scene::{
    Camera, Draw, DrawRange, Light, Material, SceneError, Stream, material, value_path,
};
use shader_text::panics;

/// The parts of a scene that glTF draws extend.
#[derive(Default)]
pub(super) struct Parts {
    pub materials: Vec<Material>,
    pub meshes: Vec<Rigged>,
    pub draws: Vec<Draw>,
    pub notes: Vec<String>,
    cameras: Vec<Seen>,
    /// Direction and colour of the first directional light.
    pub light: Option<(Vec3, Vec3)>,
    /// Whether a draw uses a glTF file's own materials.
    is_asset: bool,
    /// Index of each material created so far.
    made: BTreeMap<MaterialKey, usize>,
    /// Materials of the scene file that replace materials of glTF files.
    templates: BTreeSet<usize>,
    mapped: Vec<(String, Vec<Mapped>)>,
}

/// Everything that distinguishes a material created for glTF.
#[derive(Clone, PartialEq, Eq, PartialOrd, Ord)]
struct MaterialKey {
    file: String,
    look: Option<usize>,
    template: Option<usize>,
    words: Words,
    second: Words,
    topology: &'static str,
    is_mirrored: bool,
}

/// Mesh, primitive, skin, bits of the morph weights, and whether the shader applies joints.
type MeshKey = (usize, usize, Option<usize>, Vec<u32>, bool);

/// State that all primitives of a draw entry share.
struct Whole<'a> {
    entry: &'a DrawEntry,
    asset: &'a Asset,
    nodes: &'a Nodes<'a>,
    pictures: &'a Pictures<'a>,
    place: Mat4,
    lights: Vec<Lit>,
    meshes: BTreeMap<MeshKey, usize>,
}

impl Parts {
    pub(super) fn new(materials: Vec<Material>, meshes: Vec<Rigged>) -> Self {
        Self {
            materials,
            meshes,
            ..Self::default()
        }
    }

    /// Removes templates that no draw uses directly. Copies with a glTF material's values replace
    /// them.
    fn drop_templates(&mut self) {
        let used: BTreeSet<usize> = self.draws.iter().map(|d| d.material).collect();
        let kept: Vec<usize> = (0..self.materials.len())
            .filter(|i| used.contains(i) || !self.templates.contains(i))
            .collect();
        let mut materials = std::mem::take(&mut self.materials).into_iter().enumerate();
        self.materials = materials
            .by_ref()
            .filter(|(i, _)| kept.contains(i))
            .map(|(_, m)| m)
            .collect();
        for draw in &mut self.draws {
            draw.material = kept.binary_search(&draw.material).unwrap_or(0);
        }
    }

    /// A unique material name with only characters that are safe in file names.
    fn name(&self, wanted: &str) -> String {
        let safe = |c: char| match c {
            'a'..='z' | 'A'..='Z' | '0'..='9' | '-' | '_' | '.' => c,
            _ => '_',
        };
        let wanted: String = wanted.chars().map(safe).collect();
        let is_free = |name: &String| self.materials.iter().all(|m| m.name != *name);
        let numbered = (2..).map(|n| format!("{wanted}-{n}"));
        std::iter::once(wanted.clone())
            .chain(numbered)
            .find(is_free)
            .unwrap_or_default()
    }
}

impl Loader<'_> {
    /// Finishes the glTF draws, once all draws are read.
    pub(super) fn end_assets(&self, parts: &mut Parts) {
        if parts.is_asset {
            parts
                .templates
                .extend(parts.materials.iter().position(|m| m.name == "*"));
            parts.drop_templates();
            parts.notes.extend(mapping::told(&parts.mapped));
        }
    }

    /// The cameras of the glTF files, or one that frames the draws. `None` without glTF files.
    pub(super) fn asset_cameras(&self, parts: &Parts, aspect: f32) -> Option<Vec<Camera>> {
        let direction = self.file.depth.direction;
        if !parts.is_asset {
            return None;
        }
        if !parts.cameras.is_empty() {
            let cameras = parts.cameras.iter();
            return Some(cameras.map(|c| c.camera(aspect, direction)).collect());
        }
        let corners = parts.draws.iter().flat_map(|draw| {
            let [low, high] = parts.meshes[draw.mesh].mesh.bounds;
            let instances: Vec<Mat4> = match draw.instance_streams.get("instance_transform") {
                Some(Stream::Float { data, .. }) => {
                    let all = data.as_chunks::<16>().0.iter();
                    all.map(Mat4::from_cols_array).collect()
                }
                _ => vec![Mat4::IDENTITY],
            };
            instances.into_iter().flat_map(move |instance| {
                (0..8).map(move |corner| {
                    let pick = |axis: usize| [low, high][corner >> axis & 1][axis];
                    let corner = Vec3::new(pick(0), pick(1), pick(2));
                    (draw.transform * instance).transform_point3(corner)
                })
            })
        });
        Some(vec![cameras_and_lights::framing(
            bounds(corners),
            aspect,
            direction,
        )])
    }

    /// Adds the draws of a part of a glTF file.
    pub(super) fn asset(
        &self,
        entry: &DrawEntry,
        gltf: &Gltf,
        light: &Light,
        parts: &mut Parts,
    ) -> Result<(), SceneError> {
        // The glTF crate may panic on errors that the checks miss.
        panics::run(|| self.drawn(entry, gltf, light, parts)).unwrap_or_else(|panicked| {
            Err(SceneError::new(format!(
                "`{}`: the crate that reads glTF panicked: {panicked}",
                gltf.file
            )))
        })
    }

    fn drawn(
        &self,
        entry: &DrawEntry,
        gltf: &Gltf,
        light: &Light,
        parts: &mut Parts,
    ) -> Result<(), SceneError> {
        if entry.field.is_some() || entry.range.is_some() {
            let what = "a draw of a glTF file as it is has neither `field` nor `range`";
            return Err(SceneError::new(what).help("read it as a mesh, `[meshes]`, for these"));
        }
        let read: Read<'_> = &|name| self.folder.read(name).map(|(_, bytes)| bytes);
        let limits = &self.access.limits;
        let before = self.held.get();
        let counted: u64 = parts
            .meshes
            .iter()
            .map(|m| u64::from(m.mesh.vertex_count))
            .sum();
        let take = |vertices: u64, held: u64| {
            self.held.set(before);
            let all = counted.saturating_add(vertices);
            limits.check("vertices", all, "the vertices of all meshes")?;
            self.hold(held)
        };
        let asset = Asset::open(&gltf.file, read, &take)?;
        let nodes = asset.nodes()?;
        let below: Vec<&Below<'_>> = nodes.below(gltf.node.as_deref());
        let placed = gltf.placed(&asset.document, &below);
        gltf.check_sizes(&placed, &asset, &take)?;
        let place = transform(entry.translate, entry.rotate, entry.scale.as_ref());
        let mut lights = cameras_and_lights::lights(&below, &nodes, place);
        let first = lights.iter().find(|l| l.is_directional());
        parts.light = parts.light.or(first.map(|l| (-l.direction, l.color)));
        if lights.is_empty() {
            lights.push(Lit::toward(light.direction, light.color));
        }
        if lights.len() > MOST_LIGHTS {
            parts.notes.push(format!(
                "`{}`: the first {MOST_LIGHTS} of its {} lights are used",
                gltf.file,
                lights.len()
            ));
            lights.truncate(MOST_LIGHTS);
        }
        parts
            .cameras
            .extend(cameras_and_lights::cameras(&below, &nodes, place));
        parts.is_asset = true;
        let hold = |bytes| self.hold(bytes);
        let pictures = Pictures::new(&asset, read, limits, &hold);
        let mut whole = Whole {
            entry,
            asset: &asset,
            nodes: &nodes,
            pictures: &pictures,
            place,
            lights,
            meshes: BTreeMap::new(),
        };
        self.check_names(&whole, gltf)?;
        let before = parts.draws.len();
        for one in &placed {
            for primitive in gltf.primitives(&one.0) {
                self.primitive(&mut whole, one, &primitive, parts)?;
            }
        }
        if parts.draws.len() == before {
            return Err(gltf.nothing(&asset.document, &placed));
        }
        let notes = asset.left_out().into_iter();
        parts
            .notes
            .extend(notes.map(|line| format!("`{}`: {line}", gltf.file)));
        Ok(())
    }

    /// Refuses material names that the file lacks, because they are misspellings.
    fn check_names(&self, whole: &Whole<'_>, gltf: &Gltf) -> Result<(), SceneError> {
        let known: Vec<String> = whole
            .asset
            .document
            .materials()
            .map(|m| Look::of(&m).name)
            .chain(["default".to_owned()])
            .collect();
        for (name, to) in &whole.entry.materials {
            if name != "*" && !known.contains(name) {
                let error = SceneError::new(format!("`{}` has no material `{name}`", gltf.file))
                    .suggest(name, known.iter().map(String::as_str));
                return Err(self.source.at(error, to.span()));
            }
        }
        Ok(())
    }

    /// Adds the draws of one primitive.
    fn primitive(
        &self,
        whole: &mut Whole<'_>,
        (mesh, node): &Placed<'_>,
        primitive: &gltf::Primitive<'_>,
        parts: &mut Parts,
    ) -> Result<(), SceneError> {
        let look = Look::of(&primitive.material());
        let template = self.template(whole.entry, &look, parts)?;
        let reads = match template {
            Some(index) => Reads::of(&parts.materials[index]),
            None => Reads::BUILT_IN,
        };
        let skin = node.as_ref().and_then(gltf::Node::skin);
        let joints = match &skin {
            Some(skin) => whole.asset.joints(skin, &whole.nodes.world),
            None => Vec::new(),
        };
        let own = node.as_ref().and_then(|n| n.weights()).or(mesh.weights());
        let weights = whole
            .entry
            .morph_weights
            .as_deref()
            .or(own)
            .unwrap_or(&[])
            .to_vec();
        let key = (
            mesh.index(),
            primitive.index(),
            skin.as_ref().map(gltf::Skin::index),
            weights.iter().map(|w| w.to_bits()).collect(),
            reads.joints,
        );
        let index = match whole.meshes.get(&key) {
            Some(known) => *known,
            None => {
                let mut built = primitive::read(whole.asset, primitive, Missing::Flat)
                    .map_err(|e| whole.asset.wrong(e))?;
                posed(&mut built, reads, &weights, &joints);
                built.name = match mesh.primitives().len() {
                    1 => mesh.name().unwrap_or("mesh").to_owned(),
                    _ => format!("{}.{}", mesh.name().unwrap_or("mesh"), primitive.index()),
                };
                let bytes = size::of_mesh(&built) + size::of_joints(joints.len());
                self.hold(bytes)?;
                parts.meshes.push(Rigged {
                    mesh: built,
                    joints: joints.clone().into(),
                    morph_weights: weights.clone(),
                });
                whole.meshes.insert(key, parts.meshes.len() - 1);
                parts.meshes.len() - 1
            }
        };
        // The node of a skinned mesh does not affect its position (glTF 2.0, section 3.7.3.3).
        let own = match node {
            Some(node) if skin.is_none() => whole.nodes.world[&node.index()],
            _ => Mat4::IDENTITY,
        };
        let placed = whole.place * own;
        let instances = match node {
            Some(node) => instances(whole.asset, node)?,
            None => None,
        };
        let streams = &parts.meshes[index].mesh.streams;
        let mut drawn = Drawn {
            has_second: streams.contains_key("uv1"),
            mode: primitive.mode(),
            has_color: primitive.get(&gltf::Semantic::Colors(0)).is_some(),
            has_normal: primitive.get(&gltf::Semantic::Normals).is_some(),
            is_skinned: skin.is_some() && streams.contains_key("joints"),
            is_instanced: instances.is_some(),
            is_mirrored: placed.determinant() < 0.0,
        };
        let name = node.as_ref().and_then(gltf::Node::name);
        let name = match (&whole.entry.name, name) {
            (Some(given), Some(own)) => format!("{given}/{own}"),
            (Some(given), None) => given.clone(),
            (None, own) => own.or(mesh.name()).unwrap_or("draw").to_owned(),
        };
        let draw = Draw {
            name: match mesh.primitives().len() {
                1 => name,
                _ => format!("{name}.{}", primitive.index()),
            },
            mesh: index,
            // Set for each group of instances below.
            material: 0,
            transform: placed,
            range: DrawRange::default(),
            instances: 1,
            instance_streams: BTreeMap::new(),
            joints: match reads.joints {
                true => Arc::clone(&parts.meshes[index].joints),
                false => [].into(),
            },
            morph_weights: weights,
            values: values(&whole.entry.values),
            captured: None,
        };
        // A mirrored instance reverses the winding, but a pipeline has only one front face.
        let groups = match instances {
            None => vec![None],
            Some(all) => {
                let is_mirrored = |i: &(usize, Mat4)| (placed * i.1).determinant() < 0.0;
                let (mirrored, plain): (Vec<_>, Vec<_>) =
                    all.into_iter().enumerate().partition(is_mirrored);
                let groups = [plain, mirrored].into_iter().filter(|g| !g.is_empty());
                groups.map(Some).collect()
            }
        };
        for instances in groups {
            let mut draw = draw.clone();
            if let Some((_, first)) = instances.as_ref().and_then(|i| i.first()) {
                drawn.is_mirrored = (placed * *first).determinant() < 0.0;
            }
            draw.material = self.material_of(whole, &look, template, drawn, parts)?;
            value_path::check(&parts.materials[draw.material], &draw.values).map_err(|e| {
                let raw = e.subject().and_then(|key| whole.entry.values.get(key));
                match raw.map(toml::Spanned::span) {
                    Some(span) => self.source.at(e, span),
                    None => e,
                }
            })?;
            self.push(draw, instances, reads.instances, parts)?;
        }
        Ok(())
    }

    /// Adds a draw: one with instances, or one per instance if the shader takes none. An instance
    /// is named by its number in the file.
    fn push(
        &self,
        mut draw: Draw,
        instances: Option<Vec<(usize, Mat4)>>,
        takes_them: bool,
        parts: &mut Parts,
    ) -> Result<(), SceneError> {
        let Some(instances) = instances else {
            self.hold_draws(&parts.draws, 1, &draw)?;
            parts.draws.push(draw);
            return Ok(());
        };
        let copies = instances.len() as u64;
        let limits = &self.access.limits;
        limits.check("copies", copies, "the instances of a node")?;
        if takes_them {
            self.hold_draws(&parts.draws, 1, &draw)?;
            self.hold(copies.saturating_mul(64))?;
            draw.instances = instances.len() as u32;
            let stream = Stream::Float {
                components: 16,
                data: instances
                    .iter()
                    .flat_map(|(_, i)| i.to_cols_array())
                    .collect(),
            };
            draw.instance_streams
                .insert("instance_transform".to_owned(), stream);
            parts.draws.push(draw);
            return Ok(());
        }
        self.hold_draws(&parts.draws, copies, &draw)?;
        for (i, instance) in &instances {
            parts.draws.push(Draw {
                name: format!("{}[{i}]", draw.name),
                transform: draw.transform * *instance,
                ..draw.clone()
            });
        }
        Ok(())
    }

    /// The material of the scene file that replaces one of the glTF file.
    fn template(
        &self,
        entry: &DrawEntry,
        look: &Look,
        parts: &mut Parts,
    ) -> Result<Option<usize>, SceneError> {
        let named = entry.materials.get(&look.name);
        let named = named.or_else(|| entry.materials.get("*"));
        let Some(wanted) = named.or(entry.material.as_ref()) else {
            return Ok(None);
        };
        let names = parts.materials.iter().map(|m| m.name.as_str());
        let index = self.find("material", wanted, names.collect())?;
        parts.templates.insert(index);
        Ok(Some(index))
    }

    /// The index of a primitive's material. Creates the material on first use.
    fn material_of(
        &self,
        whole: &Whole<'_>,
        look: &Look,
        template: Option<usize>,
        drawn: Drawn,
        parts: &mut Parts,
    ) -> Result<usize, SceneError> {
        let targets: Vec<String> = match &self.file.targets {
            Some(formats) => formats.get_ref().clone(),
            // All materials of a frame have the same formats.
            None if template.is_none() && self.file.materials.is_empty() => {
                vec!["rgba8unorm-srgb".to_owned()]
            }
            None => vec!["rgba8unorm".to_owned()],
        };
        let is_encoded = targets.first().is_some_and(|f| f.ends_with("-srgb"));
        let (mut words, second) = drawn.words(look);
        if !is_encoded && template.is_none() && !targets.iter().any(|f| f.contains("float")) {
            words.insert("ENCODE");
        }
        let topology = match drawn.mode {
            Mode::Points => Topology::PointList,
            Mode::Lines | Mode::LineLoop | Mode::LineStrip => Topology::LineList,
            _ => Topology::TriangleList,
        };
        let key = MaterialKey {
            file: whole.asset.file.clone(),
            look: look.index,
            template,
            words: match template {
                Some(_) => Words::new(),
                None => words.clone(),
            },
            second: second.clone(),
            topology: match topology {
                Topology::PointList => "points",
                Topology::LineList => "lines",
                _ => "triangles",
            },
            is_mirrored: drawn.is_mirrored,
        };
        if let Some(known) = parts.made.get(&key) {
            return Ok(*known);
        }
        let mut made = match template {
            Some(index) => parts.materials[index].clone(),
            None => {
                let lights = match words.contains("LIT") {
                    true => whole.lights.as_slice(),
                    false => &[],
                };
                let limits = self.access.limits;
                let parsed = built_in::version(&words, &second, lights.len(), limits)?;
                let lights = lights.iter().enumerate();
                Material {
                    name: String::new(),
                    file: None,
                    program: parsed.program,
                    vertex: parsed.vertex,
                    fragment: parsed.fragment,
                    defines: BTreeMap::new(),
                    state: MaterialState {
                        depth_format: self.file.depth.format,
                        depth_direction: self.file.depth.direction,
                        targets: targets
                            .iter()
                            .map(|f| Some(ColorTarget::opaque(f)))
                            .collect(),
                        ..MaterialState::default()
                    },
                    values: lights.flat_map(|(i, light)| light.values(i)).collect(),
                    textures: BTreeMap::new(),
                    samplers: BTreeMap::new(),
                    attributes: BTreeMap::new(),
                    attribute_roles: BTreeMap::new(),
                    value_roles: BTreeMap::new(),
                    part_of: None,
                }
            }
        };
        let of = match template {
            Some(_) if made.name != "*" => made.name.clone(),
            _ => look.name.clone(),
        };
        let shader = made.file.clone();
        made.name = parts.name(&match template {
            Some(_) if of != look.name => format!("{of}-{}", look.name),
            _ => look.name.clone(),
        });
        state(&mut made.state, look, topology, drawn.is_mirrored, &targets);
        made.state.multisample.count = self.file.samples.as_ref().map_or(1, |s| *s.get_ref());
        let mapped = mapping::fill(&mut made, look, whole.pictures)?;
        if template.is_some() {
            let shader = shader.as_deref().and_then(std::path::Path::file_name);
            let shader = shader.map_or(of, |s| s.to_string_lossy().into_owned());
            parts.mapped.push((shader, mapped));
            if look.slots.values().any(|slot| slot.uv > 0) {
                parts.notes.push(format!(
                    "material `{}` has textures at the second set of texture coordinates (`uv1`)",
                    look.name
                ));
            }
        }
        material::check(&made)?;
        parts.materials.push(made);
        let index = parts.materials.len() - 1;
        parts.made.insert(key, index);
        Ok(index)
    }
}
