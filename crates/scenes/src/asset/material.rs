//! A material of a glTF file: its numbers, textures and render state.

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::sync::Arc;

use gltf::material::AlphaMode;
use gltf::texture::{MagFilter, MinFilter, WrappingMode};

use super::file::{Asset, Read};
use crate::image::{Hold, Reading, decode};
use preshade_draw::scene::{Address, Filter, Image, Sampler, SceneError};
use shader_text::limits::Limits;

/// The role of a texture in a material.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Use {
    BaseColor,
    MetallicRoughness,
    Normal,
    Occlusion,
    Emissive,
}

impl Use {
    /// The property's name in glTF.
    pub fn name(self) -> &'static str {
        match self {
            Self::BaseColor => "baseColorTexture",
            Self::MetallicRoughness => "metallicRoughnessTexture",
            Self::Normal => "normalTexture",
            Self::Occlusion => "occlusionTexture",
            Self::Emissive => "emissiveTexture",
        }
    }

    /// The word for this texture in the built-in material's template.
    pub fn word(self) -> &'static str {
        match self {
            Self::BaseColor => "BASE_COLOR",
            Self::MetallicRoughness => "METALLIC_ROUGHNESS",
            Self::Normal => "NORMAL",
            Self::Occlusion => "OCCLUSION",
            Self::Emissive => "EMISSIVE",
        }
    }

    /// The RGBA texel that has no effect in this role.
    pub fn neutral(self) -> [u8; 4] {
        match self {
            Self::Normal => [128, 128, 255, 255],
            _ => [255; 4],
        }
    }

    fn is_srgb(self) -> bool {
        matches!(self, Self::BaseColor | Self::Emissive)
    }
}

/// A texture of a material.
#[derive(Clone)]
pub(crate) struct Slot {
    pub texture: usize,
    pub sampler: Sampler,
    /// Index of the set of texture coordinates.
    pub uv: u32,
    /// Columns of the matrix that transforms the coordinates (KHR_texture_transform).
    pub transform: Option<[f64; 9]>,
    reading: Reading,
}

/// A material of the file, or glTF's default material.
pub(crate) struct Look {
    /// Index in the file. `None`: the default material.
    pub index: Option<usize>,
    /// The material's name, or one derived from its index.
    pub name: String,
    pub base_color: [f32; 4],
    pub metallic: f32,
    pub roughness: f32,
    /// Multiplied by the strength.
    pub emissive: [f32; 3],
    pub emissive_strength: f32,
    pub normal_scale: f32,
    pub occlusion_strength: f32,
    pub alpha: AlphaMode,
    pub alpha_cutoff: f32,
    pub is_two_sided: bool,
    pub is_unlit: bool,
    pub slots: BTreeMap<Use, Slot>,
}

impl Look {
    pub fn of(material: &gltf::Material<'_>) -> Self {
        let pbr = material.pbr_metallic_roughness();
        let mut slots = BTreeMap::new();
        let mut put = |of: Use, slot: Option<Slot>| slots.extend(slot.map(|slot| (of, slot)));
        let info = |of: Use, info: gltf::texture::Info<'_>| {
            let moved = info.texture_transform();
            let uv = moved.as_ref().and_then(|t| t.tex_coord());
            let moved = moved.map(|t| transform(t.offset(), t.rotation(), t.scale()));
            slot(of, &info.texture(), uv.unwrap_or(info.tex_coord()), moved)
        };
        put(
            Use::BaseColor,
            pbr.base_color_texture().map(|t| info(Use::BaseColor, t)),
        );
        put(
            Use::MetallicRoughness,
            pbr.metallic_roughness_texture()
                .map(|t| info(Use::MetallicRoughness, t)),
        );
        put(
            Use::Emissive,
            material.emissive_texture().map(|t| info(Use::Emissive, t)),
        );
        put(
            Use::Normal,
            material.normal_texture().map(|t| {
                let (uv, moved) = read_transform(t.extension_value("KHR_texture_transform"));
                slot(
                    Use::Normal,
                    &t.texture(),
                    uv.unwrap_or(t.tex_coord()),
                    moved,
                )
            }),
        );
        put(
            Use::Occlusion,
            material.occlusion_texture().map(|t| {
                let (uv, moved) = read_transform(t.extension_value("KHR_texture_transform"));
                slot(
                    Use::Occlusion,
                    &t.texture(),
                    uv.unwrap_or(t.tex_coord()),
                    moved,
                )
            }),
        );
        let strength = material.emissive_strength().unwrap_or(1.0);
        Self {
            index: material.index(),
            name: match (material.name(), material.index()) {
                (Some(name), _) if !name.is_empty() => name.to_owned(),
                (_, Some(index)) => format!("material-{index}"),
                _ => "default".to_owned(),
            },
            base_color: pbr.base_color_factor(),
            metallic: pbr.metallic_factor(),
            roughness: pbr.roughness_factor(),
            emissive: material.emissive_factor().map(|n| n * strength),
            emissive_strength: strength,
            normal_scale: material.normal_texture().map_or(1.0, |t| t.scale()),
            occlusion_strength: material.occlusion_texture().map_or(1.0, |t| t.strength()),
            alpha: material.alpha_mode(),
            alpha_cutoff: material.alpha_cutoff().unwrap_or(0.5),
            is_two_sided: material.double_sided(),
            is_unlit: material.unlit(),
            slots,
        }
    }
}

