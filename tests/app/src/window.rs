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
use crate::leaf;

/// Opens the window and draws until it is closed.
pub fn run() -> Result<(), Box<dyn Error>> {
    let mut app = App { shown: None, of_preshade: true, began: Instant::now() };
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
    device: wgpu::Device,
    queue: wgpu::Queue,
    grove: Grove,
    /// The original and the variant at the window's size.
    variants: [Variant; 2],
}

impl Shown {
    fn new(window: Window) -> Result<Self, Box<dyn Error>> {
        let window = Arc::new(window);
        let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle());
        let surface = instance.create_surface(Arc::clone(&window))?;
        let (_, device, queue) = pollster::block_on(device(&instance, Some(&surface)))?;
        let grove = Grove::new(&device, &queue);
        let variants = Self::sized(&device, &grove, &surface, &window)?;
        Ok(Self { window, surface, device, queue, grove, variants })
    }

    /// The surface and the attachments at the window's size. The surface has the format that the build script says the material is drawn to.
    fn sized(
        device: &wgpu::Device,
        grove: &Grove,
        surface: &wgpu::Surface<'_>,
        window: &Window,
    ) -> Result<[Variant; 2], Box<dyn Error>> {
        let size = window.inner_size();
        let (width, height) = (size.width.max(1), size.height.max(1));
        surface.configure(
            device,
            &wgpu::SurfaceConfiguration {
                usage: wgpu::TextureUsages::RENDER_ATTACHMENT,
                format: wgpu::TextureFormat::Bgra8Unorm,
                color_space: Default::default(),
                width,
                height,
                present_mode: wgpu::PresentMode::AutoVsync,
                desired_maximum_frame_latency: 2,
                alpha_mode: wgpu::CompositeAlphaMode::Auto,
                view_formats: Vec::new(),
            },
        );
        let size = wgpu::Extent3d { width, height, depth_or_array_layers: 1 };
        Ok([
            Variant::new(device, grove, leaf::original::PASSES, leaf::original::ATTACHMENTS, size)?,
            Variant::new(device, grove, leaf::PASSES, leaf::ATTACHMENTS, size)?,
        ])
    }

    fn draw(&self, time: f32, variant: usize) {
        let texture = match self.surface.get_current_texture() {
            wgpu::CurrentSurfaceTexture::Success(texture) | wgpu::CurrentSurfaceTexture::Suboptimal(texture) => texture,
            // The next frame has another try.
            _ => return,
        };
        let _ = self.grove.set_time(&self.queue, time);
        let mut encoder = self.device.create_command_encoder(&Default::default());
        self.variants[variant].draw(&mut encoder, &self.grove, &texture.texture.create_view(&Default::default()));
        self.queue.submit([encoder.finish()]);
        self.queue.present(texture);
        self.window.request_redraw();
    }
}

impl ApplicationHandler for App {
    fn resumed(&mut self, event_loop: &ActiveEventLoop) {
        let attributes = Window::default_attributes().with_title("preshade: the space bar changes between original and variant");
        let shown = event_loop.create_window(attributes).map_err(Box::from).and_then(Shown::new);
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
            WindowEvent::Resized(_) => match Shown::sized(&shown.device, &shown.grove, &shown.surface, &shown.window) {
                Ok(variants) => shown.variants = variants,
                Err(error) => eprintln!("error: {error}"),
            },
            WindowEvent::KeyboardInput { event, .. } if event.state == ElementState::Pressed => match event.logical_key {
                Key::Named(NamedKey::Space) => self.of_preshade = !self.of_preshade,
                Key::Named(NamedKey::Escape) => event_loop.exit(),
                _ => {}
            },
            WindowEvent::RedrawRequested => shown.draw(self.began.elapsed().as_secs_f32(), usize::from(self.of_preshade)),
            _ => {}
        }
    }
}
