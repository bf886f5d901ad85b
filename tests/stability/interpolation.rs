//! Interpolation: what a triangle makes of its corners, where they are behind the viewer, far away,
//! or without a value.

use preshade_draw::render::{ColorImage, Rendered, Variant as Host};
use preshade_plan::contract::Contract;
use preshade_plan::plan::Role;
use preshade_scenes::ShaderForm;

use super::case::Expect::{self, Holds, OffNearPlane, Refused, Untied};
use super::case::{ALL, COLORS, Case, DIRECTIONS, Red, SAMPLED, Stage, pictures};
use super::mutate::{Moved, Mutation, edited, moved};

const BIASED: &str = "depth-prepass";
const EQUAL: &str = "depth-prepass:form=equal";
const EARLY: &str = "early-discard";
/// A step of 255, and as much again as rounding adds to it.
const VISIBLE: &str = "visibility-buffer:budget=0.004";
const VISIBLE_WITHIN: &str = "visibility-buffer:budget=0.03";
const FIXED_LEVEL: &str = "hoist:budget=0.05,finite=assumed,jumps=carried,metric=max_abs,\
                           tessellate:level=3,pattern=uniform";
/// Planes through corners as they are, whatever the adapter's: then it is each triangle of no area
/// that is divided by it.
const AS_GIVEN: &str = "visibility-buffer:budget=1,corners=as-given";

/// The difference of a corner and the pixel by way of an origin far from both.
const AFAR_A: &str = "((a.xy + vec2(4096f * a.w)) - (clip + vec2(4096f)) * a.w)";
const AFAR_B: &str = "((b.xy + vec2(4096f * b.w)) - (clip + vec2(4096f)) * b.w)";
const AFAR_C: &str = "((c.xy + vec2(4096f * c.w)) - (clip + vec2(4096f)) * c.w)";

/// What is drawn of values that are none at vertices which no fragment sees, and the guard taken
/// away.
const HIDDEN: &[(&str, Expect)] = &[
    (BIASED, Holds),
    (EARLY, Holds),
    ("hoist", Holds),
    ("hoist:budget=0.05", Holds),
];
const ASSUMED: &str = "all values taken to be finite";
const FINITE: Mutation = Mutation::Recipe(
    "hoist:budget=0.05,finite=assumed,jumps=carried",
    "hoist:budget=0.05",
);

