//! What each experiment leaves out is what its name says. No time is asserted.

use std::time::Duration;

use preshade_draw::scene::Scene;
use preshade_lab::measure::TimingSettings;
use preshade_lab::measure::profile::{Profile, profile};
use preshade_lab::report;
use preshade_plan::state::{
    CompareFunction, DepthFormat, StencilFace, StencilOperation, StencilState,
};

use crate::outputs_support::load;
use crate::render_support::*;

fn profiled(scene: &Scene) -> Profile {
    let timing = TimingSettings {
        budget: Duration::ZERO,
        ..TimingSettings::default()
    };
    profile(gpu(), scene, &timing, "test").unwrap()
}

#[test]
fn every_kind_of_work_is_told_apart() {
    let scene = load("shrine", [64, 36]);
    let views = profiled(&scene).views;
    assert_eq!(views.len(), scene.cameras.len());
    for view in views {
        assert_eq!(view.view.order, scene.orders[0]);
        assert!(view.time_ms.median > 0.0);
        assert!(view.draws.is_some() && view.vertices.is_some());
        let names: Vec<&str> = view.materials.iter().map(|m| m.material.as_str()).collect();
        assert_eq!(names.len(), scene.materials.len(), "{names:?}");
        for of in &view.materials {
            let parts = [of.textures, of.arithmetic, of.fill];
            assert!(parts.iter().all(Option::is_some), "{of:?}");
            for part in parts.into_iter().flatten().chain([of.fragments]) {
                assert!(part.low <= part.median && part.median <= part.high);
            }
        }
    }
}

/// An adapter may test depth after a fragment stage that discards or writes depth, so a test that always fails does not
/// leave it out.
#[test]
fn fragments_that_decide_where_they_draw_are_left_out_too() {
    for (name, discards) in [("grass", true), ("frag-depth", false)] {
        let found = profiled(&load(name, [64, 36]));
        let view = &found.views[0];
        assert!(view.draws.is_some() && view.vertices.is_some(), "{name}");
        assert!(view.kept.is_empty(), "{name}: {:?}", view.kept);
        let of = &view.materials[0];
        assert_eq!(of.coverage.is_some(), discards, "{name}");
        assert_eq!(of.arithmetic.is_some(), discards, "{name}");
        let said = report::profile::render(&found);
        assert!(!said.contains("could not all be left out"), "{said}");
    }
}

#[test]
fn fragments_that_cannot_be_left_out_are_told() {
    let mut scene = load("grass", [64, 36]);
    // Fragments behind others leave a mark, so no test may send them there.
    let face = StencilFace {
        compare: CompareFunction::Always,
        fail: StencilOperation::Keep,
        depth_fail: StencilOperation::Replace,
        pass: StencilOperation::Keep,
    };
    let state = &mut scene.materials[0].state;
    state.depth_format = DepthFormat::Depth24plusStencil8;
    state.stencil = Some(StencilState {
        front: face,
        back: face,
        read_mask: 1,
        write_mask: 1,
        reference: 1,
    });
    let found = profiled(&scene);
    let view = &found.views[0];
    assert_eq!(view.kept, ["grass"]);
    assert!(view.draws.is_none() && view.materials[0].coverage.is_none());
    let said = report::profile::render(&found);
    assert!(
        said.contains("fragments of `grass` could not all be left out")
            && !said.contains("bound by"),
        "{said}"
    );
}
