//! Finds the reads and writes of commands, and the earlier commands that decide what the frames
//! read.

use std::collections::{BTreeMap, BTreeSet};

use super::data::Store;
use super::recorder::Step;
use crate::file::{
    BufferRange, BufferType, CaptureFile, Command, ComputeCommand, DrawCommand, Extent,
    GroupLayout, Load, RenderPassDescriptor, Resource, TexelPlace, View,
};

/// A part of a resource.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum ResourcePart {
    Bytes {
        buffer: usize,
        first: u64,
        end: u64,
    },
    /// One layer of a mip level. A 3D texture counts as one layer.
    Texels {
        texture: usize,
        level: u32,
        layer: u32,
    },
}

/// The parts of resources that a command reads and writes.
#[derive(Debug, Default)]
pub(super) struct Access {
    pub reads: Vec<ResourcePart>,
    /// Parts of which no earlier content remains.
    pub overwrites: Vec<ResourcePart>,
    /// Parts of which some earlier content may remain.
    pub changes: Vec<ResourcePart>,
}

impl Access {
    pub fn all(&self) -> impl Iterator<Item = ResourcePart> {
        let written = self.overwrites.iter().chain(&self.changes);
        self.reads.iter().chain(written).copied()
    }
}

/// The parts whose content later commands read.
#[derive(Default)]
struct Needed {
    /// Disjoint byte ranges, by buffer.
    bytes: BTreeMap<usize, Vec<[u64; 2]>>,
    texels: BTreeSet<(usize, u32, u32)>,
}

impl Needed {
    fn has(&self, part: ResourcePart) -> bool {
        match part {
            ResourcePart::Bytes { buffer, first, end } => {
                let ranges = self.bytes.get(&buffer).into_iter().flatten();
                ranges.into_iter().any(|[a, b]| *a < end && first < *b)
            }
            ResourcePart::Texels {
                texture,
                level,
                layer,
            } => self.texels.contains(&(texture, level, layer)),
        }
    }

    fn remove(&mut self, part: ResourcePart) {
        match part {
            ResourcePart::Bytes { buffer, first, end } => {
                if let Some(ranges) = self.bytes.get_mut(&buffer) {
                    let pieces = ranges
                        .iter()
                        .flat_map(|[a, b]| [[*a, first.min(*b)], [end.max(*a), *b]]);
                    *ranges = pieces.filter(|[a, b]| a < b).collect();
                }
            }
            ResourcePart::Texels {
                texture,
                level,
                layer,
            } => {
                self.texels.remove(&(texture, level, layer));
            }
        }
    }

    fn add(&mut self, part: ResourcePart) {
        self.remove(part);
        match part {
            ResourcePart::Bytes { buffer, first, end } => {
                self.bytes.entry(buffer).or_default().push([first, end]);
            }
            ResourcePart::Texels {
                texture,
                level,
                layer,
            } => {
                self.texels.insert((texture, level, layer));
            }
        }
    }

    /// Moves from after a command to before it.
    fn before(&mut self, access: &Access) {
        access.overwrites.iter().for_each(|part| self.remove(*part));
        access.reads.iter().for_each(|part| self.add(*part));
    }
}

/// Earlier state that the captured frames read.
pub(super) struct Before {
    /// The steps that decide what the frames read, in order.
    pub kept: Vec<usize>,
    /// Buffers that the frames read and that the app may write, but that no step writes.
    pub unwritten: Vec<usize>,
}

/// Walks backwards over the frames and the steps before them.
pub(super) fn before(
    file: &CaptureFile,
    store: &Store,
    earlier: &[Step],
    frames: &[Step],
) -> Before {
    let mut needed = Needed::default();
    let mut written = BTreeSet::new();
    let mut note = |access: &Access| {
        for part in access.overwrites.iter().chain(&access.changes) {
            if let ResourcePart::Bytes { buffer, .. } = part {
                written.insert(*buffer);
            }
        }
    };
    for command in frames.iter().rev().filter_map(|s| s.command.as_ref()) {
        let access = access(file, store, command);
        note(&access);
        needed.before(&access);
    }
    let mut kept = Vec::new();
    for (index, step) in earlier.iter().enumerate().rev() {
        let Some(command) = &step.command else {
            // A refused command would have written unknown content, so it counts.
            if !step.refused.is_empty() {
                kept.push(index);
            }
            continue;
        };
        let access = access(file, store, command);
        note(&access);
        let mut changed = access.overwrites.iter().chain(&access.changes);
        if changed.any(|part| needed.has(*part)) {
            needed.before(&access);
            kept.push(index);
        }
    }
    kept.reverse();
    let can_be_written = |buffer: &usize| {
        let usage = file.buffers.get(*buffer).map_or(0, |b| b.usage);
        usage & wgpu::BufferUsages::COPY_DST.bits() != 0
    };
    let read = needed.bytes.iter().filter(|(_, ranges)| !ranges.is_empty());
    let unwritten = read.map(|(buffer, _)| *buffer).filter(can_be_written);
    Before {
        kept,
        unwritten: unwritten.filter(|b| !written.contains(b)).collect(),
    }
}

