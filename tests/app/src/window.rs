//! The grove in a window.

use std::error::Error;
use std::sync::Arc;
use std::time::Instant;

use winit::application::ApplicationHandler;
use winit::event::{ElementState, WindowEvent};
use winit::event_loop::{ActiveEventLoop, EventLoop};
use winit::keyboard::{Key, NamedKey};
use winit::window::{Window, WindowId};

use crate::grove::{Grove, Variant, device};
use crate::leaf::{self, Pass, Pending, PipelineOptions, Tested, Unfit};

/// Opens the window and draws until it is closed.
pub fn run() -> Result<(), Box<dyn Error>> {
    let mut app = App {
        shown: None,
        of_preshade: true,
        began: Instant::now(),
    };
    Ok(EventLoop::new()?.run_app(&mut app)?)
}

struct App {
    shown: Option<Shown>,
    /// Whether the variant is drawn, or the original.
    of_preshade: bool,
    began: Instant,
}

struct Shown {
    window: Arc<Window>,
    surface: wgpu::Surface<'static>,
    /// The surface's own, which nobody knew when the material was built.
    format: wgpu::TextureFormat,
    device: wgpu::Device,
    queue: wgpu::Queue,
    grove: Grove,
    /// The variant's self-test: until it holds, the original is drawn.
    test: Option<Pending>,
    /// The original and the variant at the window's size.
    variants: [Variant; 2],
}

impl Shown {
    fn new(window: Window) -> Result<Self, Box<dyn Error>> {
        let window = Arc::new(window);
        let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle());
        let surface = instance.create_surface(Arc::clone(&window))?;
        let (adapter, device, queue) = pollster::block_on(device(&instance, Some(&surface)))?;
        let formats = surface.get_capabilities(&adapter).formats;
        let format = *formats
            .first()
            .ok_or("the adapter cannot draw to the window")?;
        let grove = Grove::new(&device, &queue);
        let variants = Self::sized(&device, &grove, &surface, &window, format)?;
        let mut shown = Self {
            window,
            surface,
            format,
            device,
            queue,
            grove,
            test: None,
            variants,
        };
        shown.test = shown.tested()?;
        Ok(shown)
    }

    /// Hands the variant's self-test to the device.
    fn tested(&self) -> Result<Option<Pending>, Unfit> {
        let Some(test) = &leaf::SELF_TEST else {
            return Ok(None);
        };
        let _ = self.grove.set_time(&self.queue, 0.0);
        let formats = [Some(self.format)];
        let options = PipelineOptions {
            formats: &formats,
            ..Default::default()
        };
        let size = wgpu::Extent3d {
            width: 256,
            height: 256,
            depth_or_array_layers: 1,
        };
        let draw = |pass: &Pass,
                    view: &dyn Fn(&str) -> Option<wgpu::TextureView>,
                    render: &mut wgpu::RenderPass<'_>| {
            self.grove
                .draw(render, &self.grove.bind(&self.device, pass, view));
        };
        test.begin(
            &self.device,
            &self.queue,
            size,
            &[leaf::INTERLEAVED],
            &options,
            draw,
        )
        .map(Some)
    }

    /// Whether the variant may be drawn.
    fn holds(&self) -> bool {
        self.test
            .as_ref()
            .is_none_or(|test| test.judge() == Some(Tested::Held))
    }

    /// The surface and the attachments at the window's size.
    fn sized(
        device: &wgpu::Device,
        grove: &Grove,
        surface: &wgpu::Surface<'_>,
        window: &Window,
        format: wgpu::TextureFormat,
    ) -> Result<[Variant; 2], Box<dyn Error>> {
        let size = window.inner_size();
        let (width, height) = (size.width.max(1), size.height.max(1));
        surface.configure(
            device,
            &wgpu::SurfaceConfiguration {
                usage: wgpu::TextureUsages::RENDER_ATTACHMENT,
                format,
                color_space: Default::default(),
                width,
                height,
                present_mode: wgpu::PresentMode::AutoVsync,
                desired_maximum_frame_latency: 2,
                alpha_mode: wgpu::CompositeAlphaMode::Auto,
                view_formats: Vec::new(),
            },
        );
        let size = wgpu::Extent3d {
            width,
            height,
            depth_or_array_layers: 1,
        };
        let options = PipelineOptions {
            formats: &[Some(format)],
            ..Default::default()
        };
        Ok([
            Variant::new(
                device,
                grove,
                leaf::original::PASSES,
                leaf::original::ATTACHMENTS,
                size,
                &options,
            )?,
            Variant::new(
                device,
                grove,
                leaf::PASSES,
                leaf::ATTACHMENTS,
                size,
                &options,
            )?,
        ])
    }

    fn draw(&self, time: f32, variant: usize) {
        let texture = match self.surface.get_current_texture() {
            wgpu::CurrentSurfaceTexture::Success(texture)
            | wgpu::CurrentSurfaceTexture::Suboptimal(texture) => texture,
            // The next frame has another try.
            _ => return,
        };
        let _ = self.grove.set_time(&self.queue, time);
        let mut encoder = self.device.create_command_encoder(&Default::default());
        self.variants[variant].draw(
            &mut encoder,
            &self.grove,
            &texture.texture.create_view(&Default::default()),
        );
        self.queue.submit([encoder.finish()]);
        self.queue.present(texture);
        self.window.request_redraw();
    }
}

impl ApplicationHandler for App {
    fn resumed(&mut self, event_loop: &ActiveEventLoop) {
        let attributes = Window::default_attributes().with_title(
            "preshade: the space bar changes \
            between original and variant",
        );
        let shown = event_loop
            .create_window(attributes)
            .map_err(Box::from)
            .and_then(Shown::new);
        match shown {
            Ok(shown) => self.shown = Some(shown),
            Err(error) => {
                eprintln!("error: {error}");
                event_loop.exit();
            }
        }
    }

    fn window_event(&mut self, event_loop: &ActiveEventLoop, _: WindowId, event: WindowEvent) {
        let Some(shown) = &mut self.shown else { return };
        match event {
            WindowEvent::CloseRequested => event_loop.exit(),
            WindowEvent::Resized(_) => match Shown::sized(
                &shown.device,
                &shown.grove,
                &shown.surface,
                &shown.window,
                shown.format,
            ) {
                Ok(variants) => shown.variants = variants,
                Err(error) => eprintln!("error: {error}"),
            },
            WindowEvent::KeyboardInput { event, .. } if event.state == ElementState::Pressed => {
                match event.logical_key {
                    Key::Named(NamedKey::Space) => self.of_preshade = !self.of_preshade,
                    Key::Named(NamedKey::Escape) => event_loop.exit(),
                    _ => {}
                }
            }
            WindowEvent::RedrawRequested => shown.draw(
                self.began.elapsed().as_secs_f32(),
                usize::from(self.of_preshade && shown.holds()),
            ),
            _ => {}
        }
    }
}
