//! Each builtin, interpolation and function that some target lacks: it is written so that other
//! compilers take it, or refused by name. One small stage for each.

use naga::{Binding, BuiltIn};
use preshade_compiler::emit::{self, EmitError};
use preshade_compiler::front::{self, Source};
use preshade_plan::plan::Plan;
use preshade_plan::plan_file::Target;
use preshade_plan::state::MaterialState;
use shader_text::error::Color;
use shader_text::options;

use crate::accept;

const COMMON: &str = "struct U { mvp: mat4x4<f32>, a: f32, b: f32, n: i32, m: u32 }
@group(0) @binding(0) var<uniform> u: U;
struct V { @builtin(position) position: vec4<f32>, @location(0) uv: vec2<f32> }
";
const VERTEX: &str =
    "@vertex fn vs(@location(0) p: vec4<f32>) -> V { return V(u.mvp * p, p.xy); }\n";
const TEXTURE: &str =
    "@group(0) @binding(1) var t: texture_2d<f32>;\n@group(0) @binding(2) var s: sampler;\n";

/// What a target says to a stage.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Said {
    /// It is written and read back.
    Read,
    /// It is written, and our reader lacks something.
    Unread,
    /// It is refused in these words.
    Refused(&'static str),
}

use Said::{Read, Refused, Unread};

/// A material with the verdicts of SPIR-V, GLSL 4.50 and GLSL ES 3.00.
#[derive(Clone)]
struct Case {
    name: &'static str,
    text: String,
    said: [Said; 3],
}

/// A fragment stage whose alpha is `x`, after `body`.
fn alpha(name: &'static str, body: &str, said: [Said; 3]) -> Case {
    with(name, "", "", body, said)
}

/// The same with declarations and another input.
fn with(name: &'static str, head: &str, input: &str, body: &str, said: [Said; 3]) -> Case {
    let (enables, declared): (Vec<&str>, Vec<&str>) =
        head.lines().partition(|l| l.starts_with("enable "));
    let text = format!(
        "{}\n{COMMON}{VERTEX}{}\n@fragment fn fs(v: V{input}) -> @location(0) vec4<f32> {{ \
         {body} return vec4<f32>(v.uv, 0.5, x); }}\n",
        enables.join("\n"),
        declared.join("\n"),
    );
    Case { name, text, said }
}

/// A fragment stage with another result.
fn writes(name: &'static str, enables: &str, members: &str, stage: &str, said: [Said; 3]) -> Case {
    let text = format!("{enables}{COMMON}{VERTEX}struct O {{ {members} }}\n@fragment {stage} }}\n");
    Case { name, text, said }
}

fn builtins() -> Vec<Case> {
    let input = |name: &'static str, attribute: &str, enables: &str, said| {
        let input = format!(", @builtin({attribute}");
        with(name, enables, &input, "let x = f32(b);", said)
    };
    let clip = format!(
        "enable clip_distances;\n{COMMON}struct C {{ @builtin(position) position: vec4<f32>, \
         @builtin(clip_distances) d: array<f32, 2>, @location(0) uv: vec2<f32> }}
@vertex fn vs(@location(0) p: vec4<f32>) -> C {{ var c: C; c.position = u.mvp * p; c.d[0] = u.a; \
    c.d[1] = p.x; c.uv = p.xy; return c; }}
@fragment fn fs(v: V) -> @location(0) vec4<f32> {{ return vec4<f32>(v.uv, 0.0, 1.0); }}\n"
    );
    let mask = "@location(0) c: vec4<f32>, @builtin(sample_mask) m: u32";
    let mask_of_glsl = Refused("sample_mask");
    vec![
        input(
            "sample_index",
            "sample_index) b: u32",
            "",
            [Read, Read, Refused("sample_index")],
        ),
        input(
            "primitive_index",
            "primitive_index) b: u32",
            "enable primitive_index;\n",
            [Read, Read, Refused("primitive_index")],
        ),
        input(
            "front_facing",
            "front_facing) b: bool",
            "",
            [Read, Read, Read],
        ),
        input(
            "sample_mask in",
            "sample_mask) b: u32",
            "",
            [Read, mask_of_glsl, mask_of_glsl],
        ),
        input(
            "subgroup_size",
            "subgroup_size) b: u32",
            "",
            [Read, Refused("subgroup_size"), Refused("subgroup_size")],
        ),
        writes(
            "sample_mask out",
            "",
            mask,
            "fn fs(v: V) -> O { if (v.uv.x < 0.1) { return O(vec4<f32>(1.0), 3u); } return \
             O(vec4<f32>(v.uv, u.a, u.b), u.m);",
            [Read, mask_of_glsl, mask_of_glsl],
        ),
        writes(
            "sample_mask in and out",
            "",
            mask,
            "fn fs(v: V, @builtin(sample_mask) b: u32) -> O { \
             return O(vec4<f32>(v.uv, u.a, u.b), b & u.m);",
            [Read, mask_of_glsl, mask_of_glsl],
        ),
        Case {
            name: "clip_distances",
            text: clip,
            said: [Read, Read, Refused("clip_distances")],
        },
        with(
            "barycentric",
            "",
            ", @builtin(barycentric) b: vec3<f32>",
            "let x = b.x;",
            [Read, Read, Refused("barycentric")],
        ),
    ]
}

