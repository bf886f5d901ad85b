//! The fixture materials and the recipes that every one of them goes through.
#![allow(dead_code)]

use std::path::{Path, PathBuf};

use preshade::unstable::front::{self, Options, Source};
use preshade::unstable::passes::plan::Plan;
use preshade::unstable::passes::state::MaterialState;

/// The recipes whose output is kept as snapshots and shown to other compilers.
pub const RECIPES: [&str; 13] = [
    "depth-prepass",
    "depth-prepass:form=equal",
    "depth-prepass:form=equal,vertex=sliced",
    "shadow",
    "early-discard",
    "early-discard:texture=float",
    "early-discard:texture=float,attachment=readonly",
    "early-discard:texture=packed",
    "early-discard:quad=lane,budget=0.02",
    "early-discard:quad=lane,mode=invert",
    "hoist",
    "hoist:budget=0.02,finite=assumed,jumps=carried",
    "skip-taps:budget=1",
];

/// Recipes of several steps, separated by commas, shown to other compilers only: most of their text is the same for every material.
pub const COMPOSED: [&str; 13] = [
    "hoist:budget=0.02,finite=assumed,jumps=carried,tessellate:level=3",
    "hoist:budget=0.02,finite=assumed,jumps=carried,tessellate:level=2,pattern=uniform,form=shared",
    "hoist:budget=0.02,finite=assumed,jumps=carried,tessellate:level=2,depth-prepass",
    "visibility-buffer:formats=any,budget=1",
    "visibility-buffer:ids=unindexed,form=compute,budget=1",
    "visibility-buffer:select=tiles,budget=1",
    "visibility-buffer:form=binned,words=one,corners=snapped,budget=1",
    // Of values that the museum's material has; others refuse.
    "specialize:set=material.flags=3+hall.fog_density=0+hall.light_count=2+morph_targets=0",
    "specialize:set=material.flags=3+hall.fog_density=0+hall.light_count=2+morph_targets=0,depth-prepass:form=equal",
    "specialize:set=material.flags=3+hall.fog_density=0+hall.light_count=2+morph_targets=0,early-discard:texture=float",
    "specialize:set=material.flags=3+hall.fog_density=0+hall.light_count=2+morph_targets=0,hoist:budget=0.02,finite=assumed,jumps=carried",
    "specialize:set=material.flags=3+hall.fog_density=0+hall.light_count=2+morph_targets=0,skip-taps:budget=1",
    "specialize:set=material.flags=3+hall.fog_density=0+hall.light_count=2+morph_targets=0,visibility-buffer:formats=any,budget=1",
];

/// A material of one file or two, with the default state.
pub fn original(files: &[&Path]) -> Plan {
    let sources: Vec<Source> = files
        .iter()
        .map(|path| {
            Source::new(
                path.file_name().unwrap().to_string_lossy(),
                std::fs::read_to_string(path).unwrap(),
            )
        })
        .collect();
    let parsed = front::parse(&sources, &Options::default())
        .unwrap_or_else(|e| panic!("{}", e.render(front::Color::Never)));
    let material = files[0].file_stem().unwrap().to_string_lossy().into_owned();
    Plan::original(
        &material,
        parsed.program,
        &parsed.vertex,
        parsed.fragment.as_deref(),
        &MaterialState::default(),
    )
}

/// The root of the checkout, also where this was built elsewhere: then it is the folder it runs in.
pub fn root() -> PathBuf {
    let built = PathBuf::from(env!("CARGO_MANIFEST_DIR"));
    match built.join("fixtures").is_dir() {
        true => built,
        false => PathBuf::from("."),
    }
}

/// Every material of `fixtures`: WGSL files, and GLSL pairs.
pub fn materials() -> Vec<Vec<PathBuf>> {
    let with_extension = |folder: &str, extension: &str| {
        let mut found: Vec<PathBuf> = std::fs::read_dir(root().join(folder))
            .unwrap()
            .map(|e| e.unwrap().path())
            .filter(|p| p.extension().is_some_and(|e| e == extension))
            .collect();
        found.sort();
        found
    };
    let wgsl = with_extension("fixtures/shaders", "wgsl")
        .into_iter()
        .map(|p| vec![p]);
    let glsl = with_extension("fixtures/glsl", "vert")
        .into_iter()
        .map(|p| {
            let frag = p.with_extension("frag");
            vec![p, frag]
        });
    wgsl.chain(glsl).collect()
}
