//! GLSL of every dialect: what it is in the IR, and that the passes take it as they take any other.

use std::path::{Path, PathBuf};

use preshade_compiler::emit;
use preshade_compiler::front::{self, Parsed, Source};
use preshade_compiler::recipe::Recipe;
use preshade_passes::transforms::depth_prepass::DepthPrepass;
use preshade_plan::pass::{Facts, Pass as _};
use preshade_plan::plan::Plan;
use preshade_plan::plan_file::Target;
use preshade_plan::state::{MaterialState, Topology};
use shader_text::error::{Code, Color};
use shader_text::files;
use shader_text::options::{ClipSpace, Options};

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/glsl/dialects")
}

fn sources(name: &str) -> Vec<Source> {
    ["vert", "frag"]
        .map(|e| {
            let name = format!("{name}.{e}");
            let text = std::fs::read_to_string(folder().join(&name)).unwrap();
            Source::new(name, text)
        })
        .to_vec()
}

fn names() -> Vec<String> {
    let files = std::fs::read_dir(folder())
        .unwrap()
        .map(|e| e.unwrap().path());
    let vertex = files.filter(|p| p.extension().is_some_and(|e| e == "vert"));
    let mut names: Vec<String> = vertex
        .map(|p| p.file_stem().unwrap().to_str().unwrap().to_owned())
        .collect();
    names.sort();
    assert!(names.len() > 10);
    names
}

fn parse(sources: &[Source], options: &Options) -> Parsed {
    front::parse(sources, options).unwrap_or_else(|e| panic!("{}", e.render(Color::Never)))
}

fn texts(vertex: &str, fragment: &str) -> Vec<Source> {
    vec![
        Source::new("a.vert", vertex),
        Source::new("a.frag", fragment),
    ]
}

fn refused(vertex: &str, fragment: &str) -> (Code, String) {
    let error = front::parse(&texts(vertex, fragment), &Options::default()).unwrap_err();
    (error.code(), error.render(Color::Never))
}

/// A material as WGSL.
fn wgsl(sources: &[Source], options: &Options) -> String {
    let parsed = parse(sources, options);
    let plan = Plan::original(
        "m",
        parsed.program,
        &parsed.vertex,
        parsed.fragment.as_deref(),
        &MaterialState::default(),
    );
    let files = emit::emit(&plan, &[Target::Wgsl], &emit::Options::default()).unwrap();
    let wgsl = files.iter().find(|f| f.name.ends_with(".wgsl")).unwrap();
    String::from_utf8(wgsl.bytes.clone()).unwrap()
}

#[test]
fn what_each_dialect_is() {
    for name in names() {
        insta::assert_snapshot!(name.clone(), wgsl(&sources(&name), &Options::default()));
    }
}

/// Inputs, and what `main` alone writes, are parameters of the functions that read them.
#[test]
fn what_functions_only_read_they_are_given() {
    let wgsl = wgsl(&sources("gl330-lent"), &Options::default());
    insta::assert_snapshot!("lent_as_wgsl", wgsl);
    let private: Vec<&str> = wgsl
        .lines()
        .filter(|l| l.starts_with("var<private>"))
        .collect();
    assert_eq!(private, ["var<private> seen: f32 = 0f;"]);
}

/// naga makes names of the members of every block, also of one that has a name of its own.
#[test]
fn members_of_a_named_block_hide_nothing() {
    let vertex = "#version 450
layout(location = 0) in vec3 p;
layout(std430, binding = 0) readonly buffer Places { mat4 instances[]; };
layout(binding = 1) uniform Tint { vec4 tint; };
layout(binding = 2) uniform Frame { uint instances; vec4 tint; } frame;
layout(location = 0) out vec4 color;
void main() {
    color = tint + frame.tint;
    gl_Position = instances[frame.instances] * vec4(p, 1.0);
}
";
    let fragment = "#version 450
layout(location = 0) in vec4 color;
layout(location = 0) out vec4 c;
void main() { c = color; }
";
    let parsed = parse(&texts(vertex, fragment), &Options::default());
    let plan = Plan::original(
        "m",
        parsed.program.clone(),
        &parsed.vertex,
        parsed.fragment.as_deref(),
        &MaterialState::default(),
    );
    let recipe = Recipe::parse(["depth-prepass:form=equal"]).unwrap();
    let plan = recipe.apply(&plan, &Facts::default()).unwrap();
    let files = emit::emit(&plan, &[Target::Wgsl], &emit::Options::default()).unwrap();
    let wgsl: Vec<String> = files
        .iter()
        .map(|f| String::from_utf8_lossy(&f.bytes).into_owned())
        .collect();
    let wgsl = wgsl.join("\n");
    assert!(
        wgsl.contains("= (global_1.tint + frame.tint);")
            || wgsl.contains("= global_1.tint + frame.tint;"),
        "{wgsl}"
    );
}

