//! Clears that do not fill the target: WebGL applies its scissor and masks to them.

use preshade_plan::safety::Checks;
use wgpu::util::DeviceExt as _;

use super::Replay;
use super::passes::Encoded;
use crate::capture::Error;
use preshade_frames::file::{Clear, RenderPassDescriptor};

impl Replay<'_> {
    /// Draws a triangle over the targets, with the clear's scissor and masks.
    pub(super) fn partial_clear(
        &mut self,
        clear: &Clear,
        pass: &RenderPassDescriptor,
        place: &str,
    ) -> Result<Vec<Encoded>, Error> {
        let mut samples = 1;
        let mut size = [1, 1];
        let mut targets = Vec::new();
        for (index, attachment) in pass.color_attachments.iter().enumerate() {
            let Some(attachment) = attachment else {
                targets.push(None);
                continue;
            };
            let texture = self.texture(attachment.view.texture, place)?;
            samples = texture.sample_count();
            size = [texture.width(), texture.height()];
            let is_cleared = clear.color.is_some()
                && clear
                    .colors
                    .get(index)
                    .copied()
                    .unwrap_or(clear.colors.is_empty());
            let mask = if is_cleared { clear.mask.color } else { 0 };
            targets.push(Some(wgpu::ColorTargetState {
                format: attachment.view.view.format.unwrap_or(texture.format()),
                blend: None,
                write_mask: wgpu::ColorWrites::from_bits_truncate(mask),
            }));
        }
        let depth = match &pass.depth_stencil_attachment {
            Some(attachment) => {
                let texture = self.texture(attachment.view.texture, place)?;
                samples = texture.sample_count();
                size = [texture.width(), texture.height()];
                Some(depth_stencil(texture.format(), clear))
            }
            None => None,
        };
        let [r, g, b, a] = clear.color.unwrap_or([0.0; 4]).map(|c| c as f32);
        let fill = [r, g, b, a, clear.depth.unwrap_or(0.0), 0.0, 0.0, 0.0];
        let bytes: Vec<u8> = fill.iter().flat_map(|n| n.to_le_bytes()).collect();
        let made = self.gpu.checked("a clear", || {
            let device = &self.gpu.device;
            let module = self.gpu.shader(
                Checks::default(),
                wgpu::ShaderModuleDescriptor {
                    label: Some("clear"),
                    source: wgpu::ShaderSource::Wgsl(include_str!("clear.wgsl").into()),
                },
            );
            let pipeline = device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
                label: Some("clear"),
                layout: None,
                vertex: wgpu::VertexState {
                    module: &module,
                    entry_point: Some("everywhere"),
                    compilation_options: Default::default(),
                    buffers: &[],
                },
                primitive: wgpu::PrimitiveState::default(),
                depth_stencil: depth,
                multisample: wgpu::MultisampleState {
                    count: samples,
                    ..Default::default()
                },
                fragment: Some(wgpu::FragmentState {
                    module: &module,
                    entry_point: Some("filled"),
                    compilation_options: Default::default(),
                    targets: &targets,
                }),
                multiview_mask: None,
                cache: None,
            });
            let buffer = device.create_buffer_init(&wgpu::util::BufferInitDescriptor {
                label: Some("clear"),
                contents: &bytes,
                usage: wgpu::BufferUsages::UNIFORM,
            });
            let group = device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some("clear"),
                layout: &pipeline.get_bind_group_layout(0),
                entries: &[wgpu::BindGroupEntry {
                    binding: 0,
                    resource: buffer.as_entire_binding(),
                }],
            });
            (pipeline, group)
        })?;
        let [width, height] = size;
        Ok(vec![
            Encoded::Pipeline(made.0),
            Encoded::Group(0, Some(made.1), Vec::new()),
            Encoded::Viewport([0.0, 0.0, width as f32, height as f32, 0.0, 1.0]),
            Encoded::Scissor(clear.scissor.unwrap_or([0, 0, width, height])),
            Encoded::StencilReference(clear.stencil.unwrap_or(0)),
            Encoded::Draw(0..3, 0..1),
            Encoded::Scissor([0, 0, width, height]),
        ])
    }
}

fn depth_stencil(format: wgpu::TextureFormat, clear: &Clear) -> wgpu::DepthStencilState {
    let face = wgpu::StencilFaceState {
        pass_op: wgpu::StencilOperation::Replace,
        ..wgpu::StencilFaceState::IGNORE
    };
    wgpu::DepthStencilState {
        format,
        depth_write_enabled: Some(clear.depth.is_some()),
        depth_compare: Some(wgpu::CompareFunction::Always),
        stencil: match clear.stencil {
            Some(_) if format.has_stencil_aspect() => wgpu::StencilState {
                front: face,
                back: face,
                read_mask: u32::MAX,
                write_mask: clear.mask.stencil,
            },
            _ => wgpu::StencilState::default(),
        },
        bias: wgpu::DepthBiasState::default(),
    }
}
