//! The pages of `docs` that are made from the files of `docs/results` say what the files say.

use std::path::Path;

use crate::results_support::{File, held, page::page, read};

const COMMAND: &str = "UPDATE_PAGES=1 cargo test --test it results_page";

#[test]
fn the_page_says_what_the_files_say() {
    let docs = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs");
    let files = read(&docs.join("results")).unwrap_or_else(|e| panic!("{e}"));
    let made = page(&files);
    let path = docs.join("results/visibility-buffer.md");
    if std::env::var_os("UPDATE_PAGES").is_some() {
        std::fs::write(&path, &made).unwrap();
    }
    let there = std::fs::read_to_string(&path)
        .unwrap_or_default()
        .replace("\r\n", "\n");
    if let Some(line) = first_difference(&there, &made) {
        panic!(
            "docs/results/visibility-buffer.md is not what docs/results says, from line {line} on: \
             `{COMMAND}` writes it"
        );
    }
}

/// The first line, from 1, in which two texts differ.
fn first_difference(a: &str, b: &str) -> Option<usize> {
    let (mut a, mut b) = (a.split('\n'), b.split('\n'));
    (1..).find_map(|line| match (a.next(), b.next()) {
        (None, None) => Some(None),
        (left, right) if left != right => Some(Some(line)),
        (Some(_) | None, _) => None,
    })?
}

/// A series of two values and three variants, as small as the schema allows, of an adapter that
/// nobody has.
fn series(adapter: &str, changed: u64) -> File {
    let variant = |name: &str, ms: f64, changed: u64| {
        serde_json::json!({
            "name": name,
            "recipe": if name == "original" { "" } else { name },
            "verdict": if changed > 1000 {
                serde_json::json!({ "kind": "broken", "where": "camera `c`" })
            } else {
                serde_json::json!({ "kind": "holds" })
            },
            "error": { "changed_pixels": changed, "changed_depth": 0, "max_abs": 2.0 / 255.0 },
            "time_ms": { "median": ms, "low": ms * 0.98, "high": ms * 1.01, "samples": [ms] },
            "shaded_per_pixel": 1.0,
            "self_test": [{ "material": "m", "result": "failed" }],
            "kept": [],
            "by_view": [],
        })
    };
    let point = |value: u32, [a, b, c]: [f64; 3]| {
        serde_json::json!({ "value": value, "report": {
            "schema": "preshade.verify.v1",
            "scene": "grass",
            "resolution": [640, 360],
            "command": "preshade verify grass.toml --set order=ascending",
            "adapter": { "name": adapter, "driver": "D 1", "backend": "metal", "kind": "integrated" },
            "clock": "wall-clock",
            "variants": [
                variant("original", a, 0),
                variant("visibility-buffer:select=id", b, changed),
                variant("visibility-buffer:form=compute", c, 0),
            ],
        }})
    };
    let ratio =
        |value: u32, r: f64| serde_json::json!([value, { "median": r, "low": r, "high": r }]);
    let text = serde_json::json!({
        "schema": "preshade.series.v1",
        "variable": "instances",
        "points": [point(1000, [1.0, 2.0, 0.5]), point(50000, [8.0, 4.0, 2.0])],
        "crossovers": [
            {
                "first": "original",
                "second": "visibility-buffer:select=id",
                "ratios": [ratio(1000, 0.5), ratio(50000, 2.0)],
                "at": [{ "value": 8366.6, "low": null, "high": 9000.4 }],
            },
            {
                "first": "visibility-buffer:form=compute",
                "second": "original",
                "ratios": [ratio(1000, 0.5), ratio(50000, 0.25)],
                "at": [],
            },
        ],
    });
    File {
        name: format!("{adapter}-grass.json"),
        held: held(&text.to_string()).unwrap_or_else(|e| panic!("{e}")),
    }
}

#[test]
fn another_adapter_gets_a_section_and_rows_of_its_own() {
    let made = page(&[series("Acme", 7), series("Zeta|2", 0)]);
    for line in [
        "## Acme",
        "## Zeta\\|2",
        "Driver D 1; metal, integrated.",
        // The compute form in a table of its own, beside the article where it has the density.
        "| file | scene | variant | 1,000 | 50,000 | crosses at |",
        "| the article | M-series | by hand |  | 1.33x | about 100,000 |",
        "| [`Acme-grass.json`](#acme-grassjson) | `grass`, 640x360, `order=ascending` | \
         `visibility-buffer:select=id` | 0.50x | 2.00x | 8,367 [below the series, 9,000] |",
        "| [`Acme-grass.json`](#acme-grassjson) | `grass`, 640x360, `order=ascending` | \
         `visibility-buffer:form=compute` | 2.00x | 4.00x |  |",
        "Milliseconds a frame, by the CPU's clock: medians, whose 95 % intervals reach no further \
         than 2.0 % from them.",
        "| as written | 1.00 | 8.00 |",
        "| as written | 8,367 [below the series, 9,000] | `visibility-buffer:select=id` |",
        "| `visibility-buffer:select=id` | 7 (2) | 7 (2) |",
        "- Self-tests: 0 of 6 held.",
        "- `visibility-buffer:form=compute`, 50,000 instances: self-test of `m` FAILED.",
    ] {
        assert!(
            made.lines().any(|l| l == line),
            "no line `{line}` in:\n{made}"
        );
    }
}

#[test]
fn what_broke_is_said() {
    let made = page(&[series("Acme", 5000)]);
    let line = "- `visibility-buffer:select=id`, 1,000 instances: BROKE its contract: camera `c`.";
    assert!(made.lines().any(|l| l == line), "{made}");
}

#[test]
fn what_is_no_result_is_refused() {
    for (text, why) in [
        ("{", "EOF"),
        ("{}", "there is no field `schema`"),
        (
            r#"{"schema": "preshade.series.v9"}"#,
            "`preshade.series.v9` is no schema",
        ),
        (
            r#"{"schema": "preshade.series.v1"}"#,
            "missing field `variable`",
        ),
    ] {
        let said = held(text).err().unwrap_or_default();
        assert!(said.contains(why), "{text}: {said}");
    }
}
