//! Materials that differ in their interface alone: builtins, interpolation, sampling, resources,
//! targets and state. Every pair of features, and of a feature and a recipe, occurs in some
//! material.
#![allow(dead_code)]

use std::collections::HashSet;

use preshade_compiler::front::{self, Source};
use preshade_compiler::recipe::Recipe;
use preshade_plan::pass::{Facts, Refusal, Use};
use preshade_plan::plan::Plan;
use preshade_plan::state::{Blend, ColorTarget, DepthDirection, DepthFormat, MaterialState};
use preshade_validate::inputs::Random;
use shader_text::error::Color;
use shader_text::options;

use crate::fixtures_support;

/// A feature of a shader.
#[derive(Clone, Copy, Default)]
struct Feature {
    name: &'static str,
    /// `enable` directives.
    enables: &'static str,
    /// Declarations of a module.
    declared: &'static str,
    /// A parameter of the stage that reads it, or a member of what passes between the stages.
    input: &'static str,
    /// Statements of the vertex stage.
    vertex: &'static str,
    /// A float of the stage that reads it.
    value: &'static str,
    /// Whether only wgpu knows it, so that Tint cannot judge it.
    native: bool,
}

const NONE: Feature = Feature {
    name: "none",
    enables: "",
    declared: "",
    input: "",
    vertex: "",
    value: "",
    native: false,
};

/// What a vertex stage reads and writes. `value` is of the vertex stage.
const VERTICES: &[Feature] = &[
    NONE,
    Feature {
        name: "vertex_index",
        input: "@builtin(vertex_index) b: u32",
        value: "f32(b)",
        ..NONE
    },
    Feature {
        name: "instance_index",
        input: "@builtin(instance_index) b: u32",
        value: "f32(b)",
        ..NONE
    },
    Feature {
        name: "draw_index",
        enables: "enable draw_index;",
        input: "@builtin(draw_index) b: u32",
        value: "f32(b)",
        native: true,
        ..NONE
    },
    Feature {
        name: "view_index of a vertex",
        input: "@builtin(view_index) b: u32",
        value: "f32(b)",
        native: true,
        ..NONE
    },
    Feature {
        name: "integer attribute",
        input: "@location(5) b: u32",
        value: "f32(b & 3u)",
        ..NONE
    },
    Feature {
        name: "signed attribute",
        input: "@location(5) b: vec4<i32>",
        value: "f32(b.w)",
        ..NONE
    },
    Feature {
        name: "half attribute",
        enables: "enable f16;",
        input: "@location(5) b: vec2<f16>",
        value: "f32(b.y)",
        ..NONE
    },
    Feature {
        name: "clip_distances",
        enables: "enable clip_distances;",
        vertex: "v.d[0] = p.x; v.d[1] = material.fog;",
        ..NONE
    },
    Feature {
        name: "invariant",
        ..NONE
    },
];

/// What the vertex stage passes to the fragment stage. `value` is of the fragment stage.
const PASSED: &[Feature] = &[
    NONE,
    passed(
        "perspective",
        "@interpolate(perspective) passed: f32",
        "p.x",
        "f.passed",
    ),
    passed(
        "centroid",
        "@interpolate(perspective, centroid) passed: vec3<f32>",
        "p",
        "f.passed.y",
    ),
    passed(
        "sample",
        "@interpolate(perspective, sample) passed: vec2<f32>",
        "p.xy",
        "f.passed.y",
    ),
    passed(
        "linear",
        "@interpolate(linear) passed: vec4<f32>",
        "v.position",
        "f.passed.w",
    ),
    passed(
        "linear centroid",
        "@interpolate(linear, centroid) passed: f32",
        "p.y",
        "f.passed",
    ),
    passed(
        "linear sample",
        "@interpolate(linear, sample) passed: vec2<f32>",
        "p.yz",
        "f.passed.x",
    ),
    passed(
        "flat float",
        "@interpolate(flat) passed: vec2<f32>",
        "p.xy",
        "f.passed.x",
    ),
    passed(
        "flat first",
        "@interpolate(flat, first) passed: u32",
        "material.m",
        "f32(f.passed)",
    ),
    passed(
        "flat either",
        "@interpolate(flat, either) passed: vec2<i32>",
        "vec2<i32>(material.n)",
        "f32(f.passed.y)",
    ),
    Feature {
        enables: "enable f16;",
        ..passed(
            "half",
            "passed: vec2<f16>",
            "vec2<f16>(p.xy)",
            "f32(f.passed.x)",
        )
    },
];

