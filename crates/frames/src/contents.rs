//! Contents of buffers and textures at a command, as far as the CPU can compute them: the start and
//! the writes of the queue. Results of shaders and passes need a replay.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use super::error::Error;
use super::file::{BufferType, Command, ComputeCommand, GroupLayout, Resource};
use super::folder::{Capture, get};
use super::pass::{self, PassDraw};

/// The contents before a command.
#[derive(Debug, Default)]
pub struct Contents {
    /// Content of the buffers that the queue changed.
    buffers: BTreeMap<usize, Vec<u8>>,
    /// Buffers that the GPU wrote.
    computed_buffers: BTreeSet<usize>,
    /// Textures that the GPU wrote, or the queue after the start.
    changed_textures: BTreeSet<usize>,
}

impl Contents {
    /// The contents before a command of a frame, with all frames before it.
    ///
    /// # Errors
    /// The capture is broken, or lacks data.
    pub fn before(capture: &Capture, frame: usize, command: usize) -> Result<Self, Error> {
        let mut contents = Self::default();
        let mut apply = |place: &str, commands: &[Command]| {
            for (index, command) in commands.iter().enumerate() {
                let draws = pass::draws(command, &format!("{place}, command {index}"))?;
                contents.apply(capture, command, &draws)?;
            }
            Ok::<_, Error>(())
        };
        apply("setup", &capture.file.setup)?;
        for earlier in 0..=frame {
            let of = get(&capture.file.frames, earlier, "frame", "the capture")?;
            let most = match earlier == frame {
                true => command.min(of.commands.len()),
                false => of.commands.len(),
            };
            apply(&format!("frame {earlier}"), &of.commands[..most])?;
        }
        Ok(contents)
    }

    /// The textures that a frame writes, before or after a draw.
    ///
    /// Includes textures that `setup` draws to or computes, because it may hold passes of earlier
    /// frames. Leaves out the uploads and copies of `setup`, because they happen once.
    ///
    /// # Errors
    /// A draw comes before its pipeline.
    pub fn written(capture: &Capture) -> Result<BTreeSet<usize>, Error> {
        let mut contents = Self::default();
        let is_pass =
            |c: &&Command| matches!(c, Command::RenderPass { .. } | Command::ComputePass { .. });
        let setup = capture.file.setup.iter().filter(is_pass);
        for command in setup.chain(capture.file.frames.iter().flat_map(|f| &f.commands)) {
            let draws = pass::draws(command, "the capture")?;
            contents.writes_of_gpu(capture, command, &draws);
        }
        Ok(contents.changed_textures)
    }

    /// Applies a command. If it is a render pass, `draws` are its draws.
    pub fn apply(
        &mut self,
        capture: &Capture,
        command: &Command,
        draws: &[PassDraw],
    ) -> Result<(), Error> {
        self.writes_of_gpu(capture, command, draws);
        match command {
            Command::WriteBuffer {
                buffer,
                offset,
                data,
            } => {
                let bytes = capture.data(data)?;
                self.write(capture, *buffer, *offset, &bytes)?;
            }
            Command::ClearBuffer {
                buffer,
                offset,
                size,
            } => {
                let of = get(&capture.file.buffers, *buffer, "buffer", "a clear")?;
                let size = size.unwrap_or(of.size.saturating_sub(*offset));
                let zeros = vec![0; size.min(of.size) as usize];
                self.write(capture, *buffer, *offset, &zeros)?;
            }
            Command::CopyBufferToBuffer {
                source,
                source_offset,
                destination,
                destination_offset,
                size,
            } => {
                if self.computed_buffers.contains(source) {
                    self.computed_buffers.insert(*destination);
                    return Ok(());
                }
                let from = self.buffer(capture, *source)?;
                let bytes = cut(&from, *source_offset, *size);
                self.write(capture, *destination, *destination_offset, bytes)?;
            }
            _ => {}
        }
        Ok(())
    }

    /// Marks the textures that a command writes, and the buffers that its shaders may store to. If
    /// it is a render pass, `draws` are its draws.
    pub fn writes_of_gpu(&mut self, capture: &Capture, command: &Command, draws: &[PassDraw]) {
        match command {
            Command::WriteTexture { destination, .. }
            | Command::CopyBufferToTexture { destination, .. }
            | Command::CopyTextureToTexture { destination, .. }
            | Command::CopyDepth { destination, .. } => {
                self.changed_textures.insert(destination.texture);
            }
            Command::CopyTextureToBuffer { destination, .. } => {
                self.computed_buffers.insert(destination.buffer);
            }
            Command::RenderPass {
                descriptor,
                commands: _,
            } => {
                for attachment in descriptor.color_attachments.iter().flatten() {
                    let resolve = attachment.resolve_target.iter();
                    let views = std::iter::once(&attachment.view).chain(resolve);
                    self.changed_textures.extend(views.map(|v| v.texture));
                }
                let depth = descriptor.depth_stencil_attachment.iter();
                self.changed_textures.extend(depth.map(|d| d.view.texture));
                for group in draws.iter().flat_map(|d| d.groups.values()) {
                    self.stored(capture, group.0);
                }
            }
            Command::ComputePass { commands, .. } => {
                for command in commands {
                    if let ComputeCommand::SetBindGroup {
                        bind_group: Some(group),
                        ..
                    } = command
                    {
                        self.stored(capture, *group);
                    }
                }
            }
            _ => {}
        }
    }

