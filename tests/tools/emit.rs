//! What is emitted reads back, keeps the author's interface, and is the same bytes each time.

use preshade_compiler::emit;
use preshade_compiler::front::{self, Source};
use preshade_compiler::recipe::Recipe;
use preshade_plan::pass::Facts;
use preshade_plan::plan::{Plan, Role};
use preshade_plan::plan_file::{self, Target};
use preshade_plan::program::Program;
use preshade_plan::state::{ColorTarget, MaterialState};
use shader_text::error::Color;
use shader_text::files::{self, File};
use shader_text::options;

use crate::accept;

const LIT: &str = r"
struct Camera {
    view_proj: mat4x4<f32>,
    eye: vec3<f32>,
}
@group(0) @binding(0) var<uniform> camera: Camera;
@group(1) @binding(0) var albedo: texture_2d<f32>;
@group(1) @binding(1) var linear_sampler: sampler;

struct Varyings {
    @builtin(position) @invariant clip: vec4<f32>,
    @location(0) uv0: vec2<f32>,
    @location(1) normal: vec3<f32>,
}

fn shade(n: vec3<f32>, albedo1: vec3<f32>) -> vec3<f32> {
    let light = normalize(vec3<f32>(1.0, 2.0, 3.0));
    return albedo1 * max(dot(n, light), 0.1);
}

@vertex
fn vs_main(@location(0) position: vec3<f32>, @location(1) normal: vec3<f32>, @location(2) uv: vec2<f32>) -> Varyings {
    var out: Varyings;
    out.clip = camera.view_proj * vec4<f32>(position, 1.0);
    out.uv0 = uv;
    out.normal = normal;
    return out;
}

@fragment
fn fs_main(in: Varyings) -> @location(0) vec4<f32> {
    let texel = textureSample(albedo, linear_sampler, in.uv0);
    if texel.a < 0.5 {
        discard;
    }
    let color = shade(normalize(in.normal), texel.rgb);
    return vec4<f32>(color, texel.a);
}
";

/// Loops, a switch, early returns, an array, a private global, padded structs, names that end in
/// digits.
const EVERYTHING: &str = include_str!("../materials/everything.wgsl");

/// A program that the writer has to write: one that no transform has touched ships as its author's
/// own text.
pub fn touched(program: &Program) -> Program {
    program.with_module(program.module().clone()).unwrap()
}

fn plan(name: &str, text: &str) -> Plan {
    let parsed = front::parse(&[Source::new(name, text)], &options::Options::default())
        .unwrap_or_else(|e| panic!("{}", e.render(Color::Never)));
    Plan::original(
        "material",
        touched(&parsed.program),
        &parsed.vertex,
        parsed.fragment.as_deref(),
        &MaterialState::default(),
    )
}

fn emit_all(plan: &Plan) -> Vec<File> {
    emit::emit(plan, &Target::GENERAL, &emit::Options::default()).unwrap()
}

fn text<'a>(files: &'a [File], name: &str) -> &'a str {
    let file = files.iter().find(|f| f.name == name).unwrap();
    std::str::from_utf8(&file.bytes).unwrap()
}

#[test]
fn a_material_is_written_in_every_target() {
    let files = emit_all(&plan("lit.wgsl", LIT));
    let names: Vec<&str> = files.iter().map(|f| f.name.as_str()).collect();
    assert_eq!(
        names,
        [
            "material.main.wgsl",
            "material.main.vert.spv",
            "material.main.frag.spv",
            "material.main.vert",
            "material.main.frag",
            "material.main.es.vert",
            "material.main.es.frag",
            "material.plan.json",
        ]
    );
    insta::assert_snapshot!("lit_wgsl", text(&files, "material.main.wgsl"));
    insta::assert_snapshot!("lit_es_frag", text(&files, "material.main.es.frag"));
    insta::assert_snapshot!("lit_plan", text(&files, "material.plan.json"));
}

#[test]
fn the_same_plan_gives_the_same_bytes() {
    let plan = plan("lit.wgsl", LIT);
    assert_eq!(emit_all(&plan), emit_all(&plan));
}

#[test]
fn other_compilers_take_every_target() {
    let sets: Vec<(String, Vec<File>)> = [("lit", LIT), ("everything", EVERYTHING)]
        .map(|(name, text)| {
            (
                name.to_owned(),
                emit_all(&plan(&format!("{name}.wgsl"), text)),
            )
        })
        .into();
    let judged = accept::accept(&sets);
    assert_eq!((judged.wgsl, judged.spirv, judged.glsl), (2, 4, 8));
}

