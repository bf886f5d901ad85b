//! A frame folder made by a test: an earlier pass fills a texture, and the main pass draws two quads with it.

use std::fs;
use std::path::PathBuf;

use serde_json::{Value, json};

/// Width and height of the pictures.
pub const SIZE: u32 = 16;

/// The colour that the earlier pass fills the texture with, as bytes.
pub const FILLED: [u8; 4] = [51, 102, 153, 255];

const SHADER: &str = "
requires subgroup_id;
struct Draw { scale: vec2f, depth: f32, tint: f32 }
@group(0) @binding(0) var<uniform> draw: Draw;
@group(1) @binding(0) var image: texture_2d<f32>;
@group(1) @binding(1) var linear: sampler;
struct Out { @builtin(position) at: vec4f, @location(0) uv: vec2f }
@vertex fn main(@location(0) p: vec2f) -> Out {
    return Out(vec4f(p * draw.scale, draw.depth, 1.0), p * 0.5 + 0.5);
}
@fragment fn shaded(in: Out) -> @location(0) vec4f {
    return vec4f(textureSample(image, linear, in.uv).rgb * draw.tint, 1.0);
}";

const FILL: &str = "
@vertex fn main(@builtin(vertex_index) i: u32) -> @builtin(position) vec4f {
    return vec4f(f32(i & 1u) * 4.0 - 1.0, f32(i >> 1u) * 4.0 - 1.0, 0.0, 1.0);
}
@fragment fn filled() -> @location(0) vec4f { return vec4f(0.2, 0.4, 0.6, 1.0); }";

/// The folder's file and its data, before it is written.
pub struct Folder {
    pub file: Value,
    data: Vec<Vec<u8>>,
}

/// The name of a data file.
pub fn name(index: usize) -> String {
    format!("{index:032x}")
}

fn floats(numbers: &[f32]) -> Vec<u8> {
    numbers.iter().flat_map(|n| n.to_le_bytes()).collect()
}

/// The near quad covers the middle at half the brightness, and the far one, drawn first, everything.
pub fn folder() -> Folder {
    let quad = [
        [-1.0, -1.0],
        [1.0, -1.0],
        [-1.0, 1.0],
        [-1.0, 1.0],
        [1.0, -1.0],
        [1.0, 1.0],
    ];
    let far = floats(&[1.0, 1.0, 0.75, 1.0]);
    let near = floats(&[0.5, 0.5, 0.25, 0.0]);
    let mut uniforms = far;
    uniforms.resize(256, 0);
    uniforms.extend(near);
    let picture = (0..SIZE * SIZE).flat_map(|i| {
        let is_middle = |n: u32| (SIZE / 4..SIZE * 3 / 4).contains(&n);
        match is_middle(i % SIZE) && is_middle(i / SIZE) {
            true => [0, 0, 0, 255],
            false => FILLED,
        }
    });
    let data = vec![
        floats(quad.as_flattened()),
        uniforms,
        SHADER.as_bytes().to_vec(),
        FILL.as_bytes().to_vec(),
        picture.collect(),
    ];
    let texture = |format: &str, usage: u32| json!({ "size": [SIZE, SIZE, 1], "format": format, "usage": usage });
    let draw = |offset: u32| {
        json!([
            { "do": "setBindGroup", "index": 0, "bindGroup": 0, "dynamicOffsets": [offset] },
            { "do": "draw", "vertexCount": 6 },
        ])
    };
    let mut commands = vec![
        json!({ "do": "setPipeline", "pipeline": 1 }),
        json!({ "do": "setVertexBuffer", "slot": 0, "buffer": 0 }),
        json!({ "do": "setBindGroup", "index": 1, "bindGroup": 1 }),
    ];
    for offset in [0, 256] {
        commands.extend(draw(offset).as_array().unwrap().iter().cloned());
    }
    let file = json!({
        "schema": "preshade.frames.v1",
        "source": { "api": "webgpu", "writer": "a test" },
        "buffers": [{ "size": 48, "usage": 32 }, { "size": 272, "usage": 64 }],
        "textures": [
            texture("rgba8unorm", 17),
            texture("rgba8unorm", 20),
            texture("depth24plus", 16),
        ],
        "samplers": [{ "magFilter": "linear" }],
        "shaders": [
            { "data": name(2), "language": "wgsl" },
            { "data": name(3), "language": "wgsl" },
        ],
        "bindGroupLayouts": [
            { "entries": [{ "binding": 0, "visibility": 3, "buffer": { "hasDynamicOffset": true } }] },
            { "entries": [
                { "binding": 0, "visibility": 2, "texture": {} },
                { "binding": 1, "visibility": 2, "sampler": {} },
            ] },
        ],
        "pipelineLayouts": [{ "bindGroupLayouts": [0, 1] }],
        "bindGroups": [
            { "layout": 0, "entries": [{ "binding": 0, "buffer": 1, "size": 16 }] },
            { "layout": 1, "entries": [
                { "binding": 0, "texture": 1, "view": {} },
                { "binding": 1, "sampler": 0 },
            ] },
        ],
        "renderPipelines": [
            {
                "layout": "auto",
                "vertex": { "module": 1 },
                "fragment": { "module": 1, "targets": [{ "format": "rgba8unorm" }] },
            },
            {
                "label": "quads",
                "layout": 0,
                "vertex": { "module": 0, "buffers": [{
                    "arrayStride": 8,
                    "attributes": [{ "format": "float32x2", "offset": 0, "shaderLocation": 0 }],
                }] },
                "fragment": {
                    "module": 0,
                    "entryPoint": "shaded",
                    "targets": [{ "format": "rgba8unorm" }],
                },
                "depthStencil": {
                    "format": "depth24plus",
                    "depthWriteEnabled": true,
                    "depthCompare": "less",
                },
            },
        ],
        "start": { "buffers": [{ "buffer": 0, "data": name(0) }] },
        "frames": [{
            "size": [SIZE, SIZE],
            "canvas": 0,
            "commands": [
                { "do": "writeBuffer", "buffer": 1, "data": name(1) },
                {
                    "do": "renderPass",
                    "descriptor": { "colorAttachments": [
                        { "view": { "texture": 1 }, "loadOp": "clear" },
                    ] },
                    "commands": [
                        { "do": "setPipeline", "pipeline": 0 },
                        { "do": "draw", "vertexCount": 3 },
                    ],
                },
                {
                    "do": "renderPass",
                    "descriptor": {
                        "colorAttachments": [{ "view": { "texture": 0 }, "loadOp": "clear" }],
                        "depthStencilAttachment": {
                            "view": { "texture": 2 },
                            "depthLoadOp": "clear",
                            "depthClearValue": 1.0,
                            "depthStoreOp": "discard",
                        },
                    },
                    "commands": commands,
                },
            ],
            "picture": { "data": name(4), "format": "rgba8unorm", "size": [SIZE, SIZE] },
        }],
    });
    Folder { file, data }
}

