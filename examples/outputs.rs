//! Auxiliary pictures of all fixtures and of the scenes whose vertices move: whether they are what
//! they must be on this machine's adapter, and what they cost beside the main pass.
//!
//! ```text
//! cargo run --release --all-features --example outputs -- [--adapter TEXT] [--invariant] [--timed]
//! ```
//!
//! Run it where `fixtures` is. Each line of stdout is JSON, printed as soon as it is measured: the
//! adapter, a row for each picture of each subject, normals, and a summary of each picture. A row
//! has the pixels compared, the depths that differ from those of the author's whole program, and
//! the largest error of velocities. `--invariant` marks the authors' positions `@invariant`:
//! without it, an adapter may round the positions of two programs differently, and such depths are
//! counted and not judged. `--timed` draws the scenes alone, at 1280x720, and adds what each pass
//! costs beside the main pass. The exit status is 1 if a picture is wrong.
#![allow(
    clippy::unwrap_used,
    clippy::panic,
    reason = "a tool that ends with a message"
)]

use preshade_draw::render::{AdapterChoice, Gpu};
use preshade_lab::measure::Timed;
use preshade_lab::measure::outputs::TOLERANCE;

#[path = "../tests/support/fixtures_support.rs"]
mod fixtures_support;
#[path = "../tests/support/outputs_support.rs"]
mod outputs_support;

use outputs_support::{Normals, Row, Subject, fixtures, moving_scenes, normals, row};

/// The pictures.
const WRITES: [&str; 6] = ["depth", "shadow", "distance", "normal", "velocity", "id"];

/// The largest difference of two normals' components: a rounding or two.
const NORMAL: f32 = 4.0 * f32::EPSILON;

/// A line of the output.
#[derive(serde::Serialize)]
#[serde(tag = "line", rename_all = "kebab-case")]
enum Line<'a> {
    Adapter { name: &'a str, invariant: bool },
    Row(&'a Row),
    Normals(&'a Normals),
    Summary(&'a Summary),
}

fn print(line: &Line<'_>) {
    println!("{}", serde_json::to_string(line).unwrap());
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
    /// Subjects whose depths differ though they are invariant, or whose velocities do.
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
        }
        subject
    };
    let name = &gpu.adapter().name;
    print(&Line::Adapter { name, invariant });
    let timed = match is_timed {
        true => Timed::Headline,
        false => Timed::No,
    };
    let mut subjects = moving_scenes(size, u32::MAX);
    if !is_timed {
        subjects.extend(fixtures([128, 96]));
    }
    let mut rows = Vec::new();
    for subject in subjects.into_iter().map(marked) {
        for write in WRITES {
            let row = row(&gpu, &subject, write, timed);
            print(&Line::Row(&row));
            rows.push(row);
        }
    }
    let normals = normals(&gpu, [640, 360]);
    let summary = summary(&rows, invariant);
    normals
        .iter()
        .map(Line::Normals)
        .for_each(|line| print(&line));
    summary
        .iter()
        .map(Line::Summary)
        .for_each(|line| print(&line));
    let is_wrong =
        summary.iter().any(|s| !s.wrong.is_empty()) || normals.iter().any(|n| n.worst > NORMAL);
    std::process::exit(i32::from(is_wrong));
}

fn summary(rows: &[Row], invariant: bool) -> Vec<Summary> {
    let of = |write: &str| {
        let all: Vec<&Row> = rows.iter().filter(|r| r.write == write).collect();
        let drawn = || all.iter().filter(|r| r.refused.is_none());
        let velocity = || drawn().filter_map(|r| r.velocity);
        let is_wrong = |row: &&&Row| {
            let is_depth_wrong = invariant && row.changed_depth > 0;
            is_depth_wrong || row.velocity.is_some_and(|(.., worst)| worst > TOLERANCE)
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
