//! Depth: two passes that must agree on it to the bit, formats that round it, surfaces that share
//! it.

use preshade_draw::render::SelfTestResult;
use preshade_plan::plan::{Plan, Role};
use preshade_plan::state::DepthBias;
use preshade_plan::state::DepthDirection::{self, Forward, Reversed};
use preshade_plan::state::DepthFormat::{Depth16unorm, Depth24plus, Depth32float};
use preshade_scenes::{ShaderForm, self_test};

use super::case::Expect::{Holds, Refused, Shades, Untied, Withstands};
use super::case::{ALL, Case, REFUSED, Red, SAMPLED, Stage, contract, setup};
use super::mutate::{Moved, Mutation, judged, moved};

const BIASED: &str = "depth-prepass";
const EQUAL: &str = "depth-prepass:form=equal";
const SLICED: &str = "depth-prepass:form=equal,vertex=sliced";
const EARLY: &str = "early-discard";
const READ_ONLY: &str = "early-discard:attachment=readonly";

/// Fragments that are shaded behind others are those of the walls that a pass cannot tell from the
/// one in front, and the depth test neither.
const BELOW: &str =
    "how many walls a format tells apart is its own, and so each group of formats is a case";
const FIXED: &str = "tolerance=0.0001";
const FIXED_RECIPE: &str = "early-discard:tolerance=0.0001";

