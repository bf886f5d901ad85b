//! The decision of `plan`: each view with each plan, each material with its reasons and refusals,
//! and pictures of the chosen plans.

use askama::Template;

use super::range::{Scale, Strip};
use super::section::{Cameras, Section, section};
use super::words::{self, DASH, or_dash};
use super::{Gallery, PageError, Shell, data, diff};
use crate::measure::{Variant, Verified};
use crate::report::control_characters::plain;
use crate::report::{decision as table, frontier};
use crate::search::plan::decision::{Decision, MaterialDecision, PlanReport};
use preshade_compiler::command::explain::EffectUse;
use preshade_draw::scene::Scene;

#[derive(Template)]
#[template(path = "html/plan.html")]
struct Page<'a> {
    shell: Shell,
    /// The basis of the choice.
    rests: &'static str,
    views: Vec<View>,
    materials: Vec<MaterialSection>,
    plans: Vec<Plan>,
    sections: Vec<Section>,
    effects: &'a [EffectUse],
    model: String,
    terms: Vec<(&'static str, String)>,
}

/// A view with every plan.
struct View {
    name: String,
    rows: Vec<Row>,
}

/// A plan in a view.
struct Row {
    section: Option<usize>,
    name: String,
    predicted: String,
    measured: String,
    speedup: String,
    strip: Option<Strip>,
    /// Whether the view is drawn with it, in words.
    drawn: &'static str,
}

struct MaterialSection {
    name: String,
    becomes: String,
    draws: String,
    reasons: Vec<String>,
    predicted: Vec<(String, String)>,
    refused: Vec<(String, String)>,
}

/// The costs of a plan.
struct Plan {
    name: String,
    notes: Vec<String>,
    said: [String; 3],
    cells: [String; 3],
}

/// The plans of the policy drawn once more: the plans of each material, and the result. Variants
/// have the names that the decision gives its plans.
#[derive(Clone, Copy)]
pub struct Redrawn<'a> {
    pub variants: &'a [Variant],
    /// Pictures, overdraw and self-tests; `None`: they were not drawn.
    pub outcome: Option<&'a Verified>,
}

/// The page. `scene` is the one decided on. `effects` are those of its materials before draws were
/// split into groups.
pub fn page(
    decision: &Decision,
    drawn: Redrawn<'_>,
    scene: &Scene,
    effects: &[EffectUse],
) -> Result<String, PageError> {
    let mut gallery = Gallery::default();
    let mut sections = Vec::new();
    for (id, variant) in drawn.variants.iter().enumerate() {
        let report = drawn.outcome.map(|o| &o.report.variants[..]);
        let pictures = drawn.outcome.map(|o| &o.pictures[..]);
        sections.push(Section {
            diffs: diff::of(scene, &variant.plans),
            ..section(
                id,
                (&variant.name, &variant.recipe),
                Vec::new(),
                report.and_then(|r| r.iter().find(|v| v.name == variant.name)),
                pictures.and_then(|p| p.iter().find(|p| p.name == variant.name)),
                Cameras::Every,
                &mut gallery,
            )?
        });
    }
    let title = format!("{}: what it calls for", decision.scene);
    let page = Page {
        shell: Shell {
            headline: title.clone(),
            title,
            about: format!(
                "{}x{}, on {}. {}",
                decision.resolution[0],
                decision.resolution[1],
                words::adapter(&decision.adapter),
                words::clock(decision.clock)
            ),
            said: table::policy(decision)
                .into_iter()
                .chain(decision.warnings.iter().map(|w| format!("Warning: {w}.")))
                .collect(),
            command: decision.command.clone(),
            file: "decision.json",
            data: data(decision)?,
            gallery,
        },
        rests: match decision.clock {
            Some(_) => {
                "The decision depends on measurements alone; predictions choose what is measured."
            }
            None => "Nothing was measured: what is decided is a prediction.",
        },
        views: views(decision, &sections),
        materials: decision.materials.iter().map(material).collect(),
        plans: decision.plans.iter().map(plan).collect(),
        sections,
        effects,
        model: table::model(decision),
        terms: decision
            .model
            .nanoseconds
            .iter()
            .map(|(term, ns)| (term.name(), format!("{ns:.6}")))
            .collect(),
    };
    Ok(plain(&page.render()?).into_owned())
}

fn views(decision: &Decision, sections: &[Section]) -> Vec<View> {
    let all = decision.plans.iter().flat_map(|p| &p.by_view);
    let scale = Scale::of(all.filter_map(|v| v.speedup.as_ref()));
    let each = decision.views.iter().enumerate();
    each.map(|(i, view)| View {
        name: format!(
            "{}: {:.2} opaque fragments shaded for each pixel, {:.2} for each that is seen",
            view.view, view.shaded_per_pixel, view.overdraw
        ),
        rows: decision
            .plans
            .iter()
            .enumerate()
            .filter_map(|(number, plan)| {
                let at = plan.by_view.get(i)?;
                Some(Row {
                    section: sections.iter().find(|s| s.name == plan.name).map(|s| s.id),
                    name: plan.name.clone(),
                    predicted: format!("{:.3}", at.predicted_ms),
                    measured: or_dash(at.time_ms, |t| words::ms(&t)),
                    speedup: or_dash(at.speedup, frontier::speedup),
                    strip: at.speedup.map(|s| scale.strip(&s)),
                    drawn: match view.plan == number {
                        true => "yes",
                        false => "",
                    },
                })
            })
            .collect(),
    })
    .collect()
}

fn material(m: &MaterialDecision) -> MaterialSection {
    let mut becomes: Vec<&str> = m
        .recipes
        .iter()
        .map(|r| if r.is_empty() { "as written" } else { r })
        .collect();
    becomes.sort_unstable();
    becomes.dedup();
    let mut predicted: Vec<_> = m.predicted.iter().collect();
    predicted.sort_by(|a, b| a.relative_time.total_cmp(&b.relative_time));
    let mut refused: Vec<(String, String)> = Vec::new();
    for r in &m.refused {
        match refused.iter_mut().find(|(_, why)| *why == r.why) {
            Some((recipes, _)) => *recipes = format!("{recipes}, {}", r.recipe),
            None => refused.push((r.recipe.clone(), r.why.clone())),
        }
    }
    MaterialSection {
        name: m.material.clone(),
        becomes: becomes.join(", or "),
        draws: match m.draws.len() {
            1 => "1 draw".to_owned(),
            n => format!("{n} draws"),
        },
        reasons: m.reasons.clone(),
        predicted: predicted
            .into_iter()
            .map(|p| (p.recipe.clone(), format!("{:.3}", p.relative_time)))
            .collect(),
        refused,
    }
}

fn plan(p: &PlanReport) -> Plan {
    let cost = p.cost.as_ref();
    let megabytes = |c: &crate::search::plan::decision::PlanCost| {
        format!("{:.2}", c.targets.values().sum::<u64>() as f64 / 1e6)
    };
    Plan {
        name: p.name.clone(),
        notes: p.notes.clone(),
        said: [
            words::contract(&p.contract),
            words::verdict(&p.verdict),
            p.error
                .as_ref()
                .map_or_else(|| DASH.to_owned(), words::error),
        ],
        cells: [
            or_dash(cost, |c| c.pipelines.to_string()),
            or_dash(cost, |c| format!("{:.1}", c.creation_ms)),
            or_dash(cost, megabytes),
        ],
    }
}
