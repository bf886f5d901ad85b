//! Every fixture shader through every pass, as text: a reviewer reads these files when a transform
//! changes.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use preshade_compiler::emit;
use preshade_compiler::recipe::Recipe;
use preshade_plan::pass::{Facts, Use};
use preshade_plan::plan::Plan;
use preshade_plan::plan_file::Target;

use crate::fixtures_support::{original, recipes};

/// The variant for a reviewer: the passes of the plan in a few lines, then the text of each
/// program. The error is the text of a refusal.
fn describe(plan: &Plan, recipe: &str) -> Result<String, String> {
    let author = plan.programs["main"].author_text().unwrap().to_owned();
    let recipe = Recipe::parse([recipe]).unwrap();
    let plan = recipe
        .apply(plan, &Facts::default())
        .map_err(|refusal| format!("{refusal}\nremedy: {}\n", refusal.remedy))?;
    let mut out = String::new();
    for pass in &plan.passes {
        let depth = pass.depth.as_ref().map_or_else(
            || "no depth".to_owned(),
            |d| {
                format!(
                    "{} {:?}{}{} bias {}/{}",
                    d.attachment,
                    d.compare,
                    if d.write { " write" } else { "" },
                    if d.read_only { " read-only" } else { "" },
                    d.bias.constant,
                    d.bias.slope_scale
                )
            },
        );
        let bindings: Vec<_> = pass
            .bindings
            .iter()
            .map(|b| format!("{}:{} {}", b.group, b.binding, b.name))
            .collect();
        let attributes: Vec<_> = pass
            .attributes
            .iter()
            .map(|a| format!("{} {}", a.location, a.name))
            .collect();
        writeln!(
            out,
            "{} [{}] {} + {}\n  {depth}\n  bindings {}\n  attributes {}",
            pass.role.name(),
            pass.program,
            pass.vertex,
            pass.fragment.as_deref().unwrap_or("-"),
            bindings.join(", "),
            attributes.join(", "),
        )
        .unwrap();
    }
    writeln!(out, "contract {:?}", plan.contract).unwrap();
    for file in emit::emit(&plan, &[Target::Wgsl], &emit::Options::default()).unwrap() {
        if file.name.ends_with(".wgsl") {
            let text = String::from_utf8(file.bytes).unwrap();
            if file.name.ends_with(".original.wgsl") {
                assert_eq!(text, author, "{}", file.name);
                continue;
            }
            let text = if text == author {
                "as written"
            } else {
                text.as_str()
            };
            writeln!(out, "\n==== {}\n{text}", file.name).unwrap();
        }
    }
    Ok(out)
}

/// A snapshot for each variant; one table of all refusals, each text once, followed by the recipes
/// and fixtures that it refuses.
#[test]
fn every_fixture_through_every_pass() {
    let mut refused: BTreeMap<String, Vec<String>> = BTreeMap::new();
    insta::glob!("../../fixtures/shaders", "*.wgsl", |path| {
        let plan = original(&[path]);
        for recipe in recipes(&[Use::Snapshot]) {
            match describe(&plan, recipe) {
                Ok(text) => {
                    let name = recipe.replace([':', '=', ','], "-");
                    insta::with_settings!({ description => recipe, omit_expression => true }, {
                        insta::assert_snapshot!(name, text);
                    });
                }
                Err(text) => {
                    let fixture = path.file_name().unwrap().to_string_lossy();
                    let row = format!("  {recipe}  {fixture}\n");
                    refused.entry(text).or_default().push(row);
                }
            }
        }
    });
    let mut table = String::new();
    for (text, mut rows) in refused {
        rows.sort();
        writeln!(table, "{text}{}", rows.concat()).unwrap();
    }
    insta::with_settings!({ omit_expression => true }, {
        insta::assert_snapshot!("refusals", table);
    });
}