pub const CASES: &[Case] = &[
    Case {
        name: "last bit of the position",
        scene: "layers",
        guards: "a pre-pass whose position differs from the main pass's by one bit: EQUAL fails on \
                 most pixels",
        setups: ALL,
        only: "",
        recipes: &[
            (BIASED, Holds),
            (EQUAL, Untied),
            (SLICED, Untied),
            (EARLY, Holds),
            (READ_ONLY, Untied),
        ],
        mutation: (
            "the pre-pass's z one float farther, under EQUAL",
            Mutation::Plans(EQUAL, |plans| moved(plans, Role::Prepass, Moved::Depth(1))),
        ),
    },
    Case {
        name: "a driver without invariance",
        scene: "../atrium",
        guards: "ties, crossing cards and decals on a driver that compiles one vertex stage in two \
                 ways",
        setups: ALL,
        only: "",
        recipes: &[
            (BIASED, Withstands(2)),
            (EARLY, Withstands(2)),
            (EQUAL, Untied),
        ],
        mutation: (
            "the pre-pass's z one float nearer (256 under reversed Z in 16 bits), under EQUAL: its \
             self-test fails, and the fallback it names draws the original",
            Mutation::Own(self_tested),
        ),
    },
    Case {
        name: "infinite far plane",
        scene: "infinite",
        guards: "a bias of the wrong sign where depth grows towards the viewer, and depths next to \
                 0 and 1",
        setups: ALL,
        only: "",
        recipes: &[
            (BIASED, Holds),
            (EQUAL, Untied),
            (EARLY, Holds),
            (READ_ONLY, Untied),
        ],
        mutation: (
            "the bias with its sign turned round",
            Mutation::Plans(BIASED, |plans| {
                biased(plans, |b| DepthBias {
                    constant: -b.constant,
                    slope_scale: -b.slope_scale,
                    ..b
                });
            }),
        ),
    },
    Case {
        name: "no bias",
        scene: "layers",
        guards: "a pre-pass at the very depth of the main pass, which under Less then draws \
                 nothing",
        setups: ALL,
        only: "",
        recipes: &[(BIASED, Withstands(4))],
        mutation: (
            "the bias taken away",
            Mutation::Plans(BIASED, |plans| biased(plans, |_| DepthBias::default())),
        ),
    },
    Case {
        name: "tolerance at 1 m to 100 km",
        scene: "distances",
        guards: "a fixed tolerance of 0.0001, which from 30 m on takes hidden surfaces for visible \
                 ones",
        setups: &[
            setup(Depth32float, Forward, 1),
            setup(Depth24plus, Forward, 1),
        ],
        only: BELOW,
        recipes: &[(EARLY, Shades(1.4)), (BIASED, Shades(1.6))],
        mutation: (FIXED, Mutation::Shades(FIXED_RECIPE, 1.4)),
    },
    Case {
        name: "tolerance at 1 m to 100 km, reversed",
        scene: "distances",
        guards: "the same under reversed Z, where no distance is too far to tell surfaces apart",
        setups: &[setup(Depth32float, Reversed, 1)],
        only: BELOW,
        recipes: &[(EARLY, Shades(1.1)), (BIASED, Shades(1.1))],
        mutation: (FIXED, Mutation::Shades(FIXED_RECIPE, 1.1)),
    },
    Case {
        name: "tolerance at 1 m to 100 km, reversed in 24 bits",
        scene: "distances",
        guards: "the same, where all depths have one step: at 100 km it is more than lies between \
                 two surfaces",
        setups: &[setup(Depth24plus, Reversed, 1)],
        only: BELOW,
        recipes: &[(EARLY, Shades(1.2)), (BIASED, Shades(1.5))],
        mutation: (FIXED, Mutation::Shades(FIXED_RECIPE, 1.2)),
    },
    Case {
        name: "tolerance at 1 m to 100 km, in 16 bits",
        scene: "distances",
        guards: "the same in a format whose step is a seventh of 0.0001: what it can tell apart at \
                 40 m",
        setups: &[
            setup(Depth16unorm, Forward, 1),
            setup(Depth16unorm, Reversed, 1),
        ],
        only: BELOW,
        recipes: &[(EARLY, Shades(1.3)), (BIASED, Shades(1.4))],
        mutation: (FIXED, Mutation::Shades(FIXED_RECIPE, 1.3)),
    },
    Case {
        name: "no tolerance",
        scene: "layers",
        guards: "a prologue that drops what is nearest, on a driver that computes it a bit farther \
                 the second time",
        setups: ALL,
        only: "",
        recipes: &[
            (EARLY, Withstands(2)),
            ("early-discard:texture=packed", Holds),
        ],
        mutation: (
            "tolerance=0, and the pre-pass's z two floats nearer",
            Mutation::Own(without_tolerance),
        ),
    },
    Case {
        name: "grazing slopes",
        scene: "grazing",
        guards: "a constant bias alone, where one pixel spans many of its steps: what a \
                 rasteriser's snapping of the same vertices apart makes of it",
        setups: ALL,
        only: "",
        recipes: &[
            (BIASED, Holds),
            (EQUAL, Untied),
            (EARLY, Holds),
            (READ_ONLY, Untied),
        ],
        mutation: (
            "a bias of one step and no slope, and the pre-pass 1/128 pixel up (with the whole bias \
             that changes nothing)",
            Mutation::Own(without_slope),
        ),
    },
    Case {
        name: "coplanar layers",
        scene: "coplanar",
        guards: "under EQUAL all of several surfaces at the nearest depth show, and the last one \
                 wins",
        setups: ALL,
        only: "",
        recipes: &[(BIASED, Holds), (EARLY, Holds)],
        mutation: ("EQUAL, told of no ties", Mutation::Untied(EQUAL)),
    },
    Case {
        name: "written depth",
        scene: "written",
        guards: "a bias that the rasteriser adds, which a depth from the fragment stage takes the \
                 place of",
        setups: ALL,
        only: "",
        recipes: &[
            (BIASED, Holds),
            (EARLY, Holds),
            (EQUAL, Refused("depth-not-invariant")),
            (READ_ONLY, Refused("readonly-depth-writer")),
        ],
        mutation: (
            "the bias left to the rasteriser",
            Mutation::Text(
                BIASED,
                &[(
                    "return (in.clip.z + relief) + ",
                    "return (in.clip.z + relief) + 0f * ",
                )],
            ),
        ),
    },
    Case {
        name: "four samples",
        scene: "layers",
        guards: "one sample's depth taken for a pixel's, at every edge",
        setups: SAMPLED,
        only: "",
        recipes: &[
            (BIASED, Holds),
            (EQUAL, Untied),
            (SLICED, Untied),
            (EARLY, Holds),
            (READ_ONLY, Untied),
        ],
        mutation: (
            "the prologue looks at the first sample alone",
            Mutation::Text(
                EARLY,
                &[
                    ("pixel, 1i)", "pixel, 0i)"),
                    ("pixel, 2i)", "pixel, 0i)"),
                    ("pixel, 3i)", "pixel, 0i)"),
                ],
            ),
        ),
    },
    Case {
        name: "depth clamp",
        scene: "clamped",
        guards: "surfaces clamped to the near plane after they were biased, in both passes: they \
                 hide themselves",
        setups: ALL,
        only: "",
        recipes: &[(BIASED, Refused("near-plane")), (EARLY, Holds)],
        mutation: (
            "told that nothing lies on the near plane",
            Mutation::Untied(BIASED),
        ),
    },
];