#[test]
fn text_reads_like_an_authors() {
    let files = emit_all(&plan("everything.wgsl", EVERYTHING));
    insta::assert_snapshot!("everything_wgsl", text(&files, "material.main.wgsl"));
}

/// The name and the files of a material, as `accept` takes them.
fn emitted(name: &str, text: &str, targets: &[Target]) -> (String, Vec<File>) {
    let files = emit::emit(&plan(name, text), targets, &emit::Options::default()).unwrap();
    (name.to_owned(), files)
}

const VS: &str = "@vertex fn vs() -> @builtin(position) vec4<f32> { return vec4(0.0); }\n";

#[test]
fn what_the_writer_loses_is_put_back() {
    let half = format!(
        "enable f16;\n{VS}@group(0) @binding(0) var<uniform> x: f32;\n\
         @fragment fn fs() -> @location(0) vec4<f32> {{ let h = f16(x); return vec4(f32(h * h)); }}"
    );
    let (_, files) = emitted("half.wgsl", &half, &[Target::Wgsl]);
    assert!(text(&files, "material.main.wgsl").contains("enable f16;\n"));

    let early = format!(
        "{VS}@fragment @early_depth_test(force) fn fs() -> @location(0) vec4<f32> {{ \
         return vec4(1.0); }}"
    );
    let (_, files) = emitted("early.wgsl", &early, &[Target::Wgsl]);
    assert!(
        text(&files, "material.main.wgsl").contains("@early_depth_test(force)\n@fragment\nfn fs(")
    );

    let diagnostics = format!(
        "diagnostic(off, derivative_uniformity);\n\
         {VS}@group(0) @binding(0) var t: texture_2d<f32>;\n@group(0) @binding(1) var s: sampler;\n\
         @fragment @diagnostic(warning, derivative_uniformity) fn fs(@location(0) uv: vec2<f32>) \
         -> @location(0) vec4<f32> {{ return vec4(1.0); }}"
    )
    .replace(
        "@builtin(position) vec4<f32> { return vec4(0.0); }",
        "V { return V(vec4(0.0), vec2(0.0)); }\nstruct V { \
         @builtin(position) p: vec4<f32>, @location(0) uv: vec2<f32> }",
    );
    let (name, files) = emitted("diagnostics.wgsl", &diagnostics, &[Target::Wgsl]);
    let written = text(&files, "material.main.wgsl");
    assert!(
        written.contains("\ndiagnostic(off, derivative_uniformity);\n"),
        "{written}"
    );
    assert!(
        written.contains("\n@diagnostic(warning, derivative_uniformity)\n@fragment\n"),
        "{written}"
    );
    accept::accept(&[(name, files)]);
}

#[test]
fn stages_that_a_pass_makes_are_under_the_authors_directives() {
    let text_in = format!("diagnostic(off, derivative_uniformity);\n{LIT}");
    let recipe = Recipe::parse(["visibility-buffer:budget=0.1"]).unwrap();
    let split = recipe
        .apply(&plan("directed.wgsl", &text_in), &Facts::default())
        .unwrap();
    let options = emit::Options::default();
    let files = emit::emit(&split, &[Target::Wgsl], &options).unwrap();
    for part in ["ids", "resolve"] {
        let written = text(&files, &format!("material.{part}.wgsl"));
        let directive = "\ndiagnostic(off, derivative_uniformity);\n";
        assert_eq!(written.matches(directive).count(), 1, "{written}");
    }
}

