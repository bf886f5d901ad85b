//! `docs/results/visibility-buffer.md`: what the files of `docs/results` say of the
//! visibility-buffer split.

use std::collections::BTreeSet;
use std::fmt::Write;

use preshade_plan::contract::Verdict;

use super::{
    Adapter, Bench, Crossing, Error, Estimate, File, Held, Point, Report, Series, Variant,
    is_compute, is_split,
};

/// The article's measurement (Cinevva, part 21): instances, milliseconds of the visibility buffer
/// and of forward shading. At 100,000 it says that they are even, and no times.
const ARTICLE: [(u32, Option<[f64; 2]>); 3] = [
    (50_000, Some([4.13, 5.51])),
    (100_000, None),
    (200_000, Some([7.80, 5.44])),
];

const HEAD: &str = "\
                    # The visibility buffer: results

<!-- Made from docs/results by `UPDATE_PAGES=1 cargo test --test it results_page`; \
    edits will be lost. -->

These tables come from the JSON files in this folder. The [guide](../guides/visibility-buffer.md) \
    explains
the variants and draws the conclusions. To add your adapter, see [send in \
    yours](README.md#send-in-yours).
";

/// The scene as its author wrote it.
const ORIGINAL: &str = "original";

const THEIRS: &str = "
## The article

Cinevva, part 21: an M-series Mac, about 1080p, cross-card blades over an 80 m field, the two \
    paths written by hand. Milliseconds a frame:

";

const COMPUTE: &str = "\
                       Shaded by a compute pass, apart: how much stronger an adapter's compute is \
                       than its rasteriser differs from one adapter to the next, and the article's \
                       resolve is a full-screen draw.
";

/// The page.
pub fn page(files: &[File]) -> String {
    let files: Vec<&File> = files.iter().filter(|f| f.held.splits()).collect();
    let mut out = HEAD.to_owned();
    out.push_str(&article());
    let adapters: BTreeSet<&Adapter> = files.iter().filter_map(|f| f.held.adapter()).collect();
    for adapter in adapters {
        let _ = writeln!(
            out,
            "\n## {}\n\nDriver {}; {}, {}.",
            text(&adapter.name),
            text(&adapter.driver),
            text(&adapter.backend),
            text(&adapter.kind)
        );
        let own = files.iter().filter(|f| f.held.adapter() == Some(adapter));
        let own: Vec<&File> = own.copied().collect();
        out.push_str(&beside_the_article(&own));
        for file in own {
            let name = &file.name;
            let _ = writeln!(out, "\n### [`{name}`]({name})\n");
            out.push_str(&match &file.held {
                Held::Series(series) => told_of_series(series),
                Held::Report(report) => told_of_report(report),
                Held::Bench(bench) => told_of_bench(bench),
                Held::Decision => String::new(),
            });
        }
    }
    out
}

/// The article's own figures.
fn article() -> String {
    let mut rows = vec![cells(["instances", "visibility buffer", "forward"])];
    for (instances, times) in ARTICLE {
        let instances = grouped(f64::from(instances));
        rows.push(match times {
            Some(times) => {
                let [split, forward] = times.map(|t| format!("{t:.2}"));
                vec![instances, split, forward]
            }
            None => cells([&instances, "even", "even"]),
        });
    }
    format!("{THEIRS}{}", table(&rows))
}

/// What an adapter's series over `instances` say to the article's question; nothing where it has
/// none.
fn beside_the_article(files: &[&File]) -> String {
    let measured = over_instances(files).flat_map(|(_, s)| &s.points);
    let values: BTreeSet<u32> = measured.map(|p| p.value).collect();
    if values.is_empty() {
        return String::new();
    }
    let mut out = "\n**Forward shading's time over the visibility buffer's** (above 1 the \
                   visibility buffer is faster), and at how many instances they cross, with the 95 \
                   % interval:\n\n"
        .to_owned();
    let theirs: Vec<String> = values
        .iter()
        .map(|value| {
            let told = ARTICLE.iter().find(|a| a.0 == *value);
            told.map_or(String::new(), |(_, times)| match times {
                Some([split, forward]) => format!("{:.2}x", forward / split),
                None => "even".to_owned(),
            })
        })
        .collect();
    let shared = theirs.iter().any(|cell| !cell.is_empty());
    let row = shared.then(|| {
        let mut row = cells(["the article", "M-series", "by hand"]);
        row.extend(theirs);
        row.push("about 100,000".to_owned());
        row
    });
    out.push_str(&ratios(files, &values, ORIGINAL, row));
    out.push_str(
        "\n**The pre-pass's time over the visibility buffer's**, likewise; \
         the article has no pre-pass:\n\n",
    );
    out.push_str(&ratios(files, &values, "depth-prepass", None));
    out
}

/// The series over `instances`.
fn over_instances<'a>(files: &'a [&File]) -> impl Iterator<Item = (&'a File, &'a Series)> {
    files.iter().filter_map(|f| match &f.held {
        Held::Series(series) if series.variable == "instances" => Some((*f, series)),
        Held::Series(_) | Held::Report(_) | Held::Bench(_) | Held::Decision => None,
    })
}

