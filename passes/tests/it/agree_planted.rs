//! Faults planted into hand-written depth and shadow passes: how many `agree` finds, by class.
//! `UPDATE_PAGES=1` writes the table of `docs/agree.md`.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::sync::Arc;

use naga::front::wgsl;
use preshade_plan::plan::Plan;
use preshade_plan::program::Program;
use preshade_plan::state::MaterialState;
use preshade_validate::Effort;
use preshade_validate::agree::{Class, Relation, agree};
use shader_text::source::{Language, SourceMap};

/// The declarations of the main passes.
const MAIN: &str = "
struct Camera { view_proj: mat4x4f, eye: vec4f, time: f32 }
struct Material { tint: vec4f, uv_scale: vec2f, uv_offset: vec2f, turn: mat3x3f, opacity: f32, cutoff: f32 }
struct In { @location(0) position: vec3f, @location(1) normal: vec3f, @location(2) uv: vec2f,
    @location(3) color: vec4f, @location(4) weights: vec2f, @location(5) offset: vec3f }
struct V { @builtin(position) position: vec4f, @location(0) uv: vec2f, @location(1) color: vec4f,
    @location(2) world: vec3f, @location(3) normal: vec3f }
@group(0) @binding(0) var<uniform> camera: Camera;
@group(1) @binding(0) var<uniform> model: mat4x4f;
@group(1) @binding(1) var<uniform> bones: array<mat4x4f, 2>;
@group(2) @binding(0) var<uniform> material: Material;
@group(2) @binding(1) var albedo: texture_2d<f32>;
@group(2) @binding(2) var linear_sampler: sampler;
@group(2) @binding(3) var mask: texture_2d<f32>;
";

/// Those of the second passes, by another hand: numbers, structs and order are its own.
const OTHER: &str = "
struct Light { view_proj: mat4x4f, time: f32 }
struct Surface { cutoff: f32, opacity: f32, uv_scale: vec2f, uv_offset: vec2f, tint: vec4f, turn: mat3x3f }
struct Vertex { @location(0) position: vec3f, @location(1) uv: vec2f, @location(2) color: vec4f,
    @location(3) weights: vec2f, @location(4) offset: vec3f }
struct Out { @builtin(position) clip: vec4f, @location(0) uv: vec2f, @location(1) alpha: f32, @location(2) world: vec3f }
@group(0) @binding(0) var<uniform> light: Light;
@group(0) @binding(1) var<uniform> model: mat4x4f;
@group(0) @binding(2) var<uniform> bones: array<mat4x4f, 2>;
@group(1) @binding(0) var mask: texture_2d<f32>;
@group(1) @binding(1) var albedo: texture_2d<f32>;
@group(1) @binding(2) var linear_sampler: sampler;
@group(1) @binding(3) var<uniform> material: Surface;
";

