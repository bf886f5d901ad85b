//! The plan with both passes, and the words for it.

use super::build::Built;
use super::{Edges, HalfRate, HalfRateParams, HalvedValues, values};
use preshade_plan::budget::Budget;
use preshade_plan::contract::Contract;
use preshade_plan::pass::{Outcome, Pass};
use preshade_plan::plan::{
    Attachment, BindingKind, BindingSource, BindingUse, Change, Draws, GpuPass, Phase, Plan, Role,
    SiteCost,
};
use preshade_plan::reflect;
use preshade_plan::state::ColorTarget;

/// Format of the targets: words, which no driver rounds.
const FORMAT: &str = "rgba32uint";

impl HalvedValues<'_, '_, '_> {
    pub(super) fn outcome(
        self,
        plan: &Plan,
        built: Built,
        params: &HalfRateParams,
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
        let (given, change) = (self.stage.given.clone(), self.change(built.edges));
        let step = (HalfRate::INFO.name, params);
        let contract = |given| Contract::Approximate { budget, given };
        self.moved.outcome(next, step, change, given, contract)
    }

    fn change(&self, edges: Edges) -> Change {
        let guides = self.choice.guides.iter();
        let guides: Vec<String> = guides
            .map(|id| format!("`{}`", values::guide_name(self.moved.values, *id)))
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
        let choice = &self.choice;
        let what = format!(
            "computes {} for one pixel of each 2x2 ({:.0} ops); {guided}, and {alone}; a pixel \
             costs {:.0} ops instead of {:.0}",
            self.moved.names(),
            choice.half,
            choice.after,
            choice.before
        );
        let cost = SiteCost {
            slice: choice.saved(),
            whole: choice.before,
        };
        self.moved.change(self.stage.pass, &what, cost)
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