#[test]
fn what_is_emitted_reads_back() {
    for name in names() {
        let parsed = parse(&sources(&name), &Options::default());
        let fragment = parsed.fragment.as_deref();
        let plan = Plan::original(
            &name,
            parsed.program.clone(),
            &parsed.vertex,
            fragment,
            &MaterialState::default(),
        );
        for target in [
            Target::Wgsl,
            Target::Glsl450,
            Target::GlslEs300,
            Target::Spirv,
        ] {
            let files = match emit::emit(&plan, &[target], &emit::Options::default()) {
                Ok(files) => files,
                // A bit that a version lacks is said, not dropped.
                Err(emit::EmitError::Inexpressible { .. }) if target == Target::GlslEs300 => {
                    continue;
                }
                Err(e) => panic!("{name}: {e}"),
            };
            let ends = |f: &&files::File| f.name.ends_with(".vert") || f.name.ends_with(".frag");
            let texts: Vec<Source> = files
                .iter()
                .filter(ends)
                .map(|f| Source::new(&f.name, String::from_utf8(f.bytes.clone()).unwrap()))
                .collect();
            if !texts.is_empty() {
                parse(&texts, &Options::default());
            }
        }
    }
}

#[test]
fn the_passes_take_it() {
    for name in [
        "seed1-tiling",
        "seed4-specular",
        "seed4-noise",
        "gl330-material",
    ] {
        let parsed = parse(&sources(name), &Options::default());
        let fragment = parsed.fragment.as_deref();
        let plan = Plan::original(
            name,
            parsed.program.clone(),
            &parsed.vertex,
            fragment,
            &MaterialState::default(),
        );
        let mut recipes = vec!["depth-prepass", "early-discard"];
        if name.starts_with("seed4") {
            recipes.push("hoist:budget=0.05,finite=assumed,jumps=carried");
        }
        for recipe in recipes {
            let variant = Recipe::parse([recipe])
                .unwrap()
                .apply(&plan, &Facts::default())
                .unwrap_or_else(|r| panic!("{name} {recipe}: {r}"));
            emit::emit(&variant, &[Target::Wgsl], &emit::Options::default())
                .unwrap_or_else(|e| panic!("{name} {recipe}: {e}"));
        }
    }
}

#[test]
fn stages_share_uniforms_and_are_matched_by_name() {
    let parsed = parse(&sources("gl330-material"), &Options::default());
    let module = parsed.program.module();
    let block = module
        .global_variables
        .iter()
        .find(|(_, g)| g.name.as_deref() == Some("uniforms"));
    let naga::TypeInner::Struct { members, .. } = &module.types[block.unwrap().1.ty].inner else {
        panic!("a struct");
    };
    // std140 by hand: three matrices, a struct of one float in 16 bytes, two lights of 32, a vec3.
    let at: Vec<(&str, u32)> = members
        .iter()
        .map(|m| (m.name.as_deref().unwrap(), m.offset))
        .collect();
    assert_eq!(
        at,
        [
            ("model", 0),
            ("view", 64),
            ("projection", 128),
            ("material", 192),
            ("lights", 208),
            ("viewPos", 272)
        ]
    );
}

#[test]
fn the_clip_space_goes_by_the_dialect() {
    let remap = "* 0.5f";
    let vertex = |text: &str, clip_space| {
        let options = Options {
            clip_space,
            ..Options::default()
        };
        wgsl(&[Source::new("a.vert", text)], &options)
    };
    let es = "attribute vec4 p; void main() { gl_Position = p; }";
    let vulkan = "#version 450\nlayout(location = 0) in vec4 p;\nvoid main() { gl_Position = p; }";
    assert!(vertex(es, None).contains(remap));
    assert!(!vertex(es, Some(ClipSpace::AsWritten)).contains(remap));
    assert!(!vertex(vulkan, None).contains(remap));
    assert!(vertex(vulkan, Some(ClipSpace::OpenGl)).contains(remap));
}

