//! Executes the original commands of a capture on wgpu.
//!
//! Objects are created on first use. If wgpu or the adapter refuses a pipeline or a bind group, the
//! replay reports it once, leaves out its draws, and executes everything else.

mod clears;
mod clock;
mod compressed;
mod depths;
mod ending;
mod objects;
mod passes;
mod read;
mod webgl;

use std::collections::BTreeMap;
use std::time::Instant;

use serde::{Deserialize, Serialize};

use super::Error;
use clock::Clock;
use objects::Objects;
use preshade_draw::render::{ColorImage, Gpu};
use preshade_frames::contents::Contents;
use preshade_frames::file::{Command, DataName, TexelPlace};
use preshade_frames::folder::{Capture, get};
use webgl::Programs;

/// A part of the capture that the replay left out.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub struct LeftOut {
    /// The object, such as `render pipeline 3`.
    pub what: String,
    pub why: String,
}

/// A capture that is being replayed on a device.
pub(crate) struct Replay<'a> {
    gpu: &'a Gpu,
    capture: &'a Capture,
    objects: Objects,
    programs: Programs,
    /// Buffer contents on the CPU: WebGL's buffers are rebuilt from them for each draw.
    contents: Contents,
    encoder: Option<wgpu::CommandEncoder>,
    left_out: BTreeMap<LeftOut, u64>,
    /// The render pipeline whose draws are skipped.
    hidden: Option<usize>,
    is_set_up: bool,
}

impl std::fmt::Debug for Replay<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Replay").finish_non_exhaustive()
    }
}

/// How far to execute a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Until {
    End,
    /// Up to the command of this index, without it.
    Command(usize),
}

impl<'a> Replay<'a> {
    /// Starts before the first frame.
    pub fn new(gpu: &'a Gpu, capture: &'a Capture) -> Self {
        Self {
            gpu,
            capture,
            objects: Objects::default(),
            programs: Programs::default(),
            contents: Contents::default(),
            encoder: None,
            left_out: BTreeMap::new(),
            hidden: None,
            is_set_up: false,
        }
    }

    /// Skips the draws of this render pipeline from now on. `None`: of none.
    pub(super) fn hide(&mut self, pipeline: Option<usize>) {
        self.hidden = pipeline;
    }

    /// Parts that were left out so far, and how often.
    pub fn left_out(&self) -> &BTreeMap<LeftOut, u64> {
        &self.left_out
    }

    /// Executes one frame, and before the first one the capture's setup. Frames have to be executed
    /// in order.
    ///
    /// # Errors
    /// The capture refers to missing objects, data is missing, or the device is lost.
    pub fn frame(&mut self, frame: usize, until: Until) -> Result<(), Error> {
        let capture = self.capture;
        if !std::mem::replace(&mut self.is_set_up, true) {
            for (index, command) in capture.file.setup.iter().enumerate() {
                self.command(command, &format!("setup, command {index}"))?;
            }
        }
        let of = get(&capture.file.frames, frame, "frame", "the replay")?;
        let most = match until {
            Until::End => of.commands.len(),
            Until::Command(command) => command.min(of.commands.len()),
        };
        for (index, command) in of.commands[..most].iter().enumerate() {
            let place = format!("frame {frame}, command {index}");
            self.command(command, &place)?;
        }
        self.flush()
    }

    /// Executes one frame again. Returns the seconds that each command takes on the GPU, or 0 for
    /// writes.
    ///
    /// Uses the GPU's own clock, or the wall clock on adapters without one. Meanwhile no other job
    /// draws on a shared adapter.
    ///
    /// # Errors
    /// As [`Self::frame`].
    pub(super) fn timed(&mut self, frame: usize) -> Result<Vec<f64>, Error> {
        self.gpu.alone(|| self.timed_alone(frame))?
    }

    fn timed_alone(&mut self, frame: usize) -> Result<Vec<f64>, Error> {
        let capture = self.capture;
        let of = get(&capture.file.frames, frame, "frame", "the replay")?;
        let clock = Clock::new(self.gpu)?;
        let mut times = Vec::new();
        for (index, command) in of.commands.iter().enumerate() {
            let place = format!("frame {frame}, command {index}");
            if matches!(
                command,
                Command::WriteBuffer { .. } | Command::WriteTexture { .. }
            ) {
                self.command(command, &place)?;
                times.push(0.0);
                continue;
            }
            let start = Instant::now();
            if let Some(clock) = &clock {
                self.encode(|e| clock.start(e));
            }
            self.command(command, &place)?;
            if let Some(clock) = &clock {
                self.encode(|e| clock.stop(e));
            }
            self.flush()?;
            times.push(match &clock {
                Some(clock) => clock.seconds(self.gpu)?,
                None => start.elapsed().as_secs_f64(),
            });
        }
        Ok(times)
    }

