//! What each experiment leaves out is what its name says. No time is asserted.

use std::time::Duration;

use preshade::unstable::measure::TimingSettings;
use preshade::unstable::measure::profile::{ViewProfile, profile};
use preshade::unstable::scene::Scene;

use crate::outputs_support::load;
use crate::render_support::*;

fn profiled(scene: &Scene) -> Vec<ViewProfile> {
    let timing = TimingSettings {
        budget: Duration::ZERO,
        ..TimingSettings::default()
    };
    profile(gpu(), scene, &timing, "test").unwrap().views
}

#[test]
fn every_kind_of_work_is_told_apart() {
    let scene = load("shrine", [64, 36]);
    let views = profiled(&scene);
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
