//! Error against truth on the fixture scenes, as a table: what is hoisted, folded or left out,
//! beside the original, both held against `f64`.
//!
//! ```text
//! cargo run --release --features verify --example truth -- [--points 2000] [--seed 1] [--write docs/results/truth.md] [SCENE..]
//! ```
//!
//! Needs no GPU. Without SCENE every scene of the fixtures is looked at; a recipe that a material
//! refuses has no row. `--write` puts the tables into a page, between its two comments that say so.
#![allow(
    clippy::unwrap_used,
    clippy::panic,
    reason = "a tool that ends with a message"
)]

#[path = "../tests/support/reference.rs"]
mod reference;

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use preshade_compiler::recipe::Recipe;
use preshade_geometry::examples;
use preshade_lab::measure;
use preshade_plan::pass::Use;
use reference::{Nearer, Points, Spread, truth};

/// The comments that the tables stand between.
const MARKS: [&str; 2] = [
    "<!-- made by `--write`; edits will be lost -->",
    "<!-- to here -->",
];

fn main() {
    let mut points = Points::default();
    let mut paths = Vec::new();
    let mut page = None;
    let mut arguments = std::env::args().skip(1);
    while let Some(argument) = arguments.next() {
        match argument.as_str() {
            "--points" => points.count = number(arguments.next()),
            "--seed" => points.seed = number(arguments.next()),
            "--write" => page = Some(PathBuf::from(arguments.next().expect("a page"))),
            _ => paths.push(PathBuf::from(argument)),
        }
    }
    if paths.is_empty() {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/scenes");
        paths = std::fs::read_dir(folder)
            .unwrap()
            .map(|e| e.unwrap().path())
            .filter(|p| p.extension().is_some_and(|e| e == "toml"))
            .collect();
        paths.sort();
    }
    let mut rows = String::new();
    // The passes that move or fold floats, or leave some out.
    let recipes: Vec<&str> = examples()
        .filter(|(_, used)| **used == Use::Truth)
        .map(|(recipe, _)| recipe)
        .collect();
    let mut counts = vec![[0; 4]; recipes.len()];
    let _ = writeln!(
        rows,
        "| scene | material | recipe | points | flips | original, ULP | variant, ULP | original, \
         steps | variant, steps | the variant is |"
    );
    let _ = writeln!(rows, "|---|---|---|--:|--:|--:|--:|--:|--:|---|");
    let mut not = Vec::new();
    for path in paths {
        let name = path.file_stem().unwrap().to_string_lossy().into_owned();
        let scene = preshade_scenes::load(&path).unwrap_or_else(|e| panic!("{}", e.render()));
        let facts = measure::known(&scene);
        let originals = measure::originals(&scene);
        for (recipe, counted) in recipes.iter().zip(&mut counts) {
            let parsed = Recipe::parse_list(recipe).unwrap();
            for (index, original) in originals.iter().enumerate() {
                let Ok(variant) = parsed.apply(original, &facts) else {
                    continue;
                };
                match truth(&scene, index, original, &variant, points) {
                    Err(why) => not.push(format!(
                        "- {name}, {}, `{recipe}`: {why}",
                        original.material
                    )),
                    Ok(told) => {
                        for row in told {
                            let (place, nearer) = match row.nearer {
                                Nearer::SameBits => (0, "the same bits"),
                                Nearer::Better => (1, "better"),
                                Nearer::AsGood => (2, "as good"),
                                Nearer::Worse => (3, "worse"),
                            };
                            counted[place] += 1;
                            let _ = writeln!(
                                rows,
                                "| {name} | {} | `{recipe}` | {} | {} + {} | {} | {} | {} | {} | \
                                 {} |",
                                row.material,
                                row.points,
                                row.flips,
                                row.variant_flips,
                                spread(row.original.ulps),
                                spread(row.variant.ulps),
                                spread(row.original.steps),
                                spread(row.variant.steps),
                                nearer
                            );
                        }
                    }
                }
            }
        }
    }
    let mut out =
        "| recipe | the same bits | better | as good | worse |\n|---|--:|--:|--:|--:|\n".to_owned();
    for (recipe, [same, better, good, worse]) in recipes.iter().zip(counts) {
        let _ = writeln!(out, "| `{recipe}` | {same} | {better} | {good} | {worse} |");
    }
    let _ = writeln!(out, "\n{rows}");
    if !not.is_empty() {
        let _ = writeln!(out, "Not evaluated:\n\n{}", not.join("\n"));
    }
    let Some(page) = page else {
        println!("{out}");
        return;
    };
    let text = std::fs::read_to_string(&page).unwrap();
    let [from, to] = MARKS.map(|m| {
        text.find(m)
            .unwrap_or_else(|| panic!("the page has no {m}"))
    });
    let [before, after] = [&text[..from + MARKS[0].len()], &text[to..]];
    std::fs::write(page, format!("{before}\n\n{out}\n{after}")).unwrap();
}

fn number(argument: Option<String>) -> u64 {
    argument.and_then(|n| n.parse().ok()).expect("a number")
}

/// Median, 99th percentile and largest.
fn spread(of: Spread) -> String {
    [of.median, of.p99, of.max].map(short).join(" / ")
}

/// Two digits.
fn short(number: f64) -> String {
    match number {
        0.0 => "0".to_owned(),
        n if !(1e-3..1e5).contains(&n) => format!("{n:.0e}"),
        n if n >= 10.0 => format!("{n:.0}"),
        n if n >= 1.0 => format!("{n:.1}"),
        n if n >= 0.1 => format!("{n:.2}"),
        n => format!("{n:.3}"),
    }
}
