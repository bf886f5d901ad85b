//! The promises of each relation.

use super::Relation;
use super::trial::{Two, What};
use crate::stage::{Slot, Stage};
use naga_edit::interface::Io;

impl Two<'_> {
    pub(super) fn promises(&self) -> Vec<(&'static str, Result<What, String>)> {
        use Relation as R;
        let positions = ("positions", Ok(What::Positions));
        let coverage = ("discards and depths", Ok(What::Coverage));
        match self.relation {
            R::Same => vec![positions, coverage, ("colours", Ok(What::Colors))],
            R::Prepass | R::Shadow => vec![positions, coverage],
            R::Position => vec![positions],
            R::Discard => vec![coverage],
            R::Velocity => vec![
                positions,
                coverage,
                ("velocity at rest", self.velocity().map(What::Still)),
                ("velocity in motion", self.velocity().map(What::Moving)),
            ],
            R::Normal => vec![positions, coverage, ("normals", self.normal())],
        }
    }

    pub(super) fn velocity(&self) -> Result<Slot, String> {
        let outputs = self.second.fragment.map(Stage::outputs).unwrap_or_default();
        let named = named(&outputs, &["velocity", "motion"]);
        let slots = locations(&outputs);
        match (named, &slots[..]) {
            (Some(slot), _) => Ok(slot),
            (None, [one]) => Ok(*one),
            (None, []) => Err("the velocity pass has no output".to_owned()),
            (None, _) => Err(
                "no output of the velocity pass has `velocity` or `motion` in its name".to_owned(),
            ),
        }
    }

    fn normal(&self) -> Result<What, String> {
        let [first, second] = [self.first, self.second].map(|stages| {
            let outputs = stages.fragment.map(Stage::outputs).unwrap_or_default();
            (named(&outputs, &["normal"]), locations(&outputs))
        });
        let theirs = match (second.0, &second.1[..]) {
            (Some(slot), _) => slot,
            (None, [one]) => *one,
            _ => return Err("no output of the normal pass has `normal` in its name".to_owned()),
        };
        let ours = match &self.normal {
            Some(pass) => pass.clone().map(|_| Slot::Location(0, None))?,
            None => first.0.ok_or("the main pass has no output")?,
        };
        Ok(What::Outputs(ours, theirs))
    }

    /// The same two programs. If the normal is compared, the first one is the pass that writes it.
    pub(super) fn of_normal(&self, what: What) -> Self {
        let pass = match (what, &self.normal) {
            (What::Outputs(..), Some(Ok(pass))) => *pass,
            _ => self.first,
        };
        Self {
            first: pass,
            ..self.clone()
        }
    }
}

/// The output whose name contains one of these words.
pub(super) fn named(outputs: &[Io], words: &[&str]) -> Option<Slot> {
    let is_it = |io: &&Io| {
        let name = io.name.as_deref().unwrap_or_default().to_lowercase();
        words.iter().any(|w| name.contains(w))
    };
    let found = outputs.iter().find(is_it)?;
    found.binding.as_ref().map(Slot::of)
}

fn locations(outputs: &[Io]) -> Vec<Slot> {
    let slots = outputs
        .iter()
        .filter_map(|io| io.binding.as_ref().map(Slot::of));
    slots.filter(|s| matches!(s, Slot::Location(..))).collect()
}
