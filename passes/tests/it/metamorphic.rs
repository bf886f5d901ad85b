//! Metamorphic tests after GraphicsFuzz (Donaldson, Evrard, Lascu and Thomson 2017): what changes
//! nothing is written into the fixture shaders, and still no variant gives anything else.
//!
//! Into the text, as an author would: dead code behind an opaque predicate, statements wrapped into
//! branches and loops that run once, expressions split and returned by name.

use std::collections::BTreeMap;
use std::sync::Arc;

use naga::ShaderStage;
use preshade_geometry::{examples, pass_named};
use preshade_plan::pass::{Facts, Use};
use preshade_plan::plan::Plan;
use preshade_plan::program::Program;
use preshade_plan::state::MaterialState;
use preshade_validate::{Check, Effort, validate};
use shader_text::source::{Language, SourceMap};

use crate::common;
use crate::metamorphic_support::{injection, statements};

fn plan(name: &str, text: &str) -> Option<Plan> {
    let module = naga::front::wgsl::parse_str(text).ok()?;
    let of = |stage| {
        let mut found = module.entry_points.iter().filter(|e| e.stage == stage);
        found.next().map(|e| e.name.clone())
    };
    let (vertex, fragment) = (of(ShaderStage::Vertex)?, of(ShaderStage::Fragment)?);
    let mut sources = SourceMap::new();
    sources.add(name, text);
    let program = Program::new(module, Arc::new(sources), Language::Wgsl).ok()?;
    let state = MaterialState::default();
    Some(Plan::original(
        name,
        program,
        &vertex,
        Some(&fragment),
        &state,
    ))
}

fn recipes() -> Vec<(&'static str, serde_json::Value)> {
    let used = examples().filter(|(_, used)| **used == Use::Inject);
    used.map(|(recipe, _)| common::step(recipe)).collect()
}

fn broken(what: &str, checks: &[Check]) -> Vec<String> {
    let broken = checks.iter().filter(|c| c.verdict.is_broken());
    broken
        .map(|c| format!("{what}: {}: {}: {}", c.role.name(), c.promise, c.verdict))
        .collect()
}

/// The injections themselves are seen where they do change something: the tests of the test.
#[test]
fn an_injection_that_is_not_neutral_is_seen() {
    let text = "
@vertex fn vs(@location(0) p: vec4<f32>) -> @builtin(position) vec4<f32> { return p; }
@fragment fn fs(@builtin(position) p: vec4<f32>) -> @location(0) vec4<f32> {
    var x = p.x;
    x = x * 2.0;
    if p.y > 4.0 { x = x + 1.0; }
    let y = x - p.z;
    return vec4(y);
}
";
    let original = plan("test", text).unwrap();
    assert_eq!(statements(text).len(), 6);
    let effort = Effort {
        inputs: 24,
        ..Effort::default()
    };
    let kept = (0..40).map(|seed| injection(text, seed, 3));
    for changed in kept {
        let injected = plan("test", &changed).unwrap_or_else(|| panic!("{changed}"));
        let checks = validate(&original, &injected, &effort);
        assert_eq!(broken("", &checks), Vec::<String>::new(), "{changed}");
        assert!(checks.iter().all(|c| c.verdict.holds()), "{changed}");
    }
    // A predicate that is not what it is taken for.
    let wrong = injection(text, 0, 6).replace("meta_one: i32 = 1", "meta_one: i32 = 2");
    let wrong = wrong.replace("meta_zero: f32 = 0.0", "meta_zero: f32 = 1.0");
    let injected = plan("test", &wrong).unwrap();
    let checks = validate(&original, &injected, &effort);
    assert!(!broken("", &checks).is_empty(), "{wrong}");
}

/// Each takes seconds: `make check` skips them.
mod slow {
    use super::*;

    /// As many seeds a shader as `PRESHADE_METAMORPHIC` says; one without it.
    #[test]
    fn what_changes_nothing_changes_no_variant() {
        let seeds: u64 = std::env::var("PRESHADE_METAMORPHIC")
            .ok()
            .and_then(|n| n.parse().ok())
            .unwrap_or(1);
        let effort = Effort {
            inputs: 6,
            steps: 40_000,
            paths: 4,
            ..Effort::default()
        };
        let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/../fixtures/shaders");
        let mut files: Vec<_> = std::fs::read_dir(folder)
            .unwrap()
            .map(|e| e.unwrap().path())
            .filter(|p| p.extension().is_some_and(|e| e == "wgsl"))
            .collect();
        files.sort();
        let facts = Facts::without_ties();
        let (mut wrong, mut injections, mut accepted) = (Vec::new(), 0, BTreeMap::new());
        for file in files {
            let name = file.file_name().unwrap().to_string_lossy().into_owned();
            let text = std::fs::read_to_string(&file).unwrap();
            let Some(original) = plan(&name, &text) else {
                continue;
            };
            for seed in 0..seeds {
                let changed = injection(&text, seed, 8);
                assert_ne!(changed, text);
                let Some(injected) = plan(&name, &changed) else {
                    let why = naga::front::wgsl::parse_str(&changed)
                        .map_or_else(|e| e.emit_to_string(&changed), |_| "invalid".to_owned());
                    panic!("{name}, seed {seed}: the injection is wrong: {why}\n{changed}");
                };
                injections += 1;
                let what = format!("{name}, seed {seed}");
                wrong.extend(broken(&what, &validate(&original, &injected, &effort)));
                for (pass, params) in recipes() {
                    let found = pass_named(pass).unwrap();
                    match found.run(&injected, &facts, &params) {
                        Ok(variant) => {
                            *accepted.entry(pass).or_insert(0) += 1;
                            let what = format!("{what} by {pass} {params}");
                            wrong.extend(broken(
                                &what,
                                &validate(&original, &variant.plan, &effort),
                            ));
                        }
                        Err(refused) => {
                            let bug = refused.refusals.iter().find(|r| r.code == "internal");
                            wrong.extend(bug.map(|r| format!("{what} by {pass}: {r}")));
                        }
                    }
                }
            }
        }
        assert!(wrong.is_empty(), "{}", wrong.join("\n"));
        assert!(injections >= 30, "{injections}");
        assert!(accepted.len() >= 5, "{accepted:?}");
    }
}
