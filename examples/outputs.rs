//! Auxiliary pictures of all fixtures and of the scenes whose vertices move: whether they are what
//! they must be on this machine's adapter, and what they cost beside the main pass.
//!
//! ```text
//! cargo run --release --all-features --example outputs -- [--adapter TEXT] [--invariant] [--timed]
//! ```
//!
//! Run it where `fixtures` is. The table goes to stdout as JSON: a row for each picture of each
//! subject, with the pixels compared, the depths that differ from those of the author's whole
//! program, and the largest error of velocities and normals. `--invariant` marks the authors'
//! positions `@invariant`: without it, an adapter may round the positions of two programs
//! differently. `--timed` adds times, at the scenes' own sizes. The exit status is 1 if a picture is
//! wrong.
#![allow(
    clippy::unwrap_used,
    clippy::panic,
    reason = "a tool that ends with a message"
)]

use preshade::unstable::measure::Timed;
use preshade::unstable::measure::outputs::TOLERANCE;
use preshade::unstable::render::{AdapterChoice, Gpu};

#[path = "../tests/support/fixtures_support.rs"]
mod fixtures_support;
#[path = "../tests/support/outputs_support.rs"]
mod outputs_support;

use outputs_support::{Normals, Row, Subject, fixtures, moving_scenes, normals, row};

/// The pictures.
const WRITES: [&str; 6] = ["depth", "shadow", "distance", "normal", "velocity", "id"];

/// The largest difference of two normals' components: a rounding or two.
const NORMAL: f32 = 1e-5;

#[derive(serde::Serialize)]
struct Report {
    adapter: String,
    invariant: bool,
    summary: Vec<Summary>,
    normals: Vec<Normals>,
    rows: Vec<Row>,
}

/// One picture over all subjects.
#[derive(serde::Serialize)]
struct Summary {
    write: String,
    /// Fixtures and scenes in which something was compared.
    compared: usize,
    not_seen: usize,
    refused: usize,
    pixels: u64,
    changed_depth: u64,
    velocities: u64,
    velocities_left_out: u64,
    worst_velocity: f64,
    /// Subjects whose depths differ, or whose velocities do.
    wrong: Vec<String>,
}

fn argument(name: &str) -> Option<String> {
    let mut arguments = std::env::args().skip_while(|a| a != name);
    arguments.nth(1)
}

fn has(name: &str) -> bool {
    std::env::args().any(|a| a == name)
}

fn main() {
    let adapter = argument("--adapter").map_or(AdapterChoice::Best, AdapterChoice::Matching);
    let gpu = Gpu::new(&adapter).unwrap_or_else(|e| panic!("{e}"));
    let (invariant, is_timed) = (has("--invariant"), has("--timed"));
    let size = if is_timed { [1280, 720] } else { [320, 180] };
    let marked = |mut subject: Subject| {
        if invariant {
            subject.scene = subject.scene.with_invariant_positions();
            subject.earlier = subject.earlier.with_invariant_positions();
        }
        subject
    };
    let scenes = moving_scenes(size).into_iter().map(marked);
    let mut rows = Vec::new();
    for subject in scenes.chain(fixtures([128, 96]).into_iter().map(marked)) {
        let is_scene = subject.name.starts_with("scene ");
        let timed = match is_timed && is_scene {
            true => Timed::Headline,
            false => Timed::No,
        };
        eprintln!("{}", subject.name);
        for write in WRITES {
            rows.push(row(&gpu, &subject, write, timed));
        }
    }
    let report = Report {
        adapter: gpu.adapter().name.clone(),
        invariant,
        summary: summary(&rows),
        normals: normals(&gpu, [640, 360]),
        rows,
    };
    println!("{}", serde_json::to_string_pretty(&report).unwrap());
    let is_wrong = report.summary.iter().any(|s| !s.wrong.is_empty())
        || report.normals.iter().any(|n| n.worst > NORMAL);
    std::process::exit(i32::from(is_wrong));
}

fn summary(rows: &[Row]) -> Vec<Summary> {
    let of = |write: &str| {
        let all: Vec<&Row> = rows.iter().filter(|r| r.write == write).collect();
        let drawn = || all.iter().filter(|r| r.refused.is_none());
        let velocity = || drawn().filter_map(|r| r.velocity);
        let is_wrong = |row: &&&Row| {
            row.changed_depth > 0 || row.velocity.is_some_and(|(.., worst)| worst > TOLERANCE)
        };
        Summary {
            write: write.to_owned(),
            compared: drawn().filter(|r| r.covered > 0).count(),
            not_seen: drawn().filter(|r| r.covered == 0).count(),
            refused: all.len() - drawn().count(),
            pixels: drawn().map(|r| r.covered).sum(),
            changed_depth: drawn().map(|r| r.changed_depth).sum(),
            velocities: velocity().map(|v| v.0).sum(),
            velocities_left_out: velocity().map(|v| v.1).sum(),
            worst_velocity: velocity().map(|v| v.3).fold(0.0, f64::max),
            wrong: drawn()
                .filter(is_wrong)
                .map(|r| r.subject.clone())
                .collect(),
        }
    };
    WRITES.into_iter().map(of).collect()
}