/// The reads and writes of a command.
pub(super) fn access(file: &CaptureFile, store: &Store, command: &Command) -> Access {
    let mut found = AccessSearch {
        file,
        store,
        access: Access::default(),
        groups: BTreeSet::new(),
    };
    found.command(command);
    found.access
}

struct AccessSearch<'f> {
    file: &'f CaptureFile,
    store: &'f Store,
    access: Access,
    /// Bind groups of the pass so far, and whether their offsets are dynamic.
    groups: BTreeSet<(usize, bool)>,
}

impl AccessSearch<'_> {
    fn bytes(&self, buffer: usize, first: u64, size: Option<u64>) -> ResourcePart {
        let whole = self.file.buffers.get(buffer).map_or(0, |b| b.size);
        let end = size.map_or(whole, |s| first.saturating_add(s));
        ResourcePart::Bytes { buffer, first, end }
    }

    fn command(&mut self, command: &Command) {
        match command {
            Command::WriteBuffer {
                buffer,
                offset,
                data,
            } => {
                let size = self.store.size(data);
                let part = self.bytes(*buffer, *offset, Some(size));
                self.access.overwrites.push(part);
            }
            Command::WriteTexture {
                destination, size, ..
            } => self.write_texels(destination, *size),
            Command::CopyBufferToBuffer {
                source,
                source_offset,
                destination,
                destination_offset,
                size,
            } => {
                let part = self.bytes(*source, *source_offset, *size);
                let ResourcePart::Bytes { first, end, .. } = part else {
                    return;
                };
                self.access.reads.push(part);
                let size = end.saturating_sub(first);
                let written = self.bytes(*destination, *destination_offset, Some(size));
                self.access.overwrites.push(written);
            }
            Command::CopyBufferToTexture {
                source,
                destination,
                size,
            } => {
                let part = self.bytes(source.buffer, source.layout.offset, None);
                self.access.reads.push(part);
                self.write_texels(destination, *size);
            }
            Command::CopyTextureToBuffer {
                source,
                destination,
                size,
            } => {
                self.access.reads.extend(self.place(source, *size).0);
                let part = self.bytes(destination.buffer, destination.layout.offset, None);
                self.access.changes.push(part);
            }
            Command::CopyTextureToTexture {
                source,
                destination,
                size,
            }
            | Command::CopyDepth {
                source,
                destination,
                size,
            } => {
                self.access.reads.extend(self.place(source, *size).0);
                self.write_texels(destination, *size);
            }
            Command::ClearBuffer {
                buffer,
                offset,
                size,
            } => {
                let part = self.bytes(*buffer, *offset, *size);
                self.access.overwrites.push(part);
            }
            Command::RenderPass {
                descriptor,
                commands,
            } => {
                self.targets(descriptor);
                commands.iter().for_each(|c| self.draw(c));
            }
            Command::ComputePass { commands, .. } => {
                commands.iter().for_each(|c| self.compute(c));
            }
        }
    }

    /// The layers that a copy reads or writes, and whether it covers them completely.
    fn place(&self, place: &TexelPlace, size: Extent) -> (Vec<ResourcePart>, bool) {
        let Some(texture) = self.file.textures.get(place.texture) else {
            return (Vec::new(), false);
        };
        let level = texture.size.wgpu();
        let level = level.mip_level_size(place.mip_level, texture.dimension);
        let ([x, y, z], [width, height, depth]) = (place.origin.0, size.0);
        let is_volume = texture.dimension == wgpu::TextureDimension::D3;
        let is_whole = [x, y] == [0, 0]
            && width >= level.width
            && height >= level.height
            && place.aspect.unwrap_or_default() == wgpu::TextureAspect::All
            && (!is_volume || (z == 0 && depth >= level.depth_or_array_layers));
        let layers = match is_volume {
            true => 0..1,
            false => z..z.saturating_add(depth).min(texture.size.0[2].max(z)),
        };
        let part = |layer| ResourcePart::Texels {
            texture: place.texture,
            level: place.mip_level,
            layer,
        };
        (layers.map(part).collect(), is_whole)
    }

    fn write_texels(&mut self, place: &TexelPlace, size: Extent) {
        match self.place(place, size) {
            (parts, true) => self.access.overwrites.extend(parts),
            (parts, false) => self.access.changes.extend(parts),
        }
    }

    /// The levels and layers of a view.
    fn view(&self, view: &View) -> Vec<ResourcePart> {
        let Some(texture) = self.file.textures.get(view.texture) else {
            return Vec::new();
        };
        let range = |first: u32, count: Option<u32>, all: u32| {
            let end = count.map_or(all, |c| first.saturating_add(c));
            first..end.min(all)
        };
        let of = &view.view;
        let levels = range(
            of.base_mip_level,
            of.mip_level_count,
            texture.mip_level_count,
        );
        let layers = match texture.dimension {
            wgpu::TextureDimension::D3 => 0..1,
            _ => range(of.base_array_layer, of.array_layer_count, texture.size.0[2]),
        };
        let texture = view.texture;
        let parts = levels.flat_map(|level| {
            layers.clone().map(move |layer| ResourcePart::Texels {
                texture,
                level,
                layer,
            })
        });
        parts.collect()
    }

    fn targets(&mut self, pass: &RenderPassDescriptor) {
        for color in pass.color_attachments.iter().flatten() {
            let parts = self.view(&color.view);
            if let Some(resolve) = &color.resolve_target {
                self.access.overwrites.extend(self.view(resolve));
            }
            match (color.load_op, color.depth_slice) {
                (Load::Clear, None) => self.access.overwrites.extend(parts),
                (Load::Clear, Some(_)) => self.access.changes.extend(parts),
                (Load::Load, _) => self.read_and_change(parts),
            }
        }
        if let Some(depth) = &pass.depth_stencil_attachment {
            let parts = self.view(&depth.view);
            let format = self.file.textures.get(depth.view.texture).map(|t| t.format);
            let has_depth = format.is_some_and(|f| f.has_depth_aspect());
            let has_stencil = format.is_some_and(|f| f.has_stencil_aspect());
            let clear = Some(Load::Clear);
            let depth_cleared = !has_depth || depth.depth_load_op == clear;
            let stencil_cleared = !has_stencil || depth.stencil_load_op == clear;
            match depth_cleared && stencil_cleared {
                true => self.access.overwrites.extend(parts),
                false => self.read_and_change(parts),
            }
        }
    }

    fn read_and_change(&mut self, parts: Vec<ResourcePart>) {
        self.access.reads.extend(&parts);
        self.access.changes.extend(parts);
    }

    fn draw(&mut self, command: &DrawCommand) {
        match command {
            DrawCommand::SetBindGroup {
                bind_group: Some(group),
                dynamic_offsets,
                ..
            } => self.group(*group, !dynamic_offsets.is_empty()),
            DrawCommand::SetVertexBuffer {
                buffer: Some(buffer),
                offset,
                size,
                ..
            }
            | DrawCommand::SetIndexBuffer {
                buffer,
                offset,
                size,
                ..
            } => {
                let part = self.bytes(*buffer, *offset, *size);
                self.access.reads.push(part);
            }
            DrawCommand::DrawIndirect { buffer, offset }
            | DrawCommand::DrawIndexedIndirect { buffer, offset } => {
                let part = self.bytes(*buffer, *offset, Some(20));
                self.access.reads.push(part);
            }
            _ => {}
        }
    }

    fn compute(&mut self, command: &ComputeCommand) {
        match command {
            ComputeCommand::SetBindGroup {
                bind_group: Some(group),
                dynamic_offsets,
                ..
            } => self.group(*group, !dynamic_offsets.is_empty()),
            ComputeCommand::DispatchWorkgroupsIndirect { buffer, offset } => {
                let part = self.bytes(*buffer, *offset, Some(12));
                self.access.reads.push(part);
            }
            _ => {}
        }
    }

    /// Adds the accesses that shaders may make through a bind group. If its layout was derived from
    /// a pipeline, they may store to everything with a storage usage.
    fn group(&mut self, group: usize, is_dynamic: bool) {
        let file = self.file;
        let is_new = self.groups.insert((group, is_dynamic));
        let Some(of) = file.bind_groups.get(group).filter(|_| is_new) else {
            return;
        };
        let layout = match &of.layout {
            GroupLayout::Number(n) => file.bind_group_layouts.get(*n),
            _ => None,
        };
        for entry in &of.entries {
            let declared =
                layout.and_then(|l| l.entries.iter().find(|e| e.binding == entry.binding));
            let may_store = declared.is_none_or(|e| {
                let buffer = e.buffer.as_ref();
                e.storage_texture.is_some() || buffer.is_some_and(|b| b.ty == BufferType::Storage)
            });
            let (parts, can_store) = match &entry.resource {
                Resource::Buffer(BufferRange {
                    buffer,
                    offset,
                    size,
                }) => {
                    let part = match is_dynamic {
                        true => self.bytes(*buffer, 0, None),
                        false => self.bytes(*buffer, *offset, *size),
                    };
                    let usage = file.buffers.get(*buffer).map_or(0, |b| b.usage);
                    let storage = wgpu::BufferUsages::STORAGE.bits();
                    (vec![part], usage & storage != 0)
                }
                Resource::Texture(view) => {
                    let usage = file.textures.get(view.texture).map_or(0, |t| t.usage);
                    let storage = wgpu::TextureUsages::STORAGE_BINDING.bits();
                    (self.view(view), usage & storage != 0)
                }
                Resource::Sampler { .. } => continue,
            };
            match may_store && can_store {
                true => self.read_and_change(parts),
                false => self.access.reads.extend(parts),
            }
        }
    }
}
