//! The plan with both passes, and the words for it.

use super::build::Built;
use super::{Edges, Found, HalfRate, Params, values};
use crate::analysis::named::span;
use crate::rebuild::outline;
use preshade_plan::budget::Budget;
use preshade_plan::contract::Contract;
use preshade_plan::guard::Guard;
use preshade_plan::pass::{Change, Outcome, Pass, Site, SiteCost};
use preshade_plan::plan::{
    Attachment, BindingKind, BindingSource, BindingUse, Draws, GpuPass, ORIGINAL, Phase, Plan, Role,
};
use preshade_plan::reflect;
use preshade_plan::state::ColorTarget;

/// Format of the targets: words, which no driver rounds.
const FORMAT: &str = "rgba32uint";

impl Found<'_, '_, '_> {
    pub(super) fn outcome(
        self,
        plan: &Plan,
        built: Built,
        params: &Params,
        budget: Budget,
    ) -> Outcome {
        let mut next = plan.clone();
        let main = self.stage.pass;
        let names: Vec<String> = (0..self.layout.targets())
            .map(|i| match i {
                0 => format!("half-rate-{}", plan.material),
                _ => format!("half-rate-{}-more", plan.material),
            })
            .collect();
        next.attachments.extend(names.iter().map(|name| Attachment {
            divisor: 2,
            ..Attachment::color(name, FORMAT, [0.0; 4])
        }));
        let mut half = GpuPass {
            role: Role::HalfRate,
            phase: Phase::HalfRate,
            program: Role::HalfRate.name().to_owned(),
            fragment: Some(built.entry.clone()),
            depth: None,
            stencil: None,
            targets: names
                .iter()
                .map(|name| {
                    Some(ColorTarget {
                        attachment: Some(name.clone()),
                        ..ColorTarget::opaque(FORMAT)
                    })
                })
                .collect(),
            draws: Draws::All,
            ..main.clone()
        };
        reflect::fill(&mut half, &built.half);
        for pass in &mut next.passes {
            pass.bindings.extend(built.bindings(&names));
            reflect::fill(pass, &built.main);
        }
        next.passes.insert(0, half);
        next.programs.insert(main.program.clone(), built.main);
        next.programs
            .insert(Role::HalfRate.name().to_owned(), built.half);
        let mut given = self.stage.given.clone();
        next.assume(self.guard.clone(), &mut given);
        let contract = Contract::Approximate { budget, given };
        let change = self.change(built.edges);
        next.add_step(HalfRate::INFO.name, params, &change, contract);
        next.fallback = Some(ORIGINAL.to_owned());
        Outcome {
            plan: next,
            change,
            left: self.left,
        }
    }

    fn change(&self, edges: Edges) -> Change {
        let moved = || self.choice.moved.iter().copied();
        let sources = self.stage.graph.program().sources();
        let names = self.wanted.iter().map(|w| format!("`{}`", w.name));
        let names: Vec<String> = names.collect();
        let guides = self.choice.guides.iter();
        let guides: Vec<String> = guides
            .map(|id| format!("`{}`", values::guide_name(self.values, *id)))
            .collect();
        let guided = match guides.is_empty() {
            true => "no value tells edges".to_owned(),
            false => format!("edges are those of {}", guides.join(", ")),
        };
        let alone = match (edges, self.edges) {
            (Edges::Computed, _) => "a pixel unlike its neighbours computes them itself",
            (Edges::Blended, Edges::Blended) => "a pixel unlike its neighbours takes their mean",
            (Edges::Blended, Edges::Computed) => {
                "a pixel unlike its neighbours takes their mean, for they need derivatives"
            }
        };
        Change {
            key: Site {
                role: Role::Main,
                entry_point: self.stage.pass.fragment.clone().unwrap_or_default(),
                slice: outline::hash(self.values, moved()),
            },
            what: format!(
                "{}computes {} for one pixel of each 2x2 ({:.0} ops); {guided}, and {alone}; a \
                 pixel costs {:.0} ops instead of {:.0}",
                Guard::condition(self.guard.as_ref()),
                names.join(", "),
                self.choice.half,
                self.choice.after,
                self.choice.before
            ),
            location: moved()
                .filter_map(|id| span(self.values, id))
                .find_map(|span| sources.locate(span)),
            cost: SiteCost {
                slice: self.choice.before - self.choice.after,
                whole: self.choice.before,
            },
        }
    }
}

impl Built {
    /// The targets' bindings with their sources, for [`reflect::fill`].
    fn bindings(&self, names: &[String]) -> Vec<BindingUse> {
        let [group, first] = self.at;
        let all = names.iter().enumerate();
        all.map(|(i, name)| {
            let source = BindingSource::Attachment { name: name.clone() };
            BindingUse::new([group, first + i as u32], BindingKind::Texture, source)
        })
        .collect()
    }
}
