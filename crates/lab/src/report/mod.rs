//! Prints records: tables for a terminal, CSV, plots, pictures and HTML pages.
//!
//! The records themselves are in [`crate::measure::record`] and [`crate::search`]. Only the command
//! line uses this module.

mod choice;
pub mod crossover;
pub mod csv;
pub mod decision;
pub mod fleet;
pub mod frontier;
mod headline;
pub mod html;
pub mod merged;
pub mod picture;
pub mod plain;
pub mod plot;
pub mod profile;
pub mod regret;
pub mod sheet;
pub mod sweep;
pub mod table;

pub use headline::nothing_pays;

/// The name of a scene; of a captured frame, with the part of it that was drawn.
fn titled(scene: &str, part: Option<&str>) -> String {
    match part {
        Some(part) => format!("{scene}, {part}"),
        None => scene.to_owned(),
    }
}