/// The time of the variant named `baseline` over that of each split, at `values` of the instances:
/// a row a split, under the row `first`.
fn ratios(
    files: &[&File],
    values: &BTreeSet<u32>,
    baseline: &str,
    first: Option<Vec<String>>,
) -> String {
    let mut head = cells(["file", "scene", "variant"]);
    head.extend(values.iter().map(|v| grouped(f64::from(*v))));
    head.push("crosses at".to_owned());
    let mut drawn = vec![head.clone()];
    drawn.extend(first);
    let mut computed = vec![head];
    for (file, series) in over_instances(files) {
        for pair in &series.crossovers {
            let (name, is_first) = match (pair.first == baseline, pair.second == baseline) {
                (true, _) => (&pair.second, true),
                (false, true) => (&pair.first, false),
                (false, false) => continue,
            };
            let Some(split) = recipe(series, name).filter(|r| is_split(r)) else {
                continue;
            };
            let mut row = vec![link(&file.name), scene(series), named(name)];
            row.extend(values.iter().map(|value| {
                let ratio = pair.ratios.iter().find(|(v, _)| v == value);
                ratio.map_or(String::new(), |(_, e)| match is_first {
                    true => format!("{:.2}x", e.median),
                    false => format!("{:.2}x", 1.0 / e.median),
                })
            }));
            let crossings: Vec<String> = pair.at.iter().map(crossing).collect();
            row.push(crossings.join("; "));
            match is_compute(split) {
                true => computed.push(row),
                false => drawn.push(row),
            }
        }
    }
    let mut out = table(&drawn);
    if computed.len() > 1 {
        let _ = write!(out, "\n{COMPUTE}\n{}", table(&computed));
    }
    out
}

/// The recipe of a variant.
fn recipe<'a>(series: &'a Series, name: &str) -> Option<&'a str> {
    let variants = &series.points.first()?.report.variants;
    let variant = variants.iter().find(|v| v.name == name)?;
    Some(&variant.recipe)
}

/// Scene, resolution and what the command sets of the scene's variables.
fn scene(series: &Series) -> String {
    let first = series.points.first().map(|p| &p.report);
    first.map_or(String::new(), |report| {
        let [width, height] = report.resolution;
        let words: Vec<&str> = report.command.split_whitespace().collect();
        let set = words.windows(2).filter(|pair| pair[0] == "--set");
        let set: String = set.map(|pair| format!(", `{}`", text(pair[1]))).collect();
        format!("`{}`, {width}x{height}{set}", report.scene)
    })
}

/// A link to the section of a file.
fn link(file: &str) -> String {
    let anchor: String = file
        .to_lowercase()
        .chars()
        .filter(|c| c.is_alphanumeric() || matches!(c, '-' | '_'))
        .collect();
    format!("[`{file}`](#{anchor})")
}

