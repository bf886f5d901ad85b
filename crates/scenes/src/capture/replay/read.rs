//! Reads contents of buffers and textures back.

use super::Replay;
use crate::capture::Error;
use crate::capture::texels::Shown;
use preshade_draw::render::readback;
use preshade_draw::scene::Image;
use preshade_frames::file::View;
use preshade_frames::folder::get;

impl Replay<'_> {
    /// The bytes of a buffer.
    ///
    /// # Errors
    /// The buffer does not exist, or the device is lost.
    pub fn read_buffer(&mut self, buffer: usize) -> Result<Vec<u8>, Error> {
        self.flush()?;
        let what = format!("buffer {buffer}");
        let from = self.buffer(buffer, &what)?.clone();
        let copy = self.gpu.checked(&what, || {
            self.gpu.device.create_buffer(&wgpu::BufferDescriptor {
                label: Some("readback"),
                size: from.size(),
                usage: wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ,
                mapped_at_creation: false,
            })
        })?;
        self.encode(|e| e.copy_buffer_to_buffer(&from, 0, &copy, 0, from.size()));
        self.flush()?;
        let mut bytes = self.gpu.read_buffer(&copy)?;
        let own = get(&self.capture.file.buffers, buffer, "buffer", &what)?.size;
        bytes.truncate(own as usize);
        Ok(bytes)
    }

    /// The levels and layers of a view.
    ///
    /// # Errors
    /// The texture does not exist, or the device is lost.
    pub fn read_view(&mut self, view: &View) -> Result<Image, Error> {
        self.flush()?;
        let place = format!("texture {}", view.texture);
        let texture = self.texture(view.texture, &place)?.clone();
        let of = get(&self.capture.file.textures, view.texture, "texture", &place)?;
        let mut of = of.clone();
        // Compressed texels may have been decoded on upload.
        of.format = self.readable(of.format);
        let of = &of;
        let shown = Shown::of(of, view);
        let mut levels = Vec::new();
        for level in shown.levels.clone() {
            let mut bytes = Vec::new();
            for layer in shown.layers.clone() {
                let size = shown.size(of, level);
                let is_flat_depth = shown.aspect == wgpu::TextureAspect::DepthOnly
                    && !matches!(
                        texture.format(),
                        wgpu::TextureFormat::Depth16Unorm
                            | wgpu::TextureFormat::Depth32Float
                            | wgpu::TextureFormat::Depth32FloatStencil8
                    );
                bytes.extend(match is_flat_depth {
                    true => readback::depth_values(self.gpu, &texture, [level, layer])?
                        .iter()
                        .flat_map(|v| v.to_le_bytes())
                        .collect(),
                    false => readback::level(
                        self.gpu,
                        &texture,
                        shown.aspect,
                        shown.format,
                        [level, layer],
                        size,
                    )?,
                });
            }
            levels.push(bytes);
        }
        Ok(shown.image(of, levels))
    }
}