fn slot(of: Use, texture: &gltf::Texture<'_>, uv: u32, transform: Option<[f64; 9]>) -> Slot {
    let given = texture.sampler();
    let address = |mode| match mode {
        WrappingMode::ClampToEdge => Address::ClampToEdge,
        WrappingMode::MirroredRepeat => Address::MirrorRepeat,
        WrappingMode::Repeat => Address::Repeat,
    };
    let (u, v) = (address(given.wrap_s()), address(given.wrap_t()));
    let (min, mip) = match given.min_filter() {
        None | Some(MinFilter::LinearMipmapLinear) => (Filter::Linear, Some(Filter::Linear)),
        Some(MinFilter::Nearest) => (Filter::Nearest, None),
        Some(MinFilter::Linear) => (Filter::Linear, None),
        Some(MinFilter::NearestMipmapNearest) => (Filter::Nearest, Some(Filter::Nearest)),
        Some(MinFilter::LinearMipmapNearest) => (Filter::Linear, Some(Filter::Nearest)),
        Some(MinFilter::NearestMipmapLinear) => (Filter::Nearest, Some(Filter::Linear)),
    };
    let mag = match given.mag_filter() {
        Some(MagFilter::Nearest) => Filter::Nearest,
        _ => Filter::Linear,
    };
    let other = |filter: Filter| (filter != mag).then_some(filter);
    Slot {
        texture: texture.index(),
        sampler: Sampler {
            filter: mag,
            min_filter: other(min),
            mip_filter: other(mip.unwrap_or(Filter::Nearest)),
            address: u,
            address_v: (v != u).then_some(v),
            ..Sampler::default()
        },
        uv,
        transform,
        reading: Reading {
            srgb: of.is_srgb(),
            mips: mip.is_some(),
        },
    }
}

/// The columns of a KHR_texture_transform matrix. It scales, then rotates, then translates.
fn transform(offset: [f32; 2], rotation: f32, scale: [f32; 2]) -> [f64; 9] {
    let (sin, cos) = f64::from(rotation).sin_cos();
    let [x, y] = scale.map(f64::from);
    let [u, v] = offset.map(f64::from);
    [cos * x, -sin * x, 0.0, sin * y, cos * y, 0.0, u, v, 1.0]
}

/// The set of coordinates and the matrix of a KHR_texture_transform that the crate does not parse.
fn read_transform(value: Option<&serde_json::Value>) -> (Option<u32>, Option<[f64; 9]>) {
    let Some(value) = value else {
        return (None, None);
    };
    let pair = |key: &str, default: f32| {
        let at = |i: usize| value.get(key)?.get(i)?.as_f64();
        [at(0), at(1)].map(|n| n.map_or(default, |n| n as f32))
    };
    let rotation = value.get("rotation").and_then(serde_json::Value::as_f64);
    let uv = value.get("texCoord").and_then(serde_json::Value::as_u64);
    let matrix = transform(
        pair("offset", 0.0),
        rotation.unwrap_or(0.0) as f32,
        pair("scale", 1.0),
    );
    (uv.and_then(|n| u32::try_from(n).ok()), Some(matrix))
}

/// The decoded images of a file, cached per image and way of reading.
pub(crate) struct Pictures<'a> {
    pub asset: &'a Asset,
    pub read: Read<'a>,
    pub limits: &'a Limits,
    pub hold: Hold<'a>,
    decoded: RefCell<BTreeMap<(usize, Reading), Arc<Image>>>,
}

impl<'a> Pictures<'a> {
    pub fn new(asset: &'a Asset, read: Read<'a>, limits: &'a Limits, hold: Hold<'a>) -> Self {
        Self {
            asset,
            read,
            limits,
            hold,
            decoded: RefCell::default(),
        }
    }

    /// The decoded image of a texture.
    ///
    /// # Errors
    /// The image is missing, cannot be read, or is too large.
    pub fn of(&self, slot: &Slot) -> Result<Arc<Image>, SceneError> {
        let asset = self.asset;
        let texture = asset.document.textures().nth(slot.texture);
        let texture = texture.ok_or_else(|| asset.wrong(format!("no texture {}", slot.texture)))?;
        // Prefer the image in a better format, if the texture has one.
        let other = ["KHR_texture_basisu", "EXT_texture_webp"]
            .iter()
            .find_map(|name| {
                let source = texture.extension_value(name)?.get("source")?.as_u64()?;
                usize::try_from(source).ok()
            });
        let index = other.or_else(|| texture.source().map(|image| image.index()));
        let index = index.ok_or_else(|| {
            let what = format!("texture {} has no image that is read", slot.texture);
            asset.wrong(what)
        })?;
        let key = (index, slot.reading);
        if let Some(known) = self.decoded.borrow().get(&key) {
            return Ok(Arc::clone(known));
        }
        let image = asset.document.images().nth(index);
        let image = image.ok_or_else(|| asset.wrong(format!("no image {index}")))?;
        let shown = match image.name().filter(|name| !name.is_empty()) {
            Some(name) => format!("{}: image `{name}`", asset.file),
            None => format!("{}: image {index}", asset.file),
        };
        let decoded = match image.source() {
            gltf::image::Source::View { view, .. } => {
                let bytes = asset
                    .view(&view)
                    .ok_or_else(|| asset.wrong(format!("image {index} leaves its buffer")))?;
                decode(&shown, bytes, slot.reading, self.limits, self.hold)?
            }
            gltf::image::Source::Uri { uri, .. } => {
                let bytes = asset.uri(uri, self.read)?;
                decode(&shown, &bytes, slot.reading, self.limits, self.hold)?
            }
        };
        let decoded = Arc::new(decoded);
        self.decoded.borrow_mut().insert(key, Arc::clone(&decoded));
        Ok(decoded)
    }
}
