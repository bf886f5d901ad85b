//! What accuracy costs in time: the recipes for a scene that no other beats in both.
//!
//! Data flows through the modules in this order:
//!
//! 1. [`space`]: the recipes that are looked at, seeded by how far each value of a fragment stage is from its interpolation;
//! 2. [`predict`]: the error and the work of each, told before anything is drawn, and which are left at that;
//! 3. [`mod@explore`]: the others drawn for their error and timed against the original (`race`), those beaten dropped as they are (`arena`, by [`pareto`]); the survivors crossed with each other; what
//!    is left, or as much of it as there is time for (`pick`, `watch`), verified on every camera's path (`verify`), and what was left for another that fell there judged again;
//! 4. [`journal`]: what was measured of a text, kept by its hash, so that a search goes on where it ended.

mod arena;
pub mod explore;
pub mod journal;
pub mod pareto;
mod pick;
pub mod predict;
mod race;
pub mod space;
mod verify;
mod watch;

pub use explore::{Ended, Exploration, Fate, Found, Point, Progress, Settings, Stage, explore};
pub use journal::Journal;