struct Pair {
    name: &'static str,
    /// World position and texture coordinates, in terms of `v`, in the two programs.
    vertex: [&'static str; 2],
    /// The test of a discard, in terms of `in`.
    fragment: [&'static str; 2],
}

const PAIRS: [Pair; 20] = [
    Pair {
        name: "leaf",
        vertex: [
            "let local = v.position; let uv = v.uv * material.uv_scale;",
            "let local = v.position; let uv = v.uv * material.uv_scale;",
        ],
        fragment: [
            "let alpha = textureSample(albedo, linear_sampler, in.uv).a * material.tint.a; let cut = alpha < 0.5;",
            "let a = textureSample(albedo, linear_sampler, in.uv).a * material.tint.a; let cut = a < 0.5;",
        ],
    },
    Pair {
        name: "fence",
        vertex: [
            "let local = v.position; let uv = v.uv * material.uv_scale + material.uv_offset;",
            "let local = v.position; let uv = v.uv * material.uv_scale + material.uv_offset;",
        ],
        fragment: [
            "let color = textureSample(albedo, linear_sampler, in.uv); let cut = color.a * material.opacity < material.cutoff;",
            "let cut = textureSample(albedo, linear_sampler, in.uv).a * material.opacity < material.cutoff;",
        ],
    },
    Pair {
        name: "vertex alpha",
        vertex: [
            "let local = v.position; let uv = v.uv;",
            "let local = v.position; let uv = v.uv;",
        ],
        fragment: [
            "let cut = textureSample(albedo, linear_sampler, in.uv).a * in.color.a < 0.4;",
            "let cut = textureSample(albedo, linear_sampler, in.uv).a * in.alpha < 0.4;",
        ],
    },
    Pair {
        name: "turned coordinates",
        vertex: [
            "let local = v.position; let uv = (material.turn * vec3f(v.uv, 1.0)).xy;",
            "let local = v.position; let uv = (material.turn * vec3f(v.uv, 1.0)).xy;",
        ],
        fragment: [
            "let cut = textureSample(albedo, linear_sampler, in.uv).a < 0.3;",
            "let cut = textureSample(albedo, linear_sampler, in.uv).a < 0.3;",
        ],
    },
    Pair {
        name: "two masks",
        vertex: [
            "let local = v.position; let uv = v.uv * 2.0;",
            "let local = v.position; let uv = v.uv * 2.0;",
        ],
        fragment: [
            "let alpha = textureSample(albedo, linear_sampler, in.uv).a * textureSample(mask, linear_sampler, in.uv * 0.5).r; let cut = alpha < 0.25;",
            "let cut = textureSample(albedo, linear_sampler, in.uv).a * textureSample(mask, linear_sampler, in.uv * 0.5).r < 0.25;",
        ],
    },
    Pair {
        name: "mask in green",
        vertex: [
            "let local = v.position; let uv = v.uv;",
            "let local = v.position; let uv = v.uv;",
        ],
        fragment: [
            "let cut = textureSample(mask, linear_sampler, in.uv * material.uv_scale).g < 0.6;",
            "let cut = textureSample(mask, linear_sampler, in.uv * material.uv_scale).g < 0.6;",
        ],
    },
    Pair {
        name: "own derivatives",
        vertex: [
            "let local = v.position; let uv = v.uv * material.uv_scale;",
            "let local = v.position; let uv = v.uv * material.uv_scale;",
        ],
        fragment: [
            "let cut = textureSampleGrad(albedo, linear_sampler, fract(in.uv), dpdx(in.uv), dpdy(in.uv)).a * material.opacity < 0.5;",
            "let x = dpdx(in.uv); let y = dpdy(in.uv); let cut = textureSampleGrad(albedo, linear_sampler, fract(in.uv), x, y).a * material.opacity < 0.5;",
        ],
    },
    Pair {
        name: "sharper leaves",
        vertex: [
            "let local = v.position; let uv = v.uv;",
            "let local = v.position; let uv = v.uv;",
        ],
        fragment: [
            "let cut = textureSampleBias(albedo, linear_sampler, in.uv, -1.0).a * material.tint.a < 0.5;",
            "let cut = textureSampleBias(albedo, linear_sampler, in.uv, -1.0).a * material.tint.a < 0.5;",
        ],
    },
    Pair {
        name: "smooth edge",
        vertex: [
            "let local = v.position; let uv = v.uv;",
            "let local = v.position; let uv = v.uv;",
        ],
        fragment: [
            "let d = textureSample(mask, linear_sampler, in.uv).r; let cut = smoothstep(0.4, 0.6, d + fwidth(in.uv.x)) * material.opacity < 0.5;",
            "let near = textureSample(mask, linear_sampler, in.uv).r + fwidth(in.uv.x); let cut = smoothstep(0.4, 0.6, near) * material.opacity < 0.5;",
        ],
    },
    Pair {
        name: "swaying grass",
        vertex: [
            "let local = v.position + vec3f(sin(camera.time + v.position.y) * 0.2, 0.0, 0.0); let uv = v.uv;",
            "let local = v.position + vec3f(sin(light.time + v.position.y) * 0.2, 0.0, 0.0); let uv = v.uv;",
        ],
        fragment: [
            "let cut = textureSample(albedo, linear_sampler, in.uv).a < 0.35;",
            "let cut = textureSample(albedo, linear_sampler, in.uv).a < 0.35;",
        ],
    },
    Pair {
        name: "skin",
        vertex: [
            "let local = (bones[0] * vec4f(v.position, 1.0) * v.weights.x + bones[1] * vec4f(v.position, 1.0) * v.weights.y).xyz; let uv = v.uv;",
            "let p = vec4f(v.position, 1.0); let local = (bones[0] * p * v.weights.x + bones[1] * p * v.weights.y).xyz; let uv = v.uv;",
        ],
        fragment: [
            "let cut = textureSample(albedo, linear_sampler, in.uv).a * material.tint.a < material.cutoff;",
            "let cut = textureSample(albedo, linear_sampler, in.uv).a * material.tint.a < material.cutoff;",
        ],
    },
    Pair {
        name: "instances",
        vertex: [
            "let local = v.position * 0.5 + v.offset; let uv = v.uv * material.uv_scale;",
            "let local = v.position * 0.5 + v.offset; let uv = v.uv * material.uv_scale;",
        ],
        fragment: [
            "let cut = textureSample(albedo, linear_sampler, in.uv.yx).a < 0.45;",
            "let cut = textureSample(albedo, linear_sampler, in.uv.yx).a < 0.45;",
        ],
    },
    Pair {
        name: "waves",
        vertex: [
            "let local = v.position + v.offset * (cos(v.position.x * 3.0 + camera.time) * 0.1); let uv = v.uv;",
            "let local = v.position + v.offset * (cos(v.position.x * 3.0 + light.time) * 0.1); let uv = v.uv;",
        ],
        fragment: [
            "let cut = textureSample(mask, linear_sampler, in.uv * 4.0).b * material.opacity < 0.2;",
            "let cut = textureSample(mask, linear_sampler, in.uv * 4.0).b * material.opacity < 0.2;",
        ],
    },
    Pair {
        name: "height fade",
        vertex: [
            "let local = v.position; let uv = v.uv;",
            "let local = v.position; let uv = v.uv;",
        ],
        fragment: [
            "let fade = saturate(in.world.y * 0.1 + 0.5); let cut = textureSample(albedo, linear_sampler, in.uv).a * fade < 0.3;",
            "let fade = saturate(in.world.y * 0.1 + 0.5); let cut = textureSample(albedo, linear_sampler, in.uv).a * fade < 0.3;",
        ],
    },
    Pair {
        name: "dissolve",
        vertex: [
            "let local = v.position; let uv = v.uv;",
            "let local = v.position; let uv = v.uv;",
        ],
        fragment: [
            "let noise = textureSample(mask, linear_sampler, in.world.xz * 0.3).r; let cut = noise + material.opacity * 0.25 < 0.7;",
            "let cut = textureSample(mask, linear_sampler, in.world.xz * 0.3).r + material.opacity * 0.25 < 0.7;",
        ],
    },
    Pair {
        name: "scrolling smoke",
        vertex: [
            "let local = v.position; let uv = v.uv + material.uv_offset * camera.time;",
            "let local = v.position; let uv = v.uv + material.uv_offset * light.time;",
        ],
        fragment: [
            "let cut = textureSample(albedo, linear_sampler, in.uv).a * textureSample(mask, linear_sampler, in.uv * 2.0).r * in.color.a < 0.15;",
            "let cut = textureSample(albedo, linear_sampler, in.uv).a * textureSample(mask, linear_sampler, in.uv * 2.0).r * in.alpha < 0.15;",
        ],
    },
    Pair {
        name: "brick gaps",
        vertex: [
            "let local = v.position; let uv = v.uv * material.uv_scale * 4.0;",
            "let local = v.position; let uv = v.uv * material.uv_scale * 4.0;",
        ],
        fragment: [
            "let gap = abs(fract(in.uv) - vec2f(0.5)); let cut = max(gap.x, gap.y) * material.opacity > 0.45;",
            "let gap = abs(fract(in.uv) - vec2f(0.5)); let cut = max(gap.x, gap.y) * material.opacity > 0.45;",
        ],
    },
    Pair {
        name: "inflated hull",
        vertex: [
            "let local = v.position * (1.0 + material.opacity * 0.1); let uv = v.uv;",
            "let local = v.position * (1.0 + material.opacity * 0.1); let uv = v.uv;",
        ],
        fragment: [
            "let cut = dot(textureSample(albedo, linear_sampler, in.uv).rgb, vec3f(0.2, 0.7, 0.1)) < 0.4;",
            "let cut = dot(textureSample(albedo, linear_sampler, in.uv).rgb, vec3f(0.2, 0.7, 0.1)) < 0.4;",
        ],
    },
    Pair {
        name: "decal",
        vertex: [
            "let local = v.position; let uv = v.position.xz * material.uv_scale + material.uv_offset;",
            "let local = v.position; let uv = v.position.xz * material.uv_scale + material.uv_offset;",
        ],
        fragment: [
            "let tap = textureSample(albedo, linear_sampler, in.uv); let cut = mix(tap.a, tap.r, 0.3) < 0.5;",
            "let tap = textureSample(albedo, linear_sampler, in.uv); let cut = mix(tap.a, tap.r, 0.3) < 0.5;",
        ],
    },
    Pair {
        name: "level by hand",
        vertex: [
            "let local = v.position; let uv = v.uv * material.uv_scale;",
            "let local = v.position; let uv = v.uv * material.uv_scale;",
        ],
        fragment: [
            "let cut = textureSampleLevel(albedo, linear_sampler, in.uv, material.opacity * 2.0).a * material.tint.a < 0.5;",
            "let cut = textureSampleLevel(albedo, linear_sampler, in.uv, material.opacity * 2.0).a * material.tint.a < 0.5;",
        ],
    },
];

impl Pair {
    fn main(&self) -> String {
        format!(
            "{MAIN}
@vertex fn vs(v: In) -> V {{
    {}
    let world = model * vec4f(local, 1.0);
    return V(camera.view_proj * world, uv, v.color, world.xyz, v.normal);
}}
@fragment fn fs(in: V) -> @location(0) vec4f {{
    {}
    if cut {{ discard; }}
    let shade = max(dot(normalize(in.normal), vec3f(0.0, 1.0, 0.0)), 0.1);
    return vec4f(textureSample(albedo, linear_sampler, in.uv).rgb * shade, 1.0);
}}",
            self.vertex[0], self.fragment[0]
        )
    }

    fn other(&self) -> String {
        format!(
            "{OTHER}
@vertex fn vs(v: Vertex) -> Out {{
    {}
    let world = model * vec4f(local, 1.0);
    return Out(light.view_proj * world, uv, v.color.a, world.xyz);
}}
@fragment fn fs(in: Out) {{
    {}
    if cut {{ discard; }}
}}",
            self.vertex[1], self.fragment[1]
        )
    }
}

/// Faults by kind: a text and what somebody writes instead.
const FAULTS: [(&str, &[(&str, &str)]); 7] = [
    (
        "threshold",
        &[
            ("< 0.5;", "< 0.45;"),
            ("< 0.5;", "< 0.6;"),
            ("< 0.4;", "< 0.5;"),
            ("< 0.4;", "< 0.35;"),
            ("< 0.3;", "< 0.2;"),
            ("< 0.3;", "< 0.35;"),
            ("< 0.25;", "< 0.1;"),
            ("< 0.25;", "< 0.3;"),
            ("< 0.6;", "< 0.5;"),
            ("< 0.35;", "< 0.5;"),
            ("< 0.45;", "< 0.5;"),
            ("< 0.2;", "< 0.1;"),
            ("< 0.7;", "< 0.8;"),
            ("< 0.15;", "< 0.5;"),
            ("> 0.45;", "> 0.4;"),
            ("< material.cutoff;", "< 0.5;"),
            ("< material.cutoff;", "< material.cutoff * 0.9;"),
            ("< material.cutoff;", "< 0.01;"),
            ("< 0.5;", "< material.cutoff;"),
            ("0.4, 0.6,", "0.45, 0.55,"),
            ("if cut", "if !cut"),
        ],
    ),
    (
        "coordinates",
        &[
            (", in.uv)", ", in.uv * 2.0)"),
            (", in.uv)", ", in.uv + vec2f(0.01, 0.0))"),
            (", in.uv)", ", vec2f(in.uv.x, 1.0 - in.uv.y))"),
            (" * material.uv_scale", ""),
            (" + material.uv_offset", ""),
            ("v.uv * material.uv_scale", "v.uv / material.uv_scale"),
            ("in.uv * 0.5", "in.uv"),
            ("in.uv * 2.0", "in.uv"),
            ("in.uv * 4.0", "in.uv * 3.9"),
            ("in.world.xz", "in.uv"),
            ("v.position.xz", "v.uv"),
            ("(material.turn * vec3f(v.uv, 1.0)).xy", "v.uv"),
            ("vec3f(v.uv, 1.0)", "vec3f(v.uv, 0.0)"),
            ("fract(in.uv)", "in.uv"),
            ("let uv = v.uv;", "let uv = v.uv * 0.99;"),
            ("* light.time", ""),
            ("v.uv * 2.0", "v.uv"),
        ],
    ),
    (
        "swizzle",
        &[
            (").a", ").r"),
            (").a", ").g"),
            (").r", ").a"),
            (").r", ").g"),
            (").g", ").r"),
            (").b", ").a"),
            ("in.uv.yx", "in.uv"),
            (", in.uv)", ", in.uv.yx)"),
            ("in.uv.x", "in.uv.y"),
            (".xz *", ".zx *"),
            (".xz *", ".xy *"),
            ("in.world.y", "in.world.x"),
            ("tap.a, tap.r", "tap.r, tap.a"),
            ("material.tint.a", "material.tint.r"),
            (").xy", ").yx"),
            ("v.color.a", "v.color.r"),
            (".rgb", ".bgr"),
            ("v.weights.x", "v.weights.y"),
        ],
    ),
    (
        "missing factor",
        &[
            (" * material.tint.a", ""),
            (" * material.opacity", ""),
            (" * in.alpha", ""),
            (" * fade", ""),
            (" * 0.25", ""),
            (" * textureSample(mask, linear_sampler, in.uv * 0.5).r", ""),
            (" * textureSample(mask, linear_sampler, in.uv * 2.0).r", ""),
            (" + fwidth(in.uv.x)", ""),
            (" * v.weights.y", ""),
            (" * v.weights.x", ""),
            (" * 0.2,", ","),
            (" * 0.1)", ")"),
            (" * 0.5 +", " +"),
            (" * 4.0", ""),
            (" + 0.5", ""),
        ],
    ),
    (
        "bias",
        &[
            (
                "textureSample(albedo, linear_sampler, in.uv)",
                "textureSampleBias(albedo, linear_sampler, in.uv, -1.0)",
            ),
            (
                "textureSample(albedo, linear_sampler, in.uv)",
                "textureSampleBias(albedo, linear_sampler, in.uv, 0.5)",
            ),
            (
                "textureSample(albedo, linear_sampler, in.uv)",
                "textureSampleLevel(albedo, linear_sampler, in.uv, 0.0)",
            ),
            (
                "textureSample(mask, linear_sampler, in.uv)",
                "textureSampleBias(mask, linear_sampler, in.uv, -1.0)",
            ),
            (", -1.0)", ", 0.0)"),
            (
                "textureSampleBias(albedo, linear_sampler, in.uv, -1.0)",
                "textureSample(albedo, linear_sampler, in.uv)",
            ),
            ("material.opacity * 2.0)", "0.0)"),
            ("material.opacity * 2.0)", "material.opacity)"),
        ],
    ),
    (
        "derivative",
        &[
            ("dpdy(in.uv)", "dpdx(in.uv)"),
            ("dpdx(in.uv)", "dpdy(in.uv)"),
            (", x, y)", ", y, x)"),
            ("dpdx(in.uv)", "dpdx(in.uv) * 2.0"),
            (", x, y)", ", x, vec2f(0.0))"),
            ("fwidth(in.uv.x)", "dpdx(in.uv.x)"),
            ("fwidth(in.uv.x)", "fwidth(in.uv.y)"),
            ("fwidth(in.uv.x)", "2.0 * fwidth(in.uv.x)"),
        ],
    ),
    (
        "transform",
        &[
            ("light.view_proj * world", "world"),
            ("model * vec4f(local, 1.0)", "vec4f(local, 1.0)"),
            ("vec4f(local, 1.0)", "vec4f(local, 0.0)"),
            ("model * vec4f(local, 1.0)", "vec4f(local, 1.0) * model"),
            ("vec4f(local, 1.0)", "vec4f(v.position, 1.0)"),
            ("let world = model", "let world = light.view_proj"),
            ("light.time + ", ""),
            (" + v.offset", ""),
            ("bones[1]", "bones[0]"),
            ("local, 1.0", "local.xzy, 1.0"),
            ("* 3.0 + light.time", "* 2.0 + light.time"),
        ],
    ),
];

/// A planted fault.
struct Fault {
    kind: &'static str,
    from: &'static str,
    to: &'static str,
    /// Where it is in the text without faults.
    at: usize,
    /// The text with it.
    text: String,
}

impl Pair {
    /// Each occurrence of each fault in the second pass, a fault of each kind in turn. Their bindings
    /// are right.
    fn faults(&self) -> Vec<Fault> {
        let text = self.other();
        let start = text.find("@vertex").unwrap();
        let mut by_kind: Vec<Vec<Fault>> = Vec::new();
        for (kind, faults) in FAULTS {
            let mut own: Vec<Fault> = Vec::new();
            for (from, to) in faults {
                for (at, _) in text.match_indices(from).filter(|(at, _)| *at > start) {
                    let text = format!("{}{to}{}", &text[..at], &text[at + from.len()..]);
                    let mut known = by_kind.iter().flatten().chain(&own);
                    let is_known = known.any(|f| f.text == text);
                    if !is_known && wgsl::parse_str(&text).is_ok() {
                        own.push(Fault {
                            kind,
                            from,
                            to,
                            at,
                            text,
                        });
                    }
                }
            }
            own.reverse();
            by_kind.push(own);
        }
        let mut all = Vec::new();
        while by_kind.iter().any(|kind| !kind.is_empty()) {
            all.extend(by_kind.iter_mut().filter_map(Vec::pop));
        }
        all
    }

    /// Why a fault changes no pixel, if the text shows it.
    fn harmless(&self, fault: &Fault) -> Option<&'static str> {
        let text = self.other();
        let [_, vertex] = self.vertex;
        let [_, fragment] = self.fragment;
        let is_inside = |part: &str| {
            let start = text.find(part).unwrap();
            (start..start + part.len()).contains(&fault.at)
        };
        let uv = &vertex[vertex.find("let uv").unwrap()..];
        if is_inside("v.color.a") && !fragment.contains("in.alpha") {
            return Some("the fragment stage does not read the alpha of the vertex");
        }
        if is_inside(uv) && !fragment.contains("in.uv") {
            return Some("the fragment stage does not read the coordinates");
        }
        let is_renaming = fault.from.replace("local", "v.position") == fault.to;
        if is_renaming && vertex.starts_with("let local = v.position;") {
            return Some("`local` is `v.position`");
        }
        None
    }
}

fn plan(name: &str, text: &str) -> Plan {
    let module =
        wgsl::parse_str(text).unwrap_or_else(|e| panic!("{name}: {}", e.emit_to_string(text)));
    let mut sources = SourceMap::new();
    sources.add(name, text);
    let program = Program::new(module, Arc::new(sources), Language::Wgsl).unwrap();
    Plan::original(name, program, "vs", Some("fs"), &MaterialState::default())
}

/// The classes that are found between a main pass and another one.
fn found(main: &Plan, text: &str) -> Vec<Class> {
    let effort = Effort {
        inputs: 480,
        ..Effort::default()
    };
    let other = plan("other.wgsl", text);
    let agreement = agree(main, &other, Relation::Shadow.into(), &effort).unwrap();
    let classes = agreement.findings.iter().map(|f| f.class);
    classes.filter(|c| c.breaks(Relation::Shadow)).collect()
}

/// How many faults are planted.
const PLANTED: usize = 300;

/// The part of the page.
fn told(
    table: &BTreeMap<&str, (usize, usize, BTreeMap<&str, usize>)>,
    seen: usize,
    missed: &[String],
    harmless: &BTreeMap<&str, usize>,
) -> String {
    let mut text = "| fault | planted | found | as |\n|---|--:|--:|---|\n".to_owned();
    for (kind, (planted, found, classes)) in table {
        let classes: Vec<String> = classes.iter().map(|(c, n)| format!("`{c}` {n}")).collect();
        let classes = classes.join(", ");
        let _ = writeln!(text, "| {kind} | {planted} | {found} | {classes} |");
    }
    let _ = writeln!(text, "| all | {PLANTED} | {seen} | |\n");
    if !missed.is_empty() {
        let _ = writeln!(text, "Missed:\n\n{}\n", missed.join("\n"));
    }
    let all: usize = harmless.values().sum();
    let _ = writeln!(
        text,
        "{all} more faults cannot change a pixel, and `agree` reports none of them:\n"
    );
    for (why, count) in harmless {
        let _ = writeln!(text, "- {count}: {why}.");
    }
    text.push('\n');
    text
}

/// Each takes seconds: `make check` skips them.
mod slow {
    use super::*;

