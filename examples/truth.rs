//! Error against truth on the fixture scenes, as a table: what is hoisted, folded or left out, beside the original, both held against `f64`.
//!
//! ```text
//! cargo run --release --features verify --example truth -- [--points 2000] [--seed 1] [SCENE..]
//! ```
//!
//! Needs no GPU. Without SCENE every scene of the fixtures is looked at; a recipe that a material refuses has no row.
#![allow(
    clippy::unwrap_used,
    clippy::panic,
    reason = "a tool that ends with a message"
)]

use std::path::{Path, PathBuf};

use preshade::measure;
use preshade::measure::truth::{Nearer, Points, Spread, truth};
use preshade::recipe::Recipe;

/// What moves or folds floats.
const RECIPES: [&str; 6] = [
    "specialize",
    "specialize:fold=rounding",
    "hoist:allow=exact",
    "hoist:allow=rounding",
    "hoist:budget=0.01,finite=assumed",
    "trim-loop:budget=0.1",
];

fn main() {
    let mut points = Points::default();
    let mut paths = Vec::new();
    let mut arguments = std::env::args().skip(1);
    while let Some(argument) = arguments.next() {
        let mut number = || arguments.next().and_then(|n| n.parse().ok());
        match argument.as_str() {
            "--points" => points.count = number().expect("a number of points"),
            "--seed" => points.seed = number().expect("a seed"),
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
    println!(
        "| scene | material | recipe | points | flips | original, ULP | variant, ULP | original, steps | variant, steps | the variant is |"
    );
    println!("|---|---|---|--:|--:|--:|--:|--:|--:|---|");
    let mut not = Vec::new();
    for path in paths {
        let name = path.file_stem().unwrap().to_string_lossy().into_owned();
        let scene = preshade::scene::load(&path).unwrap_or_else(|e| panic!("{}", e.render()));
        let facts = measure::known(&scene);
        let originals = measure::originals(&scene);
        for recipe in RECIPES {
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
                    Ok(rows) => {
                        for row in rows {
                            println!(
                                "| {name} | {} | `{recipe}` | {} | {} + {} | {} | {} | {} | {} | {} |",
                                row.material,
                                row.points,
                                row.flips,
                                row.variant_flips,
                                spread(row.original.ulps),
                                spread(row.variant.ulps),
                                spread(row.original.steps),
                                spread(row.variant.steps),
                                match row.nearer {
                                    Nearer::SameBits => "the same bits",
                                    Nearer::Better => "better",
                                    Nearer::AsGood => "as good",
                                    Nearer::Worse => "worse",
                                }
                            );
                        }
                    }
                }
            }
        }
    }
    println!("\nNot evaluated:\n\n{}", not.join("\n"));
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
