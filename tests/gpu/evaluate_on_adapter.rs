//! What the interpreter makes of functions of bits, and of some of floats, is what the adapter
//! makes of them.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use glam::{Mat4, Vec3};
use naga_interp::{Environment, Scalar, Value};
use preshade_compiler::front;
use preshade_draw::render::{ColorImage, FrameSettings, Prepared, SceneInputs};
use preshade_draw::scene::{
    Camera, Draw, DrawOrder, DrawRange, Frame, Light, Material, Mesh, Scene, Stream,
};
use preshade_lab::measure::originals;
use preshade_plan::state::{
    ColorTarget, CullMode, DepthDirection, DepthFormat, MaterialState, PrimitiveState,
};
use preshade_scenes::ShaderForm;
use shader_text::options;

use crate::render_support::gpu;

/// Words made of two words `w` and `v`, and of floats between -8 and 8 made of them, `a` and `b`.
const EXACT: &[&str] = &[
    "countTrailingZeros(w)",
    "bitcast<u32>(countTrailingZeros(bitcast<i32>(w)))",
    "countLeadingZeros(w)",
    "bitcast<u32>(countLeadingZeros(bitcast<i32>(w)))",
    "countOneBits(w)",
    "reverseBits(w)",
    "firstTrailingBit(w)",
    "bitcast<u32>(firstTrailingBit(bitcast<i32>(w)))",
    "firstLeadingBit(w)",
    "bitcast<u32>(firstLeadingBit(bitcast<i32>(w)))",
    "extractBits(w, v & 63u, (v >> 6u) & 63u)",
    "bitcast<u32>(extractBits(bitcast<i32>(w), v & 63u, (v >> 6u) & 63u))",
    "insertBits(w, v, v & 63u, (v >> 6u) & 63u)",
    "pack4x8snorm(fields(w))",
    "pack4x8unorm(fields(w))",
    "pack2x16snorm(unpack2x16snorm(w))",
    "pack2x16unorm(unpack2x16unorm(w))",
    "pack2x16float(vec2<f32>(f32(w & 2047u), -f32(v & 2047u)) / 8.0)",
    "pack4xI8(vec4<i32>(extremes(w)))",
    "pack4xU8(vec4<u32>(extremes(w)))",
    "pack4xI8Clamp(vec4<i32>(extremes(w)))",
    "pack4xU8Clamp(vec4<u32>(abs(extremes(w))))",
    "pack4xI8(unpack4xI8(w) / 3)",
    "pack4xU8(unpack4xU8(w) / 3u)",
    "bitcast<u32>(dot4I8Packed(w, v))",
    "dot4U8Packed(w, v)",
    "bitcast<u32>(frexp(a).fract)",
    "bitcast<u32>(frexp(vec2<f32>(b, a)).exp.y)",
    "bitcast<u32>(ldexp(a, i32(w & 15u) - 7))",
    "bitcast<u32>(modf(a).whole)",
    "bitcast<u32>(quantizeToF16(f32(w & 2047u) / 8.0))",
    "bitcast<u32>(i32(a * 1e9))",
    "u32(a * 1e9)",
    // By zero nothing is divided: the renderer leaves the language's checks out.
    "bitcast<u32>((bitcast<i32>(w) / bitcast<i32>(v | 1u)) + (bitcast<i32>(w) % bitcast<i32>(v | \
     1u)))",
    "(w / (v | 1u)) + (w % (v | 1u))",
    "bitcast<u32>(bitcast<i32>(w) >> (v & 31u))",
    "bitcast<u32>(abs(bitcast<i32>(w)) + sign(bitcast<i32>(v)))",
];

/// Floats, of which an adapter need not give the last bits.
const NEAR: &[&str] = &[
    "modf(vec2<f32>(a, b)).fract.y",
    "dot(refract(unit(a), unit(b), 0.75), vec3<f32>(1.0, 2.0, 3.0))",
    "dot(refract(unit(a), unit(b), 1.6), vec3<f32>(1.0, 2.0, 3.0))",
    "dot(reflect(unit(a), unit(b)), vec3<f32>(1.0, 2.0, 3.0))",
    "faceForward(unit(a), unit(b), unit(a + b)).x",
    "determinant(mat3x3<f32>(unit(a), unit(b), unit(a * b)))",
    "determinant(mat4x4<f32>(vec4(unit(a), a), vec4(unit(b), 1.0), vec4(b, a, 2.0, 1.0), \
     vec4(unit(a * b), b)))",
    "asinh(a)",
    "acosh(abs(a) + 1.0)",
    "atanh(a / 9.0)",
];

