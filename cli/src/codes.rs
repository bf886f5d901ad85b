//! The explanation of each code in brackets: `preshade --explain CODE`.

use std::collections::BTreeMap;

use preshade_compiler::{emit, lock};
use preshade_draw::{render, scene};
use preshade_geometry::{PASSES, pass_named, refusals};
use preshade_lab::measure;
use preshade_plan::contract::Assumption;
use preshade_scenes::capture;
use shader_text::nearest::nearest;
use shader_text::refusals::RefusalInfo;

use crate::Failure;

/// The codes of errors, then those of refusals.
fn infos() -> impl Iterator<Item = &'static RefusalInfo> {
    let errors = [
        shader_text::codes::REFUSALS,
        preshade_plan::codes::REFUSALS,
        emit::codes::REFUSALS,
        lock::codes::REFUSALS,
        scene::codes::REFUSALS,
        render::codes::REFUSALS,
        preshade_frames::codes::REFUSALS,
    ];
    errors.into_iter().flatten().chain(refusals())
}

/// Every code with its explanation, by name. A code of an error and of a pass has both
/// explanations.
pub fn all() -> BTreeMap<&'static str, String> {
    let mut all = BTreeMap::new();
    for info in infos() {
        let known: &mut String = all.entry(info.code).or_default();
        if !known.is_empty() {
            known.push_str("\n\n");
        }
        known.push_str(&format!("{} {}", info.explanation, info.remedy));
    }
    all
}

/// The code of an error that has one.
pub fn of(error: &(dyn std::error::Error + 'static)) -> Option<&'static str> {
    use preshade_lab::search::plan as decide;
    if let Some(error) = error.downcast_ref::<decide::PlanError>() {
        return match error {
            decide::PlanError::Measure(error) => of(error),
            decide::PlanError::Render(error) => of(error),
            decide::PlanError::Counting { .. }
            | decide::PlanError::Probe(_)
            | decide::PlanError::Recipe(_)
            | decide::PlanError::NoView(_) => None,
        };
    }
    if let Some(error) = error.downcast_ref::<measure::Error>() {
        return match error {
            measure::Error::Render(error) => of(error),
            measure::Error::Scene(error) => of(error),
            measure::Error::Mismatch(_)
            | measure::Error::Nothing(_)
            | measure::Error::Recipe(_)
            | measure::Error::Clock => None,
        };
    }
    #[cfg(feature = "capture")]
    {
        use preshade_frames::browser::BrowserError;
        use preshade_frames::browser::unpack::UnpackError;
        let told = error.downcast_ref().map(BrowserError::code);
        let told = told.or_else(|| error.downcast_ref().map(UnpackError::code));
        if told.is_some() {
            return told;
        }
    }
    None.or_else(|| error.downcast_ref().map(render::Error::code))
        .or_else(|| error.downcast_ref().map(capture::Error::code))
        .or_else(|| error.downcast_ref().map(emit::EmitError::code))
        .or_else(|| error.downcast_ref().map(lock::Mismatch::code))
        .or_else(|| error.downcast_ref().map(lock::LockError::code))
        .or_else(|| error.downcast_ref().map(scene::SceneError::code))
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
pub fn explain(code: &str) -> Result<String, Failure> {
    if code.is_empty() {
        return Ok(list());
    }
    let bare = code.rsplit(['/', '[']).next().unwrap_or(code);
    let bare = bare.trim_end_matches(']');
    if let Some((before, _)) = code.rsplit_once('/') {
        let pass = before.rsplit('[').next().unwrap_or(before);
        if pass_named(pass).is_none() {
            let names: Vec<&str> = PASSES.iter().map(|p| p.info().name).collect();
            return Err(Failure::unknown("pass", pass, &names));
        }
    }
    if let Some(text) = all().get(bare) {
        return Ok(format!("{bare}\n\n{text}\n"));
    }
    if let Some(pass) = pass_named(bare) {
        let info = pass.info();
        return Ok(format!(
            "{bare} is a pass: {}.\nTake it where {}.\nIt hurts {}.\n\n\
             `preshade passes {bare}` lists its parameters.\n",
            info.summary.trim_end_matches('.'),
            info.when.trim_end_matches('.'),
            info.hurts.trim_end_matches('.')
        ));
    }
    let assumptions = Assumption::all();
    if let Some((name, text)) = assumptions.iter().find(|(name, _)| name == bare) {
        return Ok(format!(
            "{name} is something that a contract takes as given.\n\n{text}\n\n\
             docs/reference/plan-json.md says what each asks of a host.\n"
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

    use super::*;

    #[test]
    fn every_code_is_explained() {
        let mut passes = BTreeSet::new();
        for refusal in refusals() {
            let is_new = passes.insert(refusal.code);
            assert!(is_new, "{} is declared twice", refusal.code);
        }
        for info in infos() {
            assert!(info.explanation.ends_with('.'), "{info:?}");
            assert!(!info.remedy.is_empty(), "{info:?}");
        }
        // An error of a front end and a refusal of `hoist` share this code.
        let both = explain("interface").unwrap();
        assert!(both.contains("vertex stage's outputs"), "{both}");
        assert!(both.contains("`hoist`"), "{both}");
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
        let said = unknown("depth-prepas/blended");
        assert!(said.contains("(did you mean `depth-prepass`?)"), "{said}");
        // Without a similar code, all are listed.
        assert!(unknown("zzzz").contains("there are: adaptive-form, "));
        let pass = explain("depth-prepass").ok().unwrap_or_default();
        assert!(pass.contains("`preshade passes depth-prepass`"), "{pass}");
    }
}
