//! How far values are from their interpolation: as the adapter finds it at points of the meshes, and as it is proved for all points.
#![cfg(feature = "verify")]
#![allow(clippy::unwrap_used, clippy::panic)]

mod render_support;

use std::path::Path;

use preshade::measure;
use preshade::passes::pass::{Bound, Frequency};
use preshade::render::ShaderForm;
use render_support::gpu;

fn frequencies(name: &str) -> Vec<Frequency> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("fixtures/scenes")
        .join(format!("{name}.toml"));
    let scene = preshade::scene::load(&path).unwrap().resized([96, 54]);
    let form = ShaderForm::Text;
    let found = measure::frequencies(gpu(), &scene, form, &mut |_| {}).unwrap();
    measure::interpolations(gpu(), &scene, form, found, &mut |_| {}).unwrap()
}

#[test]
fn no_point_of_a_mesh_is_further_off_than_is_proved() {
    let found = frequencies("strata");
    assert!(found.len() >= 8, "{found:#?}");
    for f in &found {
        let sampled = f.interpolation.unwrap();
        let Some(Bound::Proved {
            max,
            roundings,
            triangles,
            of,
            frames,
        }) = f.bound
        else {
            panic!("{f:#?}")
        };
        assert_eq!((triangles, frames), (of, 2), "{}", f.name);
        assert!(roundings < 0.02, "{}: {roundings}", f.name);
        assert!(sampled.points > 1000 && sampled.not_finite == 0, "{f:#?}");
        assert!(
            sampled.max <= max + roundings,
            "{}: {} above {max} and {roundings}",
            f.name,
            sampled.max
        );
        assert!(sampled.mean <= sampled.max && sampled.max <= sampled.range + 1e-4);
    }
    // What bends little is known well: the sampling finds most of what is proved.
    let bent = found.iter().find(|f| f.name.contains("* 9.0")).unwrap();
    let Some(Bound::Proved { max, .. }) = bent.bound else {
        panic!("{bent:#?}")
    };
    let sampled = bent.interpolation.unwrap().max;
    assert!(max < 1.5 * sampled, "{max} proved of {sampled}");
}

#[test]
fn a_lattice_of_noise_has_no_bound_and_says_why() {
    let found = frequencies("noise-grid-16");
    assert!(!found.is_empty());
    for f in &found {
        assert!(f.interpolation.unwrap().max > 0.05, "{f:#?}");
        match f.bound.as_ref().unwrap() {
            Bound::Unbounded { why } => assert!(!why.is_empty()),
            Bound::Proved { max, roundings, .. } => {
                assert!(max + roundings >= f.interpolation.unwrap().max);
            }
        }
    }
}
