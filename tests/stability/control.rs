//! Control: lanes that leave, and what their neighbours still need of them.

use preshade_plan::contract::Contract;

use super::case::Expect::{Holds, Refused, Untied};
use super::case::{ALL, COLORS, Case, DIRECTIONS, Red, SAMPLED, Stage};
use super::mutate::Mutation;
use super::render_support::with_prepass;

const BIASED: &str = "depth-prepass";
const EQUAL: &str = "depth-prepass:form=equal";
const EARLY: &str = "early-discard";
const READ_ONLY: &str = "early-discard:attachment=readonly";

/// Not with their quad.
const EACH_FOR_ITSELF: &[(&str, &str)] = &[("return quad > 0.5f;", "return lane > 0.5f;")];

pub const CASES: &[Case] = &[
    Case {
        name: "derivatives beside holes",
        scene: "holes",
        guards: "a lane that leaves ahead of an implicit sample or a derivative of its neighbours",
        setups: ALL,
        only: "",
        recipes: &[
            (BIASED, Holds),
            (EQUAL, Untied),
            (EARLY, Holds),
            (READ_ONLY, Untied),
            ("early-discard:quad=lane,budget=0.05", Holds),
            ("visibility-buffer:budget=0.05", Holds),
        ],
        mutation: (
            "lanes leave each for itself, on a driver that ends them (which alone changes \
             nothing): what they would sample at is elsewhere",
            Mutation::Driver {
                recipe: EARLY,
                does: &[(
                    "let bent = in.uv +",
                    "let bent = select(in.uv, vec2<f32>(), hidden) +",
                )],
                edits: EACH_FOR_ITSELF,
            },
        ),
    },
    Case {
        name: "samples in loops and branches",
        scene: "branches",
        guards: "derivatives that not all lanes of a quad are at: what they are is left to the \
                 adapter, and must be left alone",
        setups: DIRECTIONS,
        only: COLORS,
        recipes: &[
            (BIASED, Holds),
            (EARLY, Refused("undefined-derivative")),
            ("hoist", Refused("nothing-pays")),
        ],
        mutation: (
            "gradients taken ahead of the branches, by hand",
            Mutation::Shader("branches-naive.wgsl", Contract::exact),
        ),
    },
    Case {
        name: "helper invocations",
        scene: "helpers",
        guards: "lanes that are no fragments, or are none any more, and whose values their \
                 neighbours' derivatives are made of",
        setups: ALL,
        only: "",
        recipes: &[
            (BIASED, Holds),
            (EQUAL, Untied),
            (EARLY, Holds),
            (READ_ONLY, Untied),
            ("visibility-buffer:budget=0.05", Holds),
        ],
        mutation: (
            "lanes leave each for itself, on a driver that ends them (which alone changes \
             nothing): what they would compute is 0",
            Mutation::Driver {
                recipe: EARLY,
                does: &[(
                    "let bent = (in.uv * in.uv)",
                    "let bent = select(in.uv * in.uv, vec2<f32>(), hidden)",
                )],
                edits: EACH_FOR_ITSELF,
            },
        ),
    },
    Case {
        name: "early returns",
        scene: "returns",
        guards: "a slice that forgets a return ahead of the discard",
        setups: ALL,
        only: "",
        recipes: &[(BIASED, Holds), (EQUAL, Untied), (EARLY, Holds)],
        mutation: (
            "the pre-pass does not return early",
            Mutation::Text(EQUAL, &[("        return;\n", "")]),
        ),
    },
    Case {
        name: "alpha to coverage",
        scene: "coverage",
        guards: "a pre-pass that covers samples which the main pass leaves",
        setups: SAMPLED,
        only: "",
        recipes: &[(BIASED, Holds), (EARLY, Holds)],
        mutation: (
            "the pre-pass without alpha to coverage",
            Mutation::Plans(BIASED, |plans| {
                for pass in plans.iter_mut().flat_map(|p| p.passes.first_mut()) {
                    pass.multisample.alpha_to_coverage = false;
                }
            }),
        ),
    },
    Case {
        name: "stores in fragments",
        scene: "stores",
        guards: "fragments that no longer run, and with them what they write",
        setups: DIRECTIONS,
        only: "it is refused before depth is looked at",
        recipes: &[
            (BIASED, Refused("fragment-store")),
            (EQUAL, Refused("fragment-store")),
            (EARLY, Refused("fragment-store")),
        ],
        mutation: (
            "a pre-pass by hand: fragments that ran before run no more",
            Mutation::Own(lost_stores),
        ),
    },
];

fn lost_stores(stage: &Stage<'_>) -> Red {
    let plans: Vec<_> = stage.originals.iter().map(with_prepass).collect();
    let (before, after) = (stage.shaded(&stage.originals), stage.shaded(&plans));
    match after < before {
        true => Red::Seen {
            how: format!("{after:.2} fragments a pixel store, of {before:.2}"),
        },
        false => Red::Unseen,
    }
}