#[test]
fn a_deep_expression_can_be_read_again() {
    // Deeper than naga can parse as one expression, so written as statements.
    let mut body = "let a0 = x.a;\n".to_owned();
    for i in 1..400 {
        body.push_str(&format!("let a{i} = a{} * 0.5 + {i}.0;\n", i - 1));
    }
    let text_in = format!(
        "struct X {{ a: f32 }}\n@group(0) @binding(0) var<uniform> x: X;\n\
         {VS}@fragment fn fs() -> @location(0) vec4<f32> {{ {body} return vec4(a399); }}"
    );
    let parsed = front::parse(
        &[Source::new("deep.wgsl", &text_in)],
        &options::Options::default(),
    )
    .unwrap();
    // A pass may drop the author's names.
    let mut module = parsed.program.module().clone();
    for entry in &mut module.entry_points {
        entry.function.named_expressions.clear();
    }
    let program = parsed.program.with_module(module).unwrap();
    let plan = Plan::original(
        "material",
        program,
        "vs",
        Some("fs"),
        &MaterialState::default(),
    );
    let files = emit_all(&plan);
    for target in [Target::Glsl450, Target::GlslEs300] {
        let files = emit::emit(&plan, &[target], &emit::Options::default()).unwrap();
        let of = |f: &&files::File| f.name.ends_with(".vert") || f.name.ends_with(".frag");
        let texts: Vec<Source> = files
            .iter()
            .filter(of)
            .map(|f| Source::new(&f.name, String::from_utf8_lossy(&f.bytes)))
            .collect();
        let again = front::parse(&texts, &options::Options::default());
        again.unwrap_or_else(|e| panic!("{target:?}: {}", e.render(Color::Never)));
    }
    accept::accept(&[("deep".to_owned(), files)]);
}

/// A material of two GLSL stages, to be written anew.
fn from_glsl(vertex: &str, fragment: &str) -> Plan {
    let sources = [
        Source::new("m.vert", vertex),
        Source::new("m.frag", fragment),
    ];
    let parsed = front::parse(&sources, &options::Options::default())
        .unwrap_or_else(|e| panic!("{}", e.render(Color::Never)));
    Plan::original(
        "material",
        touched(&parsed.program),
        &parsed.vertex,
        parsed.fragment.as_deref(),
        &MaterialState::default(),
    )
}

#[test]
fn glsl_that_samples_where_invocations_part_is_wgsl_that_others_take() {
    let vertex = "#version 450
layout(location = 0) in vec3 p;
layout(location = 0) out vec2 uv;
void main() { uv = p.xy; gl_Position = vec4(p, 1.0); }
";
    let fragment = "#version 450
layout(location = 0) in vec2 uv;
layout(location = 0) out vec4 color;
layout(set = 0, binding = 0) uniform texture2D t;
layout(set = 0, binding = 1) uniform sampler s;
void main() {
    color = vec4(1.0);
    if (uv.x > 0.5) color = texture(sampler2D(t, s), uv);
}
";
    let files = emit_all(&from_glsl(vertex, fragment));
    let wgsl = text(&files, "material.main.wgsl");
    assert!(
        wgsl.contains("\ndiagnostic(off, derivative_uniformity);"),
        "{wgsl}"
    );
    accept::accept(&[("uniformity".to_owned(), files)]);
}

#[test]
fn a_constant_under_a_word_that_wgsl_reserves_is_renamed() {
    let vertex = "#version 450\nlayout(location=0) in vec3 p;\n\
                  void main() { gl_Position = vec4(p, 1.0); }\n";
    let fragment = "#version 450
layout(constant_id = 3) const int type = 2;
layout(location = 0) out vec4 color;
void main() { color = vec4(type == 1 ? 0.25 : 0.75); }
";
    let files = emit_all(&from_glsl(vertex, fragment));
    let wgsl = text(&files, "material.main.wgsl");
    assert!(wgsl.contains("@id(3) override type_0: i32 = 2i;"), "{wgsl}");
    accept::accept(&[("reserved".to_owned(), files)]);
}

#[test]
fn the_number_of_layers_is_asked_for_in_every_target() {
    let layers = format!(
        "@group(0) @binding(0) var t: texture_2d_array<f32>;\n\
         {VS}@fragment fn fs(@builtin(position) p: vec4<f32>) -> @location(0) vec4<f32> {{ \
         return textureLoad(t, vec2<i32>(p.xy) % vec2<i32>(textureDimensions(t)), \
         textureNumLayers(t) - 1u, 0); }}"
    );
    let (name, files) = emitted("layers.wgsl", &layers, &Target::GENERAL);
    accept::accept(&[(name, files)]);
}

#[test]
fn a_glsl_switch_that_falls_through_is_written_out() {
    let vertex = "#version 450\nlayout(location=0) in vec3 p;\n\
                  void main() { gl_Position = vec4(p, 1.0); }\n";
    let fragment = "#version 450
layout(location = 0) out vec4 color;
layout(set = 0, binding = 0) uniform U { int mode; } u;
void main() {
    float x = 0.0;
    switch (u.mode) {
        case 0: x += 1.0;
        case 1: case 2: x += 2.0; break;
        case 3: x += 4.0;
        default: x += 8.0;
    }
    color = vec4(x);
}
";
    let plan = from_glsl(vertex, fragment);
    let files = emit_all(&plan);
    insta::assert_snapshot!("glsl_switch_wgsl", text(&files, "material.main.wgsl"));
    accept::accept(&[("switch".to_owned(), files)]);
}

