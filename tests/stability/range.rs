//! Range: worlds far from the origin, long times, and the ends of what a float or a half holds.

use preshade_plan::budget::{Budget, Metric};
use preshade_plan::contract::Contract;
use preshade_plan::state::DepthBias;

use super::case::Expect::{Holds, Refused, Untied};
use super::case::{ALL, COLORS, Case, DIRECTIONS, Red};
use super::depth::biased;
use super::mutate::Mutation;

const BIASED: &str = "depth-prepass";
const EQUAL: &str = "depth-prepass:form=equal";
const SLICED: &str = "depth-prepass:form=equal,vertex=sliced";
const EARLY: &str = "early-discard";

/// The same position in real numbers. Near the origin the bias is more than what they differ by.
/// Column by column: a product of two matrices and a vector is one that a driver may take in the
/// other order again (an H200's was seen to).
const MULTIPLIED: Mutation = Mutation::Text(
    BIASED,
    &[
        (
            "let world = object.model * vec4<f32>(position, 1f);",
            "let x_axis = camera.view_proj * object.model[0]; \
             let y_axis = camera.view_proj * object.model[1]; \
             let z_axis = camera.view_proj * object.model[2]; \
             let origin = camera.view_proj * object.model[3];",
        ),
        (
            "return camera.view_proj * world;",
            "return x_axis * position.x + y_axis * position.y + z_axis * position.z + origin;",
        ),
    ],
);

const MOVED: &str = "positions whose roundings grow with the distance from the origin";
const WITHOUT: &str = "the pre-pass multiplies its matrices first";

pub const CASES: &[Case] = &[
    Case {
        name: "the world at 1,000",
        scene: "moved-1000",
        guards: MOVED,
        setups: ALL,
        only: "",
        recipes: &[
            (BIASED, Holds),
            (EQUAL, Untied),
            (SLICED, Untied),
            (EARLY, Holds),
        ],
        mutation: (
            "the bias taken away (with it the pre-pass may multiply its matrices first)",
            Mutation::Own(unbiased),
        ),
    },
    Case {
        name: "the world at 100,000",
        scene: "moved-100000",
        guards: MOVED,
        setups: ALL,
        only: "",
        recipes: &[
            (BIASED, Holds),
            (EQUAL, Untied),
            (SLICED, Untied),
            (EARLY, Holds),
        ],
        mutation: (WITHOUT, MULTIPLIED),
    },
    Case {
        name: "the world at 1,000,000",
        scene: "moved-1000000",
        guards: MOVED,
        setups: ALL,
        only: "",
        recipes: &[
            (BIASED, Holds),
            (EQUAL, Untied),
            (SLICED, Untied),
            (EARLY, Holds),
        ],
        mutation: (WITHOUT, MULTIPLIED),
    },
    Case {
        name: "the world at 10,000,000",
        scene: "moved-10000000",
        guards: MOVED,
        setups: ALL,
        only: "",
        recipes: &[
            (BIASED, Holds),
            (EQUAL, Untied),
            (SLICED, Untied),
            (EARLY, Holds),
        ],
        mutation: (WITHOUT, MULTIPLIED),
    },
    Case {
        name: "positions relative to the eye",
        scene: "far",
        guards: "a world of which little is left in differences of large numbers: the host takes \
                 the eye off in f64",
        setups: ALL,
        only: "",
        recipes: &[
            (BIASED, Holds),
            (EQUAL, Untied),
            (EARLY, Holds),
            ("hoist:budget=0.05,finite=assumed,jumps=carried", Holds),
        ],
        mutation: (
            "positions in the world, all moved by 10,000,000",
            Mutation::Own(super::far::jitters),
        ),
    },
    Case {
        name: "hash noise far out",
        scene: "hash",
        guards: "a value that jumps between one float and the next, interpolated",
        setups: DIRECTIONS,
        only: COLORS,
        recipes: &[
            (BIASED, Holds),
            (EARLY, Holds),
            ("hoist", Holds),
            ("hoist:budget=0.05,finite=assumed,jumps=carried", Holds),
        ],
        mutation: (
            "the hash computed at vertices, by hand",
            Mutation::Shader("hash-naive.wgsl", within),
        ),
    },
    Case {
        name: "a long time",
        scene: "time",
        guards: "an affine value that is carried because its rounding is small, into a sine to \
                 which it is large",
        setups: DIRECTIONS,
        only: COLORS,
        recipes: &[(BIASED, Holds), (EARLY, Holds), ("hoist", Holds)],
        mutation: (
            "the phase computed at vertices, by hand",
            Mutation::Shader("time-naive.wgsl", rounding),
        ),
    },
    Case {
        name: "the ends of exp and pow",
        scene: "ends",
        guards: "what overflows at a vertex that no fragment sees",
        setups: DIRECTIONS,
        only: COLORS,
        recipes: &[
            (BIASED, Holds),
            ("hoist", Holds),
            ("hoist:budget=0.05", Holds),
        ],
        mutation: (
            "all values taken to be finite",
            Mutation::Recipe(
                "hoist:budget=0.05,finite=assumed,jumps=carried",
                "hoist:budget=0.05",
            ),
        ),
    },
    Case {
        name: "half precision overflow",
        scene: "half",
        guards: "the same of 65,504, the greatest half",
        setups: DIRECTIONS,
        only: COLORS,
        recipes: &[
            (BIASED, Holds),
            ("hoist", Holds),
            ("hoist:budget=0.05", Holds),
        ],
        mutation: (
            "all values taken to be finite",
            Mutation::Recipe(
                "hoist:budget=0.05,finite=assumed,jumps=carried",
                "hoist:budget=0.05",
            ),
        ),
    },
    Case {
        name: "denormals",
        scene: "denormal",
        guards: "numbers computed ahead of time by a machine that keeps what the adapter flushes \
                 to 0",
        setups: DIRECTIONS,
        only: COLORS,
        recipes: &[
            (BIASED, Holds),
            (EARLY, Holds),
            ("specialize", Refused("nothing-known")),
            // The vertex stage of llvmpipe keeps denormals, and its fragments flush them.
            ("hoist", Holds),
        ],
        mutation: ("the product folded, by hand", Mutation::Own(folded)),
    },
];

/// Not far out the bias is enough for what another order of products does; without it the pre-pass
/// hides what it drew.
fn unbiased(stage: &super::case::Stage<'_>) -> Red {
    if let Red::Seen { how } = MULTIPLIED.red(stage) {
        panic!("the bias is not enough for another order of products: {how}");
    }
    Mutation::Plans(BIASED, |plans| biased(plans, |_| DepthBias::default())).red(stage)
}

/// On an adapter that keeps denormals folding changes nothing.
fn folded(stage: &super::case::Stage<'_>) -> Red {
    match Mutation::Shader("denormal-naive.wgsl", Contract::exact).red(stage) {
        Red::Unseen => Red::NotHere {
            why: "the adapter keeps denormals".to_owned(),
        },
        red => red,
    }
}

fn rounding() -> Contract {
    Contract::Rounding {
        turned: None,
        k: 1,
        given: Vec::new(),
    }
}

fn within() -> Contract {
    Contract::Approximate {
        budget: Budget {
            metric: Metric::FlipMean,
            limit: 0.05,
        },
        given: Vec::new(),
    }
}
