//! A scene on an adapter: variants are drawn, compared, timed and judged; searches and jobs over them; reports.

pub mod isolated;
pub mod jobs;
pub mod measure;
pub mod report;
pub mod search;
pub mod verify;

pub use verify::verify;