const fn passed(
    name: &'static str,
    input: &'static str,
    vertex: &'static str,
    value: &'static str,
) -> Feature {
    Feature {
        name,
        input,
        vertex,
        value,
        ..NONE
    }
}

/// Builtin inputs of a fragment stage.
const READ: &[Feature] = &[
    NONE,
    Feature {
        name: "position",
        input: "@builtin(position) r: vec4<f32>",
        value: "r.z",
        ..NONE
    },
    Feature {
        name: "front_facing",
        input: "@builtin(front_facing) r: bool",
        value: "select(0.2, 0.7, r)",
        ..NONE
    },
    Feature {
        name: "sample_index",
        input: "@builtin(sample_index) r: u32",
        value: "f32(r)",
        ..NONE
    },
    Feature {
        name: "sample_mask in",
        input: "@builtin(sample_mask) r: u32",
        value: "f32(r)",
        ..NONE
    },
    Feature {
        name: "primitive_index",
        enables: "enable primitive_index;",
        input: "@builtin(primitive_index) r: u32",
        value: "f32(r & 1u)",
        ..NONE
    },
    Feature {
        name: "barycentric",
        input: "@builtin(barycentric) r: vec3<f32>",
        value: "r.y",
        native: true,
        ..NONE
    },
    Feature {
        name: "barycentric_no_perspective",
        input: "@builtin(barycentric_no_perspective) r: vec3<f32>",
        value: "r.y",
        native: true,
        ..NONE
    },
    Feature {
        name: "view_index",
        input: "@builtin(view_index) r: u32",
        value: "f32(r)",
        native: true,
        ..NONE
    },
    // naga takes no `enable subgroups`, which Tint asks for.
    Feature {
        name: "subgroup_size",
        input: "@builtin(subgroup_size) r: u32",
        value: "f32(r)",
        native: true,
        ..NONE
    },
    Feature {
        name: "subgroup_invocation_id",
        input: "@builtin(subgroup_invocation_id) r: u32",
        value: "f32(r)",
        native: true,
        ..NONE
    },
];

/// A texture that is sampled.
macro_rules! sampled {
    ($name:literal, $ty:literal, $at:literal) => {
        Feature {
            name: $name,
            declared: concat!(
                "@group(1) @binding(0) var t: ",
                $ty,
                ";\n@group(1) @binding(1) var s: sampler;"
            ),
            value: concat!("textureSample(t, s, ", $at, ").x"),
            ..NONE
        }
    };
}