pub const CASES: &[Case] = &[
    Case {
        name: "vertices behind the near plane",
        scene: "behind",
        guards: "corners divided by a w that is clamped to be positive, or taken for ones in front",
        setups: ALL,
        only: "",
        recipes: &[
            (BIASED, Holds),
            (EQUAL, Untied),
            (EARLY, Holds),
            (VISIBLE, Holds),
            ("visibility-buffer:form=compute,budget=0.004", Holds),
        ],
        mutation: (
            "the resolve takes w for at least 0.05",
            Mutation::Text(
                VISIBLE,
                &[
                    ("vec2(a.w)", "vec2(max(a.w, 0.05f))"),
                    ("vec2(b.w)", "vec2(max(b.w, 0.05f))"),
                    ("vec2(c.w)", "vec2(max(c.w, 0.05f))"),
                ],
            ),
        ),
    },
    Case {
        name: "vertices in the plane of the eye",
        scene: "eye-plane",
        guards: "a division by w ahead of interpolation, where w is 0",
        setups: ALL,
        only: "",
        recipes: &[
            (BIASED, Holds),
            (EARLY, Holds),
            (VISIBLE, Holds),
            ("visibility-buffer:form=binned,budget=0.004", Holds),
        ],
        mutation: (
            "the resolve divides by w first",
            Mutation::Text(
                VISIBLE,
                &[
                    ("fma(-(clip), vec2(a.w), a.xy)", "(a.xy / a.w - clip)"),
                    ("fma(-(clip), vec2(b.w), b.xy)", "(b.xy / b.w - clip)"),
                    ("fma(-(clip), vec2(c.w), c.xy)", "(c.xy / c.w - clip)"),
                    (
                        "return vec3<f32>(visible_cross_result, visible_cross_result2, \
                         visible_cross_result3);",
                        "return vec3<f32>(visible_cross_result, visible_cross_result2, \
                         visible_cross_result3) / vec3<f32>(a.w, b.w, c.w);",
                    ),
                ],
            ),
        ),
    },
    Case {
        name: "triangles larger than the screen",
        scene: "huge",
        guards: "differences of large products, of which little is left: corners are told from the \
                 pixel before they are multiplied",
        setups: ALL,
        only: "",
        recipes: &[(BIASED, Holds), (EARLY, Holds), (VISIBLE_WITHIN, Holds)],
        mutation: (
            "the resolve tells corners from an origin far from the pixel",
            Mutation::Text(
                VISIBLE_WITHIN,
                &[
                    ("fma(-(clip), vec2(a.w), a.xy)", AFAR_A),
                    ("fma(-(clip), vec2(b.w), b.xy)", AFAR_B),
                    ("fma(-(clip), vec2(c.w), c.xy)", AFAR_C),
                ],
            ),
        ),
    },
    Case {
        name: "slivers",
        scene: "slivers",
        guards: "triangles of a sixth of a pixel, whose area is what is left of large products",
        setups: ALL,
        only: "",
        recipes: &[
            (BIASED, Holds),
            (EQUAL, Untied),
            (EARLY, Holds),
            (VISIBLE, Holds),
            ("visibility-buffer:form=compute,budget=0.004", Holds),
        ],
        mutation: (
            "an area to divide by of 0.5 in clip space at least, as if for triangles of none",
            Mutation::Text(
                VISIBLE,
                &[(
                    "select(edges / vec3(sum), vec3(0.33333334f), sum == 0f)",
                    "edges / vec3(sign(sum) * max(abs(sum), 0.5f))",
                )],
            ),
        ),
    },
    Case {
        name: "triangles of no area",
        scene: "zero-area",
        guards: "no area to divide by, where a rasteriser's snapping of corners gives some \
                 triangles pixels all the same",
        setups: ALL,
        only: "",
        recipes: &[
            (BIASED, OffNearPlane),
            (EQUAL, Untied),
            (EARLY, Holds),
            // Values over a triangle without area are the rasteriser's alone.
            ("visibility-buffer:budget=1", Holds),
        ],
        mutation: (
            "told that nothing lies on the near plane, where an adapter puts what has no area \
             there",
            Mutation::Own(on_near_plane),
        ),
    },
    Case {
        name: "no area to divide by",
        scene: "no-area",
        guards: "0 / 0 in the resolve, of which a filter makes a blot",
        setups: ALL,
        only: "",
        recipes: &[(BIASED, Holds), (EARLY, Holds)],
        mutation: (
            "the resolve divides by the area, whether there is one or not",
            Mutation::Own(divided),
        ),
    },
    Case {
        name: "T-junctions",
        scene: "junctions",
        guards: "cracks that are the author's, of which a variant must leave each pixel as it is",
        setups: ALL,
        only: "",
        recipes: &[
            (BIASED, Holds),
            (EQUAL, Untied),
            (EARLY, Holds),
            (VISIBLE, Holds),
            ("visibility-buffer:form=compute,budget=0.004", Holds),
        ],
        mutation: (
            "the id pass 1/64 pixel up: other cracks, and other edges",
            Mutation::Plans(VISIBLE, |plans| {
                moved(plans, Role::Ids, Moved::Up(1.0 / 64.0))
            }),
        ),
    },
    Case {
        name: "centroids at edges",
        scene: "centroid",
        guards: "a value carried without the way it is interpolated: outside of its triangle at \
                 every edge",
        setups: SAMPLED,
        only: "",
        recipes: &[
            (BIASED, Refused("surviving-samples")),
            (EARLY, Holds),
            ("hoist", Holds),
        ],
        mutation: (
            "the value carried at pixels' centres, by hand",
            Mutation::Shader("centroid-naive.wgsl", Contract::exact),
        ),
    },
    Case {
        name: "provoking vertices",
        scene: "provoking",
        guards: "a value of the whole triangle taken for one of each vertex",
        setups: DIRECTIONS,
        only: COLORS,
        recipes: &[
            (BIASED, Holds),
            (EARLY, Holds),
            ("hoist", Holds),
            (VISIBLE, Holds),
        ],
        mutation: (
            "the product of both computed at vertices, by hand",
            Mutation::Shader("provoking-naive.wgsl", rounding),
        ),
    },
    Case {
        name: "equal values at three corners",
        scene: "equal",
        guards: "equal values that interpolation brings out unequal by a bit, ahead of a jump",
        setups: DIRECTIONS,
        only: COLORS,
        recipes: &[(BIASED, Holds), (EARLY, Holds), ("hoist", Holds)],
        mutation: (
            "the level interpolated, by hand",
            Mutation::Shader("equal-naive.wgsl", Contract::exact),
        ),
    },
    Case {
        name: "no value at hidden vertices",
        scene: "hidden",
        guards: "one vertex without a finite value, which spreads over every triangle that it is a \
                 corner of",
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
        name: "a direction of no length at a hidden vertex",
        scene: "hidden-normalize",
        guards: "normalize(0), which spreads over every triangle that the vertex is a corner of",
        setups: DIRECTIONS,
        only: COLORS,
        recipes: HIDDEN,
        mutation: (ASSUMED, FINITE),
    },
    Case {
        name: "a power of a negative at hidden vertices",
        scene: "hidden-power",
        guards: "pow of a negative: NaN, or with some drivers a number",
        setups: DIRECTIONS,
        only: COLORS,
        recipes: HIDDEN,
        mutation: (ASSUMED, FINITE),
    },
    Case {
        name: "a division by 0 at a hidden vertex",
        scene: "hidden-division",
        guards: "an infinity, which interpolation makes NaN beside any other",
        setups: DIRECTIONS,
        only: COLORS,
        recipes: HIDDEN,
        mutation: (ASSUMED, FINITE),
    },
    Case {
        name: "a root of 1 - abs(dot) below 0 at hidden vertices",
        scene: "hidden-root",
        guards: "a direction that is no unit vector there: sqrt of a negative",
        setups: DIRECTIONS,
        only: COLORS,
        recipes: HIDDEN,
        mutation: (ASSUMED, FINITE),
    },
    Case {
        name: "cracks at every level",
        scene: "crack",
        guards: "an edge that its two triangles divide differently: pixels drawn never, or twice",
        setups: DIRECTIONS,
        only: COLORS,
        recipes: &[
            (
                "hoist:budget=0.05,finite=assumed,jumps=carried,metric=max_abs,tessellate:level=2",
                Holds,
            ),
            (
                "hoist:budget=0.05,finite=assumed,jumps=carried,metric=max_abs,tessellate:level=3,\
                 pattern=uniform",
                Holds,
            ),
            (
                "hoist:budget=0.05,finite=assumed,jumps=carried,metric=max_abs,tessellate:level=5,\
                 form=shared",
                Holds,
            ),
            (
                "hoist:budget=0.05,finite=assumed,jumps=carried,metric=max_abs,tessellate:level=8",
                Holds,
            ),
        ],
        mutation: (
            "each triangle takes the ends of an edge in its own order",
            Mutation::Text(
                FIXED_LEVEL,
                &[("select(a, b, swap)", "a"), ("select(b, a, swap)", "b")],
            ),
        ),
    },
    Case {
        name: "cracks between levels",
        scene: "crack",
        guards: "neighbours of different levels, and lengths of an edge that two triangles round \
                 apart",
        setups: DIRECTIONS,
        only: COLORS,
        recipes: &[
            (
                "hoist:budget=0.05,finite=assumed,jumps=carried,metric=max_abs,tessellate:level=16,\
                 edge-pixels=8",
                Holds,
            ),
            (
                "hoist:budget=0.05,finite=assumed,jumps=carried,metric=max_abs,tessellate:level=7,\
                 edge-pixels=5",
                Holds,
            ),
            (
                "hoist:budget=0.05,finite=assumed,jumps=carried,metric=max_abs,tessellate:level=40,\
                 edge-pixels=2",
                Holds,
            ),
        ],
        mutation: (
            "each triangle divides its edges as its longest one",
            Mutation::Text(
                "hoist:budget=0.05,finite=assumed,jumps=carried,metric=max_abs,tessellate:level=16,\
                 edge-pixels=8",
                &[
                    ("segments = ac;", "segments = inner;"),
                    ("segments = bc;", "segments = inner;"),
                ],
            ),
        ),
    },
];