/// naga's writer numbers the function `n` as well as its local: neither takes the other's name.
#[test]
fn a_function_keeps_its_name_beside_a_local_that_is_called_the_same() {
    let vertex = "#version 450\nlayout(location=0) in vec3 p;\n\
                  void main() { gl_Position = vec4(p, 1.0); }\n";
    let fragment = "#version 450
layout(location = 0) out vec4 color;
float hash(float n) { return fract(n * 7.5); }
float n(vec3 x) {
    float n = x.x + x.y;
    return hash(n + 1.0) + n;
}
void main() { color = vec4(n(gl_FragCoord.xyz)); }
";
    let files = emit_all(&from_glsl(vertex, fragment));
    accept::accept(&[("shadowed".to_owned(), files)]);
}

/// A case in braces ends there: nothing is copied behind its `break`, where a call would be none
/// that naga knows of when the text is read again.
#[test]
fn a_case_in_braces_falls_into_nothing() {
    let vertex = "#version 450\nlayout(location=0) in vec3 p;\n\
                  void main() { gl_Position = vec4(p, 1.0); }\n";
    let fragment = "#version 450
layout(location = 0) out vec4 color;
layout(set = 0, binding = 0) uniform U { int mode; float x; } u;
float near(float x) { return fract(x * 3.0); }
float far(float x) { return fract(x * 5.0); }
void main() {
    color = vec4(0.0);
    switch (u.mode) {
        case 0: { color.x = near(u.x); break; }
        case 1: { if (u.x > 0.5) { color.y = 1.0; break; } else { return; } }
        case 2: { color.z = far(u.x); break; }
    }
}
";
    let files = emit_all(&from_glsl(vertex, fragment));
    let wgsl = text(&files, "material.main.wgsl");
    assert_eq!(wgsl.matches("= far(").count(), 1, "{wgsl}");
    accept::accept(&[("braces".to_owned(), files)]);
}

#[test]
fn a_depth_texture_that_is_loaded_from_holds_floats_in_glsl() {
    let depth = format!(
        "{VS}@group(0) @binding(0) var depth: texture_depth_2d;\n\
         fn far(p: vec2<i32>) -> bool {{ return textureLoad(depth, p, 0) >= 1.0; }}\n\
         @fragment fn fs(@builtin(position) p: vec4<f32>) {{ let at = vec2<i32>(p.xy); \
         if all(at < vec2<i32>(textureDimensions(depth))) && textureLoad(depth, at, 0) < p.z \
         && !far(at) {{ discard; }} }}"
    );
    let (name, files) = emitted("depth.wgsl", &depth, &Target::GENERAL);
    for file in ["material.main.frag", "material.main.es.frag"] {
        let text = text(&files, file);
        assert!(text.contains("sampler2D depth;"), "{text}");
        assert_eq!(text.matches("texelFetch(depth, ").count(), 2, "{text}");
    }
    assert!(text(&files, "material.main.wgsl").contains("texture_depth_2d"));
    accept::accept(&[(name, files)]);
}

#[test]
fn what_a_target_cannot_say_is_told_with_a_remedy() {
    let depth = format!(
        "{VS}@group(0) @binding(0) var depth: texture_depth_2d;\n\
         @group(0) @binding(1) var nearest: sampler;\n\
         @fragment fn fs(@builtin(position) p: vec4<f32>) {{ \
         if textureSampleLevel(depth, nearest, p.xy, 0) < p.z {{ discard; }} }}"
    );
    let plan = plan("depth.wgsl", &depth);
    for target in [Target::Glsl450, Target::GlslEs300] {
        let error = emit::emit(&plan, &[target], &emit::Options::default()).unwrap_err();
        assert!(
            matches!(error, emit::EmitError::Inexpressible { .. }),
            "{error}"
        );
        insta::assert_snapshot!(format!("depth_{target}"), error.to_string());
    }
    let rest = emit::emit(
        &plan,
        &[Target::Wgsl, Target::Spirv],
        &emit::Options::default(),
    )
    .unwrap();
    accept::accept(&[("depth".to_owned(), rest)]);
}