    fn command(&mut self, command: &Command, place: &str) -> Result<(), Error> {
        if self.capture.file.source.api.is_webgl() {
            // WebGL's buffers are rebuilt for each draw, from the contents on the CPU.
            self.contents.apply(self.capture, command, &[])?;
            if matches!(
                command,
                Command::WriteBuffer { .. } | Command::CopyBufferToBuffer { .. }
            ) {
                return Ok(());
            }
        }
        match command {
            Command::WriteBuffer {
                buffer,
                offset,
                data,
            } => self.write_buffer(*buffer, *offset, data, place),
            Command::WriteTexture {
                destination,
                data,
                layout,
                size,
            } => self.write_texture(destination, data, layout, size, place),
            Command::RenderPass {
                descriptor,
                commands,
            } => self.render_pass(descriptor, commands, place),
            Command::ComputePass { commands, .. } => self.compute_pass(commands, place),
            copy => self.copy(copy, place),
        }
    }

    fn write_buffer(
        &mut self,
        buffer: usize,
        offset: u64,
        data: &DataName,
        place: &str,
    ) -> Result<(), Error> {
        self.flush()?;
        let buffer = self.buffer(buffer, place)?.clone();
        let bytes = self.capture.data(data)?;
        self.gpu.checked(place, || {
            self.gpu.queue.write_buffer(&buffer, offset, &bytes);
        })?;
        Ok(())
    }

    /// A copy between buffers and textures, or a clear.
    fn copy(&mut self, command: &Command, place: &str) -> Result<(), Error> {
        match command {
            Command::CopyBufferToBuffer {
                source,
                source_offset,
                destination,
                destination_offset,
                size,
            } => {
                let from = self.buffer(*source, place)?.clone();
                let to = self.buffer(*destination, place)?.clone();
                let (offset, to_offset) = (*source_offset, *destination_offset);
                let size = size.unwrap_or(from.size().saturating_sub(offset));
                self.encode(|e| e.copy_buffer_to_buffer(&from, offset, &to, to_offset, size));
            }
            Command::CopyBufferToTexture {
                source,
                destination,
                size,
            } => {
                let buffer = self.buffer(source.buffer, place)?.clone();
                let texture = self.texture(destination.texture, place)?.clone();
                let from = wgpu::TexelCopyBufferInfo {
                    buffer: &buffer,
                    layout: source.layout.wgpu(),
                };
                let to = texel_copy(&texture, destination);
                self.encode(|e| e.copy_buffer_to_texture(from, to, size.wgpu()));
            }
            Command::CopyTextureToBuffer {
                source,
                destination,
                size,
            } => {
                let texture = self.texture(source.texture, place)?.clone();
                let buffer = self.buffer(destination.buffer, place)?.clone();
                let to = wgpu::TexelCopyBufferInfo {
                    buffer: &buffer,
                    layout: destination.layout.wgpu(),
                };
                let from = texel_copy(&texture, source);
                self.encode(|e| e.copy_texture_to_buffer(from, to, size.wgpu()));
            }
            Command::CopyTextureToTexture {
                source,
                destination,
                size,
            } => {
                let from = self.texture(source.texture, place)?.clone();
                let to = self.texture(destination.texture, place)?.clone();
                let (from, to) = (texel_copy(&from, source), texel_copy(&to, destination));
                self.encode(|e| e.copy_texture_to_texture(from, to, size.wgpu()));
            }
            Command::CopyDepth {
                source,
                destination,
                size,
            } => self.copy_depth(source, destination, *size, place)?,
            Command::ClearBuffer {
                buffer,
                offset,
                size,
            } => {
                let buffer = self.buffer(*buffer, place)?.clone();
                self.encode(|e| e.clear_buffer(&buffer, *offset, *size));
            }
            Command::WriteBuffer { .. }
            | Command::WriteTexture { .. }
            | Command::RenderPass { .. }
            | Command::ComputePass { .. } => {}
        }
        Ok(())
    }

    fn encode<T>(&mut self, commands: impl FnOnce(&mut wgpu::CommandEncoder) -> T) -> T {
        let new = || self.gpu.device.create_command_encoder(&Default::default());
        commands(self.encoder.get_or_insert_with(new))
    }

    /// Submits the commands encoded so far. Queue writes come after them.
    fn flush(&mut self) -> Result<(), Error> {
        if let Some(encoder) = self.encoder.take() {
            self.gpu.submit("a captured command", encoder)?;
        }
        Ok(())
    }

    fn leave_out(&mut self, what: String, why: String) {
        *self.left_out.entry(LeftOut { what, why }).or_default() += 1;
    }

    /// The picture of an executed frame, top row first.
    ///
    /// # Errors
    /// The frame has no canvas, or the device is lost.
    pub fn picture(&mut self, frame: usize) -> Result<ColorImage, Error> {
        let place = format!("frame {frame}");
        let of = get(&self.capture.file.frames, frame, "frame", &place)?;
        let canvas = of
            .canvas
            .ok_or_else(|| Error::broken(&place, "it has no canvas"))?;
        let texture = self.texture(canvas, &place)?.clone();
        let mut image =
            preshade_draw::render::readback::color(self.gpu, &texture, texture.format())?;
        if self.capture.file.source.api.is_webgl() {
            image.turn_over();
        }
        Ok(image)
    }
}

fn texel_copy<'t>(
    texture: &'t wgpu::Texture,
    place: &TexelPlace,
) -> wgpu::TexelCopyTextureInfo<'t> {
    wgpu::TexelCopyTextureInfo {
        texture,
        mip_level: place.mip_level,
        origin: place.origin.wgpu(),
        aspect: place.aspect.unwrap_or_default(),
    }
}