/// What `hoist` promises without a budget.
fn rounding() -> Contract {
    Contract::Rounding {
        turned: None,
        k: 1,
        given: Vec::new(),
    }
}

/// Where nothing does, there is nothing that the pre-pass would hide.
fn on_near_plane(stage: &Stage<'_>) -> Red {
    match stage.facts.near_plane_pixels {
        Some(0) => Red::NotHere {
            why: "nothing lies on the near plane".to_owned(),
        },
        _ => Mutation::Untied(BIASED).red(stage),
    }
}

/// With its guard a resolve of triangles of no area makes numbers; without, what is none. An
/// adapter's own interpolation of the original may make either, and is not asked.
fn divided(stage: &Stage<'_>) -> Red {
    let plans = stage.chosen(AS_GIVEN).plans;
    let guarded = no_numbers(
        stage,
        &preshade_scenes::variant(&plans, ShaderForm::Text).unwrap(),
    );
    assert_eq!(guarded, 0, "pixels are no number with the guard");
    let edits = [(
        "select(edges / vec3(sum), vec3(0.33333334f), sum == 0f)",
        "edges / vec3(sum)",
    )];
    match no_numbers(stage, &edited(AS_GIVEN, &plans, &edits)) {
        0 => Red::Unseen,
        n => Red::Seen {
            how: format!("{n} pixels are no number"),
        },
    }
}

/// Pixels that are no number, in the picture that has most of them.
fn no_numbers(stage: &Stage<'_>, host: &Host) -> usize {
    let pictures = pictures(stage.inputs, host).unwrap();
    let count = |picture: &Rendered| {
        let colors = picture.colors.iter().flatten();
        let of_target = |image: &ColorImage| {
            let pixels = 0..(image.size[0] * image.size[1]) as usize;
            let is_none = |i: &usize| image.rgba(*i).iter().any(|c| !c.is_finite());
            pixels.filter(is_none).count()
        };
        colors.map(of_target).sum()
    };
    pictures.iter().map(count).max().unwrap_or(0)
}