    /// Marks the resources that shaders may store to through a bind group. Without an explicit
    /// layout, every binding counts.
    fn stored(&mut self, capture: &Capture, group: usize) {
        let Some(of) = capture.file.bind_groups.get(group) else {
            return;
        };
        let layout = match &of.layout {
            GroupLayout::Number(n) => capture.file.bind_group_layouts.get(*n),
            _ => None,
        };
        for entry in &of.entries {
            let declared =
                layout.and_then(|l| l.entries.iter().find(|e| e.binding == entry.binding));
            let may_store = declared.is_none_or(|e| {
                e.storage_texture.is_some()
                    || e.buffer
                        .as_ref()
                        .is_some_and(|b| b.ty == BufferType::Storage)
            });
            if !may_store {
                continue;
            }
            match &entry.resource {
                Resource::Buffer(range) => {
                    let usage = capture
                        .file
                        .buffers
                        .get(range.buffer)
                        .map_or(0, |b| b.usage);
                    let usage = wgpu::BufferUsages::from_bits_truncate(usage);
                    if usage.contains(wgpu::BufferUsages::STORAGE) {
                        self.computed_buffers.insert(range.buffer);
                    }
                }
                Resource::Texture(view) => {
                    let usage = capture
                        .file
                        .textures
                        .get(view.texture)
                        .map_or(0, |t| t.usage);
                    let usage = wgpu::TextureUsages::from_bits_truncate(usage);
                    if usage.contains(wgpu::TextureUsages::STORAGE_BINDING) {
                        self.changed_textures.insert(view.texture);
                    }
                }
                Resource::Sampler { .. } => {}
            }
        }
    }

    fn write(
        &mut self,
        capture: &Capture,
        buffer: usize,
        offset: u64,
        bytes: &[u8],
    ) -> Result<(), Error> {
        let mut content = match self.buffers.remove(&buffer) {
            Some(known) => known,
            None => start(capture, buffer)?.to_vec(),
        };
        let first = offset as usize;
        let last = first.saturating_add(bytes.len());
        let Some(to) = content.get_mut(first..last) else {
            return Err(Error::broken(
                format!("buffer {buffer}"),
                format!(
                    "bytes {first} to {last} are written, and it has {}",
                    content.len()
                ),
            ));
        };
        to.copy_from_slice(bytes);
        self.buffers.insert(buffer, content);
        Ok(())
    }

    /// The bytes of a buffer, without the stores of shaders.
    ///
    /// # Errors
    /// The capture lacks the buffer or its data.
    pub fn buffer(&self, capture: &Capture, buffer: usize) -> Result<Arc<[u8]>, Error> {
        match self.buffers.get(&buffer) {
            Some(known) => Ok(known.as_slice().into()),
            None => start(capture, buffer),
        }
    }

    /// Whether a shader or a copy from a texture may have written the buffer.
    pub fn is_computed(&self, buffer: usize) -> bool {
        self.computed_buffers.contains(&buffer)
    }

    /// Whether a texture still has its content from the start.
    pub fn is_as_at_start(&self, texture: usize) -> bool {
        !self.changed_textures.contains(&texture)
    }
}

/// A part of a buffer, clipped to its end. Without a size, the part extends to the end.
pub fn cut(bytes: &[u8], offset: u64, size: Option<u64>) -> &[u8] {
    let first = (offset as usize).min(bytes.len());
    let last = size.map_or(bytes.len(), |s| first.saturating_add(s as usize));
    &bytes[first..last.min(bytes.len())]
}

/// A buffer's content at the start.
fn start(capture: &Capture, buffer: usize) -> Result<Arc<[u8]>, Error> {
    let place = format!("buffer {buffer}");
    let of = get(&capture.file.buffers, buffer, "buffer", &place)?;
    let mut start = capture.file.start.buffers.iter();
    match start.rfind(|b| b.buffer == buffer) {
        None => Ok(vec![0; of.size as usize].into()),
        Some(start) => {
            let bytes = capture.data(&start.data)?;
            whole(&place, &bytes, of.size)?;
            if bytes.len() as u64 == of.size {
                return Ok(bytes);
            }
            let mut bytes = bytes.to_vec();
            bytes.resize(of.size as usize, 0);
            Ok(bytes.into())
        }
    }
}

/// Refuses data that is shorter than the buffer. Up to three bytes may be missing: a recorder
/// copies whole words.
pub fn whole(place: &str, bytes: &[u8], size: u64) -> Result<(), Error> {
    match (bytes.len() as u64) < size & !3 {
        true => Err(Error::broken(
            place,
            format!("its data has {} bytes, and it has {size}", bytes.len()),
        )),
        false => Ok(()),
    }
}
