//! Shaders that do not end, or may not, drawn in software only: none of them is drawn as it is, and
//! those that end are.

use std::sync::OnceLock;

use preshade_draw::render::{AdapterChoice, Gpu};
use preshade_draw::scene::{DrawOrder, Scene};
use preshade_lab::measure::{self, Session};
use preshade_scenes::ShaderForm;

use crate::render_support::{draw, material, scene};

/// A loop without end hangs a real GPU if the guard fails.
fn software() -> &'static Gpu {
    static GPU: OnceLock<Gpu> = OnceLock::new();
    GPU.get_or_init(|| {
        let gpu = Gpu::new(&AdapterChoice::Matching("llvmpipe".to_owned())).unwrap();
        assert_eq!(gpu.adapter().kind, "software");
        gpu
    })
}

/// A square of which `vertex` may change `at`, and `fragment` the colour, from `x` of -1 to 1.
fn square(vertex: &str, fragment: &str) -> Scene {
    let text = format!(
        "struct Object {{ model: mat4x4<f32>, tint: vec4<f32> }}
@group(1) @binding(0) var<uniform> object: Object;
struct V {{ @builtin(position) at: vec4<f32>, @location(0) x: f32 }}
fn spins(start: f32) -> f32 {{ var x = start; loop {{ x = x * 1.7 + 0.1; if (x > 3.0) {{ break; }} }} return x; }}
@vertex fn vs(@location(0) position: vec3<f32>) -> V {{
    var at = object.model * vec4(position, 1.0); {vertex}
    return V(at, position.x);
}}
@fragment fn fs(v: V) -> @location(0) vec4<f32> {{ var c = object.tint; {fragment} return c; }}"
    );
    let mut scene = scene(
        [32, 32],
        vec![material("m", &text)],
        vec![draw("square", glam::Mat4::IDENTITY, [0.5; 4])],
    );
    scene.orders = vec![DrawOrder::AsGiven];
    scene
}

/// What drawing the original says, if it is not drawn.
fn drawn(scene: &Scene) -> Result<(), String> {
    let session = Session::new(software(), scene, ShaderForm::Text).unwrap();
    let (_, frame) = scene.frames().next().unwrap();
    let pictures = session.pictures(session.originals(), &[frame], DrawOrder::AsGiven);
    pictures.map(|_| ()).map_err(|e| e.to_string())
}

#[test]
fn what_may_not_end_is_asked_first() {
    let fixed = "if (v.x < -2.0) { c = c + spins(v.x); }";
    // (vertex, fragment, whether it ends)
    let cases = [
        ("", "", true),
        ("", "c.x = spins(v.x);", false),
        ("", "c.x = spins(v.x + 2.0);", true),
        // Behind a branch that nobody takes.
        ("", fixed, true),
        ("at.x += spins(position.x) * 0.0;", "", false),
        ("at.x += spins(2.0) * 0.0;", "", true),
        ("", "var i = 0.0; while (i != v.x) { i += 1.0; }", false),
        ("", "loop { if (v.x > 2.0) { break; } }", false),
        (
            "",
            "loop { c.x += 0.1; if (v.x > -2.0) { discard; } }",
            true,
        ),
        (
            "",
            "loop { c.x += 0.1; if (v.x > -2.0) { return c; } }",
            true,
        ),
        (
            "",
            "var i = 0; loop { continuing { i += 1; break if i > 40; } }",
            true,
        ),
        (
            "",
            "var i = 0u; loop { continuing { i *= 2u; break if i > 40u; } }",
            false,
        ),
        (
            "",
            "for (var i = 0; i < i32(c.x * 20.0); i++) { c.y += 0.01; }",
            true,
        ),
        (
            "",
            "for (var i = 0; i < 40; i++) { for (var j = 0.0; j < v.x; j += 0.1) { c.y += 0.01; } }",
            true,
        ),
        (
            "",
            "for (var i = 0; i < 3; i++) { for (var j = 0.0; j < 1.0; j += c.w - 0.5) { c.y += 0.01; } }",
            false,
        ),
        (
            "",
            "switch (i32(c.x)) { case 0: { c.x = spins(v.x); } default: {} }",
            false,
        ),
    ];
    for (vertex, fragment, ends) in cases {
        let said = drawn(&square(vertex, fragment));
        match said {
            Ok(()) => assert!(ends, "drawn: {vertex} {fragment}"),
            Err(why) => {
                let line = if vertex.contains("spins") || fragment.contains("spins") {
                    4
                } else {
                    9
                };
                let told =
                    format!("not measured: the loop at line {line} of `test.wgsl` did not end");
                assert!(
                    !ends && why.starts_with(&told),
                    "{vertex} {fragment}: {why}"
                );
            }
        }
    }
}

/// Lanes outside of a triangle run too. Their varyings lie beyond those at its corners.
#[test]
fn lanes_outside_of_a_triangle_count() {
    let beyond = "if (v.x > 1.0001) { loop { c.x += 0.001; if (c.x < 0.0) { break; } } }";
    let mut whole = square("", beyond);
    assert_eq!(drawn(&whole), Ok(()));
    // Its right edge cuts through quads.
    let narrow = glam::Mat4::from_scale(glam::Vec3::new(0.5625, 1.0, 1.0));
    whole.draws[0].transform = narrow;
    assert!(drawn(&whole).is_err_and(|why| why.contains("did not end")));
}

/// A variant may not end where the original does: it alone is not measured.
#[test]
fn a_variant_is_asked_by_itself() {
    let scene = square("", "");
    let session = Session::new(software(), &scene, ShaderForm::Text).unwrap();
    let mut subject = measure::Subject::new(
        &session,
        measure::originals(&square("", "c.x = spins(v.x);")),
    );
    subject.build().unwrap();
    let (_, frame) = scene.frames().next().unwrap();
    let error = subject.draw(frame, DrawOrder::AsGiven).unwrap_err();
    subject.quit(&error);
    let said = format!("{:?}", subject.verdict);
    assert!(
        said.contains("NotMeasured") && said.contains("the loop at line 4"),
        "{said}"
    );
}