/// Resources. `value` is of the fragment stage, `vertex` of the vertex stage.
const RESOURCES: &[Feature] = &[
    NONE,
    Feature {
        name: "two variables at one binding",
        declared: "struct Small { a: vec4<f32> } struct Large { a: mat4x4<f32>, b: f32 }
@group(1) @binding(0) var<uniform> small: Small;
@group(1) @binding(0) var<uniform> large: Large;",
        vertex: "v.position.x += small.a.y;",
        value: "large.b",
        ..NONE
    },
    Feature {
        name: "immediates",
        declared: "var<immediate> now: vec4<f32>;",
        value: "now.z",
        native: true,
        ..NONE
    },
    sampled!("2d", "texture_2d<f32>", "f.uv"),
    sampled!("3d", "texture_3d<f32>", "vec3<f32>(f.uv, 0.5)"),
    sampled!("cube", "texture_cube<f32>", "vec3<f32>(f.uv, 0.5)"),
    sampled!("2d array", "texture_2d_array<f32>", "f.uv, 1"),
    sampled!(
        "cube array",
        "texture_cube_array<f32>",
        "vec3<f32>(f.uv, 0.5), 1"
    ),
    Feature {
        name: "1d",
        declared: "@group(1) @binding(0) var t: texture_1d<f32>;
@group(1) @binding(1) var s: sampler;",
        value: "textureSampleLevel(t, s, f.uv.x, 0.0).x",
        ..NONE
    },
    Feature {
        name: "integers",
        declared: "@group(1) @binding(0) var t: texture_2d<u32>;",
        value: "f32(textureLoad(t, vec2<i32>(f.uv), 0).y)",
        ..NONE
    },
    Feature {
        name: "multisampled",
        declared: "@group(1) @binding(0) var t: texture_multisampled_2d<f32>;",
        value: "textureLoad(t, vec2<i32>(f.uv), 1).x",
        ..NONE
    },
    Feature {
        name: "compared",
        declared: "@group(1) @binding(0) var t: texture_depth_2d;
@group(1) @binding(1) var s: sampler_comparison;",
        value: "textureSampleCompare(t, s, f.uv, 0.5)",
        ..NONE
    },
    Feature {
        name: "compared cube",
        declared: "@group(1) @binding(0) var t: texture_depth_cube;
@group(1) @binding(1) var s: sampler_comparison;",
        value: "textureSampleCompareLevel(t, s, vec3<f32>(f.uv, 0.5), 0.5)",
        ..NONE
    },
    Feature {
        name: "depth texels",
        declared: "@group(1) @binding(0) var t: texture_depth_2d;",
        value: "textureLoad(t, vec2<i32>(f.uv), 0)",
        ..NONE
    },
    Feature {
        name: "multisampled depth",
        declared: "@group(1) @binding(0) var t: texture_depth_multisampled_2d;",
        value: "textureLoad(t, vec2<i32>(f.uv), 1)",
        ..NONE
    },
    Feature {
        name: "storage",
        declared: "@group(1) @binding(0) var<storage, read> t: array<vec4<f32>>;",
        vertex: "v.position.x += t[1].y;",
        value: "t[u32(material.n)].x",
        ..NONE
    },
    Feature {
        name: "written storage",
        declared: "@group(1) @binding(0) var<storage, read_write> t: array<atomic<u32>>;",
        value: "f32(atomicAdd(&t[1], 1u))",
        ..NONE
    },
    Feature {
        name: "storage texture",
        declared: "@group(1) @binding(0) var t: texture_storage_2d<r32float, read>;",
        value: "textureLoad(t, vec2<i32>(f.uv)).x",
        ..NONE
    },
    Feature {
        name: "halves",
        enables: "enable f16;",
        declared: "struct Halves { a: vec3<f16>, b: f16 }
@group(1) @binding(0) var<uniform> t: Halves;",
        vertex: "v.position.x += f32(t.a.y);",
        value: "f32(t.b)",
        ..NONE
    },
];

/// What the fragment stage writes, and the attribute before it.
const WRITTEN: &[(&str, &str, &str, &str)] = &[
    ("colour", "", "@location(0) c: vec4<f32>", "vec4<f32>(x)"),
    (
        "integers",
        "",
        "@location(0) c: vec4<f32>, @location(1) i: vec4<u32>",
        "vec4<f32>(x), vec4<u32>(u32(x))",
    ),
    (
        "a gap",
        "",
        "@location(0) c: vec4<f32>, @location(2) g: vec2<f32>",
        "vec4<f32>(x), f.uv",
    ),
    ("no colour", "", "", ""),
    (
        "depth",
        "",
        "@location(0) c: vec4<f32>, @builtin(frag_depth) d: f32",
        "vec4<f32>(x), x",
    ),
    ("depth alone", "", "@builtin(frag_depth) d: f32", "x"),
    (
        "less depth",
        "@early_depth_test(less_equal) ",
        "@location(0) c: vec4<f32>, @builtin(frag_depth) d: f32",
        "vec4<f32>(x), x",
    ),
    (
        "greater depth",
        "@early_depth_test(greater_equal) ",
        "@location(0) c: vec4<f32>, @builtin(frag_depth) d: f32",
        "vec4<f32>(x), x",
    ),
    (
        "early",
        "@early_depth_test(force) ",
        "@location(0) c: vec4<f32>",
        "vec4<f32>(x)",
    ),
    (
        "sample_mask",
        "",
        "@location(0) c: vec4<f32>, @builtin(sample_mask) m: u32",
        "vec4<f32>(x), u32(x)",
    ),
    (
        "dual source",
        "",
        "@location(0) @blend_src(0) c: vec4<f32>, @location(0) @blend_src(1) d: vec4<f32>",
        "vec4<f32>(x), vec4<f32>(x)",
    ),
];

