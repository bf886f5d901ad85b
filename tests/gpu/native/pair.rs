//! A vertex and a fragment shader as their author wrote them, drawn by OpenGL: uniforms, attributes
//! and samplers by name.

use std::collections::BTreeMap;

use glow::HasContext as _;

use super::{Native, Pixels};

/// Texels and how they are sampled.
#[derive(Clone)]
pub struct Texture {
    /// Width and height of level 0.
    pub size: [i32; 2],
    /// RGBA8, each level's layers one after the other; six layers are a cube.
    pub levels: Vec<Vec<u8>>,
    pub layers: usize,
    pub srgb: bool,
    pub linear: bool,
    pub clamp: bool,
}

/// A vertex attribute in the buffer of its step.
pub struct Attribute {
    pub name: String,
    /// Added to the name's location: a matrix's column.
    pub column: u32,
    pub components: i32,
    pub offset: i32,
    pub integer: bool,
}

/// A vertex buffer.
pub struct Vertices {
    pub bytes: Vec<u8>,
    pub stride: i32,
    pub per_instance: bool,
    pub attributes: Vec<Attribute>,
}

/// Which row of the picture is number 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FirstRow {
    /// OpenGL's own.
    Lowest,
    /// WebGPU's, by `glClipControl`: quads begin at the same pixel, and so give the same
    /// derivatives.
    Highest,
    /// As [`FirstRow::Highest`], and depths are WebGPU's, 0 to 1.
    WebGpu,
}

/// What a uniform holds, by its name.
pub type Uniform<'a> = Box<dyn Fn(&str) -> Option<Vec<u8>> + 'a>;

/// One draw of triangles.
pub struct Draw<'a> {
    /// The bytes of the uniform of that name, array element and member included, or `None` if there
    /// is none: `lights[1].color`. Matrices' columns are 16 bytes apart.
    pub uniform: Uniform<'a>,
    /// Uniform blocks by name.
    pub blocks: BTreeMap<String, Vec<u8>>,
    pub textures: BTreeMap<String, Texture>,
    pub vertices: Vec<Vertices>,
    pub indices: Option<Vec<u32>>,
    pub first: i32,
    pub count: i32,
    pub instances: i32,
}

/// `GL_LOWER_LEFT`.
const LOWER_LEFT: u32 = 0x8CA1;
/// `GL_UPPER_LEFT`.
const UPPER_LEFT: u32 = 0x8CA2;
/// `GL_NEGATIVE_ONE_TO_ONE`.
const NEGATIVE_ONE_TO_ONE: u32 = 0x935E;
/// `GL_ZERO_TO_ONE`.
const ZERO_TO_ONE: u32 = 0x935F;

impl Native {
    /// `glProvokingVertex`, which glow does not list: the first one, as in WebGPU.
    unsafe fn first_vertex_provokes(&self) {
        let found = self.egl.get_proc_address("glProvokingVertex");
        let found = found.expect("OpenGL 3.2");
        // SAFETY: that is the function's type by the specification (OpenGL 4.5, section 13.4), and
        // the context is current.
        let call: extern "system" fn(u32) = unsafe { std::mem::transmute(found) };
        call(0x8E4D);
    }

    /// `glClipControl`, which glow does not list.
    unsafe fn clip_control(&self, origin: u32, depth: u32) {
        let found = self.egl.get_proc_address("glClipControl");
        let found = found.expect("OpenGL 4.5, or ARB_clip_control");
        // SAFETY: that is the function's type by the specification (OpenGL 4.5, section 13.5), and
        // the context is current.
        let call: extern "system" fn(u32, u32) = unsafe { std::mem::transmute(found) };
        call(origin, depth);
    }

