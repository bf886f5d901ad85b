//! The render passes of a captured frame, with the state of each draw.

use std::collections::{BTreeMap, BTreeSet};

use serde::{Deserialize, Serialize};

use super::error::Error;
use super::file::{
    Clear, Command, ComputeCommand, DrawCommand, IndexFormat, Load, RenderPassDescriptor, Resource,
    View,
};
use super::folder::{Capture, get};

/// A render pass of a frame.
#[derive(Clone, Debug)]
pub struct Pass<'c> {
    /// Index of the pass in the frame's commands.
    pub command: usize,
    /// The pass's attachments.
    pub descriptor: &'c RenderPassDescriptor,
    /// The purpose of the pass.
    pub kind: Kind,
    /// The texture that the page shows.
    canvas: Option<usize>,
    /// The draws of the pass, in order.
    pub draws: Vec<PassDraw>,
    /// Clears of parts of the attachments before the first draw, in addition to those of the
    /// descriptor.
    pub leading_clears: Vec<&'c Clear>,
    /// Whether the pass clears a part of its attachments after a draw.
    pub clears_later: bool,
    /// The number of draws before that clear, or of all draws if there is none.
    pub before_clear: usize,
}

impl Pass<'_> {
    /// Vertices of the draws before the first clear.
    pub fn vertices(&self) -> u64 {
        let draws = self.draws.iter().take(self.before_clear);
        draws.map(|d| d.call.vertices()).sum()
    }
}

/// The purpose of a pass, inferred from its attachments and draws.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Kind {
    /// Draws materials to a colour target.
    Main,
    /// Writes only depth, which a later pass tests: the host's own pre-pass.
    Prepass,
    /// Writes only depth, which a later pass reads as a texture: a shadow map.
    Shadow,
    /// Writes only depth, which no later pass of the frame uses.
    Depth,
    /// Draws a few triangles over the whole target, without depth: post-processing.
    FullScreen,
    /// Draws nothing.
    Clear,
}

impl Kind {
    /// The kind's name in reports.
    pub fn name(self) -> &'static str {
        match self {
            Self::Main => "main",
            Self::Prepass => "pre-pass",
            Self::Shadow => "shadow map",
            Self::Depth => "depth",
            Self::FullScreen => "full screen",
            Self::Clear => "clear",
        }
    }
}

/// A part of a buffer: its number, the offset in bytes, and the size in bytes (`None`: to its end).
pub type TexturePart = (usize, u64, Option<u64>);

/// One draw with the state at its call.
#[derive(Clone, Debug, Default)]
pub struct PassDraw {
    /// Number of the render pipeline.
    pub pipeline: usize,
    /// Bind group and dynamic offsets, by group index.
    pub groups: BTreeMap<u32, (usize, Vec<u32>)>,
    /// WebGL: number of the draw's named resources.
    pub named: Option<usize>,
    /// Vertex buffers by slot.
    pub vertices: BTreeMap<u32, TexturePart>,
    /// The index buffer.
    pub indices: Option<(TexturePart, IndexFormat)>,
    /// Arguments of the draw call.
    pub call: Call,
    /// x, y, width, height, nearest and farthest depth; `None`: the whole target.
    pub viewport: Option<[f32; 6]>,
    /// x, y, width, height; `None`: the whole target.
    pub scissor: Option<[u32; 4]>,
    /// The blend constant.
    pub blend_constant: [f64; 4],
    /// The stencil reference.
    pub stencil_reference: u32,
}

/// The arguments of a draw call.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Call {
    /// First index or vertex.
    pub first: u32,
    /// Indices or vertices.
    pub count: u32,
    /// Added to each index.
    pub base_vertex: i32,
    /// First instance.
    pub first_instance: u32,
    /// Number of instances.
    pub instances: u32,
    /// Buffer and offset, if the arguments come from a buffer. The values here are then not the
    /// real ones.
    pub indirect: Option<(usize, u64)>,
    /// Whether the draw uses the index buffer.
    pub indexed: bool,
}

impl Call {
    /// Vertices of all instances. If the arguments come from a buffer, each counts as 1.
    pub fn vertices(&self) -> u64 {
        u64::from(self.count.max(1)) * u64::from(self.instances.max(1))
    }
}

