//! Writes a frame folder with only the objects that its frames refer to.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use serde_json::Value;

use super::TraceError;
use super::data::{self, Store};
use crate::file::{
    CaptureFile, CapturedFrame, Command, ComputeCommand, DataName, DrawCommand, GroupLayout,
    LayoutChoice, RenderPassDescriptor, Resource, Unknown,
};
use crate::writer;
use shader_text::limits::Limits;

/// An object list of `frame.json`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum List {
    Buffers,
    Textures,
    Samplers,
    Shaders,
    GroupLayouts,
    PipelineLayouts,
    Groups,
    RenderPipelines,
    ComputePipelines,
}

/// New numbers, in the order in which commands first refer to objects.
#[derive(Default)]
struct Numbers {
    new: BTreeMap<(List, usize), usize>,
    order: BTreeMap<List, Vec<usize>>,
}

impl Numbers {
    fn set(&mut self, list: List, number: &mut usize) {
        let order = self.order.entry(list).or_default();
        *number = *self.new.entry((list, *number)).or_insert_with(|| {
            order.push(*number);
            order.len() - 1
        });
    }

    /// The entries of a list that are referred to, in their new order. Renumbers their own
    /// references too.
    fn entries<T: Clone>(
        &mut self,
        list: List,
        all: &[T],
        mut renumber: impl FnMut(&mut Self, &mut T),
    ) -> Vec<T> {
        let mut made = Vec::new();
        while let Some(old) = self.order.get(&list).and_then(|o| o.get(made.len())) {
            let Some(mut entry) = all.get(*old).cloned() else {
                break;
            };
            renumber(self, &mut entry);
            made.push(entry);
        }
        made
    }

    fn command(&mut self, command: &mut Command) {
        match command {
            Command::WriteBuffer { buffer, .. } | Command::ClearBuffer { buffer, .. } => {
                self.set(List::Buffers, buffer);
            }
            Command::WriteTexture { destination, .. } => {
                self.set(List::Textures, &mut destination.texture);
            }
            Command::CopyBufferToBuffer {
                source,
                destination,
                ..
            } => {
                self.set(List::Buffers, source);
                self.set(List::Buffers, destination);
            }
            Command::CopyBufferToTexture {
                source,
                destination,
                ..
            } => {
                self.set(List::Buffers, &mut source.buffer);
                self.set(List::Textures, &mut destination.texture);
            }
            Command::CopyTextureToBuffer {
                source,
                destination,
                ..
            } => {
                self.set(List::Textures, &mut source.texture);
                self.set(List::Buffers, &mut destination.buffer);
            }
            Command::CopyTextureToTexture {
                source,
                destination,
                ..
            }
            | Command::CopyDepth {
                source,
                destination,
                ..
            } => {
                self.set(List::Textures, &mut source.texture);
                self.set(List::Textures, &mut destination.texture);
            }
            Command::RenderPass {
                descriptor,
                commands,
            } => {
                self.targets(descriptor);
                commands.iter_mut().for_each(|c| self.draw(c));
            }
            Command::ComputePass { commands, .. } => {
                commands.iter_mut().for_each(|c| self.compute(c));
            }
        }
    }

    fn targets(&mut self, pass: &mut RenderPassDescriptor) {
        for color in pass.color_attachments.iter_mut().flatten() {
            let views = std::iter::once(&mut color.view).chain(&mut color.resolve_target);
            views.for_each(|view| self.set(List::Textures, &mut view.texture));
        }
        let depth = pass.depth_stencil_attachment.iter_mut();
        depth.for_each(|d| self.set(List::Textures, &mut d.view.texture));
    }

    fn draw(&mut self, command: &mut DrawCommand) {
        match command {
            DrawCommand::SetPipeline { pipeline } => self.set(List::RenderPipelines, pipeline),
            DrawCommand::SetBindGroup {
                bind_group: Some(group),
                ..
            } => self.set(List::Groups, group),
            DrawCommand::SetVertexBuffer {
                buffer: Some(buffer),
                ..
            }
            | DrawCommand::SetIndexBuffer { buffer, .. }
            | DrawCommand::DrawIndirect { buffer, .. }
            | DrawCommand::DrawIndexedIndirect { buffer, .. } => self.set(List::Buffers, buffer),
            _ => {}
        }
    }

    fn compute(&mut self, command: &mut ComputeCommand) {
        match command {
            ComputeCommand::SetPipeline { pipeline } => self.set(List::ComputePipelines, pipeline),
            ComputeCommand::SetBindGroup {
                bind_group: Some(group),
                ..
            } => self.set(List::Groups, group),
            ComputeCommand::DispatchWorkgroupsIndirect { buffer, .. } => {
                self.set(List::Buffers, buffer);
            }
            _ => {}
        }
    }
}

