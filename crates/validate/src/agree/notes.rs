//! Differences that no input shows: guesses, and operations that GPUs may round differently.

use std::collections::{BTreeMap, BTreeSet};

use naga::{
    Binding, BuiltIn, DerivativeAxis, DerivativeControl, Expression, Interpolation, Sampling,
    ShaderStage,
};

use super::matching::By;
use super::quote::written;
use super::trial::{Two, What};
use super::wording::Sliced;
use super::{Class, Finding, Outcome, PromiseResult, Relation};
use crate::stage::Stage;
use naga_edit::declared::Precision;
use naga_operands::calls;

/// A pre-pass's depths are compared with the main pass's, and a GPU may round two positions
/// differently.
pub(super) fn variant(two: &Two<'_>, promises: &[PromiseResult]) -> Option<Finding> {
    let [first, second] = two.relation.names();
    if !matches!(
        two.relation,
        Relation::Prepass | Relation::Velocity | Relation::Normal
    ) {
        return None;
    }
    let positions = promises.iter().find(|h| h.promise == "positions")?;
    let why = match (&positions.outcome, is_invariant(two)) {
        (Outcome::Proved { .. }, [true, true])
        | (Outcome::Differs | Outcome::NotEvaluated { .. }, _) => return None,
        (Outcome::Agreed { .. }, [true, true]) => {
            "the two positions are invariant, but that the same operations compute them was not proved"
                .to_owned()
        }
        (_, [false, false]) => "neither position is invariant".to_owned(),
        (_, [true, false]) => format!("the position of {second} is not invariant"),
        (_, [false, true]) => format!("the position of {first} is not invariant"),
    };
    let words = format!(
        "{why}, so a GPU may round them differently. If you compare depths for equality, compute both by \
         the same code and mark both (`@invariant`, `invariant gl_Position`)"
    );
    Some(Finding::general(Class::Variant, "positions", words))
}

/// All notes, a sentence each.
pub(super) fn all(two: &Two<'_>) -> Vec<String> {
    let mut notes = by_order(two);
    notes.extend(two.matching.notes.iter().cloned());
    if two.relation == Relation::Velocity {
        notes.extend(two.unmoved_note());
    }
    notes.extend(precisions(two));
    notes.extend(interfaces(two));
    notes.extend(undefined(two));
    notes.extend(derivatives(two));
    notes
}

/// Structs whose members have no name in common. For `same` that is the host's view, too.
fn by_order(two: &Two<'_>) -> Vec<String> {
    let partners = two.matching.partners.iter();
    let guessed = partners.filter(|p| p.by == By::Order && two.relation != Relation::Same);
    let said = guessed.map(|partner| {
        let member = |path: &str| path.rsplit('.').next().unwrap_or(path).to_owned();
        let pairs = partner.parts.iter();
        let pairs =
            pairs.map(|(theirs, ours)| format!("`{}` is `{}`", member(theirs), member(ours)));
        let pairs: Vec<String> = pairs.take(3).collect();
        let more = if partner.parts.len() > 3 { ", .." } else { "" };
        format!(
            "the members of `{}` and `{}` have no name in common, so they count by order: {}{more}",
            partner.theirs,
            partner.ours,
            pairs.join(", ")
        )
    });
    said.collect()
}

/// Varyings that a GPU may take from another vertex, and positions that it may round differently:
/// no input shows it. For a pre-pass, [`variant`] reports the positions.
fn interfaces(two: &Two<'_>) -> Vec<String> {
    if two.relation != Relation::Same {
        return Vec::new();
    }
    let names = two.relation.names();
    let mut notes = Vec::new();
    let is_invariant = is_invariant(two);
    if is_invariant[0] != is_invariant[1] {
        let [yes, no] = match is_invariant[0] {
            true => names,
            false => [names[1], names[0]],
        };
        notes.push(format!(
            "the position of {yes} is invariant, and that of {no} is not: a GPU may round it \
             differently in another pass"
        ));
    }
    let flat = [two.first, two.second].map(|stages| {
        let inputs = stages.fragment.map(Stage::inputs).unwrap_or_default();
        let flat = inputs.into_iter().filter_map(|io| match io.binding {
            Some(Binding::Location {
                location,
                interpolation: Some(Interpolation::Flat),
                sampling,
                ..
            }) => Some((location, (io.name, sampling == Some(Sampling::Either)))),
            _ => None,
        });
        flat.collect::<BTreeMap<_, _>>()
    });
    for (location, (name, is_either)) in &flat[0] {
        let other = flat[1].get(location).map(|(_, is_either)| *is_either);
        if other.is_some_and(|other| other != *is_either) {
            let name = name.as_deref().unwrap_or("a varying");
            let [any, first] = match is_either {
                true => names,
                false => [names[1], names[0]],
            };
            notes.push(format!(
                "`{name}` is of either vertex of a triangle in {any} (`flat, either`), and of the first in \
                 {first}: a GPU may take another one, and here it is the first"
            ));
        }
    }
    notes
}

