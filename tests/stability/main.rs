//! Hard cases stay numerically stable. Each case is drawn under every depth set-up that matters and
//! through every pass that applies, and judged by the pass's contract; then its guard is taken
//! away, and the same judge must find the failure that the guard is for.
//!
//! `UPDATE_PAGES=1 cargo test --test stability` makes `docs/results/stability.md` anew, with the
//! figures of this machine's adapter. `STABILITY_OUT=FILE` writes them to a file instead, on a
//! machine that has no checkout to write to; put into `docs/results/stability`, it becomes a
//! column, once `UPDATE_PAGES=text` has made the page of the files as they are.
#![allow(clippy::unwrap_used, clippy::panic)]

#[path = "../support/reference.rs"]
mod reference;
#[path = "../support/render_support/mod.rs"]
mod render_support;

mod case;
mod control;
mod depth;
mod far;
mod interpolation;
mod mutate;
mod page;
mod range;

use std::path::PathBuf;
use std::sync::OnceLock;

use case::{Case, Outcome, run};

/// The root of the checkout, also where the test was built elsewhere.
fn root() -> PathBuf {
    let built = PathBuf::from(env!("CARGO_MANIFEST_DIR"));
    match built.join("fixtures").is_dir() {
        true => built,
        false => PathBuf::from("."),
    }
}

/// Every group and its cases.
fn groups() -> [(&'static str, &'static [Case]); 4] {
    [
        ("depth", depth::CASES),
        ("interpolation", interpolation::CASES),
        ("range", range::CASES),
        ("control", control::CASES),
    ]
}

/// What drawing the cases of a group said, drawn once.
fn outcomes(group: usize) -> &'static [Outcome] {
    static DRAWN: [OnceLock<Vec<Outcome>>; 4] = [const { OnceLock::new() }; 4];
    DRAWN[group].get_or_init(|| {
        let (name, cases) = groups()[group];
        let cases = cases.iter().filter(|c| is_asked_for(name, c));
        cases.map(run).collect()
    })
}

/// Whether to draw a case: all, or while one is worked on those with `STABILITY_CASE` in
/// `group/name`.
fn is_asked_for(group: &str, case: &Case) -> bool {
    let asked = std::env::var("STABILITY_CASE").unwrap_or_default();
    format!("{group}/{}", case.name).contains(&asked)
}

fn check(group: usize) {
    let wrong: Vec<String> = outcomes(group).iter().flat_map(Outcome::wrong).collect();
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn depth() {
    check(0);
}

#[test]
fn interpolation() {
    check(1);
}

#[test]
fn range() {
    check(2);
}

#[test]
fn control() {
    check(3);
}

#[test]
fn names_are_unlike_and_scenes_are_used() {
    let cases: Vec<&Case> = groups().iter().flat_map(|(_, cases)| *cases).collect();
    for (i, case) in cases.iter().enumerate() {
        assert!(
            cases[..i].iter().all(|c| c.name != case.name),
            "{}",
            case.name
        );
    }
    let folder = root().join("fixtures/scenes/stability");
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let stem = path.file_stem().unwrap().to_string_lossy().into_owned();
        if path.extension().is_some_and(|e| e == "toml") {
            assert!(cases.iter().any(|c| c.scene == stem), "{stem} is not drawn");
        }
    }
}

/// A case is drawn in every format and direction, or says why not.
#[test]
fn set_ups_are_all_or_told() {
    for (_, cases) in groups() {
        for case in cases {
            let all = match case.setups[0].samples {
                1 => case::ALL,
                _ => case::SAMPLED,
            };
            let is_whole = all.iter().all(|s| case.setups.contains(s));
            assert_eq!(is_whole, case.only.is_empty(), "{}", case.name);
        }
    }
}

#[test]
fn the_page_says_what_the_figures_say() {
    let measured = || {
        let groups = (0..groups().len()).map(outcomes).collect::<Vec<_>>();
        page::Results::new(&groups.concat())
    };
    page::check(&groups(), &measured);
}
