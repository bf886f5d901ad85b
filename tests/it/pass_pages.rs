//! `docs/passes/NAME.md` is what a pass's own source says, its parameters, and an example that is
//! run here: `UPDATE_PAGES=1` writes the pages.

use std::fmt::Write;
use std::fs;
use std::path::{Path, PathBuf};

use preshade_compiler::emit;
use preshade_compiler::front::{Source, parse};
use preshade_compiler::parameters::{Parameter, parameters};
use preshade_compiler::recipe::Recipe;
use preshade_geometry::PASSES;
use preshade_plan::contract::Contract;
use preshade_plan::pass::{AnyPass, Facts, PassInfo, Use};
use preshade_plan::plan::Plan;
use preshade_plan::plan_file::Target;
use preshade_plan::state::{CompareFunction, MaterialState};
use shader_text::options::Options;

/// The recipe of a pass's page and the text it is applied to, by name.
fn example(pass: &dyn AnyPass) -> (Vec<String>, &'static str, String) {
    let mut uses = pass.examples().iter();
    let found = uses.find_map(|e| {
        e.uses.iter().find_map(|u| match u {
            Use::Page(file) => Some((e.recipe, *file)),
            _ => None,
        })
    });
    let name = pass.info().name;
    let (recipe, file) = found.unwrap_or_else(|| panic!("no example of {name} is for its page"));
    let path = root().join("fixtures").join(file).with_extension("wgsl");
    let stem = file.rsplit('/').next().unwrap();
    let steps = Recipe::parse_list(recipe).unwrap().steps;
    let steps = steps.iter().map(ToString::to_string).collect();
    (steps, stem, fs::read_to_string(path).unwrap())
}

/// The command that draws the picture of a pass's page, and a sentence about it.
fn picture(pass: &dyn AnyPass) -> (String, &'static str, u32) {
    let mut uses = pass.examples().iter();
    let found = uses.find_map(|e| {
        e.uses.iter().find_map(|u| match u {
            Use::Picture {
                scene,
                caption,
                rows,
            } => Some((e.recipe, scene, caption, rows)),
            _ => None,
        })
    });
    let name = pass.info().name;
    let (recipe, scene, caption, rows) =
        found.unwrap_or_else(|| panic!("no example of {name} draws its picture"));
    let flag = match Recipe::parse_list(recipe).unwrap().steps.len() {
        1 => "--pass",
        _ => "--variant",
    };
    (
        format!("preshade verify {scene} {flag} {recipe}"),
        caption,
        *rows,
    )
}

/// Most bytes of a picture.
const PICTURE: u64 = 60_000;

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// The comment that a pass's file opens with, as Markdown: links into the code are left as code,
/// and left out where they stand in parentheses for readers of the code.
fn comment(name: &str) -> String {
    let file = name.replace('-', "_");
    let folders = ["passes/src/transforms", "crates/geometry/src"];
    let mut candidates = folders
        .map(|f| root().join(f).join(format!("{file}.rs")))
        .into_iter();
    let path = candidates.find(|p| p.is_file()).unwrap();
    let text = fs::read_to_string(path).unwrap();
    let lines = text.lines().take_while(|l| l.starts_with("//!"));
    let lines = lines.map(|l| l.trim_start_matches("//!").strip_prefix(' ').unwrap_or(""));
    let text = lines.collect::<Vec<_>>().join("\n");
    let mut read = String::new();
    let mut rest = &text[..];
    while let Some(at) = rest.find(" ([`") {
        let end = at + rest[at..].find(')').unwrap() + 1;
        let inner = &rest[at + 2..end - 1];
        let links = inner
            .split(", ")
            .all(|l| l.starts_with("[`") && l.ends_with("`]"));
        read.push_str(&rest[..if links { at } else { end }]);
        rest = &rest[end..];
    }
    read.push_str(rest);
    read.replace("[`", "`").replace("`]", "`")
}