const POINT: [&str; 2] = [
    "#version 300 es
#extension GL_ANGLE_multi_draw : require
uniform mat2 turn; in vec2 at; out float blue;
void main() {
    gl_Position = vec4(at, 0.0, 1.0);
    gl_PointSize = 8.0;
    blue = (turn * vec2(0.0, 1.0)).y * float(gl_DrawID);
}",
    "#version 300 es
precision highp float; in float blue; out vec4 color;
void main() { color = vec4(step(gl_PointCoord, vec2(0.5)), blue, 1.0); }",
];

/// A frame of WebGL: one point of eight pixels in the middle, in the second draw of a `multiDraw`.
pub fn point() -> Folder {
    let picture = (0..SIZE * SIZE).flat_map(|i| {
        let [x, y] = [i % SIZE, i / SIZE];
        let is_in = |n: u32| (SIZE / 2 - 4..SIZE / 2 + 4).contains(&n);
        let first = |n: u32| if n < SIZE / 2 { 255 } else { 0 };
        match is_in(x) && is_in(y) {
            true => [first(x), first(y), 153, 255],
            false => [0, 0, 0, 255],
        }
    });
    let data = vec![
        floats(&[0.0, 0.0]),
        POINT[0].as_bytes().to_vec(),
        POINT[1].as_bytes().to_vec(),
        picture.collect(),
    ];
    let shader = |index| json!({ "data": name(index), "language": "glsl-es-300" });
    let file = json!({
        "schema": "preshade.frames.v1",
        "source": { "api": "webgl2", "writer": "a test" },
        "buffers": [{ "size": 8, "usage": 32 }],
        "textures": [{ "size": [SIZE, SIZE, 1], "format": "rgba8unorm", "usage": 16 }],
        "shaders": [shader(1), shader(2)],
        "renderPipelines": [{
            "layout": "auto",
            "vertex": { "module": 0, "entryPoint": "main", "buffers": [{
                "arrayStride": 8,
                "attributes": [{ "format": "float32x2", "offset": 0, "name": "at" }],
            }] },
            "fragment": {
                "module": 1,
                "entryPoint": "main",
                "targets": [{ "format": "rgba8unorm" }],
            },
            "primitive": { "topology": "point-list" },
        }],
        "named": [{ "uniforms": { "turn": [1, 0, 0.2, 0.6], "gl_DrawID": [1] } }],
        "start": { "buffers": [{ "buffer": 0, "data": name(0) }] },
        "frames": [{
            "size": [SIZE, SIZE],
            "canvas": 0,
            "commands": [{
                "do": "renderPass",
                "descriptor": { "colorAttachments": [{
                    "view": { "texture": 0 },
                    "loadOp": "clear",
                    "clearValue": [0, 0, 0, 1],
                }] },
                "commands": [
                    { "do": "setPipeline", "pipeline": 0 },
                    { "do": "setNamed", "named": 0 },
                    { "do": "setVertexBuffer", "slot": 0, "buffer": 0 },
                    { "do": "setViewport", "x": 0, "y": 0, "width": SIZE, "height": SIZE },
                    { "do": "draw", "vertexCount": 1 },
                ],
            }],
            "picture": { "data": name(3), "format": "rgba8unorm", "size": [SIZE, SIZE] },
        }],
    });
    Folder { file, data }
}

impl Folder {
    /// Writes the folder below the system's temporary one. `called` tells tests apart.
    pub fn write(&self, called: &str) -> PathBuf {
        let own = format!("preshade-capture-{}-{called}", std::process::id());
        let folder = std::env::temp_dir().join(own);
        fs::create_dir_all(folder.join("data")).unwrap();
        for (index, bytes) in self.data.iter().enumerate() {
            let path = folder.join("data").join(format!("{}.bin", name(index)));
            fs::write(path, bytes).unwrap();
        }
        fs::write(folder.join("frame.json"), self.file.to_string()).unwrap();
        folder
    }
}