#[test]
fn an_early_return_leaves_by_the_same_way() {
    let vertex = "attribute vec3 p; varying float v[2]; void main() { v[0] = p.x; \
                  gl_Position = vec4(p, 1.0); if (p.x > 0.0) return; v[1] = p.y; }";
    let text = wgsl(&[Source::new("a.vert", vertex)], &Options::default());
    assert_eq!(text.matches("v_0 = v[0];").count(), 2, "{text}");
    assert_eq!(text.matches("* 0.5f").count(), 2, "{text}");
}

#[test]
fn invariant_drives_the_attribute() {
    let marked = |text: &str| {
        let sources = texts(
            text,
            "precision mediump float; void main() { gl_FragColor = vec4(1.0); }",
        );
        let parsed = parse(&sources, &Options::default());
        let entry = &parsed
            .program
            .module()
            .entry_points
            .iter()
            .find(|e| e.stage == naga::ShaderStage::Vertex)
            .unwrap();
        format!("{:?}", entry.function.result).contains("invariant: true")
            || format!("{:?}", parsed.program.module().types).contains("invariant: true")
    };
    assert!(marked(
        "invariant gl_Position; attribute vec4 p; void main() { gl_Position = p; }"
    ));
    assert!(marked(
        "#pragma STDGL invariant(all)\nattribute vec4 p; void main() { gl_Position = p; }"
    ));
    assert!(!marked(
        "attribute vec4 p; void main() { gl_Position = p; }"
    ));
}

#[test]
fn included_files_are_found_and_pointed_at() {
    let dir = std::env::temp_dir().join(format!("preshade-include-{}", std::process::id()));
    std::fs::create_dir_all(dir.join("lib")).unwrap();
    std::fs::write(
        dir.join("lib/tint.glsl"),
        "vec3 tint(vec3 c) {\n    return c * gl_PointCoord.x;\n}\n",
    )
    .unwrap();
    let fragment = "precision mediump float;\n#include \"tint.glsl\"\n\
                    void main() { gl_FragColor = vec4(tint(vec3(1.0)), 1.0); }";
    let sources = texts(
        "attribute vec4 p; void main() { gl_Position = p; }",
        fragment,
    );
    let missing = front::parse(&sources, &Options::default()).unwrap_err();
    assert!(missing.message().contains("tint.glsl"), "{missing}");
    assert_eq!(missing.location().unwrap().line, 2);
    let options = Options {
        include: vec![dir.join("lib")],
        ..Options::default()
    };
    let angles = texts(
        "attribute vec4 p; void main() { gl_Position = p; }",
        &fragment.replace("\"tint.glsl\"", "<tint.glsl>"),
    );
    for sources in [sources, angles] {
        let found = front::parse(&sources, &options).unwrap_err();
        let at = found.location().unwrap();
        assert!(at.file.ends_with("tint.glsl") && at.line == 2, "{found}");
    }
    // A guard that another file takes back ends nothing.
    let write = |name: &str, text: &str| std::fs::write(dir.join("lib").join(name), text).unwrap();
    write(
        "q.glsl",
        "#ifndef Q\n#define Q\n#include \"u.glsl\"\n#include \"q.glsl\"\n#endif\n",
    );
    write("u.glsl", "#undef Q\n");
    let endless = texts(
        "attribute vec4 p; void main() { gl_Position = p; }",
        &fragment.replace("tint.glsl", "q.glsl"),
    );
    let error = front::parse(&endless, &options).unwrap_err();
    assert!(
        error
            .message()
            .contains("q.glsl includes itself without end"),
        "{error}"
    );
    std::fs::remove_dir_all(dir).unwrap();
}

