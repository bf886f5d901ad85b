//! `docs/results/stability.md`, made of the cases and of the figures of each adapter.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::Path;

use preshade_draw::render::AdapterReport;
use serde::{Deserialize, Serialize};

use super::case::{Case, Outcome, Red};
use super::render_support::gpu;
use super::root;

const SCHEMA: &str = "preshade.stability.v1";

/// What one adapter said of all cases.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Results {
    schema: String,
    adapter: AdapterReport,
    outcomes: Vec<Outcome>,
}

impl Results {
    pub fn new(outcomes: &[Outcome]) -> Self {
        Self {
            schema: SCHEMA.to_owned(),
            adapter: gpu().adapter().clone(),
            outcomes: outcomes.to_vec(),
        }
    }

    fn json(&self) -> String {
        serde_json::to_string_pretty(self).unwrap() + "\n"
    }

    /// A file name of letters and digits.
    fn file(&self) -> String {
        let name = self.adapter.name.to_lowercase();
        let words = name.split(|c: char| !c.is_ascii_alphanumeric());
        let words: Vec<&str> = words.filter(|w| !w.is_empty()).take(3).collect();
        words.join("-") + ".json"
    }
}

/// Writes what the environment asks for, and holds the page to the files it is made of.
pub fn check(groups: &[(&str, &[Case])], measured: &dyn Fn() -> Results) {
    if let Ok(path) = std::env::var("STABILITY_OUT") {
        std::fs::write(path, measured().json()).unwrap();
        return;
    }
    let folder = root().join("docs/results/stability");
    let update = std::env::var("UPDATE_PAGES");
    // The page of the files alone, where one of them came from another machine.
    let is_of_files = update.as_ref().is_ok_and(|asked| asked == "text");
    let update = update.is_ok();
    if update && !is_of_files {
        let mut results = measured();
        let file = folder.join(results.file());
        // Those that were not drawn this time stay as they are.
        if let Some(before) = read(&folder)
            .into_iter()
            .find(|r| same(&r.adapter, &results.adapter))
        {
            let is_new = |o: &Outcome| results.outcomes.iter().all(|n| n.name != o.name);
            let kept: Vec<Outcome> = before.outcomes.into_iter().filter(is_new).collect();
            results.outcomes.extend(kept);
        }
        let names: Vec<&str> = groups
            .iter()
            .flat_map(|(_, cases)| cases.iter().map(|c| c.name))
            .collect();
        results
            .outcomes
            .retain(|o| names.contains(&o.name.as_str()));
        results
            .outcomes
            .sort_by_key(|o| names.iter().position(|n| *n == o.name));
        std::fs::write(file, results.json()).unwrap();
    }
    let adapters = read(&folder);
    let wrong: Vec<String> = adapters
        .iter()
        .flat_map(|results| {
            let of = &results.adapter.name;
            let wrong = results.outcomes.iter().flat_map(Outcome::wrong);
            wrong.map(move |w| format!("{of}: {w}"))
        })
        .collect();
    assert!(
        wrong.is_empty(),
        "docs/results/stability: {}",
        wrong.join("\n")
    );
    let page = page(groups, &adapters);
    let path = root().join("docs/results/stability.md");
    if update {
        std::fs::write(&path, &page).unwrap();
    }
    let have = std::fs::read_to_string(&path).unwrap_or_default();
    assert!(
        have == page,
        "docs/results/stability.md is not what its cases and files say: UPDATE_PAGES=1 cargo test \
         --test stability"
    );
}

/// Whether two reports are of one adapter and driver, whichever features were asked after.
fn same(a: &AdapterReport, b: &AdapterReport) -> bool {
    (&a.name, &a.driver, &a.backend) == (&b.name, &b.driver, &b.backend)
}

fn read(folder: &Path) -> Vec<Results> {
    let mut files: Vec<_> = std::fs::read_dir(folder)
        .unwrap()
        .map(|e| e.unwrap().path())
        .filter(|p| p.extension().is_some_and(|e| e == "json"))
        .collect();
    files.sort();
    let read = |path: &std::path::PathBuf| {
        let text = std::fs::read_to_string(path).unwrap();
        serde_json::from_str(&text).unwrap_or_else(|e| panic!("{}: {e}", path.display()))
    };
    files.iter().map(read).collect()
}

