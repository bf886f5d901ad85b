//! Draws small frames with wgpu, which writes a trace of them, and keeps the picture of the last one:
//!
//! ```sh
//! cargo run --features v30 -- DIR            # or v29; into a texture
//! cargo run --features v30 -- DIR --window   # into a window
//! ```

use std::path::{Path, PathBuf};
use std::sync::Arc;

#[cfg(feature = "v29")]
use wgpu29 as wgpu;
#[cfg(feature = "v30")]
use wgpu30 as wgpu;
use winit::application::ApplicationHandler;
use winit::event::WindowEvent;
use winit::event_loop::{ActiveEventLoop, EventLoop};
use winit::window::{Window, WindowId};

mod scene;

const SIZE: [u32; 2] = [64, 48];
const FRAMES: u32 = 3;

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
    let usage = wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::COPY_SRC;
    let format = match &surface {
        Some(surface) => {
            let mut config = surface
                .get_default_config(&adapter, SIZE[0], SIZE[1])
                .expect("a configuration");
            config.usage = usage;
            surface.configure(&device, &config);
            config.format
        }
        None => wgpu::TextureFormat::Rgba8UnormSrgb,
    };
    let scene = scene::Scene::new(&device, &queue, format);
    let target = device.create_texture(&wgpu::TextureDescriptor {
        label: Some("target"),
        size: wgpu::Extent3d {
            width: SIZE[0],
            height: SIZE[1],
            depth_or_array_layers: 1,
        },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format,
        usage,
        view_formats: &[],
    });
    for frame in 0..FRAMES {
        let shown = surface.as_ref().map(|s| match s.get_current_texture() {
            wgpu::CurrentSurfaceTexture::Success(t)
            | wgpu::CurrentSurfaceTexture::Suboptimal(t) => t,
            _ => panic!("the window has no texture"),
        });
        let texture = shown.as_ref().map_or(&target, |s| &s.texture);
        scene.frame(&device, &queue, texture, frame);
        if frame + 1 == FRAMES {
            keep(&device, &queue, texture, &folder.join("picture.png"));
        }
        if let Some(shown) = shown {
            #[cfg(feature = "v29")]
            shown.present();
            #[cfg(feature = "v30")]
            queue.present(shown);
        }
    }
}

/// Writes the picture as a PNG.
fn keep(device: &wgpu::Device, queue: &wgpu::Queue, texture: &wgpu::Texture, file: &Path) {
    let row = 256;
    let buffer = device.create_buffer(&wgpu::BufferDescriptor {
        label: Some("picture"),
        size: u64::from(row * SIZE[1]),
        usage: wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ,
        mapped_at_creation: false,
    });
    let mut encoder = device.create_command_encoder(&Default::default());
    encoder.copy_texture_to_buffer(
        texture.as_image_copy(),
        wgpu::TexelCopyBufferInfo {
            buffer: &buffer,
            layout: wgpu::TexelCopyBufferLayout {
                offset: 0,
                bytes_per_row: Some(row),
                rows_per_image: None,
            },
        },
        texture.size(),
    );
    queue.submit([encoder.finish()]);
    buffer.map_async(wgpu::MapMode::Read, .., |r| r.expect("a picture"));
    device
        .poll(wgpu::PollType::wait_indefinitely())
        .expect("a device");
    let mapped = buffer.get_mapped_range(..);
    #[cfg(feature = "v30")]
    let mapped = mapped.expect("a mapped buffer");
    let mut pixels = mapped.to_vec();
    if matches!(
        texture.format(),
        wgpu::TextureFormat::Bgra8Unorm | wgpu::TextureFormat::Bgra8UnormSrgb
    ) {
        pixels.chunks_mut(4).for_each(|p| p.swap(0, 2));
    }
    let file = std::fs::File::create(file).expect("a file");
    let mut png = png::Encoder::new(file, SIZE[0], SIZE[1]);
    png.set_color(png::ColorType::Rgba);
    png.write_header()
        .and_then(|mut w| w.write_image_data(&pixels))
        .expect("a file");
}