/// C11 6.10.3.1 and 6.10.3.4, which GLSL's preprocessor follows: an argument is expanded before it
/// is put in, and what a macro comes to is looked at together with what stands behind it.
#[test]
fn macros_are_expanded_within_their_own_arguments_and_by_another_name() {
    let vertex = "attribute vec4 p; void main() { gl_Position = p; }";
    let dir = std::env::temp_dir().join(format!("preshade-rescan-{}", std::process::id()));
    std::fs::create_dir_all(&dir).unwrap();
    let shared = "#define quad four\n#define four(a, b) vec4(a, \\\n    b, a, b)\n\
                  #define twice(x) ((x) * 2.0)\nfloat shared_one = 1.0;\n";
    std::fs::write(dir.join("shared.glsl"), shared).unwrap();
    let options = Options {
        include: vec![dir.clone()],
        ..Options::default()
    };
    let fragment = |body: &str| {
        let head = "precision mediump float;\n#include \"shared.glsl\"\n";
        texts(vertex, &format!("{head}{body}"))
    };
    let given = |sources: &[Source]| wgsl(sources, &options);
    let called = given(&fragment(
        "void main() { gl_FragColor = quad(twice(1.0 + twice(twice(0.5))), shared_one); }",
    ));
    let written = given(&fragment(
        "void main() { gl_FragColor = vec4(((1.0 + ((((0.5) * 2.0)) * 2.0)) * 2.0), shared_one, \
         ((1.0 + ((((0.5) * 2.0)) * 2.0)) * 2.0), shared_one); }",
    ));
    assert_eq!(called, written);
    // What stands behind macros that were written otherwise is still found.
    let wrong = "void main() {\n    gl_FragColor = vec4(twice(twice(0.5)));\n    unheard(1.0);\n}";
    let error = front::parse(&fragment(wrong), &options).unwrap_err();
    let at = error.location().unwrap();
    assert!(at.file.ends_with("a.frag") && at.line == 5, "{error}");
    std::fs::remove_dir_all(dir).unwrap();
}

#[test]
fn what_is_not_read_is_named() {
    let vertex = "attribute vec4 p; void main() { gl_Position = p; }";
    let body = |body: &str| {
        format!("precision mediump float;\nuniform sampler2D maps[2];\nuniform int which;\n{body}")
    };
    for (name, fragment) in [
        (
            "point",
            body("void main() {\n    gl_FragColor = vec4(gl_PointCoord, 0.0, 1.0);\n}"),
        ),
        (
            "query",
            "#version 400\nuniform sampler2D s;\nout vec4 c;\n\
             void main() {\n    c = vec4(textureQueryLod(s, vec2(0.0)), 0.0, 1.0);\n}"
                .to_owned(),
        ),
        (
            "data",
            body("void main() {\n    gl_FragData[which] = vec4(1.0);\n}"),
        ),
        (
            "rect",
            "#version 150\nuniform sampler2DRect s;\nout vec4 c;\n\
             void main() { c = texture(s, vec2(0.0)); }"
                .to_owned(),
        ),
        (
            "varying",
            body("varying vec2 uv;\nvoid main() { gl_FragColor = uv.xyxy; }"),
        ),
        (
            "function",
            body("void main() {\n    gl_FragColor = vec4(unheard(1.0));\n}"),
        ),
    ] {
        let (_, frame) = refused(vertex, &fragment);
        insta::assert_snapshot!(format!("refused_{name}"), frame);
    }
}

#[test]
fn one_file_may_hold_both_stages() {
    let text = "#version 450\nlayout(push_constant) uniform Push { vec4 tint; } params;\n\
                #define TINT params.tint\n#pragma stage vertex\n\
                layout(location = 0) in vec4 Position;\n\
                layout(location = 0) out vec2 uv;\nvoid main() { gl_Position = Position; \
                uv = Position.xy; }\n#pragma stage fragment\nlayout(location = 0) in vec2 uv;\n\
                layout(location = 0) out vec4 color;\nlayout(set = 0, binding = 2) uniform \
                sampler2D Source;\nvoid main() { color = TINT * texture(Source, uv); }\n";
    let parsed = parse(&[Source::new("a.slang", text)], &Options::default());
    assert_eq!(
        (parsed.vertex.as_str(), parsed.fragment.as_deref()),
        ("vertex_main", Some("fragment_main"))
    );
}

#[test]
fn what_keeps_a_stage_from_being_run_again_is_named_as_the_author_names_it() {
    let vertex = "#version 450
layout(location = 0) in vec3 position;
layout(location = 0) out vec2 uv;
void main() { uv = position.xy; gl_Position = vec4(position, 1.0); }
";
    let refusal = |declared: &str, body: &str| {
        let fragment = format!(
            "#version 450
layout(location = 0) in vec2 uv;
layout(location = 0) out vec4 color;
{declared}
void main() {{ {body} }}
"
        );
        let parsed = parse(&texts(vertex, &fragment), &Options::default());
        let plan = Plan::original(
            "m",
            parsed.program,
            &parsed.vertex,
            parsed.fragment.as_deref(),
            &MaterialState::default(),
        );
        let recipe = Recipe::parse(["visibility-buffer:budget=1"]).unwrap();
        recipe.apply(&plan, &Facts::default()).unwrap_err()
    };
    let refused = refusal(
        "vec3 sum;\nvoid tint() { sum += vec3(uv, 0.5); }",
        "sum = vec3(0.1); tint(); color = vec4(sum, 1.0);",
    );
    assert_eq!(refused.code, "fragment-state");
    let named = "the private variable `sum`, which `tint` uses";
    assert!(refused.reason.contains(named), "{}", refused.reason);
    // What a function only reads it is given.
    assert!(!refused.reason.contains("`uv`"), "{}", refused.reason);
    assert!(refused.remedy.contains("`inout`"), "{}", refused.remedy);
    assert!(refused.location.is_some());
}