fn depths_and_targets() -> Vec<Case> {
    let depth = "@location(0) c: vec4<f32>, @builtin(frag_depth) d: f32";
    let stage = |test: &str| {
        format!(
            "@early_depth_test({test}) fn fs(v: V) -> O {{ \
             return O(vec4<f32>(v.uv, 0.0, 1.0), v.position.z);"
        )
    };
    let early =
        |name: &'static str, es: Said| writes(name, "", depth, &stage(name), [Read, Read, es]);
    vec![
        early("less_equal", Read),
        early("greater_equal", Read),
        early("force", Refused("a forced early depth test")),
        writes(
            "dual source",
            "enable dual_source_blending;\n",
            "@location(0) @blend_src(0) c: vec4<f32>, @location(0) @blend_src(1) d: vec4<f32>",
            "fn fs(v: V) -> O { return O(vec4<f32>(v.uv, 0.0, 1.0), vec4<f32>(u.a));",
            [Read, Read, Read],
        ),
    ]
}

fn functions() -> Vec<Case> {
    let bits = Refused("the function bitfieldExtract");
    let subgroups = Refused("subgroup operations");
    let gather = Refused("textureGather");
    let half = Refused("16-bit numbers");
    let long = format!(
        "let {0} = v.uv.x; let x = sin({0}) + {0};",
        "a".repeat(1100)
    );
    let long_name = Refused("a name of over 1024 characters");
    let depth =
        "@group(0) @binding(1) var t: texture_depth_2d;\n@group(0) @binding(2) var s: sampler;\n";
    let unlike = Refused("the depth texture `t` sampled without a comparison");
    vec![
        alpha(
            "modf",
            "let r = modf(v.uv.x); let x = r.fract + r.whole;",
            [Unread, Read, Read],
        ),
        alpha(
            "frexp",
            "let r = frexp(v.uv.x); let x = r.fract * f32(r.exp);",
            [Unread, Unread, Read],
        ),
        alpha(
            "quantizeToF16",
            "let x = quantizeToF16(v.uv.x);",
            [Unread, Read, Read],
        ),
        alpha(
            "dot4U8Packed",
            "let x = f32(dot4U8Packed(u.m, 17u));",
            [Unread, Read, bits],
        ),
        alpha(
            "pack4xU8",
            "let x = f32(pack4xU8(vec4<u32>(u.m)));",
            [Unread, Read, Read],
        ),
        alpha(
            "pack4xI8Clamp",
            "let x = f32(pack4xI8Clamp(vec4<i32>(u.n)));",
            [Unread, Read, Read],
        ),
        alpha(
            "unpack4xI8",
            "let x = f32(unpack4xI8(u.m).x);",
            [Unread, Read, bits],
        ),
        alpha(
            "subgroupAdd",
            "let x = subgroupAdd(v.uv.x);",
            [Read, Read, subgroups],
        ),
        alpha(
            "quadSwapX",
            "let x = quadSwapX(v.uv.x);",
            [Read, Read, subgroups],
        ),
        with(
            "gather",
            TEXTURE,
            "",
            "let x = textureGather(0, t, s, v.uv).x;",
            [Read, Read, gather],
        ),
        with(
            "gather offset",
            TEXTURE,
            "",
            "let x = textureGather(0, t, s, v.uv, vec2<i32>(1, 0)).x;",
            [Read, Read, gather],
        ),
        with(
            "phony",
            TEXTURE,
            "",
            "_ = t; _ = s; let x = 1.0;",
            [Read, Read, Read],
        ),
        with(
            "depth sample",
            depth,
            "",
            "let x = textureSample(t, s, v.uv);",
            [Read, unlike, unlike],
        ),
        with(
            "binding array",
            "enable wgpu_binding_array;\n@group(0) @binding(1) var t: \
             binding_array<texture_2d<f32>, 4>;\n@group(0) @binding(2) var s: sampler;\n",
            "",
            "let x = textureSample(t[1], s, v.uv).x;",
            [
                Read,
                Refused("the binding array `t`"),
                Refused("the binding array `t`"),
            ],
        ),
        with(
            "f16 uniform",
            "enable f16;\nstruct H { h: f16 }\n@group(0) @binding(1) var<uniform> w: H;\n",
            "",
            "let x = f32(w.h);",
            [Read, half, half],
        ),
        alpha(
            "f64",
            "let x = f32(f64(v.uv.x) * 3.0lf);",
            [Read, Read, Refused("64-bit floats")],
        ),
        with(
            "texture2D member",
            "struct W { texture2D: f32, sampler2D: f32 }\n\
             @group(0) @binding(1) var<uniform> w: W;\n",
            "",
            "let x = w.texture2D;",
            [Read, Read, Read],
        ),
        // naga gives names of builtins that the author declares another spelling.
        with(
            "own bitCount",
            "fn bitCount(v: f32) -> f32 { return v * 2.0; }\n",
            "",
            "let x = bitCount(v.uv.x);",
            [Read, Read, Read],
        ),
        alpha("long name", &long, [Read, long_name, long_name]),
    ]
}

