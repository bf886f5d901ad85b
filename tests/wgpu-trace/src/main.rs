//! Draws small frames with wgpu, which writes a trace of them, and reads the last one back as a test would:
//!
//! ```sh
//! cargo run --features v30 -- DIR            # or v29; into a texture
//! cargo run --features v30 -- DIR --window   # into a window
//! ```

#[cfg(feature = "v29")]
extern crate wgpu29 as wgpu;
#[cfg(feature = "v30")]
extern crate wgpu30 as wgpu;

use std::path::{Path, PathBuf};
use std::sync::Arc;

use winit::application::ApplicationHandler;
use winit::event::WindowEvent;
use winit::event_loop::{ActiveEventLoop, EventLoop};
use winit::window::{Window, WindowId};

mod scene;

use scene::{FRAMES, SIZE};

fn main() {
    let mut arguments = std::env::args().skip(1);
    let folder = PathBuf::from(arguments.next().expect("a folder"));
    std::fs::create_dir_all(&folder).expect("a folder");
    if arguments.next().as_deref() == Some("--window") {
        let events = EventLoop::new().expect("a display");
        events.run_app(&mut App(folder)).expect("a window");
    } else {
        draw(&folder, None);
    }
}

struct App(PathBuf);

impl ApplicationHandler for App {
    fn resumed(&mut self, events: &ActiveEventLoop) {
        let size = winit::dpi::PhysicalSize::new(SIZE[0], SIZE[1]);
        let window = Window::default_attributes().with_inner_size(size);
        let window = events.create_window(window).expect("a window");
        draw(&self.0, Some(Arc::new(window)));
        events.exit();
    }

    fn window_event(&mut self, _: &ActiveEventLoop, _: WindowId, _: WindowEvent) {}
}

fn draw(folder: &Path, window: Option<Arc<Window>>) {
    let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle());
    let surface = window.map(|w| instance.create_surface(w).expect("a surface"));
    let adapter = pollster::block_on(instance.request_adapter(&wgpu::RequestAdapterOptions {
        compatible_surface: surface.as_ref(),
        ..Default::default()
    }))
    .expect("an adapter");
    let (device, queue) = pollster::block_on(adapter.request_device(&wgpu::DeviceDescriptor {
        label: Some("/home/somebody/recorder/device"),
        trace: wgpu::Trace::Directory(folder.to_owned()),
        ..Default::default()
    }))
    .expect("a device");
    let format = match &surface {
        Some(surface) => {
            let mut config = surface
                .get_default_config(&adapter, SIZE[0], SIZE[1])
                .expect("a configuration");
            config.usage |= wgpu::TextureUsages::COPY_SRC;
            surface.configure(&device, &config);
            config.format
        }
        None => wgpu::TextureFormat::Rgba8UnormSrgb,
    };
    let scene = scene::Scene::new(&device, &queue, format);
    let target = scene::target(&device, format);
    for frame in 0..FRAMES {
        let shown = surface.as_ref().map(|s| match s.get_current_texture() {
            wgpu::CurrentSurfaceTexture::Success(t)
            | wgpu::CurrentSurfaceTexture::Suboptimal(t) => t,
            _ => panic!("the window has no texture"),
        });
        let texture = shown.as_ref().map_or(&target, |s| &s.texture);
        scene.frame(&device, &queue, texture, frame);
        if frame + 1 == FRAMES {
            scene::read(&device, &queue, texture);
        }
        if let Some(shown) = shown {
            #[cfg(feature = "v29")]
            shown.present();
            #[cfg(feature = "v30")]
            queue.present(shown);
        }
    }
}
