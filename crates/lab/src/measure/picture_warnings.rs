//! Warns if a scene's pictures cannot show errors. With a single colour, only the outline can be
//! wrong.

use std::collections::{BTreeMap, BTreeSet};

use preshade_plan::contract::Assumption;
use preshade_plan::guard::Assumed;
use preshade_plan::pass::Undrawn;
use preshade_plan::plan::{GpuPass, Phase, Plan, Role};
use preshade_plan::state::{CompareFunction, CullMode};

use super::discardable::can_discard;
use super::error::counted;
use super::{CountProgram, Counter, Error, Session, counting};
use preshade_compiler::command::rewrite::{discards, removed_discard};
use preshade_draw::render::Rendered;
use preshade_draw::scene::bind::{self, Guess, Guessed};
use preshade_draw::scene::{DrawOrder, Frame, Scene};

/// The distinct colours, as long as they are few.
#[derive(Clone, Debug, Default)]
pub(crate) struct Colours {
    seen: BTreeSet<[u8; 4]>,
    pictures: usize,
}

/// One for the surfaces, one for the background.
const PLAIN: usize = 2;

impl Colours {
    /// Adds the colours of a frame. Frames without a colour target do not count.
    pub(crate) fn look(&mut self, drawn: &Rendered) {
        let Some(Some(image)) = drawn.colors.first() else {
            return;
        };
        self.pictures += 1;
        if self.seen.len() > PLAIN {
            return;
        }
        for texel in image.to_rgba8().as_chunks::<4>().0 {
            self.seen.insert(*texel);
            if self.seen.len() > PLAIN {
                return;
            }
        }
    }

    /// A warning if no picture could show a wrong colour.
    pub(crate) fn warning(&self) -> Option<String> {
        (self.pictures > 0 && self.seen.len() <= PLAIN).then(|| {
            "only the silhouette was tested, because every picture of the original has one flat \
             colour"
                .to_owned()
        })
    }
}

/// Beginnings of attributes that mean nothing where a mesh has none: it is not skinned, and not morphed.
const WITHOUT: [&str; 5] = ["joint", "bone", "weight", "morph", "tangent"];

/// Most materials that are named.
const NAMED: usize = 3;

/// A warning about visible attributes that materials read and meshes lack.
pub(crate) fn missing_attributes(guessed: &[Guessed]) -> Option<String> {
    let is_seen = |name: &str| {
        let name = name.to_lowercase();
        !WITHOUT.iter().any(|w| name.contains(w))
    };
    let missing = guessed
        .iter()
        .filter(|g| g.guess == Guess::AttributeSynthesised && is_seen(&g.name));
    let mut by_name: BTreeMap<&str, Vec<&str>> = BTreeMap::new();
    for g in missing {
        by_name.entry(&g.name).or_default().push(&g.material);
    }
    let each: Vec<String> = by_name
        .iter()
        .map(|(name, materials)| {
            let named: Vec<&str> = materials.iter().copied().take(NAMED).collect();
            let more = match materials.len().saturating_sub(NAMED) {
                0 => String::new(),
                n => format!(" and {n} more"),
            };
            format!("`{name}` of {}{more}", named.join(", "))
        })
        .collect();
    (!each.is_empty()).then(|| {
        format!(
            "vertex attributes that a mesh does not have are one made-up value at every vertex: {}",
            each.join("; ")
        )
    })
}

/// A warning for each material with draws that no input places.
pub(crate) fn overlapping_draws(scene: &Scene) -> impl Iterator<Item = String> {
    bind::overlapping_draws(scene).into_iter().map(|(material, [first, second])| {
        format!(
            "draws `{first}` and `{second}` lie on top of each other: their transforms differ, but \
             no input of `{material}` reads one; to place them, set a matrix: \
             values.\"NAME\" = \"$model\" in [materials.{material}]"
        )
    })
}

/// Whether a picture is no longer empty once no face is culled: every triangle faces away.
pub(crate) fn faces_away(
    session: &Session<'_>,
    frames: &[(&Frame, DrawOrder)],
) -> Result<bool, Error> {
    let culls = |plan: &Plan| {
        plan.passes
            .iter()
            .any(|p| p.primitive.cull != CullMode::None)
    };
    if !session.originals().iter().any(culls) {
        return Ok(false);
    }
    let mut open = session.originals().to_vec();
    for pass in open.iter_mut().flat_map(|p| &mut p.passes) {
        pass.primitive.cull = CullMode::None;
    }
    draws(session, &open, frames, counting)
}

/// Whether `plans` draw a fragment in one of `frames`.
pub(crate) fn draws(
    session: &Session<'_>,
    plans: &[Plan],
    frames: &[(&Frame, DrawOrder)],
    count: impl Fn(&Plan, &GpuPass) -> CountProgram,
) -> Result<bool, Error> {
    let inputs = session.inputs();
    let mut counter = Counter::shaded(inputs, plans, session.form(), count)?;
    for (frame, order) in frames {
        inputs.set_frame(frame)?;
        if counter.count(frame, *order)?.covered > 0 {
            return Ok(true);
        }
    }
    Ok(false)
}

