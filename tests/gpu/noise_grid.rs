//! The scenes `noise-grid-N` are what the frozen hand-written reference draws, so that a generated
//! hoist may be held against the one by hand.

use std::collections::BTreeMap;
use std::path::Path;

use preshade_compiler::front::{self, Source};
use preshade_draw::scene::{Scene, Value};
use preshade_lab::measure;
use shader_text::options::Options;

use crate::render_support::*;

fn fixture(path: &str) -> std::path::PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("fixtures")
        .join(path)
}

/// The same scene with the reference's material: one layer, its forward entry points.
fn by_hand(mut scene: Scene, cells: u32) -> Scene {
    let text = std::fs::read_to_string(fixture("handwritten/bounds.wgsl")).unwrap();
    let options = Options {
        vertex: Some("vs".to_owned()),
        fragment: Some("fs".to_owned()),
        ..Options::default()
    };
    let parsed = front::parse(&[Source::new("bounds.wgsl", text)], &options)
        .unwrap_or_else(|e| panic!("{}", e.render(shader_text::error::Color::Never)));
    let material = &mut scene.materials[0];
    material.program = parsed.program;
    material.vertex = parsed.vertex;
    material.fragment = parsed.fragment;
    material.values = BTreeMap::from(
        [
            ("p.n", f64::from(cells)),
            ("p.layers", 1.0),
            ("p.freq", 8.0),
            ("p.order", 0.0),
        ]
        .map(|(name, number)| (name.to_owned(), Value::Numbers(vec![number]))),
    );
    scene
}

#[test]
fn the_noise_grids_are_the_hand_written_picture_but_for_rounding() {
    for cells in [16, 64, 128] {
        let path = fixture(&format!("scenes/noise-grid-{cells}.toml"));
        let scene = preshade_scenes::load(&path)
            .unwrap_or_else(|e| panic!("{}", e.render()))
            .resized([320, 180]);
        let hand = by_hand(scene.clone(), cells);
        let error = measure::compare(&render(gpu(), &hand), &render(gpu(), &scene)).unwrap();
        // One step of an 8-bit target: the two sum the same terms in other orders.
        assert!(error.max_abs <= 1.001 / 255.0, "{cells}: {error:?}");
        assert_eq!(error.depth_max_ulp, 0, "{cells}: {error:?}");
        assert!(
            error.changed_pixels < 320 * 180 / 1000,
            "{cells}: {error:?}"
        );
    }
}