#[test]
fn overrides_stay_in_wgsl_are_constants_in_spirv_and_take_their_default_in_glsl() {
    let with = |init: &str| {
        format!(
            "override level: f32{init};\n{VS}@fragment fn fs() -> @location(0) vec4<f32> {{ \
             return vec4(level); }}"
        )
    };
    let (name, files) = emitted("o.wgsl", &with(" = 0.75"), &Target::GENERAL);
    assert!(text(&files, "material.main.wgsl").contains("override level: f32 = 0.75f;"));
    assert!(text(&files, "material.main.frag").contains("0.75"));
    // Where the text has the value, the plan says so; the vertex stage reads none.
    let plan_json: serde_json::Value =
        serde_json::from_str(text(&files, "material.plan.json")).unwrap();
    let stages = &plan_json["files"][0];
    let baked = serde_json::json!({ "level": 0.75 });
    for target in ["glsl", "glsl-es"] {
        assert_eq!(stages["fragment"][target]["overrides"], baked, "{target}");
        assert!(stages["vertex"][target]["file"].is_string(), "{target}");
        assert!(stages["vertex"][target]["overrides"].is_null(), "{target}");
    }
    let constant = serde_json::json!({ "id": 0, "name": "level", "type": "f32", "default": 0.75 });
    let spirv = &stages["fragment"]["spirv"];
    assert_eq!(spirv["constants"], serde_json::json!({ "level": constant }));
    assert!(spirv["overrides"].is_null());
    assert!(stages["vertex"]["spirv"]["constants"].is_null());
    assert!(stages["fragment"]["wgsl"]["overrides"].is_null());
    accept::accept(&[(name, files)]);
    // A host must set it.
    let plan = plan("o.wgsl", &with(""));
    let error = emit::emit(&plan, &[Target::Glsl450], &emit::Options::default()).unwrap_err();
    assert!(
        error
            .to_string()
            .contains("the override `level` has no default")
    );
    let files = emit::emit(&plan, &[Target::Spirv], &emit::Options::default()).unwrap();
    let json = text(&files, "material.plan.json");
    assert!(
        json.contains("\"level\"") && !json.contains("default\": 0"),
        "{json}"
    );
    accept::accept(&[("a constant without default".to_owned(), files)]);
}

#[test]
fn a_gather_from_a_depth_texture_is_written_in_spirv() {
    let source = format!(
        "@group(0) @binding(0) var depth: texture_depth_2d;
         @group(0) @binding(1) var nearest: sampler;
         {VS}@fragment fn fs(@builtin(position) p: vec4<f32>) -> @location(0) vec4<f32> {{
             return textureGather(depth, nearest, p.xy);
         }}"
    );
    let (name, files) = emitted("g.wgsl", &source, &[Target::Spirv]);
    // Only its interface can be compared.
    assert!(text(&files, "material.plan.json").contains("textureGather of a depth texture"));
    assert_eq!(accept::accept(&[(name, files)]).spirv, 2);
}

#[test]
fn each_form_of_override_is_a_constant_or_told() {
    let source = format!(
        "override on: bool = true;
         @id(0) override steps: u32 = 4;
         @id(7) override scale: f32 = 2.0;
         override twice: f32 = scale * 2.0 + select(0.0, 1.0, on);
         override start: f32 = 0.5;
         override chance: i32 = -1;
         var<private> state: f32 = start;
         fn sum(base: f32) -> f32 {{
             var total = twice + base;
             for (var i = 0u; i < steps; i++) {{ var own = scale; total += own * f32(i); }}
             return total;
         }}
         {VS}@fragment fn fs(@builtin(position) p: vec4<f32>) -> @location(0) vec4<f32> {{
             state += p.x;
             var v = vec2(scale, f32(chance));
             if on && chance > 0 {{ return vec4(v, sum(state), twice); }}
             return vec4(sum(p.y), start, v);
         }}"
    );
    let (name, files) = emitted("c.wgsl", &source, &Target::GENERAL);
    let json: serde_json::Value = serde_json::from_str(text(&files, "material.plan.json")).unwrap();
    let spirv = &json["files"][0]["fragment"]["spirv"];
    // The lowest free ids go to those without one, and what an initialiser needs stays as it is.
    let ids = |key: &str| spirv["constants"][key]["id"].as_u64();
    let keys = ["0", "7", "on", "chance", "twice", "start"];
    assert_eq!(
        keys.map(ids),
        [Some(0), Some(7), Some(1), Some(4), None, None]
    );
    assert_eq!(spirv["overrides"], serde_json::json!({ "start": 0.5 }));
    let notes = json["notes"].to_string();
    assert!(notes.contains("computes the override `twice`"), "{notes}");
    accept::accept(&[(name, files)]);
}

