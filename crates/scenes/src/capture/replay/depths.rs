//! Writes depths by drawing them, because WebGPU allows copies to few depth formats.

use super::Replay;
use crate::capture::Error;
use preshade_draw::render::depths::{self, TexelPosition};
use preshade_draw::scene::Image;
use preshade_frames::file::{Extent, TexelPlace};

/// Whether depths of this format have to be drawn, because WebGPU does not allow a copy.
pub(super) fn is_drawn(format: wgpu::TextureFormat) -> bool {
    format.has_depth_aspect() && format != wgpu::TextureFormat::Depth16Unorm
}

impl Replay<'_> {
    /// Writes a whole level of depths. They are floats in every format, because WebGL may have
    /// computed them in ways that WebGPU lacks.
    pub(super) fn write_depths(
        &mut self,
        texture: &wgpu::Texture,
        destination: &TexelPlace,
        bytes: &[u8],
        place: &str,
    ) -> Result<(), Error> {
        let level = destination.mip_level;
        let size = texture.size().mip_level_size(level, texture.dimension());
        let layers = size.depth_or_array_layers;
        let texels = u64::from(size.width) * u64::from(size.height) * u64::from(layers);
        if bytes.len() as u64 != texels * 4 {
            let why = "WebGPU writes no part of a texture of this format";
            self.leave_out("a write of depths".to_owned(), why.to_owned());
            return Ok(());
        }
        let image = Image {
            size: [size.width, size.height],
            layers,
            dimension: texture.dimension(),
            format: wgpu::TextureFormat::Depth32Float,
            levels: vec![bytes.to_vec()],
        };
        let gpu = self.gpu;
        let drawn = gpu.checked(place, || depths::draw(gpu, &image, texture, level))?;
        drawn.map_err(|why| Error::broken(place, why))
    }

    pub(super) fn copy_depth(
        &mut self,
        source: &TexelPlace,
        destination: &TexelPlace,
        size: Extent,
        place: &str,
    ) -> Result<(), Error> {
        let from = self.texture(source.texture, place)?.clone();
        let to = self.texture(destination.texture, place)?.clone();
        let both = [&from, &to].map(|t| t.format().has_depth_aspect());
        if both != [true, true] || to.sample_count() != 1 {
            let why = "a copy of depths goes from a texture of depths to one of a single sample";
            return Err(Error::broken(place, why));
        }
        let of = |texture, at: &TexelPlace| {
            let [x, y, layer] = at.origin.0;
            TexelPosition {
                texture,
                level: at.mip_level,
                layer,
                at: [x, y],
            }
        };
        let (from, to) = (of(&from, source), of(&to, destination));
        let [width, height, _] = size.0;
        let gpu = self.gpu;
        gpu.checked(place, || {
            self.encode(|e| depths::copy(gpu, e, &from, &to, [width, height]));
        })?;
        Ok(())
    }
}