fn told_of_series(series: &Series) -> String {
    let Some(first) = series.points.first().map(|p| &p.report) else {
        return "No values.\n".to_owned();
    };
    let mut out = scene_and_command(first);
    let reports = || series.points.iter().map(|p| &p.report);
    let mut head = vec![series.variable.clone()];
    head.extend(series.points.iter().map(|p| grouped(f64::from(p.value))));
    // One row a variant that was drawn anywhere, one column a value.
    let rows = |kept: &dyn Fn(&str) -> bool, cell: &dyn Fn(&Variant) -> Option<String>| {
        let mut rows = vec![head.clone()];
        for variant in first.variants.iter().filter(|v| kept(&v.recipe)) {
            let cells: Vec<Option<String>> = reports()
                .map(|r| cell(r.variants.iter().find(|v| v.name == variant.name)?))
                .collect();
            if cells.iter().any(Option::is_some) {
                let cells = cells.into_iter().map(|c| c.unwrap_or("-".to_owned()));
                rows.push(std::iter::once(named(&variant.name)).chain(cells).collect());
            }
        }
        rows
    };
    let time = |v: &Variant| v.time_ms.map(|e| format!("{:.2}", e.median));

    out.push_str(&timed(first, reports().flat_map(|r| &r.variants)));
    out.push_str(&table(&rows(&|recipe| !is_compute(recipe), &time)));
    let computed = rows(&is_compute, &time);
    if computed.len() > 1 {
        let _ = write!(out, "\nShaded by a compute pass:\n\n{}", table(&computed));
    }
    out.push_str(&crossings(series));
    let _ = write!(
        out,
        "\nFragments shaded a covered pixel:\n\n{}",
        table(&rows(&|_| true, &|v| v
            .shaded_per_pixel
            .map(|s| format!("{s:.2}"))))
    );
    let _ = write!(out, "\n{}:\n\n", differ(first));
    let error = |v: &Variant| v.error.as_ref().map(pixels);
    out.push_str(&table(&rows(&|recipe| !recipe.is_empty(), &error)));
    let at = |p: &Point| format!(", {} {}", grouped(f64::from(p.value)), series.variable);
    out.push_str(&notes(series.points.iter().map(|p| (at(p), &p.report))));
    out
}

/// Where pairs of variants cross.
fn crossings(series: &Series) -> String {
    let mut rows = vec![cells([
        "faster below",
        &format!("{}, 95 % interval", series.variable),
        "faster above",
    ])];
    for pair in &series.crossovers {
        let Some((_, start)) = pair.ratios.first() else {
            continue;
        };
        let mut order = [named(&pair.first), named(&pair.second)];
        if start.median > 1.0 {
            order.reverse();
        }
        for at in &pair.at {
            let [below, above] = order.clone();
            rows.push(vec![below, crossing(at), above]);
            order.reverse();
        }
    }
    match rows.len() {
        1 => "\nNo two variants cross.\n".to_owned(),
        _ => format!("\nWhat crosses:\n\n{}", table(&rows)),
    }
}

fn told_of_report(report: &Report) -> String {
    let mut out = scene_and_command(report);
    out.push_str(&timed(report, report.variants.iter()));
    let mut cameras: Vec<&str> = Vec::new();
    for view in report.variants.iter().flat_map(|v| &v.by_view) {
        if !cameras.contains(&view.camera.as_str()) {
            cameras.push(&view.camera);
        }
    }
    let mut rows = vec![cells(["", "ms", "fragments shaded a covered pixel"])];
    rows[0].extend(cameras.iter().map(|c| format!("pixels in `{c}`")));
    for v in report.variants.iter().filter(|v| v.error.is_some()) {
        let number = |n: Option<f64>| n.map_or("-".to_owned(), |n| format!("{n:.2}"));
        let mut row = vec![
            named(&v.name),
            number(v.time_ms.map(|e| e.median)),
            number(v.shaded_per_pixel),
        ];
        row.extend(cameras.iter().map(|camera| {
            let views = v.by_view.iter().filter(|view| view.camera == *camera);
            let worst = views.map(|view| view.error).reduce(worse);
            worst.as_ref().map_or("-".to_owned(), pixels)
        }));
        rows.push(row);
    }
    out.push_str(&table(&rows));
    let _ = writeln!(out, "\n{}.", differ(report));
    out.push_str(&notes([(String::new(), report)].into_iter()));
    out
}