fn written(parsed: Parsed, target: Target) -> String {
    let plan = Plan::original(
        "m",
        parsed.program,
        &parsed.vertex,
        parsed.fragment.as_deref(),
        &MaterialState::default(),
    );
    let files = emit::emit(&plan, &[target], &emit::Options::default()).unwrap();
    let texts = files.iter().filter(|f| !f.name.ends_with(".json"));
    let texts = texts.map(|f| String::from_utf8(f.bytes.clone()).unwrap());
    texts.collect::<Vec<_>>().join("\n")
}

/// By Vulkan's rules two blocks of one name and two numbers are two.
#[test]
fn blocks_of_one_name_at_two_bindings_are_two() {
    let vertex = "#version 450
layout(location = 0) in vec3 p;
layout(binding = 0) uniform UBO { mat4 m; } ubo;
void main() { gl_Position = ubo.m * vec4(p, 1.0); }
";
    let fragment = "#version 450
layout(binding = 3) uniform UBO { vec4 tint; } ubo;
layout(binding = 1) uniform sampler2D map;
layout(location = 0) out vec4 c;
void main() { c = ubo.tint * texture(map, gl_FragCoord.xy); }
";
    let text = written(
        parse(&texts(vertex, fragment), &Options::default()),
        Target::Wgsl,
    );
    for binding in [0, 1, 3] {
        assert!(
            text.contains(&format!("@group(0) @binding({binding})")),
            "{text}"
        );
    }
    let clash = vertex
        .replace(
            "uniform UBO { mat4 m; } ubo;",
            "uniform UBO { mat4 m; } ubo;\nlayout(binding = 5) uniform sampler2D map;",
        )
        .replace(
            "void main() {",
            "void main() { gl_PointSize = texture(map, p.xy).x;",
        );
    let (code, frame) = refused(&clash, fragment);
    assert_eq!(code, Code::Link);
    assert!(frame.contains("at two bindings"), "{frame}");
}

/// What blocks say of their layout is kept, or refused where naga knows no such thing.
#[test]
fn layouts_of_blocks_are_kept_or_refused() {
    let vertex = "#version 450\nlayout(location = 0) in vec3 p;\n\
                  void main() { gl_Position = vec4(p, 1.0); }\n";
    let of = |block: &str| {
        format!(
            "#version 450\n{block}\nlayout(location = 0) out vec4 c;\n\
             void main() {{ c = u.m * u.v; }}\n"
        )
    };
    let plain = "layout(binding = 0) uniform U { vec4 v; mat4 m; } u;";
    let turned = format!("layout(std140, row_major) uniform;\n{plain}");
    let text = |block: &str| {
        written(
            parse(&texts(vertex, &of(block)), &Options::default()),
            Target::Wgsl,
        )
    };
    assert!(!text(plain).contains("transpose("));
    assert!(text(&turned).contains("transpose("), "{}", text(&turned));
    text(
        "layout(binding = 0) uniform U { layout(offset = 0) vec4 v; \
         layout(offset = 16) mat4 m; } u;",
    );
    for (block, offsets) in [
        (
            "layout(binding = 0) uniform U { vec4 v; layout(offset = 64) mat4 m; } u;",
            [0, 64],
        ),
        (
            "layout(binding = 0) uniform U { vec4 v; layout(align = 64) mat4 m; } u;",
            [0, 64],
        ),
        (
            "layout(push_constant) uniform U { layout(offset = 64) vec4 v; mat4 m; } u;",
            [64, 80],
        ),
    ] {
        let parsed = parse(&texts(vertex, &of(block)), &Options::default());
        let module = parsed.program.module();
        let (_, global) = module.global_variables.iter().next().unwrap();
        let naga::TypeInner::Struct { members, .. } = &module.types[global.ty].inner else {
            panic!("{block}");
        };
        let at = |name| {
            members
                .iter()
                .find(|m| m.name.as_deref() == Some(name))
                .unwrap()
                .offset
        };
        assert_eq!([at("v"), at("m")], offsets, "{block}");
    }
    for (block, why) in [
        (
            "layout(binding = 0) uniform U { mat4 m; layout(offset = 16) vec4 v; } u;",
            "ends at byte 64",
        ),
        (
            "layout(binding = 0) uniform U { mat4 m; layout(offset = 72) vec4 v; } u;",
            "no multiple of 16",
        ),
        (
            "layout(binding = 0) uniform U { mat4 m; layout(offset = 1048576) vec4 v; } u;",
            "4096 bytes",
        ),
    ] {
        let (code, frame) = refused(vertex, &of(block));
        assert_eq!(code, Code::Unsupported, "{frame}");
        assert!(frame.contains(why), "{frame}");
    }
}