/// Pixels of a row, and rows of an expression.
const COLUMNS: u32 = 64;
const ROWS: u32 = 4;

fn source() -> String {
    let mut cases = String::new();
    for (i, expression) in EXACT.iter().enumerate() {
        let _ = writeln!(cases, "        case {i}u: {{ r = {expression}; }}");
    }
    for (i, expression) in (EXACT.len()..).zip(NEAR) {
        let _ = writeln!(
            cases,
            "        case {i}u: {{ r = bitcast<u32>({expression}); }}"
        );
    }
    format!(
        "fn word(n: u32, k: u32) -> u32 {{
    if n < 4u {{
        return array<u32, 4>(0u, 0xffffffffu, 1u, 0x80000000u)[(n + k * 3u) & 3u];
    }}
    let mixed = (n * 747796405u + k * 2891336453u) ^ (n >> 3u);
    return (mixed * 277803737u) ^ (mixed >> 13u);
}}
fn fields(w: u32) -> vec4<f32> {{
    let bytes = vec4<u32>(w, w >> 8u, w >> 16u, w >> 24u) & vec4<u32>(255u);
    return (vec4<f32>(bytes) + 0.3) * 0.0098 - 1.2;
}}
fn extremes(w: u32) -> vec4<i32> {{
    return (vec4<i32>(vec4<u32>(w, w >> 8u, w >> 16u, w >> 24u) & vec4<u32>(255u)) - 128) * 3;
}}
fn unit(x: f32) -> vec3<f32> {{
    return normalize(vec3<f32>(x, x * x - 1.0, 2.0 - x));
}}
@vertex fn vs(@location(0) position: vec3<f32>) -> @builtin(position) vec4<f32> {{ \
    return vec4(position, 1.0); }}
@fragment fn fs(@builtin(position) at: vec4<f32>) -> @location(0) vec4<f32> {{
    let pixel = vec2<u32>(at.xy);
    let n = (pixel.y % {ROWS}u) * {COLUMNS}u + pixel.x;
    let w = word(n, 0u);
    let v = word(n, 1u);
    let a = f32(w & 0xffffu) / 4096.0 - 8.0;
    let b = f32(v & 0xffffu) / 4096.0 - 8.0;
    var r = 0u;
    switch pixel.y / {ROWS}u {{
{cases}        default: {{}}
    }}
    return vec4<f32>(f32(r & 0xffffu), f32(r >> 16u), 0.0, 1.0);
}}"
    )
}

#[test]
fn words_are_the_same_words() {
    let text = front::Source::new("words.wgsl", source());
    let parsed = front::parse(&[text], &options::Options::default())
        .unwrap_or_else(|e| panic!("{}", e.render(shader_text::error::Color::Never)));
    let program = parsed.program.clone();
    let stage = naga::ShaderStage::Fragment;
    let (entry, _) = program.entry_point(stage, "fs").unwrap();
    let height = ROWS * (EXACT.len() + NEAR.len()) as u32;
    let picture = drawn(parsed, [COLUMNS, height]);
    let environment = Environment {
        resources: BTreeMap::new().into(),
        texture: &|_| [0.0; 4],
        derivative: None,
        trace: None,
        steps: 10_000,
    };
    let mut wrong = Vec::new();
    for y in 0..height {
        for x in 0..COLUMNS {
            let [low, high, ..] = picture.rgba((y * COLUMNS + x) as usize);
            let there = low as u32 | (high as u32) << 16;
            let at = Value::vector(&[x as f32 + 0.5, y as f32 + 0.5, 0.0, 1.0]);
            let case = (y / ROWS) as usize;
            let expression = EXACT.iter().chain(NEAR).nth(case).unwrap();
            let here = naga_interp::entry_point(program.module(), entry, &[at], &environment);
            let here = here.unwrap_or_else(|e| panic!("{expression}: {e}"));
            let Some(Value::Composite(parts)) = here.result else {
                panic!("{expression}: no result");
            };
            let [low, high] = [0, 1].map(|i| match parts[i] {
                Value::Scalar(Scalar::F32(v)) => v as u32,
                ref other => panic!("{expression}: {other:?}"),
            });
            let here = low | high << 16;
            let is_near = case >= EXACT.len() && {
                let [here, there] = [here, there].map(f32::from_bits);
                (here - there).abs() <= 2e-4 * here.abs().max(1.0)
            };
            if here != there && !is_near {
                wrong.push(format!(
                    "{expression} at {x}, {y}: {here:08x} here, {there:08x} there"
                ));
            }
        }
    }
    assert!(
        wrong.is_empty(),
        "{} words: {:#?}",
        wrong.len(),
        &wrong[..wrong.len().min(30)]
    );
}