fn promise(contract: &Contract) -> String {
    let given = contract
        .given()
        .iter()
        .map(|a| serde_json::to_value(a).unwrap());
    let given: Vec<String> = given
        .map(|a| format!("`{}`", a.as_str().unwrap()))
        .collect();
    let budgets: Vec<String> = contract.budgets().iter().map(ToString::to_string).collect();
    let off = match budgets.is_empty() {
        true => String::new(),
        false => format!(" ({})", budgets.join(", ")),
    };
    let given = match given.is_empty() {
        true => String::new(),
        false => format!(", given {}", given.join(", ")),
    };
    format!("`{}`{off}{given}", contract.kind())
}

/// The introduction of the parameters that a listing only mentions.
const EXPERTS: &str = "\n### Expert parameters\n\nThese are for tests, for devices without a \
                       feature, and to override what was measured of the\n\
                       adapter. Leave them out: each default is measured, derived from the \
                       material, or the usual\nchoice.\n\n";

fn page(pass: &dyn AnyPass) -> String {
    let info = pass.info();
    let mut text = format!(
        "<!-- Made of passes/src/transforms by `UPDATE_PAGES=1 cargo test --test it pass_pages`; \
         edits will be lost. -->\n# {}\n\n{}\n\n",
        info.name,
        comment(info.name)
    );
    writeln!(
        text,
        "Take it where {}.\n\nIt hurts {}.\n\nSource: {}.\n",
        info.when.trim_end_matches('.'),
        info.hurts.trim_end_matches('.'),
        info.source.trim_end_matches('.')
    )
    .unwrap();
    let (command, seen, rows) = picture(pass);
    let often = match rows {
        1 => "",
        _ => ", and how often each pixel is shaded",
    };
    let file = format!("../images/passes/{}.png", info.name);
    writeln!(
        text,
        "![Original, variant and their difference times 16{often}: {seen}]({file})\n\n\
         `{command}`: {seen}.\n"
    )
    .unwrap();
    // The script that draws it reads the page.
    if !updates() {
        let bytes = fs::metadata(root().join("docs/passes").join(&file))
            .unwrap_or_else(|e| panic!("{file}: {e}: scripts/pass-pictures.sh draws it"))
            .len();
        assert!(bytes <= PICTURE, "{file} has {bytes} bytes");
    }
    text.push_str("## Parameters\n\n");
    let (experts, usual): (Vec<Parameter>, Vec<Parameter>) =
        parameters(pass).into_iter().partition(|p| p.expert);
    let default = |p: &Parameter| {
        let default = p.default.as_ref().filter(|d| !d.is_null());
        default.map_or(String::new(), |d| {
            format!(
                " Default: `{}`.",
                d.as_str().map_or(d.to_string(), str::to_owned)
            )
        })
    };
    for p in &usual {
        let what = p.what.replace('\n', " ");
        writeln!(text, "- `{}`: {what}{}", p.name, default(p)).unwrap();
        for choice in &p.choices {
            writeln!(
                text,
                "  - `{}`: {}",
                choice.value,
                choice.what.replace('\n', " ")
            )
            .unwrap();
        }
    }
    if !experts.is_empty() {
        text.push_str(EXPERTS);
    }
    for p in &experts {
        writeln!(text, "- {}: {}{}", p.in_short(), p.what, default(p)).unwrap();
    }
    let mut state = MaterialState::default();
    let mut given = String::new();
    if info.name == "half-rate" {
        state.depth_compare = Some(CompareFunction::Always);
        state.depth_write = false;
        given.push_str(" --depth-compare always --no-depth-write");
    }
    let options = Options::default();
    let (steps, name, source) = example(pass);
    let file = format!("{name}.wgsl");
    let parsed = parse(&[Source::new(file, source.as_str())], &options).unwrap();
    let original = Plan::original(
        name,
        parsed.program,
        &parsed.vertex,
        parsed.fragment.as_deref(),
        &state,
    );
    let applied = Recipe::parse(&steps)
        .unwrap()
        .apply(&original, &Facts::default());
    let plan = applied.unwrap_or_else(|r| panic!("{}: {r}", info.name));
    let flags: Vec<String> = steps.iter().map(|s| format!("--pass {s}")).collect();
    write!(
        text,
        "\n## Example\n\n`preshade rewrite {name}.wgsl{given} {}` of\n\n```wgsl\n{source}```\n\n",
        flags.join(" ")
    )
    .unwrap();
    writeln!(
        text,
        "promises {}; the passes are:\n",
        promise(&plan.contract)
    )
    .unwrap();
    text.push_str(
        "| pass | vertex | fragment | depth compare | writes depth |\n|---|---|---|---|---|\n",
    );
    for p in &plan.passes {
        let depth = p.depth.as_ref();
        writeln!(
            text,
            "| {} | `{}` | {} | {} | {} |",
            p.role.name(),
            p.vertex,
            p.fragment
                .as_ref()
                .map_or("none".to_owned(), |f| format!("`{f}`")),
            depth.map_or("none".to_owned(), |d| format!("{:?}", d.compare)),
            depth.map_or("no", |d| if d.write { "yes" } else { "no" }),
        )
        .unwrap();
    }
    for file in emit::emit(&plan, &[Target::Wgsl], &emit::Options::default()).unwrap() {
        let content = String::from_utf8(file.bytes).unwrap();
        let is_original = content == source;
        if file.name.ends_with(".wgsl") && !is_original {
            write!(
                text,
                "\n<details><summary>{}</summary>\n\n```wgsl\n{content}```\n\n</details>\n",
                file.name
            )
            .unwrap();
        }
    }
    text
}