#[test]
fn invariant_positions_are_not_contracted_in_spirv() {
    // Decoration 42, NoContraction, of some id: OpDecorate has opcode 71 and here 3 words.
    let decorations = |text: &str| {
        let (_, files) = emitted("m.wgsl", text, &[Target::Spirv]);
        let file = files
            .iter()
            .find(|f| f.name.ends_with(".vert.spv"))
            .unwrap();
        let words: Vec<u32> = file
            .bytes
            .chunks(4)
            .map(|c| u32::from_le_bytes(c.try_into().unwrap()))
            .collect();
        words
            .windows(3)
            .filter(|w| w[0] == (3 << 16 | 71) && w[2] == 42)
            .count()
    };
    let text = |attribute: &str| {
        format!(
            "@vertex fn vs(@location(0) p: vec3<f32>) -> {attribute} \
             @builtin(position) vec4<f32> {{ return vec4(p * 2.0 + 1.0, 1.0); }}"
        )
    };
    assert_eq!(decorations(&text("")), 0);
    // The product and the sum.
    assert_eq!(decorations(&text("@invariant")), 2);

    // What another output is made of is left alone: by a struct's member, through a variable, or
    // out of a function.
    let struct_ = "struct Out { @invariant @builtin(position) clip: vec4<f32>, \
                   @location(0) light: vec4<f32> }\n";
    let of = |body: &str| {
        decorations(&format!(
            "{struct_}@vertex fn vs(@location(0) p: vec4<f32>) -> Out {{ {body} }}\n"
        ))
    };
    assert_eq!(of("return Out(p * 2.0, p * 3.0 + p * 4.0);"), 1);
    assert_eq!(
        of(
            "var out: Out; out.light = p * 3.0 + p; out.clip = p * 2.0; out.light += p; return out;"
        ),
        1
    );
    assert_eq!(
        of("var out = Out(p, p * 3.0); if p.x * p.y > 1.0 { out.clip = p - p.yxwz; } return out;"),
        // The condition and the difference.
        2
    );
    // Through a pointer, a loop and an index the walk takes in what it must.
    let through = format!(
        "{struct_}fn grow(v: ptr<function, vec4<f32>>, by: f32) {{ *v = *v * by; }}\n\
         fn shade(v: vec4<f32>) -> vec4<f32> {{ return v * 5.0 + v; }}\n\
         @vertex fn vs(@location(0) p: vec4<f32>) -> Out {{\n\
             var steps = array<vec4<f32>, 2>(p + p.x, p - p.y);\n\
             var at = p;\n\
             for (var i = 0; i < 2; i++) {{ at += steps[i]; grow(&at, p.z / 2.0); }}\n\
             return Out(at, shade(p));\n\
         }}\n"
    );
    // The two steps, the sum, the product in `grow` and its factor; not `shade`.
    assert_eq!(decorations(&through), 5);
}

#[test]
fn writing_is_atomic_and_leaves_equal_files_alone() {
    let dir = std::path::Path::new(env!("CARGO_TARGET_TMPDIR"))
        .join(format!("write-{}", std::process::id()));
    let file = |name: &str, bytes: &str| File {
        name: name.to_owned(),
        bytes: bytes.into(),
    };
    let changed = shader_text::files::write(&dir, &[file("a", "1"), file("b", "2")]).unwrap();
    assert_eq!(changed, [dir.join("a"), dir.join("b")]);
    let changed = shader_text::files::write(&dir, &[file("a", "1"), file("b", "3")]).unwrap();
    assert_eq!(changed, [dir.join("b")]);
    // `c` is a folder: nothing is written, `a` included, and no temporary file stays.
    std::fs::create_dir(dir.join("c")).unwrap();
    let error = shader_text::files::write(&dir, &[file("a", "new"), file("c", "x")]).unwrap_err();
    assert!(error.to_string().contains("c"), "{error}");
    assert_eq!(std::fs::read_to_string(dir.join("a")).unwrap(), "1");
    let mut names: Vec<_> = std::fs::read_dir(&dir)
        .unwrap()
        .map(|e| e.unwrap().file_name())
        .collect();
    names.sort();
    assert_eq!(names, ["a", "b", "c"]);
    std::fs::remove_dir_all(&dir).unwrap();
}

