//! Range: worlds far from the origin, long times, and the ends of what a float or a half holds.

use preshade::passes::contract::Contract;

use super::case::Case;
use super::case::DIRECTIONS;
use super::case::Expect::{Holds, Untied};
use super::case::Red;
use super::mutate::Mutation;

const BIASED: &str = "depth-prepass";
const EQUAL: &str = "depth-prepass:form=equal";
const SLICED: &str = "depth-prepass:form=equal,vertex=sliced";
const EARLY: &str = "early-discard";
const VISIBLE: &str = "visibility-buffer";

/// A position by the same factors in another order.
const REASSOCIATED: Mutation = Mutation::Text(SLICED, &[("PLACEHOLDER", "")]);

const MOVED: &str = "a position that a pass computes in another order, whose roundings grow with the distance from the origin";
const IN_ANOTHER_ORDER: &str = "the pre-pass multiplies the matrices first";

pub const CASES: &[Case] = &[
    Case {
        name: "the world at 1,000",
        scene: "moved-1000",
        guards: MOVED,
        setups: DIRECTIONS,
        recipes: &[
            (BIASED, Holds),
            (EQUAL, Untied),
            (SLICED, Untied),
            (EARLY, Holds),
            (VISIBLE, Holds),
        ],
        mutation: (IN_ANOTHER_ORDER, REASSOCIATED),
    },
    Case {
        name: "the world at 100,000",
        scene: "moved-100000",
        guards: MOVED,
        setups: DIRECTIONS,
        recipes: &[
            (BIASED, Holds),
            (EQUAL, Untied),
            (SLICED, Untied),
            (EARLY, Holds),
        ],
        mutation: (IN_ANOTHER_ORDER, REASSOCIATED),
    },
    Case {
        name: "the world at 10,000,000",
        scene: "moved-10000000",
        guards: MOVED,
        setups: DIRECTIONS,
        recipes: &[(BIASED, Holds), (EARLY, Holds)],
        mutation: (IN_ANOTHER_ORDER, REASSOCIATED),
    },
    Case {
        name: "hash noise far out",
        scene: "hash",
        guards: "a value that jumps between one float and the next, interpolated",
        setups: DIRECTIONS,
        recipes: &[
            (BIASED, Holds),
            (EARLY, Holds),
            ("hoist", Holds),
            ("hoist:budget=0.05,finite=assumed", Holds),
        ],
        mutation: (
            "the hash computed at vertices, by hand",
            Mutation::Shader("hash-naive.wgsl", within),
        ),
    },
    Case {
        name: "a long time",
        scene: "time",
        guards: "an affine value that is carried because its rounding is small, into a sine to which it is large",
        setups: DIRECTIONS,
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
        recipes: &[
            (BIASED, Holds),
            ("hoist", Holds),
            ("hoist:budget=0.05", Holds),
        ],
        mutation: (
            "all values taken to be finite",
            Mutation::Recipe("hoist:budget=0.05,finite=assumed", "hoist:budget=0.05"),
        ),
    },
    Case {
        name: "half precision overflow",
        scene: "half",
        guards: "the same of 65,504, the greatest half",
        setups: DIRECTIONS,
        recipes: &[
            (BIASED, Holds),
            ("hoist", Holds),
            ("hoist:budget=0.05", Holds),
        ],
        mutation: (
            "all values taken to be finite",
            Mutation::Recipe("hoist:budget=0.05,finite=assumed", "hoist:budget=0.05"),
        ),
    },
    Case {
        name: "denormals",
        scene: "denormal",
        guards: "numbers computed ahead of time by a machine that keeps what the adapter flushes to 0",
        setups: DIRECTIONS,
        recipes: &[
            (BIASED, Holds),
            (EARLY, Holds),
            ("specialize", Holds),
            ("hoist", Holds),
        ],
        mutation: ("the product folded, by hand", Mutation::Own(folded)),
    },
];

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
        k: 1,
        given: Vec::new(),
    }
}

fn within() -> Contract {
    Contract::Approximate {
        metric: "flip_mean".to_owned(),
        budget: 0.05,
        given: Vec::new(),
    }
}