/// The render passes of a frame.
///
/// # Errors
/// The capture has no such frame, or a draw comes before its pipeline.
pub fn passes(capture: &Capture, frame: usize) -> Result<Vec<Pass<'_>>, Error> {
    let place = format!("frame {frame}");
    let of = get(&capture.file.frames, frame, "frame", &place)?;
    let mut found = Vec::new();
    for (command, done) in of.commands.iter().enumerate() {
        if let Command::RenderPass {
            descriptor,
            commands,
        } = done
        {
            let steps = steps(commands, &format!("{place}, command {command}"))?;
            let is_clear = |step: &Step<'_>| matches!(step, Step::Clear(_));
            let clears = steps.iter().map_while(|step| match step {
                Step::Clear(clear) => Some(*clear),
                Step::Draw(_) => None,
            });
            let leading_clears: Vec<&Clear> = clears.collect();
            let drawn = steps.iter().skip(leading_clears.len()).position(is_clear);
            let draws = only_draws(steps);
            found.push(Pass {
                command,
                descriptor,
                kind: Kind::Clear,
                canvas: of.canvas,
                leading_clears,
                clears_later: drawn.is_some(),
                before_clear: drawn.unwrap_or(draws.len()),
                draws,
            });
        }
    }
    // In reverse, so that the reads of later commands are known.
    let mut later = Later::default();
    let mut of_command: BTreeMap<usize, usize> = BTreeMap::new();
    of_command.extend(
        found
            .iter()
            .enumerate()
            .map(|(index, pass)| (pass.command, index)),
    );
    for (command, done) in of.commands.iter().enumerate().rev() {
        if let Some(index) = of_command.get(&command) {
            let pass: &mut Pass<'_> = &mut found[*index];
            pass.kind = kind(pass, &later);
            later.add(capture, pass);
        }
        later.read.extend(read_otherwise(capture, done));
    }
    Ok(found)
}

/// How the commands after a pass use textures.
#[derive(Default)]
struct Later {
    /// Textures that a later command reads.
    read: BTreeSet<usize>,
    /// Depth textures that a later pass tests without clearing them first.
    tested: BTreeSet<usize>,
}

impl Later {
    fn add(&mut self, capture: &Capture, pass: &Pass<'_>) {
        let draws = pass.draws.iter();
        self.read
            .extend(draws.flat_map(|draw| sampled(capture, draw)));
        let depth = pass.descriptor.depth_stencil_attachment.as_ref();
        let kept = depth.filter(|d| d.depth_load_op != Some(Load::Clear));
        self.tested.extend(kept.map(|d| d.view.texture));
    }
}

/// One step of a pass.
#[derive(Clone, Debug)]
pub enum Step<'c> {
    /// A draw with its state.
    Draw(Box<PassDraw>),
    /// A clear between draws.
    Clear(&'c Clear),
}

/// The draws of a command. Empty if it is no render pass.
pub fn draws(command: &Command, place: &str) -> Result<Vec<PassDraw>, Error> {
    match command {
        Command::RenderPass { commands, .. } => Ok(only_draws(steps(commands, place)?)),
        _ => Ok(Vec::new()),
    }
}

fn only_draws(steps: Vec<Step<'_>>) -> Vec<PassDraw> {
    let draw = |step| match step {
        Step::Draw(draw) => Some(*draw),
        Step::Clear(_) => None,
    };
    steps.into_iter().filter_map(draw).collect()
}

/// The draws and clears of a pass, in order.
pub fn steps<'c>(commands: &'c [DrawCommand], place: &str) -> Result<Vec<Step<'c>>, Error> {
    let mut state = PassDraw::default();
    let mut pipeline = None;
    let mut found = Vec::new();
    for command in commands {
        let call = match command {
            DrawCommand::SetPipeline { pipeline: set } => {
                pipeline = Some(*set);
                continue;
            }
            DrawCommand::Draw {
                vertex_count,
                instance_count,
                first_vertex,
                first_instance,
            } => Call {
                first: *first_vertex,
                count: *vertex_count,
                instances: *instance_count,
                first_instance: *first_instance,
                ..Call::default()
            },
            DrawCommand::DrawIndexed {
                index_count,
                instance_count,
                first_index,
                base_vertex,
                first_instance,
            } => Call {
                first: *first_index,
                count: *index_count,
                base_vertex: *base_vertex,
                first_instance: *first_instance,
                instances: *instance_count,
                indexed: true,
                indirect: None,
            },
            DrawCommand::DrawIndirect { buffer, offset } => Call {
                indirect: Some((*buffer, *offset)),
                ..Call::default()
            },
            DrawCommand::DrawIndexedIndirect { buffer, offset } => Call {
                indirect: Some((*buffer, *offset)),
                indexed: true,
                ..Call::default()
            },
            DrawCommand::Clear(clear) => {
                found.push(Step::Clear(clear));
                continue;
            }
            other => {
                state.set(other);
                continue;
            }
        };
        let pipeline =
            pipeline.ok_or_else(|| Error::broken(place, "a draw comes before its pipeline"))?;
        found.push(Step::Draw(Box::new(PassDraw {
            pipeline,
            call,
            ..state.clone()
        })));
    }
    Ok(found)
}

