//! Prints records: tables for a terminal, CSV, plots, pictures and HTML pages.
//!
//! The records themselves are in [`crate::measure::record`] and [`crate::search`]. Only the command
//! line uses this module.

mod choice;
pub mod contact_sheet;
pub mod control_characters;
pub mod crossover;
pub mod csv;
pub mod decision;
pub mod fleet;
pub mod frontier;
mod grid;
mod headline;
pub mod html;
pub mod merged;
pub mod picture;
pub mod plot;
pub mod profile;
pub mod regret;
pub mod sweep;
pub mod table;

pub use headline::nothing_pays;

use preshade_draw::render::AdapterReport;

/// The scene and the adapter: the name of a scene, with the part of a captured frame.
fn place(
    scene: &str,
    part: Option<&str>,
    [width, height]: [u32; 2],
    samples: u32,
    adapter: &AdapterReport,
) -> String {
    let part = part.map_or(String::new(), |part| format!(", {part}"));
    let samples = match samples {
        1 => String::new(),
        n => format!(", {n} samples"),
    };
    format!(
        "{scene}{part}, {width}x{height}{samples}, on {} ({}, {})",
        adapter.title(),
        adapter.backend,
        adapter.kind
    )
}