/// What decides whether the fragment stage discards.
const DISCARDS: &[&str] = &["nothing", "uv", "passed", "read", "bound"];

const FORMATS: &[DepthFormat] = &[
    DepthFormat::Depth32float,
    DepthFormat::Depth24plus,
    DepthFormat::Depth16unorm,
    DepthFormat::Depth24plusStencil8,
    DepthFormat::Depth32floatStencil8,
];

/// Samples, blending, alpha to coverage, and the direction of the depth.
const STATES: &[(&str, u32, bool, bool, DepthDirection)] = &[
    ("one sample", 1, false, false, DepthDirection::Forward),
    ("four samples", 4, false, false, DepthDirection::Forward),
    ("blended", 1, true, false, DepthDirection::Forward),
    ("blended samples", 4, true, false, DepthDirection::Forward),
    ("coverage", 4, false, true, DepthDirection::Forward),
    (
        "reversed samples",
        4,
        false,
        false,
        DepthDirection::Reversed,
    ),
];

/// One level of each factor.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Interface {
    levels: [usize; FACTORS],
    /// Whether it is there for GLSL ES, which has all of its features.
    pub is_for_es: bool,
}

const FACTORS: usize = 8;
const RECIPE: usize = 7;

/// The recipes of the passes' examples that any material can be asked for.
pub fn recipes() -> Vec<&'static str> {
    let uses = [
        Use::Snapshot,
        Use::Compile,
        Use::Validate,
        Use::Fuzz,
        Use::Keep,
        Use::Break,
    ];
    let mut recipes = vec![""];
    // Those with values of one fixture's hall fit no other.
    for recipe in fixtures_support::recipes(&uses) {
        if !recipes.contains(&recipe) && !recipe.contains("hall.") {
            recipes.push(recipe);
        }
    }
    recipes
}

/// What no GLSL ES 3.00 has: names of levels.
const NOT_ES: &[&str] = &[
    "draw_index",
    "view_index of a vertex",
    "half attribute",
    "clip_distances",
    "sample",
    "linear",
    "linear centroid",
    "linear sample",
    "flat first",
    "half",
    "sample_index",
    "sample_mask in",
    "primitive_index",
    "barycentric",
    "barycentric_no_perspective",
    "view_index",
    "subgroup_size",
    "subgroup_invocation_id",
    "immediates",
    "cube array",
    "1d",
    "multisampled",
    "depth texels",
    "multisampled depth",
    "storage",
    "written storage",
    "storage texture",
    "halves",
    "less depth",
    "greater depth",
    "early",
    "sample_mask",
];

/// Interfaces in which every two levels of two factors meet; so do those that GLSL ES has, in
/// interfaces without the others. `more` are at random.
pub fn interfaces(seed: u64, more: usize) -> Vec<Interface> {
    let named = |features: &[Feature]| features.iter().map(|f| f.name).collect::<Vec<_>>();
    let factors: [Vec<&str>; FACTORS] = [
        named(VERTICES),
        named(PASSED),
        named(READ),
        named(RESOURCES),
        WRITTEN.iter().map(|(name, ..)| *name).collect(),
        DISCARDS.to_vec(),
        vec![""; FORMATS.len() * STATES.len()],
        recipes(),
    ];
    let every = factors.each_ref().map(|names| (0..names.len()).collect());
    let of_es = factors.each_ref().map(|names| {
        let all = 0..names.len();
        all.filter(|i| !NOT_ES.contains(&names[*i])).collect()
    });
    let mut random = Random::new(seed, "interfaces");
    let mut rows = covering(&every, &mut random);
    let of_es = covering(&of_es, &mut random);
    rows.extend((0..more).map(|_| any(&every, &mut random)));
    let made = |rows: Vec<_>, is_for_es| {
        let made = rows.into_iter();
        made.map(move |levels| Interface { levels, is_for_es })
    };
    made(rows, false).chain(made(of_es, true)).collect()
}

/// A level of each factor, at random.
fn any(factors: &[Vec<usize>; FACTORS], random: &mut Random) -> [usize; FACTORS] {
    factors
        .each_ref()
        .map(|levels| levels[random.below(levels.len())])
}

