//! OpenGL 4.0 without a window: one draw of patches, read back. The only place in the tests that
//! talks to a driver behind wgpu's back.
//!
//! Needed: libEGL and a driver with OpenGL 4.0; on Debian and Ubuntu `scripts/setup.sh gl` installs
//! Mesa's, which needs no graphics card. Where they are missing everything here panics and says so:
//! a skipped picture proves nothing.
#![allow(unsafe_code)]

pub mod both;
pub mod generate;
pub mod pair;

use glow::HasContext as _;
use khronos_egl as egl;

/// `EGL_PLATFORM_SURFACELESS_MESA`.
const SURFACELESS: egl::Enum = 0x31DD;

const INSTALL: &str = "on Debian and Ubuntu `scripts/setup.sh gl` installs Mesa's software OpenGL";

/// One attribute: floats, interleaved in the vertex buffer.
pub struct Attribute {
    pub location: u32,
    pub components: i32,
    pub offset: i32,
}

/// A draw of patches of three vertices.
pub struct PatchDraw<'a> {
    /// Width and height.
    pub size: [u32; 2],
    pub clear_color: [f32; 4],
    /// Texts of the vertex, control, evaluation and fragment stages.
    pub stages: [&'a str; 4],
    /// The uniform `tessellation_level`.
    pub level: f32,
    /// Uniform blocks by name, and what each holds.
    pub blocks: Vec<(&'a str, &'a [u8])>,
    pub vertices: &'a [u8],
    pub stride: i32,
    pub attributes: Vec<Attribute>,
    pub indices: Vec<u32>,
}

/// What was drawn, from the lowest row on.
pub struct Pixels {
    /// Red, green, blue and alpha.
    pub color: Vec<u8>,
    /// In 0..1.
    pub depth: Vec<f32>,
}

/// A context, current on the thread that made it.
pub struct Native {
    egl: egl::DynamicInstance<egl::EGL1_5>,
    display: egl::Display,
    context: egl::Context,
    gl: glow::Context,
}

impl Drop for Native {
    fn drop(&mut self) {
        // What fails here was lost already.
        let _ = self.egl.make_current(self.display, None, None, None);
        let _ = self.egl.destroy_context(self.display, self.context);
    }
}

impl Native {
    pub fn new() -> Self {
        // SAFETY: loading the system's libEGL runs its initialisers, which every program that draws
        // trusts.
        let egl = unsafe { egl::DynamicInstance::<egl::EGL1_5>::load_required() }
            .unwrap_or_else(|e| panic!("no EGL 1.5 ({e}): {INSTALL}"));
        // SAFETY: the surfaceless platform has one display, and takes no native one.
        let display = unsafe {
            egl.get_platform_display(SURFACELESS, egl::DEFAULT_DISPLAY, &[egl::ATTRIB_NONE])
        }
        .unwrap_or_else(|e| panic!("EGL has no surfaceless platform ({e}): {INSTALL}"));
        egl.initialize(display)
            .unwrap_or_else(|e| panic!("EGL does not start ({e}): {INSTALL}"));
        egl.bind_api(egl::OPENGL_API)
            .unwrap_or_else(|e| panic!("EGL has no desktop OpenGL ({e}): {INSTALL}"));
        let wanted = [
            egl::SURFACE_TYPE,
            egl::PBUFFER_BIT,
            egl::RENDERABLE_TYPE,
            egl::OPENGL_BIT,
            egl::NONE,
        ];
        let config = egl.choose_first_config(display, &wanted);
        let config = config.ok().flatten();
        let config = config.unwrap_or_else(|| panic!("EGL has no OpenGL configuration: {INSTALL}"));
        let version = [
            egl::CONTEXT_MAJOR_VERSION,
            4,
            egl::CONTEXT_MINOR_VERSION,
            0,
            egl::CONTEXT_OPENGL_PROFILE_MASK,
            egl::CONTEXT_OPENGL_CORE_PROFILE_BIT,
            egl::NONE,
        ];
        let context = egl
            .create_context(display, config, None, &version)
            .unwrap_or_else(|e| panic!("the driver has no OpenGL 4.0 ({e}): {INSTALL}"));
        egl.make_current(display, None, None, Some(context))
            .unwrap_or_else(|e| panic!("no context without a surface ({e}): {INSTALL}"));
        // SAFETY: the context is current, and EGL gives its functions by their names.
        let gl = unsafe {
            glow::Context::from_loader_function(|name| {
                egl.get_proc_address(name)
                    .map_or(std::ptr::null(), |f| f as *const _)
            })
        };
        Self {
            egl,
            display,
            context,
            gl,
        }
    }