/// A picture of one triangle over the whole target.
fn drawn(parsed: front::Parsed, size: [u32; 2]) -> ColorImage {
    let material = Material {
        name: "words".to_owned(),
        file: None,
        program: parsed.program,
        vertex: parsed.vertex,
        fragment: parsed.fragment,
        defines: BTreeMap::new(),
        state: MaterialState {
            primitive: PrimitiveState {
                cull: CullMode::None,
                ..PrimitiveState::default()
            },
            targets: vec![Some(ColorTarget::opaque("rgba32float"))],
            ..MaterialState::default()
        },
        values: BTreeMap::new(),
        textures: BTreeMap::new(),
        samplers: BTreeMap::new(),
        attributes: BTreeMap::new(),
        attribute_roles: BTreeMap::new(),
        value_roles: BTreeMap::new(),
        part_of: None,
    };
    let positions = Stream::Float {
        components: 3,
        data: vec![-1.0, -1.0, 0.5, 3.0, -1.0, 0.5, -1.0, 3.0, 0.5],
    };
    let scene = Scene {
        files: Vec::new(),
        is_made_up: false,
        own_size: None,
        part: None,
        initial: Default::default(),
        rows: Default::default(),
        notes: Vec::new(),
        name: "words".to_owned(),
        size,
        viewport: None,
        depth_format: DepthFormat::Depth32float,
        depth_direction: DepthDirection::Forward,
        samples: 1,
        clear_color: [0.0; 4],
        materials: vec![material],
        meshes: vec![Mesh {
            name: "triangle".to_owned(),
            vertex_count: 3,
            streams: BTreeMap::from([("position".to_owned(), positions)]),
            indices: None,
            bounds: [Vec3::splat(-1.0), Vec3::ONE],
        }],
        draws: vec![Draw {
            name: "triangle".to_owned(),
            mesh: 0,
            material: 0,
            transform: Mat4::IDENTITY,
            range: DrawRange::default(),
            instances: 1,
            instance_streams: BTreeMap::new(),
            joints: [].into(),
            morph_weights: Vec::new(),
            values: BTreeMap::new(),
            captured: None,
        }],
        cameras: vec![Camera {
            name: "front".to_owned(),
            frames: vec![Frame {
                view: Mat4::IDENTITY,
                projection: Mat4::IDENTITY,
                eye: Vec3::NEG_Z,
                time: 0.0,
            }],
        }],
        orders: vec![DrawOrder::AsGiven],
        light: Light {
            direction: Vec3::Y,
            color: Vec3::ONE,
            map: 64,
            ..Light::default()
        },
    };
    let inputs = SceneInputs::new(gpu(), &scene).unwrap();
    let variant = preshade_scenes::variant(&originals(&scene), ShaderForm::Text).unwrap();
    let mut prepared = Prepared::new(&inputs, &variant, &FrameSettings::of(&scene)).unwrap();
    prepared.aim(&scene.cameras[0].frames[0], DrawOrder::AsGiven);
    let mut colors = prepared.render().unwrap().colors.into_iter();
    colors.next().flatten().unwrap()
}
