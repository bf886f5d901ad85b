//! Pairs of `fixtures/cases`: each says in its first line what is right.

use std::path::PathBuf;

use preshade_plan::mapping::Equation;
use preshade_validate::Effort;
use preshade_validate::agree::{Agreement, Class, Outcome, Question, Relation, agree};

use crate::agree::read;
use crate::fixtures_support::root;

/// The files of a folder of cases.
fn files(folder: &str, names: &[&str]) -> Vec<PathBuf> {
    let folder = root().join("fixtures/cases").join(folder);
    names.iter().map(|name| folder.join(name)).collect()
}

fn compared(
    folder: &str,
    [first, second]: [&[&str]; 2],
    relation: Relation,
    maps: &[&str],
) -> Agreement {
    let maps: Vec<Equation> = maps.iter().map(|m| m.parse().unwrap()).collect();
    let question = Question {
        maps: &maps,
        ..relation.into()
    };
    let effort = Effort {
        inputs: 480,
        ..Effort::default()
    };
    let [first, second] = [first, second].map(|names| read(&files(folder, names)).unwrap());
    agree(&first, &second, question, &effort).unwrap()
}

/// The classes of its findings but for notes, each once.
fn classes(agreement: &Agreement) -> Vec<Class> {
    let all = agreement.findings.iter().map(|f| f.class);
    let mut all: Vec<Class> = all.filter(|c| *c != Class::Variant).collect();
    all.dedup();
    all
}

#[test]
fn each_pair_differs_as_its_first_line_says() {
    use Class as C;
    /// A folder, the files of both programs, and the classes of what differs.
    type Pair = (
        &'static str,
        [&'static [&'static str]; 2],
        Relation,
        &'static [Class],
    );
    let pairs: [Pair; 6] = [
        (
            ".",
            [
                &["agree-cutoff.main.wgsl"],
                &["agree-cutoff-is-lower.prepass.wgsl"],
            ],
            Relation::Prepass,
            &[C::KeepsHidden],
        ),
        (
            ".",
            [
                &["agree-faded-leaf.main.wgsl"],
                &["agree-faded-leaf.inverted.prepass.wgsl"],
            ],
            Relation::Prepass,
            &[C::Rounding],
        ),
        (
            "newcomer/agree-tie",
            [&["main.wgsl"], &["shadow.wgsl"]],
            Relation::Shadow,
            &[C::Loses],
        ),
        (
            "newcomer/agree-level-only",
            [&["main.vert", "main.frag"], &["shadow.vert", "shadow.frag"]],
            Relation::Shadow,
            &[C::KeepsHidden, C::Loses, C::Rounding],
        ),
        (
            "adv",
            [&["agree-forced-early.wgsl"], &["agree-forced-early-b.wgsl"]],
            Relation::Same,
            &[C::Depth],
        ),
        (
            "adv",
            [&["agree-rare.wgsl"], &["agree-rare-b.wgsl"]],
            Relation::Same,
            &[C::Color],
        ),
    ];
    for (folder, sides, relation, expected) in pairs {
        let found = compared(folder, sides, relation, &[]);
        assert_eq!(classes(&found), expected, "{sides:?}: {found:#?}");
    }
}

/// Each takes seconds: `make check` skips them.
mod slow {
    use super::*;

    /// A shadow's matrix in place of the product of two.
    #[test]
    fn one_matrix_stands_for_a_product() {
        let folder = "newcomer/agree-view-projection";
        let main: &[&str] = &["main.vert", "main.frag"];
        let right: &[&str] = &["shadow-right.vert", "shadow.frag"];
        let wrong: &[&str] = &["shadow.vert", "shadow.frag"];
        let shadow = Relation::Shadow;
        let is_right = |found: &Agreement| {
            let all = classes(found);
            let mut promises = found.promises.iter();
            all.iter().all(|c| *c == Class::Rounding)
                && !promises.any(|h| matches!(h.outcome, Outcome::NotEvaluated { .. }))
        };
        for maps in [&[][..], &["lightSpace=proj*view"]] {
            let found = compared(folder, [main, right], shadow, maps);
            assert!(is_right(&found), "{maps:?}: {found:#?}");
            let said = "`lightSpace` stands for `proj * view`";
            let is_said = found.notes.iter().any(|note| note.starts_with(said));
            assert_eq!(is_said, maps.is_empty(), "{:?}", found.notes);
            let found = compared(folder, [main, wrong], shadow, maps);
            assert_eq!(classes(&found), [Class::Position], "{maps:?}: {found:#?}");
        }
        for maps in [&[][..], &["proj*view=lightSpace"]] {
            let found = compared(folder, [right, main], shadow, maps);
            assert!(is_right(&found), "{maps:?}: {found:#?}");
            let found = compared(folder, [wrong, main], shadow, maps);
            assert_eq!(classes(&found), [Class::Position], "{maps:?}: {found:#?}");
        }
        let found = compared(folder, [main, right], shadow, &["lightSpace=view*proj"]);
        assert_eq!(classes(&found), [Class::Position], "{found:#?}");
    }
}