/// Changes the bias of every pre-pass.
pub fn biased(plans: &mut [Plan], change: impl Fn(DepthBias) -> DepthBias) {
    for pass in plans.iter_mut().flat_map(|p| &mut p.passes) {
        if let (Role::Prepass, Some(depth)) = (pass.role, &mut pass.depth) {
            depth.bias = change(depth.bias);
        }
    }
}

/// What a host does that meets such a driver: it runs the self-test, which fails, and draws the
/// fallback, which is right.
fn self_tested(stage: &Stage<'_>) -> Red {
    let facts = stage.facts.clone();
    let recipe = |text: &str| preshade_compiler::recipe::Recipe::parse_list(text).unwrap();
    let variant = preshade_lab::measure::variant(&stage.originals, &recipe(EQUAL), &facts);
    if variant.is_refused() {
        return Red::NotHere {
            why: REFUSED.to_owned(),
        };
    }
    let scene = stage.inputs.scene();
    // Far from 1 a step of 16 bits is thousands of floats: of so many some pixels show it.
    let steps = match (scene.depth_format, scene.depth_direction) {
        (Depth16unorm, Reversed) => -256,
        _ => -1,
    };
    let mut plans = variant.plans;
    moved(&mut plans, Role::Prepass, Moved::Depth(steps));
    let mut fallbacks = Vec::new();
    let mut failed = 0;
    for (plan, original) in plans.iter().zip(&stage.originals) {
        match self_test(stage.inputs, plan, ShaderForm::Text).unwrap() {
            Some(SelfTestResult::Failed { .. }) => {
                failed += 1;
                let named = plan.fallback.as_deref().unwrap();
                let mut fallback = recipe(named).apply(original, &facts).unwrap();
                // The driver is as it is.
                moved(
                    std::slice::from_mut(&mut fallback),
                    Role::Prepass,
                    Moved::Depth(steps),
                );
                fallbacks.push(fallback);
            }
            _ => fallbacks.push(plan.clone()),
        }
    }
    let fallback = stage
        .compare(&preshade_scenes::variant(&fallbacks, ShaderForm::Text).unwrap())
        .unwrap();
    match failed == plans.iter().filter(|p| p.self_test.is_some()).count()
        && failed > 0
        && fallback.is_exact()
    {
        true => Red::Seen {
            how: format!("{failed} self-tests failed, their fallbacks changed 0 pixels"),
        },
        false => Red::Unseen,
    }
}

/// What holds with a tolerance, the pre-pass two floats nearer, without one.
fn without_tolerance(stage: &Stage<'_>) -> Red {
    let mut plans = stage.chosen("early-discard:tolerance=0").plans;
    let contract = contract(&plans);
    let nearer = match stage.inputs.scene().depth_direction {
        DepthDirection::Forward => -2,
        DepthDirection::Reversed => 2,
    };
    moved(&mut plans, Role::Prepass, Moved::Depth(nearer));
    judged(stage, &plans, &contract)
}

/// With the slope in the bias, what is snapped apart by 1/128 pixel stays hidden; without, it
/// shows.
fn without_slope(stage: &Stage<'_>) -> Red {
    let mut plans = stage.chosen(BIASED).plans;
    let contract = contract(&plans);
    moved(&mut plans, Role::Prepass, Moved::Up(1.0 / 128.0));
    if let Red::Seen { how } = judged(stage, &plans, &contract) {
        panic!("with its slope the bias does not hold: {how}");
    }
    biased(&mut plans, |b| DepthBias {
        constant: b.constant.signum(),
        slope_scale: 0.0,
        ..b
    });
    judged(stage, &plans, &contract)
}