fn page(groups: &[(&str, &[Case])], adapters: &[Results]) -> String {
    let mut out = "<!-- Made of tests/stability and docs/results/stability by `UPDATE_PAGES=1 \
                   cargo test --test stability`; edits will be lost. -->
# Hard cases

Each case is a scene that a transform once broke, or could break. The test draws it with the \
    original and with
each variant, under every depth format and direction that matters, and holds the variant to its \
    contract. Then it
removes the guard against the failure (the *mutation*), and the same judge must find the failure. \
    A case whose
mutation goes unnoticed proves nothing, so it fails. A case that skips a depth format or direction \
    gives the reason.

The scenes are in `fixtures/scenes/stability`, the cases in `tests/stability`. To add a column for \
    another machine,
run the test binary there with `STABILITY_OUT=FILE` from the root of a checkout, and put the file \
    into
`docs/results/stability`.
"
    .to_owned();
    let _ = writeln!(out, "\nDrawn on:\n");
    for (number, results) in (1..).zip(adapters) {
        let a = &results.adapter;
        let _ = writeln!(
            out,
            "{number}. {} ({}, {}, {})",
            a.name, a.backend, a.kind, a.driver
        );
    }
    for (group, cases) in groups {
        let _ = writeln!(out, "\n## {}\n", capital(group));
        let columns: String = (1..=adapters.len())
            .map(|n| format!(" on {n} | mutated on {n} |"))
            .collect();
        let _ = writeln!(out, "| case | guards against | drawn | mutation |{columns}");
        let _ = writeln!(
            out,
            "|---|---|---|---|{}",
            "---|".repeat(2 * adapters.len())
        );
        for case in *cases {
            let recipes: Vec<String> = case
                .recipes
                .iter()
                .map(|(recipe, expect)| format!("`{recipe}`{}", suffix(expect)))
                .collect();
            let setups: Vec<String> = case.setups.iter().map(ToString::to_string).collect();
            let mut drawn = format!("{} under {}", recipes.join(", "), setups.join(", "));
            if !case.only.is_empty() {
                let _ = write!(drawn, " (no others: {})", case.only);
            }
            let _ = write!(
                out,
                "| {} | {} | {drawn} | {} |",
                case.name, case.guards, case.mutation.0
            );
            for results in adapters {
                let found = results.outcomes.iter().find(|o| o.name == case.name);
                let (runs, mutated) = found.map_or_else(
                    || ("not drawn".to_owned(), "not drawn".to_owned()),
                    |o| match o.case == case.hash() {
                        true => (runs(o), red(&o.mutated, o.mutations)),
                        false => (OLDER.to_owned(), OLDER.to_owned()),
                    },
                );
                let _ = write!(out, " {runs} | {mutated} |");
            }
            out.push('\n');
        }
    }
    let _ = write!(
        out,
        "
## Far from the origin

The scene of *positions relative to the eye*, moved along x and z. The reference is a host that \
    keeps positions in
`f64`. Figures are median / 99th percentile / largest over 500 points, on a machine that rounds \
    each operation
correctly ([method](../reference/validation.md#error-against-f64)). *In the world*, the host \
    rounds positions to `f32`
and multiplies view and projection in `f32`. *Relative to the eye*, it subtracts the eye's \
    position first. Both run
the same shader, which uses only differences of positions. Steps are 1/255. *Hoisted* is `{}`.

{}",
        super::far::HOISTED,
        super::far::table()
    );
    out
}

/// What is said of figures of a case that is another by now.
const OLDER: &str = "of an older case";

fn suffix(expect: &super::case::Expect) -> String {
    use super::case::Expect;
    match expect {
        Expect::Holds => String::new(),
        Expect::Untied => " (refused where depths tie)".to_owned(),
        Expect::OffNearPlane => " (refused where some lie on the near plane)".to_owned(),
        Expect::Shades(most) => format!(" (shading at most {most} a pixel)"),
        Expect::Withstands(steps) => format!(" (also with its pre-pass {steps} floats away)"),
        Expect::Refused(code) => format!(" (refused: {code})"),
    }
}

/// `12 hold`, and what is wrong.
fn runs(outcome: &Outcome) -> String {
    let mut counts: BTreeMap<&str, usize> = BTreeMap::new();
    for run in &outcome.runs {
        let word = match &*run.result {
            "holds" => "hold",
            "refused" => "refused",
            super::case::UNMET => "on an assumption that is not met",
            _ => "**wrong**",
        };
        *counts.entry(word).or_default() += 1;
    }
    let counted: Vec<String> = counts.iter().map(|(w, n)| format!("{n} {w}")).collect();
    counted.join(", ")
}

fn red(red: &Red, of: usize) -> String {
    match red {
        Red::Seen { how } if of > 1 => format!("seen in {of} of its set-ups, in the first: {how}"),
        Red::Seen { how } => format!("seen: {how}"),
        Red::Unseen => "**not seen**".to_owned(),
        Red::NotHere { why } => format!("not here: {why}"),
    }
}

fn capital(word: &str) -> String {
    let mut letters = word.chars();
    letters
        .next()
        .map_or(String::new(), |c| c.to_uppercase().chain(letters).collect())
}