/// Rows in which every two levels of two factors meet. Each row begins with a pair that no earlier
/// row has; of several random rests, it gets the one with most new pairs.
fn covering(factors: &[Vec<usize>; FACTORS], random: &mut Random) -> Vec<[usize; FACTORS]> {
    const TRIED: usize = 24;
    let mut met = HashSet::new();
    let mut rows = Vec::new();
    for [a, b] in pairs(&std::array::from_fn(|factor| factor)) {
        let [a, b] = [a[0], b[0]];
        for i in &factors[a] {
            for j in &factors[b] {
                if met.contains(&[[a, *i], [b, *j]]) {
                    continue;
                }
                let tried = (0..TRIED).map(|_| {
                    let mut row = any(factors, random);
                    (row[a], row[b]) = (*i, *j);
                    (pairs(&row).filter(|pair| !met.contains(pair)).count(), row)
                });
                let (_, row) = tried.max_by_key(|(new, _)| *new).unwrap_or_default();
                met.extend(pairs(&row));
                rows.push(row);
            }
        }
    }
    rows
}

/// Every two factors of a row, with their levels.
fn pairs(row: &[usize; FACTORS]) -> impl Iterator<Item = [[usize; 2]; 2]> + '_ {
    (0..FACTORS).flat_map(move |a| (a + 1..FACTORS).map(move |b| [[a, row[a]], [b, row[b]]]))
}

impl Interface {
    fn features(&self) -> [Feature; 4] {
        let [vertex, passed, read, resource, ..] = self.levels;
        [
            VERTICES[vertex],
            PASSED[passed],
            READ[read],
            RESOURCES[resource],
        ]
    }

    fn state_levels(&self) -> (DepthFormat, (&'static str, u32, bool, bool, DepthDirection)) {
        let level = self.levels[6];
        (
            FORMATS[level % FORMATS.len()],
            STATES[level / FORMATS.len()],
        )
    }

    /// The names of its levels.
    pub fn names(&self) -> Vec<String> {
        let (format, (state, ..)) = self.state_levels();
        let mut names: Vec<String> = self.features().iter().map(|f| f.name.to_owned()).collect();
        names.push(format!("writes {}", WRITTEN[self.levels[4]].0));
        names.push(format!("discards by {}", DISCARDS[self.levels[5]]));
        names.push(format!("{format:?}"));
        names.push(state.to_owned());
        names.push(self.recipe().to_owned());
        names
    }

    /// The recipe; empty for the original.
    pub fn recipe(&self) -> &'static str {
        recipes()[self.levels[RECIPE]]
    }

    /// Whether only wgpu knows its text, or some of its state.
    pub fn is_native(&self) -> bool {
        let early = WRITTEN[self.levels[4]].1;
        self.features().iter().any(|f| f.native) || !early.is_empty()
    }

