//! The scene that preshade makes up for a bare shader, drawn: something is seen of each material
//! that reaches a position, and discards are at work.

use std::path::Path;

use preshade_compiler::front::{self, Source};
use preshade_lab::measure::{self, Session, Settings, Timed, TimingSettings, record};
use preshade_plan::state::MaterialState;
use preshade_scenes::ShaderForm;
use shader_text::error::Color;
use shader_text::options::Options;

use crate::render_support::gpu;

/// The original, drawn in the scene that is made up for it.
fn drawn(name: &str, text: String) -> record::Report {
    let parsed = front::parse(&[Source::new(name, text)], &Options::default())
        .unwrap_or_else(|e| panic!("{}", e.render(Color::Never)));
    let scene = preshade_scenes::synthesise(parsed, MaterialState::default()).resized([160, 90]);
    let session = Session::new(gpu(), &scene, ShaderForm::Text).unwrap();
    let settings = Settings {
        timed: Timed::No,
        timing: TimingSettings::default(),
        frames_per_camera: 1,
        command: String::new(),
    };
    let verified = measure::verify(&session, &[], &settings, &mut |_| {});
    verified.unwrap_or_else(|e| panic!("{name}: {e}")).report
}

#[test]
fn something_is_seen_of_every_material() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/materials/drawn");
    let mut empty = Vec::new();
    let mut count = 0;
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        let report = drawn(&name, std::fs::read_to_string(&path).unwrap());
        count += 1;
        let shaded = report.variants[0].shaded_per_pixel;
        if shaded.is_none_or(|n| n <= 0.0) {
            empty.push(format!("{name}: {:?}", report.variants[0].verdict));
        }
    }
    assert!(count >= 10, "{count}");
    assert!(empty.is_empty(), "{}", empty.join("\n"));
}

/// With an opacity of 1, a dither pattern would discard nothing.
#[test]
fn a_dithered_opacity_discards_some_fragments() {
    let text = "
struct M { fade: f32, opacity: f32 }
@group(0) @binding(0) var<uniform> view_proj: mat4x4<f32>;
@group(0) @binding(1) var<uniform> m: M;
fn dither(p: vec2<f32>) -> f32 {
    return fract(52.9829189 * fract(dot(p, vec2(0.06711056, 0.00583715))));
}
@vertex fn vs(@location(0) position: vec3<f32>) -> @builtin(position) vec4<f32> {
    return view_proj * vec4(position, 1.0);
}
@fragment fn fs(@builtin(position) at: vec4<f32>) -> @location(0) vec4<f32> {
    if dither(at.xy) > m.opacity { discard; }
    return vec4(0.5);
}
";
    let report = drawn("fade.wgsl", text.to_owned());
    assert!(report.untested.is_empty(), "{:?}", report.untested);
}

/// An alpha-tested leaf, with a name for each thing that a name could tell.
const LEAF: &str = "
struct Frame { @matrix: mat4x4<f32>, @plain: vec4<f32> }
struct Surface { @tint: vec4<f32>, @threshold: f32 }
@group(0) @binding(0) var<uniform> @frame: Frame;
@group(1) @binding(0) var<uniform> @surface: Surface;
@group(1) @binding(1) var @texture: texture_2d<f32>;
@group(1) @binding(2) var @sampler: sampler;
struct Out { @builtin(position) @clip: vec4<f32>, @location(0) @uv_out: vec2<f32>, @location(1) @normal_out: vec3<f32> }
@vertex fn vs(@location(0) @first: vec3<f32>, @location(1) @second: vec3<f32>, @location(2) @third: vec2<f32>) -> Out {
    return Out(@frame.@matrix * vec4<f32>(@first, 1.0), @third, @second);
}
@fragment fn fs(in: Out) -> @location(0) vec4<f32> {
    let texel = textureSample(@texture, @sampler, in.@uv_out) * @surface.@tint;
    if texel.a < @surface.@threshold { discard; }
    return vec4<f32>(texel.rgb + in.@normal_out * 0.1, 1.0) + @frame.@plain * 0.001;
}
";

/// Names that mean something to preshade, and some that mean nothing.
const NAMES: [&str; 28] = [
    "q",
    "w17",
    "foo",
    "vtx",
    "thing",
    "data",
    "blob",
    "s_1",
    "normal",
    "uv",
    "color",
    "position",
    "tangent",
    "weights",
    "time",
    "model",
    "view_proj",
    "normal_map",
    "mask",
    "noise",
    "cutoff",
    "near",
    "light",
    "metal",
    "rough",
    "height",
    "instances",
    "bones",
];

#[test]
fn a_leaf_named_anything_at_all_is_drawn_with_its_discard_at_work() {
    let holes = [
        "matrix",
        "plain",
        "tint",
        "threshold",
        "frame",
        "surface",
        "texture",
        "sampler",
        "clip",
        "uv_out",
        "normal_out",
        "first",
        "second",
        "third",
    ];
    let mut wrong = Vec::new();
    for round in 0..24_u64 {
        // A shuffle by a generator of its own, so that a failure can be made again.
        let mut state = round.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1;
        let mut names = NAMES.to_vec();
        for i in (1..names.len()).rev() {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1);
            names.swap(i, (state >> 33) as usize % (i + 1));
        }
        let mut text = LEAF.to_owned();
        // Longer names first: `@texture` is not `@t` with an ending.
        for (hole, name) in holes.iter().zip(&names) {
            for after in [":", ",", ".", ")", ";", " ", "*"] {
                text = text.replace(&format!("@{hole}{after}"), &format!("{name}{after}"));
            }
        }
        let report = drawn("leaf.wgsl", text);
        let shaded = report.variants[0].shaded_per_pixel;
        if shaded.is_none_or(|n| n <= 0.0) || !report.untested.is_empty() {
            let names: Vec<_> = holes.iter().zip(&names).collect();
            wrong.push(format!(
                "round {round}: {shaded:?} {:?} {names:?}",
                report.untested
            ));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}