/// A file with the given commands and only the objects that they refer to.
pub(super) fn compact(
    all: &CaptureFile,
    mut setup: Vec<Command>,
    mut frames: Vec<CapturedFrame>,
    mut unknown: Vec<Unknown>,
) -> CaptureFile {
    let mut n = Numbers::default();
    setup.iter_mut().for_each(|c| n.command(c));
    for frame in &mut frames {
        frame.commands.iter_mut().for_each(|c| n.command(c));
        let canvas = frame.canvas.iter_mut();
        canvas.for_each(|canvas| n.set(List::Textures, canvas));
    }
    let buffers = unknown.iter_mut().flat_map(|u| &mut u.buffer);
    buffers.for_each(|buffer| n.set(List::Buffers, buffer));
    // Lists come before the lists that their entries refer to.
    let bind_groups = n.entries(List::Groups, &all.bind_groups, |n, group| {
        match &mut group.layout {
            GroupLayout::Number(layout) => n.set(List::GroupLayouts, layout),
            GroupLayout::Render { pipeline, .. } => n.set(List::RenderPipelines, pipeline),
            GroupLayout::Compute {
                compute_pipeline, ..
            } => n.set(List::ComputePipelines, compute_pipeline),
        }
        for entry in &mut group.entries {
            match &mut entry.resource {
                Resource::Buffer(part) => n.set(List::Buffers, &mut part.buffer),
                Resource::Texture(view) => n.set(List::Textures, &mut view.texture),
                Resource::Sampler { sampler } => n.set(List::Samplers, sampler),
            }
        }
    });
    let layout = |n: &mut Numbers, choice: &mut LayoutChoice| {
        if let LayoutChoice::Number(layout) = choice {
            n.set(List::PipelineLayouts, layout);
        }
    };
    let render = &all.render_pipelines;
    let render_pipelines = n.entries(List::RenderPipelines, render, |n, pipeline| {
        layout(n, &mut pipeline.layout);
        n.set(List::Shaders, &mut pipeline.vertex.stage.module);
        let fragment = pipeline.fragment.iter_mut();
        fragment.for_each(|f| n.set(List::Shaders, &mut f.stage.module));
    });
    let compute = &all.compute_pipelines;
    let compute_pipelines = n.entries(List::ComputePipelines, compute, |n, pipeline| {
        layout(n, &mut pipeline.layout);
        n.set(List::Shaders, &mut pipeline.compute.module);
    });
    let layouts = &all.pipeline_layouts;
    let pipeline_layouts = n.entries(List::PipelineLayouts, layouts, |n, layout| {
        let groups = layout.bind_group_layouts.iter_mut().flatten();
        groups.for_each(|group| n.set(List::GroupLayouts, group));
    });
    CaptureFile {
        buffers: n.entries(List::Buffers, &all.buffers, |_, _| {}),
        textures: n.entries(List::Textures, &all.textures, |_, _| {}),
        samplers: n.entries(List::Samplers, &all.samplers, |_, _| {}),
        shaders: n.entries(List::Shaders, &all.shaders, |_, _| {}),
        bind_group_layouts: n.entries(List::GroupLayouts, &all.bind_group_layouts, |_, _| {}),
        pipeline_layouts,
        bind_groups,
        render_pipelines,
        compute_pipelines,
        setup,
        unknown,
        frames,
        schema: all.schema.clone(),
        source: all.source.clone(),
        ..CaptureFile::default()
    }
}

/// Writes the data before `frame.json`, so that a folder with a `frame.json` is complete.
pub(super) fn write(
    file: &mut CaptureFile,
    store: &Store,
    out: &Path,
    limits: &Limits,
) -> Result<(), TraceError> {
    let folder = writer::Writer::new(out, limits).map_err(TraceError::Write)?;
    let mut writer = Writer {
        store,
        folder: &folder,
        limits,
        written: BTreeSet::new(),
        known: BTreeMap::new(),
        bytes: 0,
    };
    for shader in &mut file.shaders {
        writer.put(&mut shader.data)?;
    }
    for start in &mut file.start.buffers {
        writer.put(&mut start.data)?;
    }
    for start in &mut file.start.textures {
        writer.put(&mut start.data)?;
    }
    let frames = file.frames.iter_mut().flat_map(|f| &mut f.commands);
    for command in file.setup.iter_mut().chain(frames) {
        if let Command::WriteBuffer { data, .. } | Command::WriteTexture { data, .. } = command {
            writer.put(data)?;
        }
    }
    let mut json = serde_json::to_value(file).map_err(|e| TraceError::Broken(e.to_string()))?;
    without_nulls(&mut json);
    let written = folder.finish(json.to_string().into_bytes());
    written.map_err(TraceError::Write)
}

struct Writer<'w> {
    store: &'w Store,
    folder: &'w writer::Writer,
    limits: &'w Limits,
    written: BTreeSet<DataName>,
    known: BTreeMap<DataName, DataName>,
    bytes: u64,
}

impl Writer<'_> {
    /// Writes data once, under the hash of its content.
    fn put(&mut self, name: &mut DataName) -> Result<(), TraceError> {
        if let Some(known) = self.known.get(name) {
            *name = known.clone();
            return Ok(());
        }
        let bytes = self.store.bytes(name)?;
        let hash = blake3::hash(&bytes).to_hex();
        let hash = data::name(&hash[..32]);
        if self.written.insert(hash.clone()) {
            self.bytes += bytes.len() as u64;
            self.limits
                .check("scene-bytes", self.bytes, "the bytes of the capture")?;
            let written = self.folder.data(hash.file(), bytes.to_vec());
            written.map_err(TraceError::Write)?;
        }
        self.known
            .insert(std::mem::replace(name, hash.clone()), hash);
        Ok(())
    }
}

/// Removes keys whose value is null: a missing key means the default.
fn without_nulls(json: &mut Value) {
    match json {
        Value::Object(entries) => {
            entries.retain(|_, value| !value.is_null());
            entries
                .iter_mut()
                .for_each(|(_, value)| without_nulls(value));
        }
        Value::Array(list) => list.iter_mut().for_each(without_nulls),
        _ => {}
    }
}