fn told_of_bench(bench: &Bench) -> String {
    let [width, height] = bench.resolution;
    let mut out = format!(
        "`xtask bench --grass`, {width}x{height}: the hand-written reference, which has a field \
         of grass of its own, beside what is generated from its forward entry points, in one \
         process.\n\n"
    );
    let mut rows = vec![cells([
        "instances",
        "form",
        "recipe",
        "by hand ms",
        "generated ms",
        "by hand / generated, 95 % interval",
        "pixels that differ",
    ])];
    for row in bench.rows.iter().filter(|row| row.order == "grass") {
        let Estimate { median, low, high } = row.ratio;
        rows.push(vec![
            grouped(f64::from(row.layers)),
            text(&row.form),
            format!("`{}`", row.recipe),
            format!("{:.2}", row.handwritten_ms.median),
            format!("{:.2}", row.generated_ms.median),
            format!("{median:.3} [{low:.3}, {high:.3}]"),
            grouped(row.changed_pixels as f64),
        ]);
    }
    out.push_str(&table(&rows));
    out
}

fn scene_and_command(report: &Report) -> String {
    let [width, height] = report.resolution;
    // Recorded while several --pass were several variants.
    // As today's program takes it: the pass has got a budget since.
    let today = |word: &str| match word.strip_prefix("visibility-buffer") {
        Some(rest) if !word.contains("budget=") => {
            let joint = if rest.is_empty() { ":" } else { "," };
            format!("{word}{joint}budget=1")
        }
        _ => word.to_owned(),
    };
    let command = report.command.replace(" --pass ", " --variant ");
    let command: Vec<String> = command.split(' ').map(today).collect();
    let command = command.join(" ");
    let scene = &report.scene;
    format!("Scene `{scene}`, {width}x{height}.\n\n```sh\n{command}\n```\n")
}

/// The sentence above a table of times: the clock, and the widest interval.
fn timed<'a>(report: &Report, variants: impl Iterator<Item = &'a Variant>) -> String {
    let clock = match report.clock.as_deref() {
        Some("gpu-timestamps") => "by GPU timestamps",
        Some("wall-clock") => "by the CPU's clock",
        Some(_) | None => "not taken",
    };
    let widest = variants
        .filter_map(|v| v.time_ms)
        .map(|e| (e.high - e.median).max(e.median - e.low) / e.median)
        .fold(0.0, f64::max);
    format!(
        "\nMilliseconds a frame, {clock}: medians, whose 95 % intervals reach no further than \
         {:.1} % from them.\n\n",
        100.0 * widest
    )
}

/// What the figures of a table of differences are.
fn differ(report: &Report) -> String {
    let [width, height] = report.resolution;
    format!(
        "Pixels of {} whose colour differs from the scene as written (in brackets: by at most how \
         many steps of 1/255)",
        grouped(f64::from(width) * f64::from(height))
    )
}

fn pixels(error: &Error) -> String {
    match error.changed_pixels {
        0 => "0".to_owned(),
        n => format!("{} ({:.0})", grouped(n as f64), error.max_abs * 255.0),
    }
}

fn worse(a: Error, b: Error) -> Error {
    Error {
        changed_pixels: a.changed_pixels.max(b.changed_pixels),
        changed_depth: a.changed_depth.max(b.changed_depth),
        max_abs: a.max_abs.max(b.max_abs),
    }
}

