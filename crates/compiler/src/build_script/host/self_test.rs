// The self-test of a variant.

use super::{Attachment, Color, DepthUse, Ops, Pass, Phase, PipelineOptions, Unfit};

/// Draws that a host runs when it loads a variant, because some guarantees depend on the driver. If
/// the test fails, draw `original` instead.
#[derive(Clone, Copy, Debug)]
pub struct SelfTest {
    /// Attachments of the test: its own and the material's.
    pub attachments: &'static [Attachment],
    /// All of them must pass.
    pub runs: &'static [Run],
}

/// Draws one after the other, each in a render pass of its own.
#[derive(Clone, Copy, Debug)]
pub struct Run {
    /// The fault if samples pass that must not.
    pub failure: &'static str,
    /// In order.
    pub draws: &'static [TestDraw],
}

/// One draw of a self-test.
#[derive(Clone, Copy, Debug)]
pub struct TestDraw {
    /// The pass to draw as.
    pub pass: &'static Pass,
    /// Name of the depth attachment.
    pub attachment: &'static str,
    /// Depth comparison.
    pub compare: wgpu::CompareFunction,
    /// Depth is written.
    pub write: bool,
    /// Value that the attachment is cleared to by the first draw of the run that has it.
    pub clear: f32,
    /// Whether samples must pass.
    pub must_pass: bool,
}

/// Result of a self-test.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Tested {
    /// You may draw the variant.
    Held,
    /// The variant does not work on this driver. Draw `original`.
    Failed(&'static str),
    /// Nothing of the material was in view. Test again with another camera, or draw `original`.
    SawNothing,
}