    /// Its text.
    pub fn text(&self) -> String {
        let [vertex, passed, read, resource] = self.features();
        let (_, attribute, members, results) = WRITTEN[self.levels[4]];
        let mut enables: Vec<&str> = [vertex, passed, read, resource]
            .iter()
            .map(|f| f.enables)
            .chain(
                members
                    .contains("blend_src")
                    .then_some("enable dual_source_blending;"),
            )
            .filter(|e| !e.is_empty())
            .collect();
        enables.sort_unstable();
        enables.dedup();
        let clip = match vertex.name {
            "clip_distances" => "@builtin(clip_distances) d: array<f32, 2>, ",
            _ => "",
        };
        let invariant = match vertex.name {
            "invariant" => "@invariant ",
            _ => "",
        };
        let member = |m: &str| match m {
            "" => String::new(),
            m => format!(", @location(1) {m}"),
        };
        let parameter = |p: &str| match p {
            "" => String::new(),
            p => format!(", {p}"),
        };
        let statement = |name: &str, value: &str| match value {
            "" => format!("    let {name} = 0.25;\n"),
            value => format!("    let {name} = {value};\n"),
        };
        let assigned = match passed.vertex {
            "" => String::new(),
            value => format!("    v.passed = {value};\n"),
        };
        let moved = match vertex.value {
            "" => String::new(),
            value => format!("    v.position.y += {value};\n"),
        };
        let discard = match DISCARDS[self.levels[5]] {
            "nothing" => String::new(),
            "uv" => "    if f.uv.x < material.fog { discard; }\n".to_owned(),
            other => format!("    if {other} < material.fog {{ discard; }}\n"),
        };
        let fragment = match members {
            "" => format!("{attribute}fn fs(f: F{}) {{\n", parameter(read.input)),
            _ => format!("{attribute}fn fs(f: F{}) -> O {{\n", parameter(read.input)),
        };
        let (outputs, end) = match members {
            "" => (String::new(), String::new()),
            _ => (
                format!("struct O {{ {members} }}\n"),
                format!("    return O({results});\n"),
            ),
        };
        [
            enables.join("\n"),
            "\nstruct Material { mvp: mat4x4<f32>, fog: f32, b: f32, n: i32, m: u32 }\n".to_owned(),
            "@group(0) @binding(0) var<uniform> material: Material;\n".to_owned(),
            format!("{}\n", resource.declared),
            format!(
                "struct V {{ {invariant}@builtin(position) position: vec4<f32>, {clip}\
                 @location(0) uv: vec2<f32>{} }}\n",
                member(passed.input)
            ),
            format!(
                "struct F {{ @location(0) uv: vec2<f32>{} }}\n",
                member(passed.input)
            ),
            outputs,
            format!(
                "@vertex fn vs(@location(0) p: vec3<f32>, @location(1) uv: vec2<f32>{}) -> V {{\n",
                parameter(vertex.input)
            ),
            "    var v: V;\n    v.position = material.mvp * vec4<f32>(p, 1.0);\n".to_owned(),
            "    v.uv = uv;\n".to_owned(),
            format!("    {}\n    {}\n", vertex.vertex, resource.vertex),
            moved,
            assigned,
            "    return v;\n}\n@fragment ".to_owned(),
            fragment,
            statement("bound", resource.value),
            statement("passed", passed.value),
            statement("read", read.value),
            "    let x = fract(sin(f.uv.y * material.b) * 3.0 + passed * read + bound);\n"
                .to_owned(),
            discard,
            end,
            "}\n".to_owned(),
        ]
        .concat()
    }

    /// Its pipeline state.
    pub fn state(&self) -> MaterialState {
        let (format, (_, samples, blended, to_coverage, direction)) = self.state_levels();
        let (name, _, members, _) = WRITTEN[self.levels[4]];
        let mut color = ColorTarget::opaque("rgba8unorm");
        color.blend = blended.then_some(Blend::ALPHA);
        let has_color = members.contains("@location(0)");
        let mut targets = vec![has_color.then_some(color)];
        match name {
            "integers" => targets.push(Some(ColorTarget::opaque("rgba8uint"))),
            "a gap" => targets.extend([None, Some(ColorTarget::opaque("rg16float"))]),
            _ => {}
        }
        targets.truncate(if has_color { 3 } else { 0 });
        let mut state = MaterialState {
            depth_format: format,
            depth_direction: direction,
            targets,
            ..MaterialState::default()
        };
        state.multisample.count = samples;
        // WebGPU has one of the two masks, and takes the alpha of the first target.
        state.multisample.alpha_to_coverage = to_coverage && has_color && name != "sample_mask";
        state
    }

    /// The material as its author wrote it.
    pub fn parsed(&self) -> front::Parsed {
        let source = Source::new("material.wgsl", self.text());
        front::parse(&[source], &options::Options::default())
            .unwrap_or_else(|e| panic!("{}\n{}", e.render(Color::Never), self.text()))
    }

    /// Its plan.
    pub fn original(&self) -> Plan {
        let parsed = self.parsed();
        let (vertex, fragment) = (&parsed.vertex, parsed.fragment.as_deref());
        Plan::original("m", parsed.program, vertex, fragment, &self.state())
    }
}

/// The plan that a recipe makes, where no tie was measured; the original for an empty one.
///
/// # Errors
/// The recipe's refusal.
pub fn varied(recipe: &str, original: &Plan) -> Result<Plan, Box<Refusal>> {
    if recipe.is_empty() {
        return Ok(original.clone());
    }
    let recipe = Recipe::parse_list(recipe).unwrap();
    recipe.apply(original, &Facts::without_ties())
}

