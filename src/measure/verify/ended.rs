//! What is said of a variant in the end: its verdict, and why there is none.

use preshade_passes::contract::Verdict;
use preshade_passes::plan::Plan;
use preshade_passes::visibility_buffer;

use super::Subject;
use crate::measure::verdict::{advice, needs_invariant_original};
use crate::measure::{rasterizer, telling};
use crate::render::Gpu;
use crate::report::{ORIGINAL, Pictures, VariantReport, path};

impl Subject<'_> {
    /// What is known of it between two views.
    pub(super) fn so_far(&self) -> VariantReport {
        let mut report = self.report.clone();
        match &self.broken {
            Some(r#where) => {
                report.verdict = Verdict::Broken {
                    r#where: r#where.clone(),
                };
            }
            None if self.prepared.is_some() => {
                report.verdict = Verdict::NotMeasured {
                    why: "not all views were drawn yet".to_owned(),
                };
            }
            None => {}
        }
        report
    }

    /// That its pictures are outside of the contract, and what may be why.
    fn broken(&self, gpu: &Gpu, r#where: String) -> Verdict {
        let seen = rasterizer(gpu).ok();
        let otherwise = |plan: &Plan| visibility_buffer::contradicted(plan, seen.as_ref()?);
        let told = match self.plans.iter().find_map(otherwise) {
            Some(otherwise) => Some(format!(
                "it was made for an adapter that does as {otherwise}: leave that out, and see again"
            )),
            None => {
                let error = self.report.error.as_ref();
                error.and_then(|error| advice(&self.report.contract, error))
            }
        };
        let parts = [Some(r#where), told];
        Verdict::Broken {
            r#where: parts.into_iter().flatten().collect::<Vec<_>>().join("; "),
        }
    }

    /// The verdict. `lost` says why measuring ended early; `away`: nothing is seen for every triangle is culled.
    pub(super) fn finish(
        mut self,
        gpu: &Gpu,
        lost: Option<&str>,
        away: bool,
    ) -> (VariantReport, Option<Pictures>) {
        let drawn = self.prepared.is_some() && self.report.error.is_some();
        match (self.broken.take(), lost) {
            // What the contract takes as given is not so here: neither kept nor broken.
            (Some(r#where), _) if needs_invariant_original(&self.report.contract) => {
                self.report.verdict = Verdict::NotMeasured {
                    why: format!(
                        "its promise is about an original whose position is @invariant, and this one's is not (--invariant marks it): {where}"
                    ),
                };
            }
            (Some(r#where), _) => self.report.verdict = self.broken(gpu, r#where),
            (None, Some(why)) => {
                self.report.verdict = Verdict::NotMeasured {
                    why: why.to_owned(),
                };
            }
            (None, None) if self.shadow.is_some() => {
                self.report.verdict = self.shadow.unwrap_or(Verdict::Holds);
            }
            (None, None) if drawn && away && self.covered == Some(0) => {
                self.report.verdict = Verdict::NotMeasured {
                    why: telling::FACES_AWAY.to_owned(),
                };
            }
            (None, None) if drawn && self.covered == Some(0) && self.report.name != ORIGINAL => {
                self.report.verdict = Verdict::NotMeasured {
                    why: "no opaque surface is seen in any view".to_owned(),
                };
            }
            (None, None) if drawn && self.covered == Some(0) && self.empty.is_some() => {
                self.report.verdict = Verdict::NotMeasured {
                    why: self.empty.unwrap_or_default(),
                };
            }
            (None, None) if drawn => self.report.verdict = Verdict::Holds,
            (None, None) => {}
        }
        self.report.by_path = path::times(&self.report.by_view);
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