impl SelfTest {
    /// Runs the test on draws of the material. `draw` binds the pass's bind groups, vertex and
    /// index buffers, and draws, the same in each call. It gets the test's attachments by name, for
    /// a pass that samples one. `buffers` are the host's vertex buffers, as for [`Pass::pipeline`].
    /// This waits for the device; a browser cannot wait, so use [`SelfTest::begin`] there.
    ///
    /// # Errors
    /// As [`Pass::vertex_buffers`].
    pub fn run(
        &self,
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        size: wgpu::Extent3d,
        buffers: &[wgpu::VertexBufferLayout<'_>],
        draw: impl FnMut(&Pass, &dyn Fn(&str) -> Option<wgpu::TextureView>, &mut wgpu::RenderPass<'_>),
    ) -> Result<Tested, Unfit> {
        let options = PipelineOptions::default();
        self.run_with(device, queue, size, buffers, &options, draw)
    }

    /// As [`SelfTest::run`], with pipeline options.
    ///
    /// # Errors
    /// As [`Pass::pipeline_with`].
    pub fn run_with(
        &self,
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        size: wgpu::Extent3d,
        buffers: &[wgpu::VertexBufferLayout<'_>],
        options: &PipelineOptions<'_>,
        draw: impl FnMut(&Pass, &dyn Fn(&str) -> Option<wgpu::TextureView>, &mut wgpu::RenderPass<'_>),
    ) -> Result<Tested, Unfit> {
        let pending = self.begin(device, queue, size, buffers, options, draw)?;
        match device.poll(wgpu::PollType::wait_indefinitely()) {
            Ok(_) => Ok(pending.judge().unwrap_or(Tested::SawNothing)),
            Err(_) => Ok(Tested::SawNothing),
        }
    }

    /// As [`SelfTest::run_with`], without waiting. Call [`Pending::judge`] in later frames, and
    /// draw `original` until the test has passed.
    ///
    /// # Errors
    /// As [`Pass::pipeline_with`].
    pub fn begin(
        &self,
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        size: wgpu::Extent3d,
        buffers: &[wgpu::VertexBufferLayout<'_>],
        options: &PipelineOptions<'_>,
        mut draw: impl FnMut(
            &Pass,
            &dyn Fn(&str) -> Option<wgpu::TextureView>,
            &mut wgpu::RenderPass<'_>,
        ),
    ) -> Result<Pending, Unfit> {
        let samples = |a: &Attachment| {
            let draws = self.runs.iter().flat_map(|r| r.draws);
            let mut on_it = draws.filter(|d| d.attachment == a.name);
            let is_scenes = on_it.any(|d| !matches!(d.pass.phase, Phase::Shadow | Phase::Outputs));
            options.samples.filter(|_| is_scenes).unwrap_or(a.samples)
        };
        let texture = |a: &Attachment| (a.name, a.texture_with(device, size, samples(a)));
        let textures: Vec<(&str, wgpu::Texture)> = self.attachments.iter().map(texture).collect();
        let view = |name: &str| {
            let found = textures.iter().find(|(n, _)| *n == name);
            found.map(|(_, t)| t.create_view(&wgpu::TextureViewDescriptor::default()))
        };
        let count: usize = self.runs.iter().map(|r| r.draws.len()).sum();
        let mut recorded = Recorded {
            queries: device.create_query_set(&wgpu::QuerySetDescriptor {
                label: None,
                ty: wgpu::QueryType::Occlusion,
                count: count as u32,
            }),
            encoder: device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default()),
            query: 0,
        };
        let host = Host {
            device,
            size,
            buffers,
            options,
            view: &view,
        };
        for run in self.runs {
            let mut cleared: Vec<&str> = Vec::new();
            for test in run.draws {
                let first = !cleared.contains(&test.attachment);
                cleared.push(test.attachment);
                recorded.draw(&host, test, first, &mut draw)?;
            }
        }
        let Recorded {
            queries,
            mut encoder,
            ..
        } = recorded;
        let buffer = |usage| {
            device.create_buffer(&wgpu::BufferDescriptor {
                label: None,
                size: (count * 8) as u64,
                usage,
                mapped_at_creation: false,
            })
        };
        let resolved = buffer(wgpu::BufferUsages::QUERY_RESOLVE | wgpu::BufferUsages::COPY_SRC);
        let read = buffer(wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ);
        encoder.resolve_query_set(&queries, 0..count as u32, &resolved, 0);
        encoder.copy_buffer_to_buffer(&resolved, 0, &read, 0, (count * 8) as u64);
        let _ = queue.submit([encoder.finish()]);
        let pending = Pending {
            runs: self.runs,
            read,
            mapped: std::sync::Arc::new(std::sync::OnceLock::new()),
        };
        let mapped = std::sync::Arc::clone(&pending.mapped);
        pending
            .read
            .map_async(wgpu::MapMode::Read, .., move |done| {
                let _ = mapped.set(done.is_ok());
            });
        Ok(pending)
    }
}

/// A running self-test.
#[derive(Clone, Debug)]
pub struct Pending {
    runs: &'static [Run],
    read: wgpu::Buffer,
    /// Whether the results can be read, once that is known.
    mapped: std::sync::Arc<std::sync::OnceLock<bool>>,
}

impl Pending {
    /// The result. `None` while the device is busy: a native host must poll the device or submit to
    /// it, a browser need not.
    pub fn judge(&self) -> Option<Tested> {
        let passed = match *self.mapped.get()? {
            true => self.read.get_mapped_range(..).ok(),
            false => None,
        };
        let Some(mapped) = passed else {
            return Some(Tested::SawNothing);
        };
        let passed: Vec<bool> = mapped
            .chunks_exact(8)
            .map(|n| n.iter().any(|b| *b != 0))
            .collect();
        Some(judge(self.runs, &passed))
    }
}

fn judge(runs: &[Run], passed: &[bool]) -> Tested {
    let mut passed = passed.iter();
    let mut saw = true;
    for run in runs {
        for (draw, passed) in run.draws.iter().zip(passed.by_ref()) {
            match (draw.must_pass, passed) {
                (false, true) => return Tested::Failed(run.failure),
                (true, false) => saw = false,
                _ => {}
            }
        }
    }
    match saw {
        true => Tested::Held,
        false => Tested::SawNothing,
    }
}

/// Resources of the test.
struct Host<'h> {
    device: &'h wgpu::Device,
    size: wgpu::Extent3d,
    buffers: &'h [wgpu::VertexBufferLayout<'h>],
    options: &'h PipelineOptions<'h>,
    /// The test's attachments by name.
    view: &'h dyn Fn(&str) -> Option<wgpu::TextureView>,
}

/// The recorded commands.
struct Recorded {
    queries: wgpu::QuerySet,
    encoder: wgpu::CommandEncoder,
    /// Draws so far.
    query: u32,
}

impl Recorded {
    fn draw(
        &mut self,
        host: &Host<'_>,
        test: &TestDraw,
        first: bool,
        draw: &mut impl FnMut(
            &Pass,
            &dyn Fn(&str) -> Option<wgpu::TextureView>,
            &mut wgpu::RenderPass<'_>,
        ),
    ) -> Result<(), Unfit> {
        let pass = test.pass;
        let Some((own, attachment)) = pass.depth.as_ref().zip((host.view)(test.attachment)) else {
            return Err(Unfit::Host(format!(
                "the pass `{}` has no depth to test",
                pass.role
            )));
        };
        let state = wgpu::DepthStencilState {
            depth_write_enabled: Some(test.write),
            depth_compare: Some(test.compare),
            stencil: wgpu::StencilState::default(),
            ..own.state.clone()
        };
        let pipeline = pass.pipeline_of(host.device, host.buffers, Some(state), host.options)?;
        let samples = pass.samples_with(host.options)?;
        // The scene's colours are unused, but with other targets a driver may compile another vertex
        // stage. A colour with a name may be sampled by a later draw.
        let target = |(i, target): (usize, &Option<wgpu::ColorTargetState>)| {
            let named = pass.colors.get(i).and_then(|c| c.as_ref()?.attachment);
            if let Some(view) = named.and_then(host.view) {
                return Some(view);
            }
            let colour = Attachment {
                name: "self-test",
                format: target.as_ref()?.format,
                samples,
                usage: wgpu::TextureUsages::RENDER_ATTACHMENT,
            };
            let texture = colour.texture(host.device, host.size);
            Some(texture.create_view(&wgpu::TextureViewDescriptor::default()))
        };
        let targets = pass.targets_with(host.options)?;
        let colours: Vec<Option<wgpu::TextureView>> =
            targets.iter().enumerate().map(target).collect();
        let ops = Ops {
            clear_first: true,
            store: wgpu::StoreOp::Store,
        };
        let colour = Color {
            attachment: None,
            ops,
        };
        // A packed depth, as in the frame.
        let [r, g, b, a] = [f64::from(own.clear); 4];
        let far = wgpu::Color { r, g, b, a };
        let colours: Vec<_> = colours
            .iter()
            .map(|v| v.as_ref().map(|v| colour.attach(v, true, far)))
            .collect();
        let has_stencil = own.stencil_ops.map(|_| ops);
        let depth = DepthUse {
            read_only: false,
            clear: test.clear,
            ops,
            stencil_ops: has_stencil,
            ..own.clone()
        };
        let mut render = self.encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("self-test"),
            color_attachments: &colours,
            depth_stencil_attachment: Some(depth.attach(&attachment, first)),
            occlusion_query_set: Some(&self.queries),
            ..wgpu::RenderPassDescriptor::default()
        });
        render.set_pipeline(&pipeline);
        render.begin_occlusion_query(self.query);
        draw(pass, host.view, &mut render);
        render.end_occlusion_query();
        self.query += 1;
        Ok(())
    }
}