/// Features of a fragment stage of GLSL ES 1.00: a declaration of it, and a float.
const ES_100: [&[[&str; 2]]; 3] = [
    &[
        ["", "0.25"],
        ["varying float passed;", "passed"],
        ["varying vec3 passed;", "passed.y"],
        ["varying mat2 passed;", "passed[1].x"],
        ["varying vec4 passed[2];", "passed[1].w"],
    ],
    &[
        ["", "0.25"],
        ["", "gl_FragCoord.z"],
        ["", "(gl_FrontFacing ? 0.2 : 0.7)"],
        [
            "#extension GL_OES_standard_derivatives : enable",
            "dFdx(at.x)",
        ],
    ],
    &[
        ["", "0.25"],
        ["uniform sampler2D bound;", "texture2D(bound, at).x"],
        [
            "uniform samplerCube bound;",
            "textureCube(bound, vec3(at, 0.5)).x",
        ],
        ["uniform sampler2D bound[2];", "texture2D(bound[1], at).x"],
        ["uniform int bound;", "float(bound)"],
        ["uniform bool bound;", "(bound ? 0.1 : 0.6)"],
        ["uniform float bound[3];", "bound[2]"],
        ["uniform mat3 bound;", "bound[1].y"],
        [
            "struct Bound { vec3 a; float b; }; uniform Bound bound;",
            "bound.b",
        ],
    ],
];

/// A material of GLSL ES 1.00.
#[derive(Clone, Debug)]
pub struct Es100 {
    /// Its vertex and its fragment stage.
    pub texts: [String; 2],
    /// The recipe; empty for the original.
    pub recipe: &'static str,
}

/// Materials of GLSL ES 1.00 in which every two levels of two factors meet.
pub fn of_es_100(seed: u64) -> Vec<Es100> {
    let count = |n: usize| (0..n).collect::<Vec<_>>();
    let one = || count(1);
    let [passed, read, bound] = ES_100.map(|levels| count(levels.len()));
    let discards = count(DISCARDS.len());
    let factors = [
        passed,
        read,
        bound,
        discards,
        count(2),
        one(),
        one(),
        count(recipes().len()),
    ];
    let rows = covering(&factors, &mut Random::new(seed, "es 100"));
    rows.into_iter().map(es_100).collect()
}

fn es_100([passed, read, bound, discard, writes_depth, _, _, recipe]: [usize; FACTORS]) -> Es100 {
    let [passed, read, bound] = [ES_100[0][passed], ES_100[1][read], ES_100[2][bound]];
    let assigned = match passed[0] {
        "" => "",
        "varying float passed;" => "passed = position.x;",
        "varying vec3 passed;" => "passed = position;",
        "varying mat2 passed;" => "passed = mat2(position, 1.0);",
        _ => "passed[0] = vec4(uv, uv); passed[1] = vec4(position, 1.0);",
    };
    let extension = |line: &'static str| if line.starts_with('#') { line } else { "" };
    let (depth_extension, depth) = match writes_depth {
        0 => ("", ""),
        _ => (
            "#extension GL_EXT_frag_depth : enable",
            "gl_FragDepthEXT = x;",
        ),
    };
    let discard = match DISCARDS[discard] {
        "nothing" => String::new(),
        "uv" => "if (at.x < fog) discard;".to_owned(),
        other => format!("if ({other}_value < fog) discard;"),
    };
    let vertex = format!(
        "attribute vec3 position;\nattribute vec2 uv;\nuniform mat4 mvp;\nvarying vec2 at;\n{}\n\
         void main() {{\n    at = uv;\n    {assigned}\n    gl_Position = mvp * vec4(position, 1.0);\n}}\n",
        passed[0]
    );
    let fragment = format!(
        "{}\n{depth_extension}\nprecision highp float;\nuniform float fog;\nvarying vec2 at;\n{}\n{}\n\
         void main() {{\n    float passed_value = {};\n    float read_value = {};\n    \
         float bound_value = {};\n    \
         float x = fract(sin(at.y * fog) * 3.0 + passed_value * read_value + bound_value);\n    \
         {discard}\n    gl_FragColor = vec4(x);\n    {depth}\n}}\n",
        extension(read[0]),
        passed[0],
        bound[0],
        passed[1],
        read[1],
        bound[1]
    );
    Es100 {
        texts: [vertex, fragment],
        recipe: recipes()[recipe],
    }
}