    /// The driver's name for what it draws with.
    pub fn renderer(&self) -> String {
        // SAFETY: the context is current on this thread: it can neither be sent nor shared (it
        // holds raw pointers).
        unsafe { self.gl.get_parameter_string(glow::RENDERER) }
    }

    /// Draws once. Depth is compared by `LESS`, and what turns counter-clockwise is culled:
    /// positions come upside down, as WebGPU's do on OpenGL.
    pub fn draw(&self, draw: &PatchDraw<'_>) -> Pixels {
        // SAFETY: the context is current on this thread. Buffers are as long as what is said to be
        // in them: `buffer_data` copies slices whole, the indices are checked against the vertices
        // here, and each block against the size that the program says it has. The slices that
        // pixels are read into hold the whole framebuffer at the alignment set.
        unsafe { self.draw_checked(draw) }
    }

    unsafe fn draw_checked(&self, draw: &PatchDraw<'_>) -> Pixels {
        let gl = &self.gl;
        let [width, height] = draw.size.map(|n| n as i32);
        let count = draw.vertices.len() as u32 / draw.stride as u32;
        assert!(draw.indices.iter().all(|i| *i < count));
        for a in &draw.attributes {
            assert!(a.offset + 4 * a.components <= draw.stride);
        }
        unsafe {
            let program = self.link(draw.stages);
            gl.use_program(Some(program));

            let framebuffer = gl.create_framebuffer().unwrap();
            gl.bind_framebuffer(glow::FRAMEBUFFER, Some(framebuffer));
            let attachments = [
                (glow::COLOR_ATTACHMENT0, glow::RGBA8),
                (glow::DEPTH_ATTACHMENT, glow::DEPTH_COMPONENT32F),
            ];
            let mut buffers = Vec::new();
            for (attachment, format) in attachments {
                let buffer = gl.create_renderbuffer().unwrap();
                gl.bind_renderbuffer(glow::RENDERBUFFER, Some(buffer));
                gl.renderbuffer_storage(glow::RENDERBUFFER, format, width, height);
                gl.framebuffer_renderbuffer(
                    glow::FRAMEBUFFER,
                    attachment,
                    glow::RENDERBUFFER,
                    Some(buffer),
                );
                buffers.push(buffer);
            }
            let status = gl.check_framebuffer_status(glow::FRAMEBUFFER);
            assert_eq!(status, glow::FRAMEBUFFER_COMPLETE);

            let array = gl.create_vertex_array().unwrap();
            gl.bind_vertex_array(Some(array));
            let vertices = gl.create_buffer().unwrap();
            gl.bind_buffer(glow::ARRAY_BUFFER, Some(vertices));
            gl.buffer_data_u8_slice(glow::ARRAY_BUFFER, draw.vertices, glow::STATIC_DRAW);
            for a in &draw.attributes {
                gl.enable_vertex_attrib_array(a.location);
                let (at, n) = (a.location, a.components);
                gl.vertex_attrib_pointer_f32(at, n, glow::FLOAT, false, draw.stride, a.offset);
            }
            let indices = gl.create_buffer().unwrap();
            gl.bind_buffer(glow::ELEMENT_ARRAY_BUFFER, Some(indices));
            let bytes: &[u8] = bytemuck::cast_slice(&draw.indices);
            gl.buffer_data_u8_slice(glow::ELEMENT_ARRAY_BUFFER, bytes, glow::STATIC_DRAW);
            let mut uniforms = Vec::new();
            for (slot, (name, bytes)) in draw.blocks.iter().enumerate() {
                let index = gl.get_uniform_block_index(program, name);
                let index = index.unwrap_or_else(|| panic!("the program has no block `{name}`"));
                let size = gl.get_active_uniform_block_parameter_i32(
                    program,
                    index,
                    glow::UNIFORM_BLOCK_DATA_SIZE,
                );
                assert!(size as usize <= bytes.len(), "{name}: {size}");
                gl.uniform_block_binding(program, index, slot as u32);
                let buffer = gl.create_buffer().unwrap();
                gl.bind_buffer(glow::UNIFORM_BUFFER, Some(buffer));
                gl.buffer_data_u8_slice(glow::UNIFORM_BUFFER, bytes, glow::STATIC_DRAW);
                gl.bind_buffer_base(glow::UNIFORM_BUFFER, slot as u32, Some(buffer));
                uniforms.push(buffer);
            }
            let level = gl.get_uniform_location(program, "tessellation_level");
            assert!(level.is_some());
            gl.uniform_1_f32(level.as_ref(), draw.level);

            let [r, g, b, a] = draw.clear_color;
            gl.viewport(0, 0, width, height);
            gl.clear_color(r, g, b, a);
            gl.clear_depth(1.0);
            gl.clear(glow::COLOR_BUFFER_BIT | glow::DEPTH_BUFFER_BIT);
            gl.enable(glow::DEPTH_TEST);
            gl.depth_func(glow::LESS);
            gl.enable(glow::CULL_FACE);
            gl.cull_face(glow::BACK);
            gl.front_face(glow::CW);
            gl.patch_parameter_i32(glow::PATCH_VERTICES, 3);
            let count = draw.indices.len() as i32;
            gl.draw_elements(glow::PATCHES, count, glow::UNSIGNED_INT, 0);

            gl.pixel_store_i32(glow::PACK_ALIGNMENT, 1);
            let texels = (width * height) as usize;
            let mut color = vec![0; texels * 4];
            let mut depth = vec![0.0f32; texels];
            let into = glow::PixelPackData::Slice(Some(&mut color));
            gl.read_pixels(0, 0, width, height, glow::RGBA, glow::UNSIGNED_BYTE, into);
            let into = glow::PixelPackData::Slice(Some(bytemuck::cast_slice_mut(&mut depth)));
            let format = glow::DEPTH_COMPONENT;
            gl.read_pixels(0, 0, width, height, format, glow::FLOAT, into);
            assert_eq!(gl.get_error(), glow::NO_ERROR);

            gl.delete_program(program);
            gl.delete_framebuffer(framebuffer);
            gl.delete_vertex_array(array);
            buffers.into_iter().for_each(|b| gl.delete_renderbuffer(b));
            uniforms.extend([vertices, indices]);
            uniforms.into_iter().for_each(|b| gl.delete_buffer(b));
            Pixels { color, depth }
        }
    }

    unsafe fn link(&self, stages: [&str; 4]) -> glow::Program {
        let gl = &self.gl;
        let kinds = [
            glow::VERTEX_SHADER,
            glow::TESS_CONTROL_SHADER,
            glow::TESS_EVALUATION_SHADER,
            glow::FRAGMENT_SHADER,
        ];
        unsafe {
            let program = gl.create_program().unwrap();
            for (kind, text) in kinds.into_iter().zip(stages) {
                let shader = gl.create_shader(kind).unwrap();
                gl.shader_source(shader, text);
                gl.compile_shader(shader);
                let log = gl.get_shader_info_log(shader);
                assert!(gl.get_shader_compile_status(shader), "{log}\n{text}");
                gl.attach_shader(program, shader);
                gl.delete_shader(shader);
            }
            gl.link_program(program);
            let log = gl.get_program_info_log(program);
            assert!(gl.get_program_link_status(program), "{log}");
            program
        }
    }
}