/// Names that begin as types do, and offsets that no constant holds: written, and in no time.
#[test]
fn what_glsl_out_is_written_of() {
    let vertex = "#version 300 es\nin vec3 p;\nout vec3 sampler2Dc;\n\
                  void main() { sampler2Dc = p; gl_Position = vec4(p, 1.0); }\n";
    let fragment = "#version 300 es
precision highp float;
in vec3 sampler2Dc;
uniform samplerCube samplerCubeMap;
uniform sampler2D map;
uniform float sampler2DWeight;
out vec4 c;
void main() { c = texture(samplerCubeMap, sampler2Dc) + textureOffset(map, sampler2Dc.xy, ivec2(1, \
    -1)) * sampler2DWeight + textureOffset(map, sampler2Dc.xy, ivec2(2)); }
";
    for target in [Target::Glsl450, Target::GlslEs300] {
        let text = written(parse(&texts(vertex, fragment), &Options::default()), target);
        assert!(text.contains("samplerCube samplerCubeMap;"), "{text}");
    }
    let (code, frame) = refused(
        vertex,
        "#version 300 es\nuniform sampler2D maps[30000000];\nvoid main() {}\n",
    );
    assert_eq!(code, Code::TooDeep, "{frame}");
}

/// Points whose size would be lost are no GLSL; triangles need none.
#[test]
fn a_size_of_points_is_not_lost_in_silence() {
    let vertex = "#version 300 es\nin vec3 p;\nvoid main() { gl_PointSize = 9.0; \
                  gl_Position = vec4(p, 1.0); }\n";
    let fragment =
        "#version 300 es\nprecision highp float;\nout vec4 c;\nvoid main() { c = vec4(1.0); }\n";
    let parsed = parse(&texts(vertex, fragment), &Options::default());
    let plan = |topology| {
        let mut state = MaterialState::default();
        state.primitive.topology = topology;
        let program = parsed.program.clone();
        Plan::original(
            "m",
            program,
            &parsed.vertex,
            parsed.fragment.as_deref(),
            &state,
        )
    };
    let emitted = |topology, target| {
        emit::emit(&plan(topology), &[target], &emit::Options::default()).map(|_| ())
    };
    assert_eq!(emitted(Topology::TriangleList, Target::GlslEs300), Ok(()));
    assert_eq!(emitted(Topology::PointList, Target::Wgsl), Ok(()));
    let refused = emitted(Topology::PointList, Target::GlslEs300).unwrap_err();
    assert!(refused.to_string().contains("`gl_PointSize`"), "{refused}");
    // What is dropped is said, in `plan.json` too.
    let notes = |topology| plan(topology).notes.join("\n");
    assert!(notes(Topology::PointList).contains("points come out one pixel large"));
    assert!(notes(Topology::TriangleList).contains("changes no triangle and no line"));
}

#[test]
fn a_change_stands_at_the_line_of_the_author() {
    // OpenGL's clip space: the reader ends `main` with a statement of its own, which has no line.
    let vertex = "#version 300 es\nin vec3 position;\nout vec2 at;\nvoid main() {\n    at = position.xy;\n    \
                  gl_Position = vec4(position, 1.0);\n}\n";
    let fragment = "#version 300 es\nprecision highp float;\nin vec2 at;\nout vec4 color;\n\
                    void main() { color = vec4(at, at); }\n";
    let parsed = parse(&texts(vertex, fragment), &Options::default());
    let plan = Plan::original(
        "m",
        parsed.program,
        &parsed.vertex,
        parsed.fragment.as_deref(),
        &MaterialState::default(),
    );
    let done = DepthPrepass::run(&plan, &Facts::default(), &Default::default()).unwrap();
    let at = done.change.location.unwrap();
    assert!(at.file.ends_with("a.vert") && at.line == 6, "{at:?}");
}