/// An undefined result of the first program, and that inputs with it were not compared.
fn undefined(two: &Two<'_>) -> Option<String> {
    let (what, span) = two.undefined.get()?;
    let [first, _] = two.relation.names();
    let text = written(two.first.vertex.program, span, 0);
    let text = text.map_or(String::new(), |text| format!(" (`{text}`)"));
    Some(format!(
        "on some inputs {first} computes {what}{text}, which GLSL leaves undefined: these are not compared"
    ))
}

/// Whether the position of each is invariant.
fn is_invariant(two: &Two<'_>) -> [bool; 2] {
    [two.first, two.second].map(|stages| {
        let mut outputs = stages.vertex.outputs().into_iter();
        outputs.any(|io| {
            let position = naga::Binding::BuiltIn(BuiltIn::Position { invariant: true });
            io.binding == Some(position)
        })
    })
}

/// Stages that compute with fewer bits in one program than in the other.
fn precisions(two: &Two<'_>) -> Vec<String> {
    let [first, second] = two.relation.names();
    let of = |stage: ShaderStage, program: &preshade_plan::program::Program| {
        let all = program.declared().precisions.iter();
        let own = all.filter(|p| p.stage == stage);
        own.fold((Precision::High, BTreeSet::new()), |(_, mut all), p| {
            all.extend(p.qualified.iter().copied());
            (p.default, all)
        })
    };
    let mut notes = Vec::new();
    for (stage, name) in [
        (ShaderStage::Vertex, "vertex"),
        (ShaderStage::Fragment, "fragment"),
    ] {
        let (a, of_a) = of(stage, two.first.vertex.program);
        let (b, of_b) = of(stage, two.second.vertex.program);
        let end = "a GPU may round them differently, which no input shows here";
        if a != b {
            notes.push(format!(
                "the {name} stage of {first} computes in {a} by default, and that of {second} in {b}: {end}"
            ));
        }
        let lower =
            |own: &BTreeSet<Precision>, default| own.iter().copied().filter(|p| *p > default).max();
        for (who, other, found) in [
            (
                first,
                second,
                lower(&of_a, a).filter(|p| *p > b && !of_b.contains(p)),
            ),
            (
                second,
                first,
                lower(&of_b, b).filter(|p| *p > a && !of_a.contains(p)),
            ),
        ] {
            if let Some(precision) = found {
                notes.push(format!(
                    "the {name} stage of {who} has {precision} variables, and that of {other} has none: \
                     {end}"
                ));
            }
        }
    }
    notes
}

/// Derivatives along one axis that one program takes finely and the other coarsely.
fn derivatives(two: &Two<'_>) -> Vec<String> {
    let what = match two.relation {
        Relation::Position => return Vec::new(),
        Relation::Same => What::Colors,
        _ => What::Coverage,
    };
    let [ours, theirs] = Sliced::of_both(two, &two.criteria(what), false);
    let [first, second] = two.relation.names();
    let ours = controls(ours.stages(two.first).fragment);
    let theirs = controls(theirs.stages(two.second).fragment);
    let axes = ["dpdx", "dpdy", "fwidth"];
    let note = |name: &&str| {
        let own = |all: &BTreeSet<String>| {
            let of_axis = all.iter().filter(|n| n.starts_with(*name)).cloned();
            of_axis.collect::<BTreeSet<_>>()
        };
        let (a, b) = (own(&ours), own(&theirs));
        let said = |names: BTreeSet<String>| {
            let names: Vec<String> = names.iter().map(|n| format!("`{n}`")).collect();
            names.join(" and ")
        };
        (a != b && !a.is_empty() && !b.is_empty()).then(|| {
            format!(
                "{first} takes {}, and {second} {}: a GPU gives them different values, and here they \
                 are equal",
                said(a),
                said(b)
            )
        })
    };
    axes.iter().filter_map(note).collect()
}

/// The names of a stage's derivatives in WGSL.
fn controls(stage: Option<Stage<'_>>) -> BTreeSet<String> {
    let mut found = BTreeSet::new();
    let Some(stage) = stage else {
        return found;
    };
    let module = stage.module();
    let called = calls::called(module, &stage.function().body);
    let called = called.iter().map(|f| &module.functions[*f]);
    for function in called.chain([stage.function()]) {
        for (_, expression) in function.expressions.iter() {
            if let Expression::Derivative { axis, ctrl, .. } = expression {
                let axis = match axis {
                    DerivativeAxis::X => "dpdx",
                    DerivativeAxis::Y => "dpdy",
                    DerivativeAxis::Width => "fwidth",
                };
                let control = match ctrl {
                    DerivativeControl::Coarse => "Coarse",
                    DerivativeControl::Fine => "Fine",
                    DerivativeControl::None => "",
                };
                found.insert(format!("{axis}{control}"));
            }
        }
    }
    found
}