/// Inputs, outputs, a global that a helper shares, an early return, a discard, a matrix output
/// through a struct.
const GLSL_VERTEX: &str = include_str!("../materials/everything.vert");
const GLSL_FRAGMENT: &str = include_str!("../materials/everything.frag");

#[test]
fn glsl_reads_like_an_authors_wgsl() {
    let sources = [
        Source::new("m.vert", GLSL_VERTEX),
        Source::new("m.frag", GLSL_FRAGMENT),
    ];
    let parsed = front::parse(&sources, &options::Options::default())
        .unwrap_or_else(|e| panic!("{}", e.render(Color::Never)));
    let plan = Plan::original(
        "material",
        touched(&parsed.program),
        &parsed.vertex,
        parsed.fragment.as_deref(),
        &MaterialState::default(),
    );
    let files = emit_all(&plan);
    insta::assert_snapshot!("glsl_wgsl", text(&files, "material.main.wgsl"));
    accept::accept(&[("glsl".to_owned(), files)]);
}

/// A plan that draws one program twice, once without its fragment stage, and with another fragment
/// stage in a third pass.
fn three_passes() -> Plan {
    let text = format!(
        "{LIT}@fragment fn fs_depth(in: Varyings) {{ if textureSample(albedo, linear_sampler, \
         in.uv0).a < 0.5 {{ discard; }} }}\nfn unused() -> f32 {{ return 1.0; }}\n"
    );
    let options = options::Options {
        fragment: Some("fs_main".to_owned()),
        ..shader_text::options::Options::default()
    };
    let parsed = front::parse(&[Source::new("lit.wgsl", &text)], &options).unwrap();
    let mut plan = Plan::original(
        "lit",
        touched(&parsed.program),
        &parsed.vertex,
        parsed.fragment.as_deref(),
        &MaterialState::default(),
    );
    let mut prepass = plan.passes[0].clone();
    prepass.role = Role::Prepass;
    prepass.fragment = Some("fs_depth".to_owned());
    let mut shadow = plan.passes[0].clone();
    shadow.role = Role::Shadow;
    shadow.fragment = None;
    plan.passes.insert(0, prepass);
    plan.passes.insert(0, shadow);
    plan
}

#[test]
fn passes_that_share_a_program_share_its_files() {
    let plan = three_passes();
    let files = emit_all(&plan);
    let names: Vec<&str> = files.iter().map(|f| f.name.as_str()).collect();
    assert_eq!(
        names,
        [
            "lit.main.wgsl",
            "lit.main.vert.spv",
            "lit.main.fs_depth.frag.spv",
            "lit.main.fs_main.frag.spv",
            "lit.main.vert",
            "lit.main.fs_depth.frag",
            "lit.main.fs_main.frag",
            "lit.main.es.vert",
            "lit.main.fs_depth.es.frag",
            "lit.main.fs_main.es.frag",
            "lit.shadow.es.frag",
            "lit.plan.json",
        ]
    );
    assert!(!text(&files, "lit.main.wgsl").contains("unused"));
    let plan_file: plan_file::PlanFile =
        serde_json::from_str(text(&files, "lit.plan.json")).unwrap();
    assert_eq!(plan_file.plan.passes, plan.passes);
    let of = |pass: usize, target| {
        let files = &plan_file.files[pass];
        (
            files.vertex[&target].file.clone(),
            files.fragment.get(&target).map(|f| f.file.clone()),
        )
    };
    assert_eq!(of(0, Target::Spirv), ("lit.main.vert.spv".to_owned(), None));
    assert_eq!(
        of(1, Target::Glsl450),
        (
            "lit.main.vert".to_owned(),
            Some("lit.main.fs_depth.frag".to_owned())
        )
    );
    assert_eq!(
        of(2, Target::Wgsl),
        ("lit.main.wgsl".to_owned(), Some("lit.main.wgsl".to_owned()))
    );
    accept::accept(&[("three passes".to_owned(), files)]);
}

#[test]
fn a_broken_plan_is_told_as_our_bug() {
    let mut plan = three_passes();
    plan.passes[0].vertex = "nowhere".to_owned();
    let error = emit::emit(&plan, &[Target::Wgsl], &emit::Options::default()).unwrap_err();
    assert!(
        matches!(error, emit::EmitError::BrokenPlan { .. }),
        "{error}"
    );
}