    #[test]
    fn planted_faults_are_found() {
        let mains: Vec<Plan> = PAIRS.iter().map(|p| plan("main.wgsl", &p.main())).collect();
        let mut all = Vec::new();
        let mut harmless: BTreeMap<&str, usize> = BTreeMap::new();
        for (pair, main) in PAIRS.iter().zip(&mains) {
            let alarms = found(main, &pair.other());
            assert_eq!(alarms, [], "{}: a false alarm", pair.name);
            let (without, with): (Vec<_>, Vec<_>) = pair
                .faults()
                .into_iter()
                .partition(|f| pair.harmless(f).is_some());
            for fault in &without {
                let why = pair.harmless(fault).unwrap_or_default();
                let alarms = found(main, &fault.text);
                assert_eq!(alarms, [], "{}: {why}:\n{}", pair.name, fault.text);
                *harmless.entry(why).or_default() += 1;
            }
            all.push(with);
        }
        // Of each pair in turn.
        let most = all.iter().map(Vec::len).max().unwrap();
        let turns = (0..most).flat_map(|i| {
            let pairs = PAIRS.iter().zip(&mains).zip(&all);
            pairs.filter_map(move |((pair, main), faults)| Some((pair, main, faults.get(i)?)))
        });
        let planted: Vec<_> = turns.take(PLANTED).collect();
        assert_eq!(planted.len(), PLANTED);
        let mut table: BTreeMap<&str, (usize, usize, BTreeMap<&str, usize>)> = BTreeMap::new();
        let mut missed = Vec::new();
        for (pair, main, fault) in planted {
            let classes = found(main, &fault.text);
            let row = table.entry(fault.kind).or_default();
            row.0 += 1;
            row.1 += usize::from(!classes.is_empty());
            if let Some(class) = classes.first() {
                *row.2.entry(class.name()).or_default() += 1;
            } else {
                let (name, from, to) = (pair.name, fault.from, fault.to);
                missed.push(format!("- {name}, {}: `{from}` as `{to}`", fault.kind));
            }
        }
        let seen: usize = table.values().map(|row| row.1).sum();
        let text = told(&table, seen, &missed, &harmless);
        assert!(seen * 100 >= PLANTED * 95, "{text}");
        let page = concat!(env!("CARGO_MANIFEST_DIR"), "/../docs/agree.md");
        let (begin, end) = ("<!-- planted -->\n", "<!-- /planted -->");
        let known = std::fs::read_to_string(page).unwrap();
        let (before, rest) = known.split_once(begin).unwrap();
        let (_, after) = rest.split_once(end).unwrap();
        let new = format!("{before}{begin}{text}{end}{after}");
        if std::env::var_os("UPDATE_PAGES").is_some() {
            std::fs::write(page, &new).unwrap();
        }
        assert_eq!(known, new, "UPDATE_PAGES=1 writes the table");
    }
}