    /// Draws, nearest first by depth, without culling, on a clear of `clear`. Rows come from the
    /// top. An error is what the driver says of the texts, or a uniform without a value.
    pub fn draw_pair(
        &self,
        first: FirstRow,
        size: [u32; 2],
        clear: [f32; 4],
        texts: [&str; 2],
        draws: &[Draw<'_>],
    ) -> Result<Pixels, String> {
        // SAFETY: as for `draw`: the context is current on this thread, and every buffer is as long
        // as is said.
        unsafe { self.draw_pair_checked(first, size, clear, texts, draws) }
    }

    unsafe fn draw_pair_checked(
        &self,
        first: FirstRow,
        size: [u32; 2],
        clear: [f32; 4],
        texts: [&str; 2],
        draws: &[Draw<'_>],
    ) -> Result<Pixels, String> {
        let gl = &self.gl;
        let [width, height] = size.map(|n| n as i32);
        unsafe {
            let program = self.link_pair(texts)?;
            gl.use_program(Some(program));
            let framebuffer = gl.create_framebuffer().unwrap();
            gl.bind_framebuffer(glow::FRAMEBUFFER, Some(framebuffer));
            for (attachment, format) in [
                (glow::COLOR_ATTACHMENT0, glow::RGBA8),
                (glow::DEPTH_ATTACHMENT, glow::DEPTH_COMPONENT32F),
            ] {
                let buffer = gl.create_renderbuffer().unwrap();
                gl.bind_renderbuffer(glow::RENDERBUFFER, Some(buffer));
                gl.renderbuffer_storage(glow::RENDERBUFFER, format, width, height);
                gl.framebuffer_renderbuffer(
                    glow::FRAMEBUFFER,
                    attachment,
                    glow::RENDERBUFFER,
                    Some(buffer),
                );
            }
            assert_eq!(
                gl.check_framebuffer_status(glow::FRAMEBUFFER),
                glow::FRAMEBUFFER_COMPLETE
            );
            gl.viewport(0, 0, width, height);
            gl.clear_color(clear[0], clear[1], clear[2], clear[3]);
            gl.clear_depth(1.0);
            match first {
                FirstRow::Lowest => {}
                FirstRow::Highest => self.clip_control(UPPER_LEFT, NEGATIVE_ONE_TO_ONE),
                FirstRow::WebGpu => self.clip_control(UPPER_LEFT, ZERO_TO_ONE),
            }
            gl.enable(glow::TEXTURE_CUBE_MAP_SEAMLESS);
            self.first_vertex_provokes();
            gl.disable(glow::CULL_FACE);
            gl.front_face(glow::CCW);
            gl.enable(glow::DEPTH_TEST);
            gl.depth_func(glow::LESS);
            gl.clear(glow::COLOR_BUFFER_BIT | glow::DEPTH_BUFFER_BIT);
            let drawn: Result<(), String> = draws
                .iter()
                .try_for_each(|draw| self.draw_one(program, draw));
            gl.pixel_store_i32(glow::PACK_ALIGNMENT, 1);
            let texels = (width * height) as usize;
            let mut color = vec![0; texels * 4];
            let mut depth = vec![0.0f32; texels];
            let into = glow::PixelPackData::Slice(Some(&mut color));
            gl.read_pixels(0, 0, width, height, glow::RGBA, glow::UNSIGNED_BYTE, into);
            let into = glow::PixelPackData::Slice(Some(bytemuck::cast_slice_mut(&mut depth)));
            gl.read_pixels(
                0,
                0,
                width,
                height,
                glow::DEPTH_COMPONENT,
                glow::FLOAT,
                into,
            );
            assert_eq!(gl.get_error(), glow::NO_ERROR);
            gl.delete_program(program);
            gl.delete_framebuffer(framebuffer);
            self.clip_control(LOWER_LEFT, NEGATIVE_ONE_TO_ONE);
            if first == FirstRow::Lowest {
                let width = width as usize;
                color = color
                    .chunks_exact(4 * width)
                    .rev()
                    .flatten()
                    .copied()
                    .collect();
                depth = depth.chunks_exact(width).rev().flatten().copied().collect();
            }
            drawn.map(|()| Pixels { color, depth })
        }
    }

    unsafe fn draw_one(&self, program: glow::Program, draw: &Draw<'_>) -> Result<(), String> {
        let gl = &self.gl;
        unsafe {
            let array = gl.create_vertex_array().unwrap();
            gl.bind_vertex_array(Some(array));
            for vertices in &draw.vertices {
                let buffer = gl.create_buffer().unwrap();
                gl.bind_buffer(glow::ARRAY_BUFFER, Some(buffer));
                gl.buffer_data_u8_slice(glow::ARRAY_BUFFER, &vertices.bytes, glow::STATIC_DRAW);
                for a in &vertices.attributes {
                    // What the driver sees no use for it drops.
                    let Some(location) = gl.get_attrib_location(program, &a.name) else {
                        continue;
                    };
                    let at = location + a.column;
                    gl.enable_vertex_attrib_array(at);
                    match a.integer {
                        true => gl.vertex_attrib_pointer_i32(
                            at,
                            a.components,
                            glow::UNSIGNED_INT,
                            vertices.stride,
                            a.offset,
                        ),
                        false => gl.vertex_attrib_pointer_f32(
                            at,
                            a.components,
                            glow::FLOAT,
                            false,
                            vertices.stride,
                            a.offset,
                        ),
                    }
                    gl.vertex_attrib_divisor(at, u32::from(vertices.per_instance));
                }
            }
            for i in 0..gl.get_active_uniforms(program) {
                let uniform = gl.get_active_uniform(program, i).unwrap();
                self.set_uniform(program, &uniform, draw)?;
            }
            for (slot, (name, bytes)) in draw.blocks.iter().enumerate() {
                let Some(index) = gl.get_uniform_block_index(program, name) else {
                    continue;
                };
                gl.uniform_block_binding(program, index, slot as u32);
                let buffer = gl.create_buffer().unwrap();
                gl.bind_buffer(glow::UNIFORM_BUFFER, Some(buffer));
                gl.buffer_data_u8_slice(glow::UNIFORM_BUFFER, bytes, glow::STATIC_DRAW);
                gl.bind_buffer_base(glow::UNIFORM_BUFFER, slot as u32, Some(buffer));
            }
            let instances = draw.instances;
            match &draw.indices {
                Some(all) => {
                    let buffer = gl.create_buffer().unwrap();
                    gl.bind_buffer(glow::ELEMENT_ARRAY_BUFFER, Some(buffer));
                    gl.buffer_data_u8_slice(
                        glow::ELEMENT_ARRAY_BUFFER,
                        bytemuck::cast_slice(all),
                        glow::STATIC_DRAW,
                    );
                    gl.draw_elements_instanced(
                        glow::TRIANGLES,
                        draw.count,
                        glow::UNSIGNED_INT,
                        4 * draw.first,
                        instances,
                    );
                }
                None => {
                    gl.draw_arrays_instanced(glow::TRIANGLES, draw.first, draw.count, instances)
                }
            }
            gl.delete_vertex_array(array);
        }
        Ok(())
    }

    unsafe fn set_uniform(
        &self,
        program: glow::Program,
        uniform: &glow::ActiveUniform,
        draw: &Draw<'_>,
    ) -> Result<(), String> {
        let gl = &self.gl;
        let base = uniform.name.trim_end_matches("[0]");
        for element in 0..uniform.size {
            let name = match uniform.name.ends_with("[0]") {
                true => format!("{base}[{element}]"),
                false => base.to_owned(),
            };
            unsafe {
                // A block's members have no location.
                let Some(location) = gl.get_uniform_location(program, &name) else {
                    continue;
                };
                let location = Some(&location);
                if let Some(texture) = draw.textures.get(&name) {
                    let unit = draw.textures.keys().position(|k| *k == name).unwrap() as u32;
                    self.bind_texture(unit, texture, uniform.utype);
                    gl.uniform_1_i32(location, unit as i32);
                    continue;
                }
                // A sampler that only the driver takes for used reads black.
                if matches!(uniform.utype, glow::SAMPLER_2D | glow::SAMPLER_CUBE) {
                    continue;
                }
                let Some(bytes) = (draw.uniform)(&name) else {
                    return Err(format!("the uniform `{name}` has no value"));
                };
                let word = |i: usize| <[u8; 4]>::try_from(&bytes[4 * i..4 * i + 4]).unwrap();
                let f = |i: usize| f32::from_le_bytes(word(i));
                let n = |i: usize| i32::from_le_bytes(word(i));
                let floats = |count: usize| (0..count).map(f).collect::<Vec<f32>>();
                // A matrix's columns begin every four words.
                let matrix = |columns: usize, rows: usize| {
                    (0..columns * rows)
                        .map(|i| f(i / rows * 4 + i % rows))
                        .collect::<Vec<f32>>()
                };
                match uniform.utype {
                    glow::FLOAT => gl.uniform_1_f32(location, f(0)),
                    glow::FLOAT_VEC2 => gl.uniform_2_f32_slice(location, &floats(2)),
                    glow::FLOAT_VEC3 => gl.uniform_3_f32_slice(location, &floats(3)),
                    glow::FLOAT_VEC4 => gl.uniform_4_f32_slice(location, &floats(4)),
                    glow::INT | glow::BOOL => gl.uniform_1_i32(location, n(0)),
                    glow::INT_VEC2 | glow::BOOL_VEC2 => gl.uniform_2_i32(location, n(0), n(1)),
                    glow::INT_VEC3 | glow::BOOL_VEC3 => {
                        gl.uniform_3_i32(location, n(0), n(1), n(2))
                    }
                    glow::INT_VEC4 | glow::BOOL_VEC4 => {
                        gl.uniform_4_i32(location, n(0), n(1), n(2), n(3))
                    }
                    glow::UNSIGNED_INT => gl.uniform_1_u32(location, n(0) as u32),
                    glow::FLOAT_MAT2x3 => {
                        gl.uniform_matrix_2x3_f32_slice(location, false, &matrix(2, 3))
                    }
                    glow::FLOAT_MAT3x2 => {
                        gl.uniform_matrix_3x2_f32_slice(location, false, &matrix(3, 2))
                    }
                    glow::FLOAT_MAT3x4 => {
                        gl.uniform_matrix_3x4_f32_slice(location, false, &matrix(3, 4))
                    }
                    glow::FLOAT_MAT4x2 => {
                        gl.uniform_matrix_4x2_f32_slice(location, false, &matrix(4, 2))
                    }
                    glow::FLOAT_MAT2 => {
                        gl.uniform_matrix_2_f32_slice(location, false, &matrix(2, 2))
                    }
                    glow::FLOAT_MAT3 => {
                        gl.uniform_matrix_3_f32_slice(location, false, &matrix(3, 3))
                    }
                    glow::FLOAT_MAT4 => {
                        gl.uniform_matrix_4_f32_slice(location, false, &matrix(4, 4))
                    }
                    glow::FLOAT_MAT4x3 => {
                        gl.uniform_matrix_4x3_f32_slice(location, false, &matrix(4, 3))
                    }
                    glow::FLOAT_MAT2x4 => {
                        gl.uniform_matrix_2x4_f32_slice(location, false, &matrix(2, 4))
                    }
                    other => return Err(format!("the uniform `{name}` is of type {other:#x}")),
                }
            }
        }
        Ok(())
    }

    unsafe fn bind_texture(&self, unit: u32, texture: &Texture, sampler: u32) {
        let gl = &self.gl;
        unsafe {
            let made = gl.create_texture().unwrap();
            gl.active_texture(glow::TEXTURE0 + unit);
            let cube = texture.layers == 6;
            let target = match sampler {
                glow::SAMPLER_2D_ARRAY => glow::TEXTURE_2D_ARRAY,
                _ if cube => glow::TEXTURE_CUBE_MAP,
                _ => glow::TEXTURE_2D,
            };
            gl.bind_texture(target, Some(made));
            gl.pixel_store_i32(glow::UNPACK_ALIGNMENT, 1);
            let format = match texture.srgb {
                true => glow::SRGB8_ALPHA8,
                false => glow::RGBA8,
            };
            for (level, texels) in texture.levels.iter().enumerate() {
                let [w, h] = texture.size.map(|n| (n >> level).max(1));
                let layer = (4 * w * h) as usize;
                if target == glow::TEXTURE_2D_ARRAY {
                    gl.tex_image_3d(
                        target,
                        level as i32,
                        format as i32,
                        w,
                        h,
                        texture.layers as i32,
                        0,
                        glow::RGBA,
                        glow::UNSIGNED_BYTE,
                        glow::PixelUnpackData::Slice(Some(&texels[..texture.layers * layer])),
                    );
                    continue;
                }
                for i in 0..texture.layers {
                    let face = if cube {
                        glow::TEXTURE_CUBE_MAP_POSITIVE_X + i as u32
                    } else {
                        target
                    };
                    let bytes = &texels[i * layer..(i + 1) * layer];
                    let data = glow::PixelUnpackData::Slice(Some(bytes));
                    gl.tex_image_2d(
                        face,
                        level as i32,
                        format as i32,
                        w,
                        h,
                        0,
                        glow::RGBA,
                        glow::UNSIGNED_BYTE,
                        data,
                    );
                }
            }
            let (far, near) = match texture.linear {
                true => (glow::LINEAR_MIPMAP_LINEAR, glow::LINEAR),
                false => (glow::NEAREST_MIPMAP_NEAREST, glow::NEAREST),
            };
            let wrap = if texture.clamp {
                glow::CLAMP_TO_EDGE
            } else {
                glow::REPEAT
            };
            gl.tex_parameter_i32(
                target,
                glow::TEXTURE_MAX_LEVEL,
                texture.levels.len() as i32 - 1,
            );
            gl.tex_parameter_i32(target, glow::TEXTURE_MIN_FILTER, far as i32);
            gl.tex_parameter_i32(target, glow::TEXTURE_MAG_FILTER, near as i32);
            gl.tex_parameter_i32(target, glow::TEXTURE_WRAP_S, wrap as i32);
            gl.tex_parameter_i32(target, glow::TEXTURE_WRAP_T, wrap as i32);
        }
    }

    unsafe fn link_pair(&self, texts: [&str; 2]) -> Result<glow::Program, String> {
        let gl = &self.gl;
        unsafe {
            let program = gl.create_program().unwrap();
            for (kind, text) in [glow::VERTEX_SHADER, glow::FRAGMENT_SHADER]
                .into_iter()
                .zip(texts)
            {
                let shader = gl.create_shader(kind).unwrap();
                gl.shader_source(shader, text);
                gl.compile_shader(shader);
                let log = gl.get_shader_info_log(shader);
                if !gl.get_shader_compile_status(shader) {
                    return Err(log);
                }
                gl.attach_shader(program, shader);
                gl.delete_shader(shader);
            }
            gl.link_program(program);
            let log = gl.get_program_info_log(program);
            match gl.get_program_link_status(program) {
                true => Ok(program),
                false => Err(log),
            }
        }
    }
}
