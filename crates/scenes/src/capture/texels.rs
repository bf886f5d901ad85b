//! Converts captured textures and samplers to those of a scene.

use super::{Error, material};
use preshade_draw::scene::bind::Data;
use preshade_draw::scene::{Address, Filter, Image, Sampler};
use preshade_frames::file::{self, Texture, View};
use preshade_frames::folder::{Capture, get};

/// The levels and layers of a texture in a view.
#[derive(Clone, Debug)]
pub(super) struct Shown {
    pub levels: std::ops::Range<u32>,
    /// Layers of a 2D texture. A volume has one.
    pub layers: std::ops::Range<u32>,
    /// Texel format of the resulting [`Image`].
    pub format: wgpu::TextureFormat,
    /// The aspect with these texels.
    pub aspect: wgpu::TextureAspect,
}

impl Shown {
    pub(super) fn of(texture: &Texture, view: &View) -> Self {
        let v = &view.view;
        let all = match texture.dimension {
            wgpu::TextureDimension::D2 => texture.size.0[2],
            _ => 1,
        };
        let level = v.base_mip_level.min(texture.mip_level_count);
        let layer = v.base_array_layer.min(all);
        let flat = matches!(
            v.dimension,
            Some(wgpu::TextureViewDimension::D2 | wgpu::TextureViewDimension::D1)
        );
        let layers = v.array_layer_count.unwrap_or(match v.dimension {
            _ if flat => 1,
            Some(wgpu::TextureViewDimension::Cube) => 6,
            _ => all - layer,
        });
        let levels = v.mip_level_count.unwrap_or(texture.mip_level_count - level);
        let own = v.format.unwrap_or(texture.format);
        let depth = own.has_depth_aspect() && v.aspect != Some(wgpu::TextureAspect::StencilOnly);
        Self {
            levels: level..level.saturating_add(levels).min(texture.mip_level_count),
            layers: layer..layer.saturating_add(layers).min(all),
            format: match own {
                wgpu::TextureFormat::Depth16Unorm => own,
                _ if depth => wgpu::TextureFormat::Depth32Float,
                _ if own.has_stencil_aspect() => wgpu::TextureFormat::R8Uint,
                _ => own,
            },
            aspect: match own.is_depth_stencil_format() {
                true if depth => wgpu::TextureAspect::DepthOnly,
                true => wgpu::TextureAspect::StencilOnly,
                false => wgpu::TextureAspect::All,
            },
        }
    }

    /// Width, height and slices of one layer of a level.
    pub(super) fn size(&self, texture: &Texture, level: u32) -> [u32; 3] {
        let [width, height, depth] = texture.size.0;
        let of = |s: u32| (s >> level).max(1);
        match texture.dimension {
            wgpu::TextureDimension::D1 => [of(width), 1, 1],
            wgpu::TextureDimension::D2 => [of(width), of(height), 1],
            wgpu::TextureDimension::D3 => [of(width), of(height), of(depth)],
        }
    }

    /// Bytes of one layer of a level.
    pub(super) fn layer_bytes(&self, texture: &Texture, level: u32) -> usize {
        let [width, height, slices] = self.size(texture, level);
        let (across, down) = self.format.block_dimensions();
        let block = self.format.block_copy_size(None).unwrap_or(4);
        let row = u64::from(width.div_ceil(across)) * u64::from(block);
        (row * u64::from(height.div_ceil(down)) * u64::from(slices)) as usize
    }

    /// Makes an image of these levels.
    pub(super) fn image(&self, texture: &Texture, levels: Vec<Vec<u8>>) -> Image {
        let [width, height, slices] = self.size(texture, self.levels.start);
        Image {
            size: [width, height],
            layers: match texture.dimension {
                wgpu::TextureDimension::D3 => slices,
                _ => self.layers.len() as u32,
            },
            dimension: texture.dimension,
            format: self.format,
            levels,
        }
    }
}

/// Content of a view at the start. Texels that the capture lacks are zero.
pub(super) fn at_start(capture: &Capture, view: &View) -> Result<Image, Error> {
    let place = format!("texture {}", view.texture);
    let texture = get(&capture.file.textures, view.texture, "texture", &place)?;
    let shown = Shown::of(texture, view);
    let mut levels = Vec::new();
    for level in shown.levels.clone() {
        let bytes = shown.layer_bytes(texture, level);
        let mut content = vec![0; bytes * shown.layers.len()];
        let starts = capture.file.start.textures.iter();
        let starts = starts.filter(|s| s.texture == view.texture && s.mip_level == level);
        let is_shown = |aspect| [shown.aspect, wgpu::TextureAspect::All].contains(&aspect);
        for start in starts.filter(|s| s.aspect.is_none_or(is_shown)) {
            let data = capture.data(&start.data)?;
            for (to, layer) in shown.layers.clone().enumerate() {
                let from = match start.layer {
                    Some(own) if own != layer => continue,
                    Some(_) => 0,
                    None => layer as usize * bytes,
                };
                let part = data.get(from..from + bytes).ok_or_else(|| {
                    Error::broken(
                        &place,
                        format!(
                            "level {level} has {} bytes, and a layer of it has {bytes}",
                            data.len()
                        ),
                    )
                })?;
                content[to * bytes..][..bytes].copy_from_slice(part);
            }
        }
        levels.push(content);
    }
    Ok(shown.image(texture, levels))
}

/// Pads data to a multiple of 16 bytes, the size of bound buffers.
pub(super) fn padded(data: Data) -> Data {
    if data.bytes.len().is_multiple_of(16) && !data.bytes.is_empty() {
        return data;
    }
    let mut bytes = data.bytes.to_vec();
    bytes.resize(bytes.len().next_multiple_of(16).max(16), 0);
    Data::new(bytes)
}

/// A view of zeros.
pub(super) fn empty(capture: &Capture, view: &View) -> Result<Image, Error> {
    let place = format!("texture {}", view.texture);
    let texture = get(&capture.file.textures, view.texture, "texture", &place)?;
    let shown = Shown::of(texture, view);
    let level = |level| vec![0; shown.layer_bytes(texture, level) * shown.layers.len()];
    let levels = shown.levels.clone().map(level).collect();
    Ok(shown.image(texture, levels))
}

pub(super) fn sampler(of: &file::Sampler) -> Sampler {
    let address = |mode| match mode {
        wgpu::AddressMode::Repeat => Address::Repeat,
        wgpu::AddressMode::MirrorRepeat => Address::MirrorRepeat,
        _ => Address::ClampToEdge,
    };
    let filter = |mode| match mode {
        wgpu::FilterMode::Nearest => Filter::Nearest,
        wgpu::FilterMode::Linear => Filter::Linear,
    };
    Sampler {
        filter: filter(of.mag_filter),
        min_filter: Some(filter(of.min_filter)),
        mip_filter: Some(match of.mipmap_filter {
            wgpu::MipmapFilterMode::Nearest => Filter::Nearest,
            wgpu::MipmapFilterMode::Linear => Filter::Linear,
        }),
        address: address(of.address_mode_u),
        address_v: Some(address(of.address_mode_v)),
        address_w: Some(address(of.address_mode_w)),
        lod: Some([of.lod_min_clamp, of.lod_max_clamp]),
        anisotropy: of.max_anisotropy.max(1),
        compare: of.compare.and_then(|c| material::same(c).ok()),
    }
}
