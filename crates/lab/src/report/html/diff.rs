//! The changes of a variant in a shader, line by line.
//!
//! The same writer prints both sides, so that only real changes show.

use preshade_plan::plan::Plan;
use similar::{ChangeTag, TextDiff};

use preshade_compiler::emit::{Options, emit};
use preshade_draw::scene::Scene;
use preshade_plan::plan_file::Target;

/// One emitted file against the material as its author wrote it.
pub(crate) struct Diff {
    pub name: String,
    /// Number of lines.
    pub added: usize,
    /// Number of lines.
    pub removed: usize,
    /// The changed lines with a few around them, and the number of lines left out.
    pub lines: Vec<Line>,
}

pub(crate) struct Line {
    /// `+`, `-`, a space, or nothing for a gap.
    pub sign: &'static str,
    pub text: String,
}

/// Unchanged lines around a change.
const AROUND: usize = 3;

/// Most lines of a diff.
const MOST: usize = 600;

/// Every WGSL file of the plans that differs from the author's text, against the printed original.
pub(crate) fn of(scene: &Scene, plans: &[Plan]) -> Vec<Diff> {
    let mut diffs = Vec::new();
    for (material, plan) in scene.materials.iter().zip(plans) {
        let Some(original) = printed(material) else {
            continue;
        };
        let Ok(files) = emit(plan, &[Target::Wgsl], &Options::default()) else {
            continue;
        };
        let own = material.program.author_text();
        for file in files {
            let text = String::from_utf8_lossy(&file.bytes).into_owned();
            let is_text = std::path::Path::new(&file.name)
                .extension()
                .is_some_and(|e| e == "wgsl");
            if is_text && own != Some(&text) && original != text {
                diffs.push(diff(file.name, &original, &text));
            }
        }
    }
    diffs
}

/// The material as written, printed like emitted text.
fn printed(material: &preshade_draw::scene::Material) -> Option<String> {
    let mut plan = material.plan();
    let pass = plan.main()?.program.clone();
    let program = plan.programs.get(&pass)?;
    // Only changed files are printed.
    let printed = program.with_module(program.module().clone()).ok()?;
    plan.programs.insert(pass, printed);
    let files = emit(&plan, &[Target::Wgsl], &Options::default()).ok()?;
    let text = files.into_iter().find(|f| f.name.contains(".wgsl"))?;
    String::from_utf8(text.bytes).ok()
}

fn diff(name: String, before: &str, after: &str) -> Diff {
    let diff = TextDiff::from_lines(before, after);
    let mut lines = Vec::new();
    let count = |tag| diff.iter_all_changes().filter(|c| c.tag() == tag).count();
    let (added, removed) = (count(ChangeTag::Insert), count(ChangeTag::Delete));
    for group in diff.grouped_ops(AROUND) {
        if !lines.is_empty() {
            lines.push(Line {
                sign: "",
                text: "…".to_owned(),
            });
        }
        for change in group.iter().flat_map(|op| diff.iter_changes(op)) {
            lines.push(Line {
                sign: match change.tag() {
                    ChangeTag::Delete => "-",
                    ChangeTag::Insert => "+",
                    ChangeTag::Equal => " ",
                },
                text: change.value().trim_end().to_owned(),
            });
        }
    }
    if lines.len() > MOST {
        let left = lines.len() - MOST;
        lines.truncate(MOST);
        lines.push(Line {
            sign: "",
            text: format!("… and {left} lines more"),
        });
    }
    Diff {
        name,
        added,
        removed,
        lines,
    }
}
