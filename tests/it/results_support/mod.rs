//! The files of `docs/results`, as far as the pages made of them need: the rest of a file is not
//! read, so that one made by an older or a newer `preshade` is still readable as long as its schema
//! has the same name.

use std::path::Path;

use preshade_plan::contract::Verdict;
use serde::Deserialize;
use serde_json::Value;

pub mod page;

/// A file.
pub struct File {
    /// Its name, without the folder.
    pub name: String,
    /// What it holds.
    pub held: Held,
}

/// What a file holds, by its field `schema`.
pub enum Held {
    /// A scene at several values of a variable: `verify --sweep .. --share`.
    Series(Series),
    /// A scene: `verify --share`.
    Report(Report),
    /// Hand-written forms beside generated ones: `bench --format json`.
    Bench(Bench),
    /// What `plan` decided, or what its decisions regret: no page is made of those.
    Decision,
}

#[derive(Deserialize)]
pub struct Series {
    pub variable: String,
    pub crossovers: Vec<Crossover>,
    /// Ascending by value.
    pub points: Vec<Point>,
}

#[derive(Deserialize)]
pub struct Point {
    pub value: u32,
    pub report: Report,
}

#[derive(Deserialize)]
pub struct Crossover {
    pub first: String,
    pub second: String,
    /// Time of the first over that of the second.
    pub ratios: Vec<(u32, Estimate)>,
    pub at: Vec<Crossing>,
}

#[derive(Deserialize)]
pub struct Crossing {
    pub value: f64,
    pub low: Option<f64>,
    pub high: Option<f64>,
}

#[derive(Deserialize)]
pub struct Report {
    pub scene: String,
    pub resolution: [u32; 2],
    pub command: String,
    pub adapter: Adapter,
    pub clock: Option<String>,
    /// The original first.
    pub variants: Vec<Variant>,
}

#[derive(Deserialize, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub struct Adapter {
    pub name: String,
    pub driver: String,
    pub backend: String,
    pub kind: String,
}

#[derive(Deserialize)]
pub struct Variant {
    pub name: String,
    pub recipe: String,
    pub verdict: Verdict,
    pub error: Option<Error>,
    pub time_ms: Option<Estimate>,
    pub shaded_per_pixel: Option<f64>,
    #[serde(default)]
    pub self_test: Vec<SelfTest>,
    pub kept: Vec<Kept>,
    pub by_view: Vec<View>,
}

#[derive(Deserialize)]
pub struct View {
    pub camera: String,
    pub error: Error,
}

#[derive(Deserialize, Clone, Copy)]
pub struct Error {
    pub changed_pixels: u64,
    pub changed_depth: u64,
    /// Of a channel from 0 to 1.
    pub max_abs: f64,
}

/// A median with its 95 % interval.
#[derive(Deserialize, Clone, Copy)]
pub struct Estimate {
    pub median: f64,
    pub low: f64,
    pub high: f64,
}

#[derive(Deserialize)]
pub struct SelfTest {
    pub material: String,
    /// `held`, `failed` or `not-run`.
    pub result: String,
}

#[derive(Deserialize)]
pub struct Kept {
    pub material: String,
    pub why: String,
}

#[derive(Deserialize)]
pub struct Bench {
    pub resolution: [u32; 2],
    pub adapter: Adapter,
    pub rows: Vec<Row>,
}

#[derive(Deserialize)]
pub struct Row {
    /// Instances, where `order` is `grass`.
    pub layers: u32,
    pub order: String,
    pub form: String,
    pub recipe: String,
    pub handwritten_ms: Estimate,
    pub generated_ms: Estimate,
    /// Time of the hand-written form over the generated one's.
    pub ratio: Estimate,
    pub changed_pixels: u64,
}

/// Every JSON file of a folder, by name.
///
/// # Errors
/// A sentence with the file's name, for one that cannot be read or has no known schema.
pub fn read(folder: &Path) -> Result<Vec<File>, String> {
    let said = |at: &Path, e: &dyn std::fmt::Display| format!("{}: {e}", at.display());
    let mut files = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(|e| said(folder, &e))? {
        let path = entry.map_err(|e| said(folder, &e))?.path();
        if path.extension().is_none_or(|e| e != "json") {
            continue;
        }
        let text = std::fs::read_to_string(&path).map_err(|e| said(&path, &e))?;
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        files.push(File {
            name: name.into_owned(),
            held: held(&text).map_err(|e| said(&path, &e))?,
        });
    }
    files.sort_by(|a, b| a.name.cmp(&b.name));
    Ok(files)
}

/// What a file's text holds.
///
/// # Errors
/// A sentence, for what is no JSON, has no known schema or lacks what the schema says.
pub fn held(text: &str) -> Result<Held, String> {
    let json: Value = serde_json::from_str(text).map_err(|e| e.to_string())?;
    let schema = json["schema"].as_str().map(str::to_owned);
    match schema.as_deref() {
        Some("preshade.series.v1") => serde_json::from_value(json).map(Held::Series),
        Some("preshade.verify.v1") => serde_json::from_value(json).map(Held::Report),
        Some("preshade.bench.v1") => serde_json::from_value(json).map(Held::Bench),
        Some(
            "preshade.decision.v1"
            | "preshade.decision.v2"
            | "preshade.regret.v1"
            | "preshade.regret.v2"
            | "preshade.explore.v1",
        ) => {
            return Ok(Held::Decision);
        }
        Some(other) => return Err(format!("`{other}` is no schema that is known here")),
        None => return Err("there is no field `schema`".to_owned()),
    }
    .map_err(|e| e.to_string())
}

impl Held {
    /// Where it was measured; `None`: it holds nothing.
    pub fn adapter(&self) -> Option<&Adapter> {
        match self {
            Self::Series(series) => Some(&series.points.first()?.report.adapter),
            Self::Report(report) => Some(&report.adapter),
            Self::Bench(bench) => Some(&bench.adapter),
            Self::Decision => None,
        }
    }

    /// Whether the visibility-buffer split is in it.
    pub fn splits(&self) -> bool {
        match self {
            Self::Series(series) => series.points.iter().any(|p| p.report.splits()),
            Self::Report(report) => report.splits(),
            Self::Bench(bench) => bench.rows.iter().any(|row| is_split(&row.recipe)),
            Self::Decision => false,
        }
    }
}

impl Report {
    fn splits(&self) -> bool {
        self.variants.iter().any(|v| is_split(&v.recipe))
    }
}

/// Whether a recipe makes a visibility buffer.
pub fn is_split(recipe: &str) -> bool {
    recipe.contains("visibility-buffer")
}

/// Whether a recipe shades in a compute pass.
pub fn is_compute(recipe: &str) -> bool {
    is_split(recipe) && (recipe.contains("form=compute") || recipe.contains("form=binned"))
}