/// Whether the pages are written anew.
fn updates() -> bool {
    std::env::var_os("UPDATE_PAGES").is_some()
}

/// The book's contents and the README's table name each pass.
#[test]
fn lists_of_passes_are_complete() {
    for (file, after) in [
        ("docs/SUMMARY.md", "# Passes\n\n"),
        ("README.md", "| pass | use it when |\n|---|---|\n"),
    ] {
        let path = root().join(file);
        let mut text = fs::read_to_string(&path).unwrap();
        for pass in PASSES.iter() {
            let PassInfo { name, when, .. } = pass.info();
            let (link, line) = match file {
                "README.md" => (
                    format!("[`{name}`](docs/passes/{name}.md)"),
                    format!("| [`{name}`](docs/passes/{name}.md) | {when} |\n"),
                ),
                _ => (
                    format!("(passes/{name}.md)"),
                    format!("- [{name}](passes/{name}.md)\n"),
                ),
            };
            if text.contains(&link) {
                continue;
            }
            assert!(
                updates(),
                "{file} does not list {name}: UPDATE_PAGES=1 cargo test --test it pass_pages"
            );
            let at = text.find(after).unwrap() + after.len();
            text.insert_str(at, &line);
        }
        if updates() {
            fs::write(&path, text).unwrap();
        }
    }
}

#[test]
fn each_pass_has_the_page_that_its_source_makes() {
    let folder = root().join("docs/passes");
    let mut expected: Vec<PathBuf> = Vec::new();
    for pass in PASSES.iter() {
        let path = folder.join(format!("{}.md", pass.info().name));
        let made = page(*pass);
        if updates() {
            fs::create_dir_all(&folder).unwrap();
            fs::write(&path, &made).unwrap();
        }
        let there = fs::read_to_string(&path).unwrap_or_default();
        assert!(
            there == made,
            "{} is not what its source says: UPDATE_PAGES=1 cargo test --test it pass_pages",
            path.display()
        );
        expected.push(path);
    }
    let mut there: Vec<PathBuf> = fs::read_dir(&folder)
        .unwrap()
        .map(|e| e.unwrap().path())
        .collect();
    there.sort();
    expected.sort();
    assert_eq!(there, expected);
}

/// What a user of a visibility buffer decides is four parameters. Recipes accept the others.
#[test]
fn a_listing_shows_what_a_user_decides() {
    let pass = preshade_geometry::pass_named("visibility-buffer").unwrap();
    let all = parameters(pass);
    let shown = all.iter().filter(|p| !p.expert).map(|p| p.name.as_str());
    let shown: Vec<&str> = shown.collect();
    assert_eq!(shown, ["budget", "form", "select", "vertices"]);
    assert!(Recipe::parse(["visibility-buffer:corners=snapped,ids=unindexed"]).is_ok());
    let unknown = Recipe::parse(["visibility-buffer:corner=snapped"]).unwrap_err();
    let unknown = unknown.to_string();
    assert!(
        unknown.contains("`corners`") && !unknown.contains("words"),
        "{unknown}"
    );
}
