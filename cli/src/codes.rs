//! The explanation of each code in brackets: `preshade --explain CODE`.

use std::collections::BTreeMap;

use preshade::unstable::nearest::nearest;
use preshade::unstable::passes::contract::Assumption;
use preshade::unstable::passes::{PASSES, pass_named, refusals};

use crate::Failure;

/// A section for each code that is no pass's: errors of front ends, scenes, locks and emission.
const TEXT: &str = include_str!("codes.md");

/// Every code with its explanation, by name.
pub fn all() -> BTreeMap<&'static str, String> {
    let sections = TEXT.split("## ").skip(1).filter_map(|section| {
        let (code, text) = section.split_once('\n')?;
        Some((code.trim(), text.trim().to_owned()))
    });
    let refusals = refusals().map(|r| (r.code, format!("{} {}", r.explanation, r.remedy)));
    sections.chain(refusals).collect()
}

/// The code of an error that has one.
pub fn of(error: &(dyn std::error::Error + 'static)) -> Option<&'static str> {
    use preshade::unstable::search::plan as decide;
    use preshade::unstable::{emit, lock, measure, render, scene};
    if let Some(error) = error.downcast_ref::<decide::Error>() {
        return match error {
            decide::Error::Measure(error) => of(error),
            decide::Error::Render(error) => of(error),
            decide::Error::Counting { .. }
            | decide::Error::Probe(_)
            | decide::Error::Recipe(_)
            | decide::Error::NoView(_) => None,
        };
    }
    if let Some(error) = error.downcast_ref::<measure::Error>() {
        return match error {
            measure::Error::Render(error) => of(error),
            measure::Error::Mismatch(_) | measure::Error::Clock => None,
        };
    }
    None.or_else(|| error.downcast_ref().map(render::Error::code))
        .or_else(|| error.downcast_ref().map(emit::EmitError::code))
        .or_else(|| error.downcast_ref().map(lock::Mismatch::code))
        .or_else(|| error.downcast_ref().map(lock::LockError::code))
        .or_else(|| {
            error
                .downcast_ref()
                .map(|_: &scene::Error| scene::Error::CODE)
        })
}

/// Every code, pass and assumption, each with the first sentence of its explanation.
fn list() -> String {
    let codes = all()
        .into_iter()
        .map(|(code, text)| (code.to_owned(), sentence(&text)));
    let passes = PASSES.iter().map(|p| p.info());
    let passes = passes.map(|info| (info.name.to_owned(), sentence(info.summary)));
    let given = Assumption::all().into_iter();
    let given = given.map(|(name, text)| (name, sentence(&text)));
    [
        ("Refusals and errors", codes.collect::<Vec<_>>()),
        ("Passes", passes.collect()),
        ("What contracts take as given", given.collect()),
    ]
    .iter()
    .map(|(of, named)| {
        let widest = named.iter().map(|(name, _)| name.len()).max().unwrap_or(0);
        let lines = named.iter();
        let lines = lines.map(|(name, said)| format!("  {name:<widest$}  {said}\n"));
        format!("{of}:\n{}", lines.collect::<String>())
    })
    .collect::<Vec<_>>()
    .join("\n")
}

/// The first sentence of a text, on one line.
fn sentence(text: &str) -> String {
    let text = text.split_whitespace().collect::<Vec<_>>().join(" ");
    match text.find(". ") {
        Some(end) => text[..=end].to_owned(),
        None => text,
    }
}

/// The explanation of a code, as a message prints it: `blended`, `depth-prepass/blended`,
/// `error[parse]` or `parse`. The name of a pass gives its description; no code gives the list of
/// codes.
///
/// # Errors
/// The code is unknown: similar codes, or all.
pub fn explain(code: &str) -> Result<String, Failure> {
    if code.is_empty() {
        return Ok(list());
    }
    let bare = code.rsplit(['/', '[']).next().unwrap_or(code);
    let bare = bare.trim_end_matches(']');
    if let Some(text) = all().get(bare) {
        return Ok(format!("{bare}\n\n{text}\n"));
    }
    if let Some(pass) = pass_named(bare) {
        let info = pass.info();
        return Ok(format!(
            "{bare} is a pass: {}.\nTake it where {}.\nIt hurts {}.\n\n`preshade passes {bare}` lists its parameters.\n",
            info.summary.trim_end_matches('.'),
            info.when.trim_end_matches('.'),
            info.hurts.trim_end_matches('.')
        ));
    }
    let assumptions = Assumption::all();
    if let Some((name, text)) = assumptions.iter().find(|(name, _)| name == bare) {
        return Ok(format!(
            "{name} is something that a contract takes as given.\n\n{text}\n\ndocs/reference/plan-json.md says what each asks of a host.\n"
        ));
    }
    let codes = all().into_keys();
    let passes = PASSES.iter().map(|p| p.info().name);
    let given = assumptions.iter().map(|(name, _)| name.as_str());
    let known: Vec<&str> = codes.chain(passes).chain(given).collect();
    match &near(bare, &known)[..] {
        [] => Err(Failure::unknown("code", bare, &known)),
        near => Err(Failure(format!(
            "error: there is no code `{bare}` (did you mean {}?)",
            near.join(" or ")
        ))),
    }
}

/// How many names are suggested.
const SUGGESTED: usize = 5;

/// In backquotes, the name with the most similar spelling, and names that contain the given one.
fn near(word: &str, known: &[&str]) -> Vec<String> {
    let nearest = nearest(word, known.iter().copied());
    let containing = known
        .iter()
        .copied()
        .filter(|k| word.len() > 2 && k.contains(word) && Some(*k) != nearest);
    let all = nearest.into_iter().chain(containing).take(SUGGESTED);
    all.map(|name| format!("`{name}`")).collect()
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, clippy::panic)]

    use std::collections::BTreeSet;
    use std::path::Path;

    use super::*;

    #[test]
    fn every_code_is_explained() {
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
        let all = all();
        let explained: BTreeSet<&str> = all.keys().copied().collect();
        for refusal in refusals() {
            assert!(refusal.explanation.ends_with('.'), "{refusal:?}");
            assert!(!refusal.remedy.is_empty(), "{refusal:?}");
        }
        // Typed errors list their own codes.
        for (file, function) in [
            ("front/error.rs", "pub fn name(self)"),
            ("emit/mod.rs", "pub fn code(&self)"),
            ("render/mod.rs", "pub fn code(&self)"),
            ("lock/error.rs", "pub fn code(&self)"),
        ] {
            let text = std::fs::read_to_string(root.join("src").join(file)).unwrap();
            let functions: Vec<&str> = text.split(function).skip(1).collect();
            assert!(!functions.is_empty(), "{file} has no `{function}`");
            for function in functions {
                let names = function.split("\n    }\n").next().unwrap();
                let names: Vec<&str> = names.split('"').skip(1).step_by(2).collect();
                assert!(names.len() > 2, "{file}: {names:?}");
                for name in names {
                    let is_explained = explained.contains(name);
                    assert!(is_explained, "cli/src/codes.md says nothing of {name}");
                }
            }
        }
        assert!(explained.contains(preshade::unstable::scene::Error::CODE));
        let codes: Vec<&str> = refusals().map(|r| r.code).collect();
        let each: BTreeSet<&str> = codes.iter().copied().collect();
        assert_eq!(codes.len(), each.len(), "a code is declared twice");
    }

    #[test]
    fn codes_are_found_as_messages_print_them() {
        let blended = explain("blended").ok();
        for code in ["depth-prepass/blended", "note[depth-prepass/blended]"] {
            assert_eq!(explain(code).ok(), blended);
        }
        let unknown = |code| explain(code).err().map(|f| f.0).unwrap_or_default();
        for (code, near) in [
            ("blendid", "`blended`"),
            ("depth-prepas", "`depth-prepass`"),
            ("note[depth-prepass/blend]", "`blended`"),
            ("subgrp", "`subgroup`"),
        ] {
            let said = unknown(code);
            assert!(said.contains(near), "{code}: {said}");
        }
        // Without a similar code, all are listed.
        assert!(unknown("zzzz").contains("there are: adaptive-form, "));
        let pass = explain("depth-prepass").ok().unwrap_or_default();
        assert!(pass.contains("`preshade passes depth-prepass`"), "{pass}");
    }
}