impl PassDraw {
    /// Applies a command that sets state to this draw.
    fn set(&mut self, command: &DrawCommand) {
        match command {
            DrawCommand::SetBindGroup {
                index,
                bind_group: Some(group),
                dynamic_offsets,
            } => {
                self.groups
                    .insert(*index, (*group, dynamic_offsets.clone()));
            }
            DrawCommand::SetBindGroup { index, .. } => {
                self.groups.remove(index);
            }
            DrawCommand::SetNamed { named } => self.named = Some(*named),
            DrawCommand::SetVertexBuffer {
                slot,
                buffer: Some(buffer),
                offset,
                size,
            } => {
                self.vertices.insert(*slot, (*buffer, *offset, *size));
            }
            DrawCommand::SetVertexBuffer { slot, .. } => {
                self.vertices.remove(slot);
            }
            DrawCommand::SetIndexBuffer {
                buffer,
                index_format,
                offset,
                size,
            } => self.indices = Some(((*buffer, *offset, *size), *index_format)),
            DrawCommand::SetViewport {
                x,
                y,
                width,
                height,
                min_depth,
                max_depth,
            } => self.viewport = Some([*x, *y, *width, *height, *min_depth, *max_depth]),
            DrawCommand::SetScissorRect {
                x,
                y,
                width,
                height,
            } => self.scissor = Some([*x, *y, *width, *height]),
            DrawCommand::SetBlendConstant { color } => self.blend_constant = color.numbers(),
            DrawCommand::SetStencilReference { reference } => self.stencil_reference = *reference,
            _ => {}
        }
    }
}

/// The textures that a draw binds.
pub fn sampled(capture: &Capture, draw: &PassDraw) -> BTreeSet<usize> {
    let groups = draw.groups.values();
    let bound = groups.flat_map(|(group, _)| bound(capture, *group));
    let named = draw.named.and_then(|n| capture.file.named.get(n));
    let named = named.into_iter().flat_map(|n| n.textures.values());
    let named = named.flat_map(|t| t.all().iter().map(|t| t.texture.texture));
    bound.chain(named).collect()
}

/// The textures that a command reads without a draw: in copies, resolves and compute.
pub fn read_otherwise(capture: &Capture, command: &Command) -> Vec<usize> {
    match command {
        Command::CopyTextureToBuffer { source, .. }
        | Command::CopyTextureToTexture { source, .. }
        | Command::CopyDepth { source, .. } => vec![source.texture],
        Command::RenderPass { descriptor, .. } => {
            let colors = descriptor.color_attachments.iter().flatten();
            let resolved = colors.filter(|c| c.resolve_target.is_some());
            resolved.map(|c| c.view.texture).collect()
        }
        Command::ComputePass { commands, .. } => {
            let groups = commands.iter().filter_map(|command| match command {
                ComputeCommand::SetBindGroup { bind_group, .. } => *bind_group,
                _ => None,
            });
            groups.flat_map(|group| bound(capture, group)).collect()
        }
        _ => Vec::new(),
    }
}

/// The textures of a bind group.
fn bound(capture: &Capture, group: usize) -> Vec<usize> {
    let group = capture.file.bind_groups.get(group);
    let entries = group.into_iter().flat_map(|g| &g.entries);
    entries
        .filter_map(|e| match &e.resource {
            Resource::Texture(view) => Some(view.texture),
            _ => None,
        })
        .collect()
}

/// Whether the pass only draws triangles that can cover the target: no depth, at most 6 vertices,
/// one instance.
fn is_full_screen(pass: &Pass<'_>) -> bool {
    pass.descriptor.depth_stencil_attachment.is_none()
        && pass
            .draws
            .iter()
            .all(|d| d.call.instances <= 1 && d.call.count <= 6 && d.call.indirect.is_none())
}

fn kind(pass: &Pass<'_>, later: &Later) -> Kind {
    if pass.draws.is_empty() {
        return Kind::Clear;
    }
    let is_read = |texture: usize| later.read.contains(&texture);
    let colors = pass.descriptor.color_attachments.iter().flatten();
    let shown = pass.canvas;
    let mut drawn = colors.flat_map(|c| std::iter::once(&c.view).chain(&c.resolve_target));
    // three.js binds a colour target to its shadow maps, which nobody reads.
    let has_color = drawn.any(|view| Some(view.texture) == shown || is_read(view.texture));
    let has_color = has_color || pass.descriptor.depth_stencil_attachment.is_none();
    if has_color {
        return match is_full_screen(pass) {
            true => Kind::FullScreen,
            false => Kind::Main,
        };
    }
    let depth = pass.descriptor.depth_stencil_attachment.as_ref();
    let Some(View { texture, .. }) = depth.map(|d| &d.view) else {
        return Kind::Clear;
    };
    let has_color = !pass.descriptor.color_attachments.is_empty();
    match () {
        () if is_read(*texture) => Kind::Shadow,
        // A later pass may draw on it, or another frame may read it.
        () if has_color => Kind::Main,
        () if later.tested.contains(texture) => Kind::Prepass,
        () => Kind::Depth,
    }
}