#[test]
fn what_a_target_lacks_is_refused_by_name_and_the_rest_compiles() {
    let mut sets = Vec::new();
    let mut wrong = Vec::new();
    let cases = [builtins(), depths_and_targets(), functions()].concat();
    for case in &cases {
        let source = Source::new("case.wgsl", &case.text);
        let parsed = front::parse(&[source], &options::Options::default())
            .unwrap_or_else(|e| panic!("{}: {}", case.name, e.render(Color::Never)));
        let fragment = parsed.fragment.as_deref();
        let state = MaterialState::default();
        let plan = Plan::original("m", parsed.program, &parsed.vertex, fragment, &state);
        let targets = [Target::Spirv, Target::Glsl450, Target::GlslEs300];
        for (target, wanted) in targets.into_iter().zip(case.said) {
            let emitted = emit::emit(&plan, &[target], &emit::Options::default());
            let found = match emitted {
                Ok(files) => {
                    let json = files.iter().find(|f| f.name.ends_with(".json")).unwrap();
                    let json = String::from_utf8_lossy(&json.bytes).into_owned();
                    sets.push((format!("{} {target}", case.name), files));
                    match json.contains("was not read back") {
                        true => "unread".to_owned(),
                        false => "read".to_owned(),
                    }
                }
                Err(EmitError::Inexpressible { what, .. }) => what,
                Err(other) => other.to_string(),
            };
            let is_it = match wanted {
                Read => found == "read",
                Unread => found == "unread",
                Refused(what) => found.starts_with(what),
            };
            if !is_it {
                wrong.push(format!("{} {target}: {found}, not {wanted:?}", case.name));
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    let judged = accept::accept(&sets);
    assert!(
        judged.spirv >= cases.len() && judged.glsl > 30,
        "{judged:?}"
    );
}

/// `_ = t;` keeps a binding in an automatic layout.
#[test]
fn a_resource_that_is_only_named_stays_in_every_text() {
    let case = with(
        "phony",
        TEXTURE,
        "",
        "_ = t; _ = s; let x = 1.0;",
        [Read; 3],
    );
    let source = Source::new("phony.wgsl", &case.text);
    let parsed = front::parse(&[source], &options::Options::default()).unwrap();
    // Not the author's own text.
    let module = parsed.program.module().clone();
    let program = parsed.program.with_module(module).unwrap();
    let state = MaterialState::default();
    let plan = Plan::original("m", program, "vs", Some("fs"), &state);
    let bound: Vec<u32> = plan.passes[0].bindings.iter().map(|b| b.binding).collect();
    assert_eq!(bound, [0, 1, 2]);
    let targets = [Target::Wgsl, Target::Spirv];
    let files = emit::emit(&plan, &targets, &emit::Options::default()).unwrap();
    let wgsl = String::from_utf8_lossy(&files[0].bytes).into_owned();
    assert!(wgsl.contains("_ = t;") && wgsl.contains("_ = s;"), "{wgsl}");
    accept::accept(&[("phony".to_owned(), files)]);
}

/// WGSL has no word for these builtins, GLSL and SPIR-V have.
#[test]
fn builtins_of_a_draw_are_refused_by_glsl() {
    for (builtin, wanted) in [
        (BuiltIn::BaseVertex, "base_vertex"),
        (BuiltIn::BaseInstance, "base_instance"),
    ] {
        let text = "@vertex fn vs(@builtin(vertex_index) i: u32) -> @builtin(position) vec4<f32> \
                    { return vec4<f32>(f32(i)); }
            @fragment fn fs() -> @location(0) vec4<f32> { return vec4<f32>(1.0); }";
        let source = Source::new("draw.wgsl", text);
        let parsed = front::parse(&[source], &options::Options::default()).unwrap();
        let mut module = parsed.program.module().clone();
        let stage = &mut module.entry_points[0];
        assert_eq!(stage.name, "vs");
        stage.function.arguments[0].binding = Some(Binding::BuiltIn(builtin));
        let program = parsed.program.with_module(module).unwrap();
        let state = MaterialState::default();
        let plan = Plan::original("m", program, "vs", Some("fs"), &state);
        for target in [Target::Glsl450, Target::GlslEs300] {
            match emit::emit(&plan, &[target], &emit::Options::default()) {
                Err(EmitError::Inexpressible { what, .. }) => assert_eq!(what, wanted),
                other => panic!("{wanted} {target}: {:?}", other.map(|files| files.len())),
            }
        }
    }
}
