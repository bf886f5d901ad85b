//! Turns writes before the first GPU command into contents at the start.

use std::collections::{BTreeMap, BTreeSet};

use super::TraceError;
use super::data::Store;
use super::slice::{self, ResourcePart};
use crate::file::{
    CaptureFile, Command, DataName, Extent, StartBuffer, StartTexture, TexelLayout, TexelPlace,
};

/// Moves writes from `setup` to `start`, unless an earlier command that stays uses the same resource.
///
/// # Errors
/// Data is missing or too short, or a write reaches beyond its resource.
pub(super) fn fold(file: &mut CaptureFile, store: &mut Store) -> Result<(), TraceError> {
    let mut begun = Begun::default();
    let mut setup = Vec::new();
    for command in std::mem::take(&mut file.setup) {
        if !begun.takes(file, store, &command)? {
            let access = slice::access(file, store, &command);
            begun.touched.extend(access.all().map(resource));
            setup.push(command);
        }
    }
    file.setup = setup;
    for (buffer, bytes) in begun.buffers {
        let data = store.add_bytes(bytes);
        file.start.buffers.push(StartBuffer { buffer, data });
    }
    for ((texture, mip_level), bytes) in begun.levels {
        let data = store.add_bytes(bytes);
        file.start.textures.push(StartTexture {
            texture,
            mip_level,
            layer: None,
            aspect: None,
            data,
        });
    }
    Ok(())
}

#[derive(Default)]
struct Begun {
    buffers: BTreeMap<usize, Vec<u8>>,
    /// Content by texture and mip level, with all layers.
    levels: BTreeMap<(usize, u32), Vec<u8>>,
    touched: BTreeSet<Touched>,
}

#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Touched {
    Buffer(usize),
    Texture(usize),
}

fn resource(part: ResourcePart) -> Touched {
    match part {
        ResourcePart::Bytes { buffer, .. } => Touched::Buffer(buffer),
        ResourcePart::Texels { texture, .. } => Touched::Texture(texture),
    }
}

impl Begun {
    /// Adds a write to the start. False if the command has to stay in `setup`.
    fn takes(
        &mut self,
        file: &CaptureFile,
        store: &Store,
        command: &Command,
    ) -> Result<bool, TraceError> {
        match command {
            Command::WriteBuffer {
                buffer,
                offset,
                data,
            } if !self.touched.contains(&Touched::Buffer(*buffer)) => {
                let size = file.buffers.get(*buffer).map_or(0, |b| b.size) as usize;
                let content = self.buffers.entry(*buffer).or_insert_with(|| vec![0; size]);
                let bytes = store.bytes(data)?;
                let first = *offset as usize;
                let to = content.get_mut(first..first.saturating_add(bytes.len()));
                to.ok_or_else(|| beyond("buffer", *buffer))?
                    .copy_from_slice(&bytes);
                Ok(true)
            }
            Command::WriteTexture {
                destination,
                data,
                layout,
                size,
            } if !self
                .touched
                .contains(&Touched::Texture(destination.texture)) =>
            {
                self.texels(file, store, destination, (data, layout, *size))
            }
            _ => Ok(false),
        }
    }

    fn texels(
        &mut self,
        file: &CaptureFile,
        store: &Store,
        to: &TexelPlace,
        (data, layout, size): (&DataName, &TexelLayout, Extent),
    ) -> Result<bool, TraceError> {
        let beyond = || beyond("texture", to.texture);
        let texture = file.textures.get(to.texture).ok_or_else(beyond)?;
        let format = texture.format;
        let Some(block) = format.block_copy_size(None) else {
            return Ok(false);
        };
        if format.is_depth_stencil_format() || texture.sample_count != 1 {
            return Ok(false);
        }
        let level = texture.size.wgpu();
        let level = level.mip_level_size(to.mip_level, texture.dimension);
        let level = level.physical_size(format);
        let (across, down) = format.block_dimensions();
        let [block, across, down] = [block, across, down].map(|n| n as usize);
        // Counted in blocks from here on.
        let [x, y, z] = to.origin.0.map(|n| n as usize);
        let (x, y) = (x / across, y / down);
        let [width, height, layers] = size.0.map(|n| n as usize);
        let (width, height) = (width.div_ceil(across), height.div_ceil(down));
        let row = level.width as usize / across;
        let rows = level.height as usize / down;
        let all = level.depth_or_array_layers as usize;
        if x + width > row || y + height > rows || z + layers > all {
            return Err(beyond());
        }
        let content = self.levels.entry((to.texture, to.mip_level));
        let content = content.or_insert_with(|| vec![0; row * rows * all * block]);
        let bytes = store.bytes(data)?;
        let pitch = layout.bytes_per_row.map_or(width * block, |b| b as usize);
        let image = layout.rows_per_image.map_or(height, |r| r as usize);
        for (layer, line) in (0..layers).flat_map(|l| (0..height).map(move |h| (l, h))) {
            let from = layout.offset as usize + (layer * image + line) * pitch;
            let from = bytes.get(from..from + width * block).ok_or_else(beyond)?;
            let at = (((z + layer) * rows + y + line) * row + x) * block;
            content[at..at + width * block].copy_from_slice(from);
        }
        Ok(true)
    }
}

fn beyond(what: &str, number: usize) -> TraceError {
    TraceError::Broken(format!(
        "a write to {what} {number} of the trace reaches beyond its data or its size"
    ))
}