/// Self-tests, depths, what broke and what was not drawn, of the reports, each with where it stands
/// in its series.
fn notes<'a>(reports: impl Iterator<Item = (String, &'a Report)>) -> String {
    // What is told once, of the first value at which it is so.
    let mut told: BTreeSet<(&str, &str)> = BTreeSet::new();
    let mut lines: Vec<String> = Vec::new();
    let [mut depths, mut held, mut tests] = [0, 0, 0];
    for (at, report) in reports {
        for v in &report.variants {
            let name = named(&v.name);
            let changed = v.error.map_or(0, |e| e.changed_depth);
            depths += changed;
            if changed > 0 {
                let changed = grouped(changed as f64);
                lines.push(format!("{name}{at}: {changed} depths differ."));
            }
            for test in &v.self_test {
                tests += 1;
                let said = match test.result.as_str() {
                    "held" => {
                        held += 1;
                        continue;
                    }
                    "failed" => "FAILED",
                    _ => "said nothing",
                };
                let material = &test.material;
                lines.push(format!("{name}{at}: self-test of `{material}` {said}."));
            }
            match &v.verdict {
                Verdict::Holds => {}
                Verdict::Broken { r#where } => {
                    let place = text(r#where);
                    lines.push(format!("{name}{at}: BROKE its contract: {place}."));
                }
                Verdict::NotMeasured { why } => {
                    if told.insert((&v.name, "")) {
                        lines.push(format!("{name}{at}: not measured: {}.", text(why)));
                    }
                }
            }
            for kept in &v.kept {
                if told.insert((&v.name, &kept.material)) {
                    let (material, why) = (&kept.material, text(&kept.why));
                    lines.push(format!("{name}{at}: `{material}` as written: {why}."));
                }
            }
        }
    }
    if depths == 0 {
        lines.insert(0, "No depth differs.".to_owned());
    }
    if tests > 0 {
        lines.insert(0, format!("Self-tests: {held} of {tests} held."));
    }
    lines.iter().fold("\n".to_owned(), |mut out, line| {
        let _ = writeln!(out, "- {line}");
        out
    })
}

fn crossing(at: &Crossing) -> String {
    let end = |end: Option<f64>, open: &str| end.map_or(open.to_owned(), grouped);
    let interval = match (at.low, at.high) {
        (None, None) => "noise hides where".to_owned(),
        (low, high) => {
            let low = end(low, "below the series");
            format!("{low}, {}", end(high, "past the series"))
        }
    };
    format!("{} [{interval}]", grouped(at.value))
}

/// A variant's name as code; the scene as written in words.
fn named(name: &str) -> String {
    match name {
        ORIGINAL => "as written".to_owned(),
        name => format!("`{name}`"),
    }
}

fn cells<const N: usize>(cells: [&str; N]) -> Vec<String> {
    cells.map(str::to_owned).to_vec()
}

/// A Markdown table: the first row is its head, columns with numbers stand to the right.
fn table(rows: &[Vec<String>]) -> String {
    let Some(head) = rows.first() else {
        return String::new();
    };
    let is_number = |cell: &String| cell.starts_with(|c: char| c.is_ascii_digit());
    let rules = (0..head.len()).map(|column| {
        let mut cells = rows[1..].iter().filter_map(|row| row.get(column));
        match cells.any(is_number) {
            true => "---:".to_owned(),
            false => "---".to_owned(),
        }
    });
    let rules: Vec<String> = rules.collect();
    let mut out = String::new();
    for row in std::iter::once(head).chain([&rules]).chain(&rows[1..]) {
        let _ = writeln!(out, "| {} |", row.join(" | "));
    }
    out
}

/// Text of a file inside a line or a cell of Markdown.
fn text(text: &str) -> String {
    text.replace(['\n', '\r'], " ").replace('|', "\\|")
}

/// A whole number with its thousands apart.
fn grouped(number: f64) -> String {
    let digits = format!("{number:.0}");
    let mut out = String::new();
    for (i, digit) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            out.push(',');
        }
        out.push(digit);
    }
    out
}