#[test]
fn a_pass_without_its_program_is_told_as_our_bug() {
    let mut plan = three_passes();
    plan.passes[0].program = "nothing".to_owned();
    let error = emit::emit(&plan, &[Target::Wgsl], &emit::Options::default()).unwrap_err();
    assert!(
        matches!(error, emit::EmitError::BrokenPlan { .. }),
        "{error}"
    );
}

#[test]
fn names_that_the_host_holds_on_to_are_kept() {
    let text_in = "override level_: f32 = 1.0;
@id(3) override 强度: f32 = 2.0;
fn f1(x1: f32) -> f32 { return x1; }
@vertex fn vs_1() -> @builtin(position) vec4<f32> { return vec4(level_); }
@fragment fn naïve_() -> @location(0) vec4<f32> { return vec4(f1(强度)); }
";
    let (name, files) = emitted("names.wgsl", text_in, &[Target::Wgsl]);
    let written = text(&files, "material.main.wgsl");
    for item in [
        "override level_: f32",
        "@id(3) override 强度: f32",
        "fn f1(x1: f32)",
        "fn vs_1()",
        "fn naïve_()",
    ] {
        assert!(written.contains(item), "{item}\n{written}");
    }
    accept::accept(&[(name, files)]);
}

#[test]
fn an_untouched_program_ships_as_its_author_wrote_it() {
    let source = format!("// The author's comment.\n{VS}");
    let parsed = front::parse(
        &[Source::new("plain.wgsl", &source)],
        &options::Options::default(),
    )
    .unwrap();
    let plan = Plan::original(
        "plain",
        parsed.program,
        &parsed.vertex,
        None,
        &MaterialState::default(),
    );
    assert_eq!(text(&emit_all(&plan), "plain.main.wgsl"), source);
}

#[test]
fn a_pass_names_the_features_it_needs() {
    let half = format!(
        "enable f16;\n{VS}@group(0) @binding(0) var<uniform> x: f32;\n\
         @fragment fn fs() -> @location(0) vec4<f32> {{ return vec4(f32(f16(x))); }}"
    );
    let parsed = front::parse(
        &[Source::new("half.wgsl", &half)],
        &options::Options::default(),
    )
    .unwrap();
    let mut state = MaterialState::default();
    state.primitive.unclipped_depth = true;
    let plan = Plan::original(
        "half",
        parsed.program,
        &parsed.vertex,
        parsed.fragment.as_deref(),
        &state,
    );
    assert_eq!(
        plan.passes[0].features,
        ["depth-clip-control", "shader-f16"]
    );
}

#[test]
fn a_pass_names_the_limits_it_needs_raised() {
    let mut source = String::new();
    let mut reads = String::new();
    for i in 0..17 {
        source.push_str(&format!(
            "@group(5) @binding({i}) var t{i}: texture_2d<f32>;\n"
        ));
        reads.push_str(&format!(" + textureLoad(t{i}, vec2<i32>(0), 0)"));
    }
    source.push_str(
        "@group(0) @binding(0) var<uniform> table: array<vec4<f32>, 5000>;
@group(0) @binding(1000) var<uniform> last: vec4<f32>;
@vertex fn vs(@location(16) p: vec4<f32>) -> @builtin(position) vec4<f32> { return p; }
struct Out { @location(0) a: vec4<f32>, @location(1) b: vec4<f32>, @location(2) c: vec4<f32> }
",
    );
    source.push_str(&format!(
        "@fragment fn fs() -> Out {{ let a = table[1] + last{reads}; return Out(a, a, a); }}"
    ));
    let parsed = front::parse(
        &[Source::new("dear.wgsl", &source)],
        &options::Options::default(),
    )
    .unwrap();
    let target = || Some(ColorTarget::opaque("rgba32float"));
    let state = MaterialState {
        targets: vec![target(), target(), target()],
        ..MaterialState::default()
    };
    let plan = Plan::original("dear", parsed.program, "vs", Some("fs"), &state);
    let limits: Vec<(&str, u64)> = plan.passes[0]
        .limits
        .iter()
        .map(|(name, value)| (name.as_str(), *value))
        .collect();
    assert_eq!(
        limits,
        [
            ("maxBindGroups", 6),
            ("maxBindingsPerBindGroup", 1001),
            ("maxColorAttachmentBytesPerSample", 48),
            ("maxSampledTexturesPerShaderStage", 17),
            ("maxUniformBufferBindingSize", 80_000),
            ("maxVertexAttributes", 17),
        ]
    );
}
