//! The final verdict of a variant.

use preshade_geometry::visibility_buffer;
use preshade_plan::contract::Verdict;
use preshade_plan::plan::Plan;

use super::measurement::Measurement;
use crate::measure::record::{ORIGINAL, Pictures, VariantReport, times};
use crate::measure::verdict::needs_invariant_original;
use crate::measure::{picture_warnings, rasterizer};
use preshade_draw::render::Gpu;

impl Measurement<'_> {
    /// Its report between two views.
    pub(super) fn so_far(&self) -> VariantReport {
        let verdict = match &self.subject.verdict {
            Verdict::Holds => Verdict::NotMeasured {
                why: "not all views were drawn yet".to_owned(),
            },
            verdict => verdict.clone(),
        };
        VariantReport {
            verdict,
            error: self.subject.error.clone(),
            ..self.report.clone()
        }
    }

    /// The verdict if its pictures break the contract, with a contradiction of the adapter.
    fn broken(&self, gpu: &Gpu, r#where: String) -> Verdict {
        let seen = rasterizer(gpu).ok();
        let otherwise = |plan: &Plan| visibility_buffer::contradicted(plan, seen.as_ref()?);
        let otherwise = self.subject.plans.iter().find_map(otherwise);
        Verdict::Broken {
            r#where: match otherwise {
                Some(otherwise) => {
                    format!("{where}; it was made with {otherwise}: leave that parameter out")
                }
                None => r#where,
            },
        }
    }

    /// Whether guards failed in every view, so that its pictures are the original's.
    fn is_replaced(&self) -> bool {
        let plans = &self.subject.plans;
        !self.subject.is_exercised && plans.iter().any(|plan| !plan.steps.is_empty())
    }

    /// The verdict. `lost`: why measuring ended early. `away`: every triangle is culled.
    fn verdict(&mut self, gpu: &Gpu, lost: Option<&str>, away: bool) -> Verdict {
        let not_measured = |why: &str| Verdict::NotMeasured {
            why: why.to_owned(),
        };
        let drawn = self.subject.prepared().is_some() && self.subject.error.is_some();
        let is_empty = drawn && self.covered == Some(0);
        match (&self.subject.verdict, lost) {
            // An assumption of the contract does not hold, so the contract neither holds nor is
            // broken.
            (Verdict::Broken { r#where }, _)
                if needs_invariant_original(&self.subject.judged.contract) =>
            {
                Verdict::NotMeasured {
                    why: format!(
                        "its promise is about an original whose position is @invariant, and this \
                         one's is not (--invariant marks it): {where}"
                    ),
                }
            }
            (Verdict::Broken { r#where }, _) if self.unmet.is_some() => {
                let unmet = self.unmet.take().unwrap_or_default();
                not_measured(&format!("{unmet}: {where}"))
            }
            (Verdict::Broken { r#where }, _) => self.broken(gpu, r#where.clone()),
            (_, Some(why)) => not_measured(why),
            (verdict, None) => match self.aside.take() {
                Some(aside) => aside,
                None if is_empty && away => not_measured(picture_warnings::FACES_AWAY),
                None if is_empty && self.report.name != ORIGINAL => {
                    not_measured("no opaque surface is seen in any view")
                }
                None if drawn && self.is_replaced() => {
                    let guards = self.report.kept.iter().find(|k| k.without.is_none());
                    let why = guards.map_or(String::new(), |k| format!(": {}", k.why));
                    not_measured(&format!("no view drew the variant{why}"))
                }
                None if is_empty && self.empty.is_some() => {
                    not_measured(self.empty.as_deref().unwrap_or_default())
                }
                None => verdict.clone(),
            },
        }
    }

    /// Its report and its pictures.
    pub(super) fn finish(
        mut self,
        gpu: &Gpu,
        lost: Option<&str>,
        away: bool,
    ) -> (VariantReport, Option<Pictures>) {
        self.report.verdict = self.verdict(gpu, lost, away);
        self.report.error = self.subject.error;
        self.report.by_path = times(&self.report.by_view);
        let is_original = self.report.name == ORIGINAL;
        let worst = self.worst.and_then(|(_, worst)| worst);
        let elsewhere = self.elsewhere.pictures();
        let pictures = self.pictures.map(|p| Pictures {
            worst,
            elsewhere,
            ..p
        });
        (self.report, pictures.filter(|_| !is_original))
    }
}