/// The opaque materials that may discard with the scene's values, but have no discarded fragment in
/// any of `frames`. Materials of one shader count together.
pub(crate) fn undiscarded<'s>(
    session: &'s Session<'_>,
    frames: &[(&Frame, DrawOrder)],
) -> Result<Vec<Vec<&'s str>>, Error> {
    let mut shaders: BTreeMap<Vec<&str>, Vec<&Plan>> = BTreeMap::new();
    for plan in session.originals().iter().filter(|plan| discards(plan)) {
        let main = plan.main().filter(|main| main.phase == Phase::Opaque);
        let Some((main, program)) = main.and_then(|m| Some((m, plan.program(m)?))) else {
            continue;
        };
        let files = program.sources().files().iter().map(|f| f.name.as_str());
        let key = files.chain(main.fragment.as_deref()).collect();
        shaders.entry(key).or_default().push(plan);
    }
    let mut found = Vec::new();
    for plans in shaders.values() {
        let mut is_tested = false;
        for plan in plans {
            is_tested = is_tested || discards_in(session, plan, frames)?;
        }
        if !is_tested && plans.iter().any(|plan| can_discard(session.scene(), plan)) {
            found.push(plans.iter().map(|p| p.material.as_str()).collect());
        }
    }
    Ok(found)
}

/// Why no verdict about the discard of these materials can be trusted.
pub(crate) fn untested(materials: &[&str]) -> String {
    let names: Vec<String> = materials.iter().map(|m| format!("`{m}`")).collect();
    format!(
        "no fragment of {} is discarded in any view, so that its discard is untested",
        names.join(", ")
    )
}

/// How many pixels of a captured frame were left out, as two pictures of the original differ in them.
pub(crate) fn unsteady(pixels: u64) -> Option<String> {
    (pixels > 0).then(|| {
        format!(
            "{} of the original differ when it is drawn again: no variant is judged by them",
            counted(pixels, "pixel")
        )
    })
}

/// Most branches that a message names.
const BRANCHES: usize = 4;

/// The branches that the pictures show one way only, where a plan of `plans` promises a budget: the
/// budget does not cover the other ways. `None`: there are none.
pub fn undrawn<'p>(scene: &Scene, plans: impl Iterator<Item = &'p Plan>) -> Option<String> {
    let budgeted = plans.filter(|plan| !plan.contract.budgets().is_empty());
    let budgeted: BTreeSet<&str> = budgeted.map(|plan| plan.material.as_str()).collect();
    if budgeted.is_empty() {
        return None;
    }
    let mut found = super::undrawn(scene).unwrap_or_default();
    found.retain(|u| budgeted.contains(u.material.as_str()));
    let mut each: Vec<String> = found.iter().take(BRANCHES).map(unrun).collect();
    each.dedup();
    let more = match found.len().saturating_sub(BRANCHES) {
        0 => String::new(),
        n => format!("; and {n} more"),
    };
    let what = match scene.is_made_up {
        true => "these values are made up, so a budget promises nothing",
        false => "a budget holds for these values, and the guard lists them",
    };
    (!each.is_empty()).then(|| format!("{}{more}: {what}", each.join("; ")))
}

/// A branch that the pictures show one way only, and the values that decide it.
fn unrun(branch: &Undrawn) -> String {
    let values: Vec<String> = branch.values.iter().map(drawn_value).collect();
    let which = match &branch.location {
        Some(at) => format!("at {}:{}", at.file, at.line),
        None => format!("on `{}`", branch.condition),
    };
    format!(
        "{} in every draw, so one way of the branch {which} was never run",
        values.join(" and ")
    )
}

/// A value of all draws, in words.
fn drawn_value(value: &Assumed) -> String {
    let text = value.to_string();
    match text.split_once(" = ") {
        Some((name, number)) => format!("`{name}` is {number}"),
        None => text,
    }
}

/// Whether the plan changes how the fragments of its material are decided: in another pass, on the
/// assumption that a discard is repeated, or by values under which nothing is discarded.
pub(crate) fn decides_coverage(plan: &Plan) -> bool {
    plan.passes.iter().any(|pass| pass.role != Role::Main)
        || plan
            .contract
            .given()
            .contains(&Assumption::InvariantDiscard)
        || removed_discard(plan).is_some()
}

/// Whether a fragment of a material is discarded in one of `frames`, whatever hides it.
fn discards_in(
    session: &Session<'_>,
    plan: &Plan,
    frames: &[(&Frame, DrawOrder)],
) -> Result<bool, Error> {
    let inputs = session.inputs();
    let mut open = plan.clone();
    for depth in open.passes.iter_mut().filter_map(|p| p.depth.as_mut()) {
        depth.compare = CompareFunction::Always;
        depth.write = false;
    }
    let plans = std::slice::from_ref(&open);
    let mut kept = Counter::shaded(inputs, plans, session.form(), counting)?;
    let all = |_: &Plan, _: &GpuPass| CountProgram::Constant;
    let mut all = Counter::shaded(inputs, plans, session.form(), all)?;
    for (frame, order) in frames {
        inputs.set_frame(frame)?;
        let [kept, all] = [kept.count(frame, *order)?, all.count(frame, *order)?];
        if kept.fragments != all.fragments {
            return Ok(true);
        }
    }
    Ok(false)
}

/// The reason if every triangle faces away.
pub(crate) const FACES_AWAY: &str = "every triangle faces away and is culled: draw both sides \
 (`--cull none`, or `state.primitive.cull = \"none\"` in a scene), or say which side is the front \
 (`front_face`)";

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn attributes_that_are_seen_are_told_once() {
        let of = |material: &str, name: &str| Guessed {
            material: material.to_owned(),
            name: name.to_owned(),
            guess: Guess::AttributeSynthesised,
        };
        let all = [
            of("a", "color"),
            of("b", "color"),
            of("c", "color"),
            of("d", "color"),
            of("a", "joints"),
            of("a", "morph_offset_0"),
        ];
        let said = missing_attributes(&all).unwrap_or_default();
        assert!(said.ends_with("`color` of a, b, c and 1 more"), "{said}");
        assert_eq!(missing_attributes(&all[4..]), None);
    }
}
