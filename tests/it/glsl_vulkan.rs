//! GLSL for Vulkan: what WebGPU can say is read, and the rest is refused by its name.

use preshade_compiler::emit;
use preshade_compiler::front::{self, Parsed, Source};
use preshade_compiler::recipe::Recipe;
use preshade_plan::pass::Facts;
use preshade_plan::plan::Plan;
use preshade_plan::plan_file::Target;
use preshade_plan::state::MaterialState;
use shader_text::error::{Code, Color};
use shader_text::options::Options;

const VERTEX: &str = "#version 460
layout(location = 0) in vec4 p;
layout(location = 0) out vec2 uv;
void main() { uv = p.xy; gl_Position = p; }
";

fn sources(vertex: &str, fragment: &str) -> [Source; 2] {
    [
        Source::new("a.vert", vertex),
        Source::new("a.frag", fragment),
    ]
}

/// A fragment stage with these declarations and this body.
fn fragment(declared: &str, body: &str) -> String {
    format!(
        "#version 460
#extension GL_EXT_example : require
layout(location = 0) in vec2 uv;
layout(location = 0) out vec4 c;
{declared}
void main() {{
    {body}
}}
"
    )
}

fn read(vertex: &str, fragment: &str) -> Parsed {
    front::parse(&sources(vertex, fragment), &Options::default())
        .unwrap_or_else(|e| panic!("{}", e.render(Color::Never)))
}

fn plan(parsed: Parsed) -> Plan {
    let fragment = parsed.fragment.as_deref();
    let state = MaterialState::default();
    Plan::original("m", parsed.program, &parsed.vertex, fragment, &state)
}

/// The files of a target, `plan.json` excluded. Emission has read them back.
fn written(plan: &Plan, target: Target) -> String {
    let files = emit::emit(plan, &[target], &emit::Options::default())
        .unwrap_or_else(|e| panic!("{target:?}: {e}"));
    let texts = files.iter().filter(|f| !f.name.ends_with(".json"));
    texts
        .map(|f| String::from_utf8_lossy(&f.bytes).into_owned())
        .collect()
}

/// The fragment stage as SPIR-V.
fn fragment_words(plan: &Plan) -> Vec<u8> {
    let files = emit::emit(plan, &[Target::Spirv], &emit::Options::default()).unwrap();
    let mut files = files.into_iter();
    let fragment = files.find(|f| f.name.ends_with(".frag.spv"));
    fragment.unwrap().bytes
}

fn wgsl(vertex: &str, fragment: &str) -> String {
    written(&plan(read(vertex, fragment)), Target::Wgsl)
}

/// Every kind of name that the grammar lacks, or the library.
#[test]
fn what_webgpu_lacks_is_refused_by_name() {
    let buffer = "layout(binding = 1) buffer B { uint n; uint many[]; } b;";
    for (name, declared, body) in [
        (
            "input_attachment_index",
            "layout(input_attachment_index = 0, binding = 0) uniform subpassInput g;",
            "c = vec4(0.0);",
        ),
        (
            "accelerationStructureEXT",
            "layout(binding = 0) uniform accelerationStructureEXT scene;",
            "c = vec4(0.0);",
        ),
        ("rayQueryEXT", "", "rayQueryEXT q; c = vec4(0.0);"),
        (
            "buffer_reference",
            "layout(buffer_reference, std430) buffer Node { vec4 color; };",
            "c = vec4(0.0);",
        ),
        ("int64_t", "", "int64_t n = int64_t(3); c = vec4(float(n));"),
        ("u16vec2", "", "c = vec4(u16vec2(1).x);"),
        ("`0x11S`", "", "c = vec4(0x11S);"),
        (
            "f16sampler2D",
            "layout(binding = 0) uniform f16sampler2D t;",
            "c = vec4(0.0);",
        ),
        (
            "textureBuffer",
            "layout(binding = 0) uniform textureBuffer t;",
            "c = vec4(0.0);",
        ),
        (
            "gl_ShadingRateEXT",
            "",
            "gl_ShadingRateEXT = 1; c = vec4(0.0);",
        ),
        (
            "pervertexEXT",
            "layout(location = 1) pervertexEXT in vec3 n[];",
            "c = vec4(n[0], 1.0);",
        ),
        (
            "coopmat",
            "",
            "coopmat<float, 3, 16, 8, 0> m; c = vec4(0.0);",
        ),
        (
            "atomicCompSwap",
            buffer,
            "c = vec4(atomicCompSwap(b.n, 1u, 2u));",
        ),
        (
            "imageAtomicAdd",
            "layout(binding = 0, r32ui) uniform uimage2D i;",
            "c = vec4(imageAtomicAdd(i, ivec2(0), 1u));",
        ),
        (
            "sparseTextureARB",
            "layout(binding = 0) uniform sampler2D t;",
            "c = vec4(0.0); int r = sparseTextureARB(t, uv, c);",
        ),
        ("clockARB", "", "c = vec4(clockARB());"),
        ("gl_DeviceIndex", "", "c = vec4(gl_DeviceIndex);"),
        (
            "gl_HelperInvocation",
            "",
            "c = vec4(gl_HelperInvocation ? 1.0 : 0.0);",
        ),
        ("gl_PointCoord", "", "c = gl_PointCoord.xyxy;"),
        (
            "interpolateAtCentroid",
            "",
            "c = interpolateAtCentroid(uv).xyxy;",
        ),
        (
            "beginInvocationInterlockARB",
            "",
            "beginInvocationInterlockARB(); c = vec4(0.0);",
        ),
        (
            "pixel_interlock_ordered",
            "layout(pixel_interlock_ordered) in;",
            "c = vec4(0.0);",
        ),
        ("subgroupElect", "", "c = vec4(subgroupElect());"),
        (
            "spirv_instruction",
            "spirv_instruction(set = \"x\", id = 1) float f(float x);",
            "c = vec4(f(1.0));",
        ),
    ] {
        let text = fragment(declared, body);
        let error = front::parse(&sources(VERTEX, &text), &Options::default()).unwrap_err();
        let shown = error.render(Color::Never);
        assert_eq!(error.code(), Code::Unsupported, "{name}: {shown}");
        let name = name.trim_matches('`');
        let message = format!("`{name}` is not supported: ");
        assert!(error.message().starts_with(&message), "{name}: {shown}");
        assert!(!error.notes().is_empty(), "{name}: {shown}");
        let line = text.lines().position(|l| l.contains(name)).unwrap() + 1;
        assert_eq!(
            error.location().map(|l| l.line as usize),
            Some(line),
            "{name}: {shown}"
        );
    }
}

/// An author may use these names, and what `main` does not reach may use anything.
#[test]
fn names_of_extensions_are_no_keywords() {
    let text = fragment(
        "float atomicAdd(float x) { return x + 1.0; }
struct hitObjectNV2 { float x; };
float unused() { rayQueryEXT q; return float(int64_t(2)); }",
        "float buffer_reference = atomicAdd(1.0); hitObjectNV2 h; h.x = buffer_reference; \
         c = vec4(h.x);",
    );
    read(VERTEX, &text);
}

#[test]
fn what_changes_no_value_is_dropped() {
    let text = fragment(
        "layout(early_fragment_tests) in;
layout(binding = 0) uniform sampler2D t[2];
layout(location = 1) flat in int which;
int count = 0;",
        "int n = nonuniformEXT(which);
    debugPrintfEXT(\"which is %d at %f\", count++, uv.x);
    [[unroll, dependency_infinite]] for (int i = 0; i < 2; i++) n += i;
    [[flatten]] if (uv.x < 0.0) demote;
    c = texture(t[0], uv) * float(n + count);",
    );
    let vertex = VERTEX.replace(
        "void main() {",
        "layout(location = 1) flat out int which;\nvoid main() { which = 1;",
    );
    let parsed = read(&vertex, &text);
    let notes = parsed.program.declared().notes.join("\n");
    assert!(
        notes.contains("`debugPrintfEXT` is") && notes.contains("`nonuniformEXT` is"),
        "{notes}"
    );
    let wgsl = written(&plan(parsed), Target::Wgsl);
    assert!(wgsl.contains("discard;"), "{wgsl}");
    // The arguments of what is printed are evaluated still.
    assert!(wgsl.contains("+ 1i"), "{wgsl}");
    let error = front::parse(
        &sources(VERTEX, &fragment("", "c = vec4(\"text\");")),
        &Options::default(),
    );
    assert_eq!(error.unwrap_err().code(), Code::Parse);
}

/// The parser knows GLSL ES 3.10's images as types of an extension only.
#[test]
fn images_of_es_are_images() {
    let text = "#version 310 es
precision highp float;
layout(binding = 0, rgba32f) uniform readonly highp image2D i;
layout(location = 0) out vec4 c;
void main() { c = imageLoad(i, ivec2(0)); }
";
    let wgsl = wgsl(
        "#version 310 es\nvoid main() { gl_Position = vec4(0.0); }",
        text,
    );
    assert!(wgsl.contains("texture_storage_2d<rgba32float"), "{wgsl}");
}

#[test]
fn a_storage_block_that_nothing_writes_is_read_only() {
    let vertex = "#version 450
layout(location = 0) in vec3 p;
layout(std430, binding = 0) buffer I { mat4 model[]; };
layout(location = 0) out vec2 uv;
void main() { uv = p.xy; gl_Position = model[gl_InstanceIndex] * vec4(p, 1.0); }
";
    let written = fragment(
        "layout(std430, binding = 1) buffer O { vec4 last; float all[]; } o;",
        "o.all[1] = uv.x; c = o.last;",
    );
    let wgsl = wgsl(vertex, &written);
    let declared = |binding: u32| {
        let mark = format!("@binding({binding})");
        let line = wgsl.lines().find(|l| l.contains(&mark));
        line.unwrap_or_else(|| panic!("{wgsl}"))
    };
    assert!(!declared(0).contains("read_write"), "{wgsl}");
    assert!(declared(1).contains("read_write"), "{wgsl}");
}

#[test]
fn the_longer_declaration_of_a_block_holds_for_both_stages() {
    for block in [
        "layout(set = 0, binding = 0) uniform",
        "layout(push_constant) uniform",
    ] {
        let short = format!("{block} Short {{ mat4 m; vec4 a; }} u;");
        let long = format!("{block} Long {{ mat4 matrix; vec4 tint; vec4 more; }} u;");
        let vertex = |declared: &str, member: &str| {
            VERTEX
                .replace("void main", &format!("{declared}\nvoid main"))
                .replace("gl_Position = p", &format!("gl_Position = u.{member} * p"))
        };
        for (vertex, fragment) in [
            (vertex(&short, "m"), fragment(&long, "c = u.tint + u.more;")),
            (vertex(&long, "matrix"), fragment(&short, "c = u.a;")),
        ] {
            let plan = plan(read(&vertex, &fragment));
            let module = plan.program(&plan.passes[0]).unwrap().module();
            let blocks: Vec<usize> = module
                .types
                .iter()
                .filter_map(|(_, ty)| match &ty.inner {
                    naga::TypeInner::Struct { members, .. }
                        if members.iter().all(|m| m.binding.is_none()) =>
                    {
                        Some(members.len())
                    }
                    _ => None,
                })
                .collect();
            // Vulkan gives each stage a range of push constants, which has its own part only.
            let expected: &[usize] = match block.contains("push_constant") {
                true => &[2, 3],
                false => &[3],
            };
            let mut blocks = blocks;
            blocks.sort_unstable();
            assert_eq!(blocks, expected, "{block}");
            for target in [Target::Wgsl, Target::Spirv, Target::Glsl450] {
                written(&plan, target);
            }
        }
        // Another type at one offset stays an error, but for push constants: each stage has its own
        // view of them.
        let other = long.replace("vec4 tint", "ivec4 tint");
        let text = fragment(&other, "c = u.more;");
        let read = front::parse(&sources(&vertex(&short, "m"), &text), &Options::default());
        match block.contains("push_constant") {
            true => assert!(read.is_ok(), "{:?}", read.err()),
            false => assert_eq!(read.unwrap_err().code(), Code::Link),
        }
    }
}

#[test]
fn a_specialisation_constant_gives_its_default_to_what_must_be_fixed() {
    let text = fragment(
        "layout(constant_id = 7) const int TAPS = 4;
layout(constant_id = 2) const float SCALE = 2.0;
const int TWICE = TAPS * 2;
layout(binding = 0) uniform W { vec4 weights[TWICE]; };",
        "float local[TAPS]; local[0] = uv.x; c = vec4(0.0);
    for (int i = 0; i < TAPS; i++) c += weights[i] * local[0] * SCALE;
    switch (int(uv.y)) { case TAPS: c.x = 1.0; }",
    );
    let parsed = read(VERTEX, &text);
    let module = parsed.program.module();
    // A loop of another length than the array would be wrong, so it is no override at all.
    let overrides = module.overrides.iter().map(|(_, o)| o.name.as_deref());
    assert_eq!(overrides.collect::<Vec<_>>(), [Some("SCALE")]);
    let notes = parsed.program.declared().notes.join("\n");
    assert!(
        notes.contains("specialisation constant 7, `TAPS`"),
        "{notes}"
    );
    assert!(!notes.contains("SCALE"), "{notes}");
    let wgsl = written(&plan(parsed), Target::Wgsl);
    assert!(
        wgsl.contains("array<vec4<f32>, 8>") && wgsl.contains("case 4"),
        "{wgsl}"
    );
}

/// Where the author asks for the value first, a default that an operation does not take is no error:
/// in no target, and not when a pipeline is made.
#[test]
fn a_specialisation_constant_may_have_a_default_that_a_guarded_operation_does_not_take() {
    let text = fragment(
        "layout(constant_id = 3) const int TAPS = 0;
layout(constant_id = 4) const float RADIUS = 0.0;
layout(constant_id = 5) const int BITS = 40;
layout(binding = 0) uniform U { ivec4 K; };",
        "c = vec4(uv, 0.0, 1.0);
    if (TAPS > 0) { c.x = float(K.x / TAPS) + float(K.y % TAPS); }
    if (RADIUS > 0.0) { c.y = 1.0 / RADIUS + log(RADIUS) + inversesqrt(RADIUS); }
    if (BITS < 32) { c.z = float(K.y >> BITS) + float(1 << BITS) + float(bitfieldExtract(K.z, 0, BITS)); }
    c.w = clamp(c.x, 1.0, RADIUS) + smoothstep(0.0, RADIUS, uv.x);",
    );
    let plan = plan(read(VERTEX, &text));
    for target in [Target::Glsl450, Target::GlslVulkan, Target::Spirv] {
        written(&plan, target);
    }
    let wgsl = written(&plan, Target::Wgsl);
    let module = naga::front::wgsl::parse_str(&wgsl).unwrap();
    let flags = naga::valid::ValidationFlags::all();
    let info = naga::valid::Validator::new(flags, naga::valid::Capabilities::all());
    let info = { info }.validate(&module).unwrap();
    for (taps, radius, bits) in [(0.0, 0.0, 40.0), (3.0, 0.5, 4.0)] {
        let values = [("3", taps), ("4", radius), ("5", bits)];
        let values = values
            .map(|(id, value)| (id.to_owned(), value))
            .into_iter()
            .collect();
        let stage = Some((naga::ShaderStage::Fragment, "fragment_main"));
        naga::back::pipeline_constants::process_overrides(&module, &info, stage, &values)
            .unwrap_or_else(|e| panic!("{values:?}: {e}\n{wgsl}"));
    }
}

/// The constants, array lengths, and where they are, of a module.
fn spec_lengths(words: &[u8]) -> Vec<String> {
    use rspirv::dr::Operand;
    use rspirv::spirv::{Decoration, Op};
    let module = rspirv::dr::load_bytes(words).unwrap();
    let spec_id = |id: u32| {
        let mut all = module.annotations.iter();
        all.find_map(|i| match i.operands.as_slice() {
            [
                Operand::IdRef(of),
                Operand::Decoration(Decoration::SpecId),
                Operand::LiteralBit32(n),
            ] if *of == id => Some(*n),
            _ => None,
        })
    };
    let types = module.types_global_values.iter();
    let arrays = types.filter(|i| i.class.opcode == Op::TypeArray);
    let mut out: Vec<String> = arrays
        .map(|i| match i.operands[1].id_ref_any().and_then(spec_id) {
            Some(id) => format!("constant {id}"),
            None => "fixed".to_owned(),
        })
        .collect();
    out.sort();
    out
}

const LENGTHS: &str = "layout(constant_id = 7) const int TAPS = 4;
layout(constant_id = 8) const uint LIGHTS = 2u;
struct Light { vec4 color; float at; };
layout(binding = 0) uniform W {
    vec4 weights[TAPS];
    float narrow[TAPS];
    Light lights[LIGHTS];
    vec4 four[4];
    vec4 after;
};";

/// Only Vulkan's languages have such arrays. In others a loop over the constant would leave them.
#[test]
fn a_specialisation_constant_gives_the_length_of_arrays() {
    let text = fragment(
        LENGTHS,
        "c = after;
    for (int i = 0; i < weights.length(); i++) c += weights[i] * narrow[i] * four[i & 3];
    for (uint i = 0u; i < LIGHTS; i++) c += lights[i].color * lights[i].at;",
    );
    let parsed = read(VERTEX, &text);
    let declared = parsed.program.declared();
    let named: Vec<&str> = declared.lengths.iter().map(|l| l.own.as_str()).collect();
    assert_eq!(named, ["TAPS", "LIGHTS"]);
    let notes = declared.notes.join("\n");
    assert!(!notes.contains("final"), "{notes}");
    let plan = plan(parsed);
    let glsl = written(&plan, Target::GlslVulkan);
    for wanted in [
        "layout(constant_id = 7) const int TAPS = 4;",
        "layout(constant_id = 8) const uint LIGHTS = 2u;",
        "vec4 weights[TAPS];",
        "[TAPS];",
        "lights[LIGHTS];",
        "vec4 four[4];",
    ] {
        assert!(glsl.contains(wanted), "{wanted}\n{glsl}");
    }
    let words = fragment_words(&plan);
    assert_eq!(spec_lengths(&words), ["constant 7", "constant 8", "fixed"]);
    let wgsl = written(&plan, Target::Wgsl);
    assert!(!wgsl.contains("override"), "{wgsl}");
    let files = emit::emit(&plan, &[Target::Wgsl], &emit::Options::default()).unwrap();
    let json = files
        .iter()
        .find(|f| f.name.ends_with("plan.json"))
        .unwrap();
    let json = String::from_utf8_lossy(&json.bytes);
    assert!(
        json.contains("`TAPS`, gives the length of an array"),
        "{json}"
    );
}

/// naga initialises a local array, for which GLSL has no words if a constant gives the length.
#[test]
fn a_local_array_has_the_length_of_its_constant_in_spirv() {
    let text = fragment(
        "layout(constant_id = 7) const int TAPS = 4;
float sum(float of[TAPS]) { float s = 0.0; for (int i = 0; i < TAPS; i++) s += of[i]; return s; }",
        "float local[TAPS]; for (int i = 0; i < TAPS; i++) local[i] = uv.x; c = vec4(sum(local));",
    );
    let plan = plan(read(VERTEX, &text));
    let words = fragment_words(&plan);
    assert_eq!(spec_lengths(&words), ["constant 7"]);
    // `spirv-cross` reads no zero of such a type.
    let module = rspirv::dr::load_bytes(&words).unwrap();
    let is_array = |id: u32| {
        let mut types = module.types_global_values.iter();
        types.any(|i| i.result_id == Some(id) && i.class.opcode == rspirv::spirv::Op::TypeArray)
    };
    let mut zeros = module.types_global_values.iter();
    assert!(!zeros.any(|i| {
        i.class.opcode == rspirv::spirv::Op::ConstantNull && i.result_type.is_some_and(is_array)
    }));
    let glsl = written(&plan, Target::GlslVulkan);
    assert!(!glsl.contains("TAPS") && glsl.contains("[4]"), "{glsl}");
}

const FOUR: &str = "layout(constant_id = 7) const int TAPS = 4;
layout(binding = 0) uniform W { vec4 weights[TAPS]; vec4 after; };";

/// One larger default does not show what half of a length is.
#[test]
fn a_length_in_an_expression_is_the_constant() {
    let body = "c = after; for (int i = 0; i < weights.length() / 2; i++) c += weights[i];";
    let plan = plan(read(VERTEX, &fragment(FOUR, body)));
    let glsl = written(&plan, Target::GlslVulkan);
    assert!(glsl.contains("= TAPS;") && glsl.contains(" / 2)"), "{glsl}");
    let hidden = "c = after; int TAPS = 3; if (weights.length() / 2 > TAPS) c += weights[0];";
    let parsed = read(VERTEX, &fragment(FOUR, hidden));
    assert_eq!(parsed.program.declared().lengths, []);
}

/// A push-constant block has a largest size.
#[test]
fn a_block_of_push_constants_has_lengths() {
    let declared = "layout(constant_id = 7) const int TAPS = 4;
layout(push_constant) uniform P { vec4 after; vec4 weights[TAPS]; } p;";
    let body = "c = p.after; for (int i = 0; i < TAPS; i++) c += p.weights[i];";
    let glsl = written(
        &plan(read(VERTEX, &fragment(declared, body))),
        Target::GlslVulkan,
    );
    assert!(glsl.contains("weights[TAPS]"), "{glsl}");
}

/// Both stages call their blocks `P`, so one of them gets another name.
#[test]
fn each_stage_has_its_own_range_of_push_constants() {
    let vertex = VERTEX
        .replace(
            "void main",
            "layout(push_constant) uniform P { mat4 m; } pc;\nvoid main",
        )
        .replace("gl_Position = p", "gl_Position = pc.m * p");
    let declared =
        "layout(push_constant) uniform P { layout(offset = 64) vec4 tint; float k; } pc;";
    let plan = plan(read(
        &vertex,
        &fragment(declared, "c = pc.tint.zyxw * pc.k;"),
    ));
    let glsl = written(&plan, Target::GlslVulkan);
    let offsets: Vec<&str> = glsl
        .lines()
        .filter_map(|line| line.trim().strip_prefix("layout(offset = "))
        .collect();
    assert_eq!(
        offsets,
        ["0) mat4x4 m;", "64) vec4 tint;", "80) float k;"],
        "{glsl}"
    );
}

/// Two constants of one default, which the vertex stage does not have.
#[test]
fn targets_without_lengths_have_no_constant_for_them() {
    let declared = "layout(constant_id = 1) const int A = 4;
layout(constant_id = 2) const int B = 4;
layout(binding = 0) uniform W { vec4 a[A]; vec4 b[B]; };";
    let body = "c = vec4(0.0); for (int i = 0; i < A; i++) c += a[i] + b[i];
    for (int i = 0; i < B; i++) c += b[i];";
    let plan = plan(read(VERTEX, &fragment(declared, body)));
    let wgsl = written(&plan, Target::Wgsl);
    assert!(!wgsl.contains("override"), "{wgsl}");
    let words = fragment_words(&plan);
    assert_eq!(spec_lengths(&words), ["constant 1", "constant 2"]);
}

/// The IR has one type of a block in both stages.
#[test]
fn a_length_on_which_stages_differ_is_final() {
    let vertex = |declared: &str, value: &str| {
        format!(
            "#version 460
{declared}
layout(location = 0) in vec4 p;
layout(location = 0) out vec2 uv;
void main() {{ uv = {value}; gl_Position = p; }}
"
        )
    };
    let body = "c = after; for (int i = 0; i < TAPS; i++) c += weights[i];";
    for (declared, value, lost) in [
        (
            "layout(binding = 0) uniform W { vec4 weights[4]; vec4 after; };",
            "after.xy",
            "TAPS",
        ),
        (
            "layout(constant_id = 5) const int Q = 4;
layout(binding = 0) uniform W { vec4 weights[Q]; vec4 after; };",
            "after.xy * float(Q)",
            "Q",
        ),
        (
            "layout(constant_id = 7) const int Q = 4;
layout(binding = 1) uniform V { vec4 own[Q]; };",
            "own[Q - 1].xy",
            "Q",
        ),
    ] {
        let parsed = read(&vertex(declared, value), &fragment(FOUR, body));
        let of = parsed.program.declared();
        assert_eq!(of.lengths, [], "{declared}");
        let notes = of.notes.join("\n");
        assert!(
            notes.contains("`TAPS`") && notes.contains(&format!("`{lost}`")),
            "{notes}"
        );
        let glsl = written(&plan(parsed), Target::GlslVulkan);
        assert!(!glsl.contains("constant_id"), "{glsl}");
    }
    // Another constant of the same id keeps its own value.
    let declared = "layout(constant_id = 7) const float SCALE = 2.0;";
    let parsed = read(&vertex(declared, "p.xy * SCALE"), &fragment(FOUR, body));
    let glsl = written(&plan(parsed), Target::GlslVulkan);
    assert!(
        glsl.contains("layout(constant_id = 7) const float SCALE"),
        "{glsl}"
    );
}

/// The resolve of a visibility buffer has the constants of both stages.
#[test]
fn constants_of_one_id_get_two_in_one_stage() {
    let vertex = "#version 460
layout(constant_id = 0) const float SCALE = 2.0;
layout(location = 0) in vec4 p;
layout(location = 0) out vec2 uv;
void main() { uv = p.xy * SCALE; gl_Position = p * SCALE; }
";
    let declared = "layout(constant_id = 0) const float BRIGHT = 3.0;";
    let parsed = read(vertex, &fragment(declared, "c = uv.xyxy * BRIGHT;"));
    let recipe = Recipe::parse(["visibility-buffer:budget=0.05"]).unwrap();
    let plan = recipe
        .apply(&plan(parsed), &Facts::default())
        .unwrap_or_else(|r| panic!("{r}"));
    let files = emit::emit(&plan, &[Target::Spirv], &emit::Options::default()).unwrap();
    let json = files.iter().find(|f| f.name.ends_with(".json")).unwrap();
    let json = String::from_utf8_lossy(&json.bytes);
    assert!(
        json.contains("as another one of this stage has its own, 0"),
        "{json}"
    );
}

/// A constant that stands elsewhere too, or in an expression, is final.
#[test]
fn a_length_that_is_computed_is_final() {
    for (declarations, body) in [
        (
            "layout(binding = 0) uniform W { vec4 weights[TAPS + 1]; };",
            "c = weights[0];",
        ),
        (
            "layout(binding = 0) uniform W { vec4 weights[TAPS]; };",
            "c = weights[0]; switch (int(uv.y)) { case TAPS: c.x = 1.0; }",
        ),
        (
            "layout(binding = 0) uniform sampler2D maps[TAPS];",
            "c = texture(maps[0], uv);",
        ),
    ] {
        let declarations = format!("layout(constant_id = 7) const int TAPS = 4;\n{declarations}");
        let parsed = read(VERTEX, &fragment(&declarations, body));
        let declared = parsed.program.declared();
        assert_eq!(declared.lengths, [], "{declarations}");
        let notes = declared.notes.join("\n");
        assert!(
            notes.contains("constant 7, `TAPS`"),
            "{declarations}: {notes}"
        );
    }
}

/// The texts are read back, which naga does to a certain depth only.
#[test]
fn large_arrays_of_samplers_are_switched() {
    let vertex = VERTEX.replace(
        "void main() {",
        "layout(location = 1) flat out int i;\nvoid main() { i = int(p.z);",
    );
    for n in [16, 128, 225] {
        for index in ["i", "nonuniformEXT(i)"] {
            let declared = format!(
                "layout(location = 1) flat in int i;
layout(set = 0, binding = 0) uniform sampler2D t[{n}];"
            );
            let text = fragment(&declared, &format!("c = texture(t[{index}], uv, 0.5);"));
            let plan = plan(read(&vertex, &text));
            let wgsl = written(&plan, Target::Wgsl);
            written(&plan, Target::Glsl450);
            let samples = wgsl.matches("textureSampleGrad(").count();
            let biased = wgsl.matches("textureSampleBias(").count();
            match index {
                "i" => assert_eq!((samples, biased), (0, n), "{wgsl}"),
                // The level comes from the quad, before the lanes part.
                _ => {
                    assert_eq!((samples, biased), (n, 0), "{wgsl}");
                    let before = wgsl.find("dpdx").unwrap() < wgsl.find("switch").unwrap();
                    assert!(before && wgsl.contains("exp2("), "{wgsl}");
                }
            }
            assert_eq!(wgsl.contains("switch"), n > 16 || index != "i");
        }
    }
}

/// Samplers that are parameters cannot be named in a helper function, and offsets are constants.
#[test]
fn arrays_of_samplers_are_selected_as_parameters_and_with_offsets() {
    let vertex = VERTEX.replace(
        "void main() {",
        "layout(location = 1) flat out int i;\nvoid main() { i = int(p.z);",
    );
    let declared = "layout(location = 1) flat in int i;
layout(set = 0, binding = 0) uniform sampler2D t[100];
vec4 of(sampler2D s[100], int i) { return texture(s[i], uv); }";
    let body = |nonuniform: &str| {
        format!(
            "c = textureOffset(t[{nonuniform}(i)], uv, ivec2(1, 0)) + textureOffset(t[i], uv, \
             ivec2(0, 1));"
        )
    };
    let text = fragment(declared, &(body("") + " c += of(t, i);"));
    let wgsl = wgsl(&vertex, &text);
    assert_eq!(wgsl.matches("switch").count(), 2, "{wgsl}");
    // Halves, so that the nesting stays shallow.
    assert!(wgsl.contains("< 50i"), "{wgsl}");
    let text = fragment(declared, &body("nonuniformEXT"));
    read(&vertex, &text);
    let text = fragment(declared, "int n = nonuniformEXT(i); c = of(t, n);");
    let error = front::parse(&sources(&vertex, &text), &Options::default()).unwrap_err();
    assert!(error.message().contains("`nonuniformEXT`"), "{error}");
}

#[test]
fn y_down_is_told_with_the_wgsl() {
    let notes = |target: Target, vertex: &str| {
        let plan = plan(read(vertex, &fragment("", "c = vec4(1.0);")));
        let files = emit::emit(&plan, &[target], &emit::Options::default()).unwrap();
        let json = files
            .iter()
            .find(|f| f.name.ends_with(".plan.json"))
            .unwrap();
        String::from_utf8(json.bytes.clone()).unwrap()
    };
    let told = "gl_Position.y = -gl_Position.y;";
    assert!(notes(Target::Wgsl, VERTEX).contains(told));
    assert!(!notes(Target::Spirv, VERTEX).contains(told));
    let opengl = VERTEX
        .replace("460", "410")
        .replace("layout(location = 0) out", "out");
    assert!(!notes(Target::Wgsl, &opengl).contains(told));
}

/// What naga's IR has beyond WebGPU's core is read, and the plan lists the feature.
#[test]
fn features_are_read_and_listed() {
    let clip = VERTEX.replace(
        "gl_Position = p;",
        "gl_Position = p; gl_ClipDistance[0] = p.x; gl_ClipDistance[1] = p.y;",
    );
    let half = VERTEX
        .replace("out vec2 uv", "out f16vec2 uv")
        .replace("p.xy", "f16vec2(p.xy)");
    let plain = fragment("", "c = vec4(uv, 0.0, 1.0);");
    let halves = fragment(
        "float16_t twice(float16_t x) { return x * 2.0hf; }",
        "f16vec2 v = uv + f16vec2(0.5hf); float16_t l = twice(length(v)); c = vec4(float(l));",
    )
    .replace("in vec2 uv", "in f16vec2 uv");
    let two = fragment(
        "layout(location = 0, index = 1) out vec4 d;",
        "c = vec4(uv, 0.0, 1.0); d = vec4(uv, 1.0, 1.0);",
    );
    for (vertex, fragment, feature, says) in [
        (
            clip.as_str(),
            &plain,
            "clip-distances",
            "@builtin(clip_distances)",
        ),
        (half.as_str(), &halves, "shader-f16", "enable f16;"),
        (
            VERTEX,
            &fragment("", "c = vec4(gl_BaryCoordEXT, 1.0);"),
            "wgpu-shader-barycentrics",
            "@builtin(barycentric)",
        ),
        (VERTEX, &two, "dual-source-blending", "@blend_src(1)"),
        (
            VERTEX,
            &fragment(
                "",
                "c = vec4(subgroupAdd(uv), subgroupQuadSwapHorizontal(uv.x), 1.0);",
            ),
            "subgroups",
            "quadSwapX(",
        ),
        (
            VERTEX,
            &fragment(
                "",
                "c = vec4(subgroupBroadcast(uv, 2), gl_SubgroupInvocationID, 1.0);",
            ),
            "subgroups",
            "subgroupBroadcast(",
        ),
    ] {
        let plan = plan(read(vertex, fragment));
        let needed = &plan.passes[0].features;
        assert!(
            needed.iter().any(|f| *f == feature),
            "{feature}: {needed:?}"
        );
        let wgsl = written(&plan, Target::Wgsl);
        assert!(wgsl.contains(says), "{feature}: {wgsl}");
    }
    let mask = fragment(
        "",
        "c = vec4(gl_SampleMaskIn[0] & 1); gl_SampleMask[0] = gl_SampleMaskIn[0] & 3;",
    );
    let wgsl = wgsl(VERTEX, &mask);
    assert_eq!(wgsl.matches("@builtin(sample_mask)").count(), 2, "{wgsl}");
}

/// The ids' texture of a visibility buffer gets a unit of its own.
#[test]
fn a_visibility_buffer_is_written_as_glsl() {
    let text = fragment(
        "layout(binding = 0) uniform sampler2D map;",
        "c = textureLod(map, uv, 0.0);",
    );
    let recipe = Recipe::parse(["visibility-buffer:budget=0.05"]).unwrap();
    let plan = plan(read(VERTEX, &text));
    let plan = recipe
        .apply(&plan, &Facts::default())
        .unwrap_or_else(|r| panic!("{r}"));
    written(&plan, Target::Glsl450);
}

#[test]
fn atomic_functions_change_members_of_storage_blocks() {
    let text = fragment(
        "struct Node { vec4 color; uint count; };
layout(std430, binding = 0) buffer B { uint n; int low; vec4 all[]; } b;
layout(std430, binding = 1) buffer C { Node nodes[8]; };
layout(std430, binding = 2) buffer D { uint alone; } d;
layout(std430, binding = 3) readonly buffer E { uint n; } e;",
        "uint at = atomicAdd(b.n, 1);
    if (at < 4u) b.all[at] = uv.xyxy;
    atomicMin(b.low, -3);
    uint before = atomicExchange(nodes[at & 7u].count, e.n);
    atomicXor(d.alone, 2u);
    c = vec4(before + d.alone) + nodes[1].color;",
    );
    let plan = plan(read(VERTEX, &text));
    let wgsl = written(&plan, Target::Wgsl);
    for said in [
        "n: atomic<u32>",
        "low: atomic<i32>",
        "count: atomic<u32>",
        "alone: atomic<u32>",
        "= atomicAdd(&b.n, 1u)",
        "atomicMin(&b.low, -3i)",
        "atomicExchange(&global.nodes[",
        "atomicXor(&d.alone, 2u)",
        "atomicLoad(&d.alone)",
    ] {
        assert!(wgsl.contains(said), "{said}\n{wgsl}");
    }
    // What no atomic function changes stays a plain number.
    assert!(wgsl.contains("struct E {\n    n: u32,"), "{wgsl}");
    let spirv = written(&plan, Target::Spirv);
    assert!(!spirv.is_empty());
    for target in [Target::Glsl450, Target::GlslVulkan] {
        let text = written(&plan, target);
        assert!(text.contains("atomicAdd("), "{text}");
    }
    let arrays = fragment(
        "layout(std430, binding = 0) buffer B { uint n; } b[2];",
        "c = vec4(atomicAdd(b[1].n, 1u));",
    );
    let wgsl = written(&self::plan(read(VERTEX, &arrays)), Target::Wgsl);
    assert!(wgsl.contains("atomicAdd(&b[1].n, 1u)"), "{wgsl}");
    let whole = fragment(
        "struct Node { uint count; float w; };
layout(std430, binding = 0) buffer B { Node nodes[4]; };",
        "atomicAdd(nodes[0].count, 1u); Node copy = nodes[1]; c = vec4(copy.w);",
    );
    let error = front::parse(&sources(VERTEX, &whole), &Options::default()).unwrap_err();
    assert!(error.message().contains("as a whole"), "{error}");
    let text = fragment("", "uint n = 0u; c = vec4(atomicAdd(n, 1u));");
    let error = front::parse(&sources(VERTEX, &text), &Options::default()).unwrap_err();
    assert_eq!(error.code(), Code::Unsupported, "{error}");
    assert!(error.message().contains("storage block"), "{error}");
    assert!(error.location().is_some_and(|l| l.line == 7), "{error}");
}

#[test]
fn atomic_functions_change_texels() {
    let text = fragment(
        "layout(binding = 0, r32ui) uniform uimage2D hits;
layout(binding = 1, r32i) uniform iimage2DArray low;",
        "ivec2 at = ivec2(uv);
    imageAtomicAdd(hits, at, 1);
    for (int i = 0; i < 2; i++) imageAtomicMin(low, ivec3(at, i), -3);
    c = vec4(imageLoad(hits, at).x);",
    );
    let plan = plan(read(VERTEX, &text));
    let wgsl = written(&plan, Target::Wgsl);
    for said in [
        "texture_storage_2d<r32uint,atomic>",
        "textureAtomicAdd(hits, at, 1u)",
        "textureAtomicMin(low, ",
    ] {
        assert!(wgsl.contains(said), "{said}\n{wgsl}");
    }
    assert!(!wgsl.contains("textureStore"), "{wgsl}");
    let features = &plan.passes[0].features;
    assert!(
        features.iter().any(|f| f == "wgpu-texture-atomic"),
        "{features:?}"
    );
    written(&plan, Target::Spirv);
    for target in [Target::Glsl450, Target::GlslVulkan] {
        assert!(written(&plan, target).contains("imageAtomicAdd(hits, "));
    }
    let declared = "layout(binding = 0, r32ui) uniform uimage2D i;\n\
                    void f(uimage2D j) { imageAtomicAdd(j, ivec2(0), 1u); }";
    let error = front::parse(
        &sources(VERTEX, &fragment(declared, "f(i); c = vec4(1.0);")),
        &Options::default(),
    );
    assert_eq!(error.unwrap_err().code(), Code::Unsupported);
}

/// In GLSL a discard ends the invocation, and so the loops of its callers.
#[test]
fn a_discard_in_a_function_ends_the_loops_around_its_call() {
    let text = fragment(
        "void cut(float a) { if (a < 0.0) discard; }
float inner(float a) { cut(a); return a; }",
        "float a = uv.x;
    while (true) { a -= inner(a); if (a > uv.y) break; }
    c = vec4(a);",
    );
    let wgsl = wgsl(VERTEX, &text);
    assert!(wgsl.contains("var<private> killed: bool;"), "{wgsl}");
    let (_, behind) = wgsl.split_once("killed = true;").unwrap();
    assert!(behind.trim_start().starts_with("discard;"), "{wgsl}");
    // The call is in the loop, the discard two functions further.
    let called = wgsl.find("= inner(a)").unwrap_or_else(|| panic!("{wgsl}"));
    let asked = wgsl.find("if killed {").unwrap_or_else(|| panic!("{wgsl}"));
    assert!(called < asked, "{wgsl}");
    assert_eq!(wgsl.matches("if killed").count(), 1, "{wgsl}");
    // No loop needs it here.
    let plain = text
        .replace("while (true)", "if (a > 0.5)")
        .replace(" break;", " a = 1.0;");
    assert!(!self::wgsl(VERTEX, &plain).contains("killed"));
}

#[test]
fn a_demotion_stays_one_for_vulkan() {
    let text = fragment(
        "layout(binding = 0) uniform sampler2D map;",
        "if (uv.x < 0.5) demote;\n    c = texture(map, uv);",
    );
    let plan = plan(read(VERTEX, &text));
    let vulkan = written(&plan, Target::GlslVulkan);
    assert!(
        vulkan.contains("demote;") && !vulkan.contains("discard"),
        "{vulkan}"
    );
    let files = emit::emit(&plan, &[Target::Spirv], &emit::Options::default()).unwrap();
    let opcodes: Vec<u32> = files
        .iter()
        .filter(|f| f.name.ends_with("frag.spv"))
        .flat_map(|f| opcodes(&f.bytes))
        .collect();
    // OpDemoteToHelperInvocation, OpKill.
    assert!(
        opcodes.contains(&5380) && !opcodes.contains(&252),
        "{opcodes:?}"
    );
}

/// The opcodes of a module.
fn opcodes(bytes: &[u8]) -> Vec<u32> {
    let (words, _) = bytes.as_chunks::<4>();
    let words: Vec<u32> = words.iter().map(|w| u32::from_le_bytes(*w)).collect();
    let (mut all, mut at) = (Vec::new(), 5);
    while let Some(word) = words.get(at) {
        all.push(word & 0xffff);
        at += (word >> 16).max(1) as usize;
    }
    all
}

#[test]
fn a_precise_local_is_noted() {
    let vertex = VERTEX.replace(
        "gl_Position = p;",
        "precise vec4 q = p * 2.0; gl_Position = q;",
    );
    let parsed = read(
        &vertex,
        &fragment("", "precise float a = uv.x * 2.0 + uv.y; c = vec4(a);"),
    );
    let notes = parsed.program.declared().notes.join("\n");
    assert!(notes.contains("`precise`"), "{notes}");
}

#[test]
fn the_number_of_the_view_is_a_feature() {
    let vertex = VERTEX.replace("gl_Position = p;", "gl_Position = p * float(gl_ViewIndex);");
    let plan = plan(read(&vertex, &fragment("", "c = vec4(gl_ViewIndex);")));
    assert!(written(&plan, Target::Wgsl).contains("@builtin(view_index)"));
    written(&plan, Target::Spirv);
    let features = &plan.passes[0].features;
    assert!(
        features.iter().any(|f| f == "wgpu-multiview"),
        "{features:?}"
    );
}

/// Vulkan's samplers do not say whether they compare.
#[test]
fn a_sampler_compares_if_a_shadow_uses_it() {
    let text = fragment(
        "layout(binding = 0) uniform texture2DArray maps;
layout(binding = 1) uniform sampler s, plain;
layout(binding = 3) uniform sampler compared;
layout(binding = 4) uniform texture2D color;
float inner(sampler which) { return texture(sampler2DArrayShadow(maps, which), vec4(uv, 0, 0.5)); }
float outer(sampler which, sampler other) {
    return inner(which) + texture(sampler2D(color, other), uv).x;
}",
        "c = vec4(outer(compared, plain));",
    );
    let wgsl = wgsl(VERTEX, &text.replace("s, plain", "plain"));
    assert_eq!(wgsl.matches("sampler_comparison").count(), 3, "{wgsl}");
    assert!(wgsl.contains("var plain: sampler;"), "{wgsl}");
}

/// An element of an array compares as a texture of its own does.
#[test]
fn an_array_of_textures_compares_if_a_shadow_uses_an_element() {
    let text = fragment(
        "layout(binding = 0) uniform texture2D maps[2];
layout(binding = 1) uniform sampler s;
layout(push_constant) uniform U { int which; };
",
        "c = vec4(texture(sampler2DShadow(maps[which], s), vec3(uv, 0.5)));",
    );
    let wgsl = wgsl(VERTEX, &text);
    for said in [
        "var maps: binding_array<texture_depth_2d, 2>;",
        "var s: sampler_comparison;",
        "textureSampleCompare(maps[",
    ] {
        assert!(wgsl.contains(said), "{said}\n{wgsl}");
    }
}

#[test]
fn es_has_vulkans_types() {
    let text = "#version 310 es
precision mediump float;
layout(set = 0, binding = 0) uniform mediump sampler s;
layout(set = 0, binding = 1) uniform mediump texture2D t;
layout(location = 0) in highp vec2 uv;
layout(location = 0) out vec4 c;
vec4 of(mediump texture2D t, mediump sampler s) { return texture(sampler2D(t, s), uv); }
void main() { c = of(t, s); }
";
    let plan = plan(read(VERTEX, text));
    let wgsl = written(&plan, Target::Wgsl);
    assert!(wgsl.contains(": texture_2d<f32>;"), "{wgsl}");
    // Vulkan's depth is WebGPU's.
    assert!(!wgsl.contains("gl_Position.z"), "{wgsl}");
    // The function takes both there, too.
    let vulkan = written(&plan, Target::GlslVulkan);
    assert!(vulkan.contains("texture2D t"), "{vulkan}");
}

#[test]
fn arrays_of_textures_samplers_and_blocks_are_binding_arrays() {
    let text = fragment(
        "layout(set = 0, binding = 0) uniform texture2D t[3];
layout(set = 0, binding = 1) uniform sampler s[2];
layout(set = 1, binding = 0) uniform U { layout(offset = 16) vec4 tint; int which; } u[2];
layout(set = 1, binding = 1) uniform texture2D every[];",
        "int i = u[1].which;
    c = texture(sampler2D(t[i], s[u[i].which]), uv) * u[i].tint
        + textureLod(sampler2D(every[i], s[0]), uv, 0.0);",
    );
    let plan = plan(read(VERTEX, &text));
    let wgsl = written(&plan, Target::Wgsl);
    for said in [
        "var t: binding_array<texture_2d<f32>, 3>;",
        "var s: binding_array<sampler, 2>;",
        "var<uniform> u: binding_array<U, 2>;",
        "var every: binding_array<texture_2d<f32>>;",
    ] {
        assert!(wgsl.contains(said), "{said}\n{wgsl}");
    }
    let features = plan.passes[0].features.join(" ");
    for feature in ["wgpu-texture-binding-array", "wgpu-buffer-binding-array"] {
        assert!(features.contains(feature), "{features}");
    }
    let text = fragment(
        "layout(binding = 0) uniform U { vec4 tint; } u[2][2];",
        "c = u[0][1].tint;",
    );
    let error = front::parse(&sources(VERTEX, &text), &Options::default()).unwrap_err();
    assert_eq!(error.code(), Code::Unsupported, "{error}");
}

#[test]
fn members_with_offsets_come_in_any_order() {
    let text = fragment(
        "layout(binding = 0) uniform U { layout(offset = 32) vec4 last; layout(offset = 0) vec4 \
         first; };",
        "c = last - first;",
    );
    let wgsl = wgsl(VERTEX, &text);
    let at = |word: &str| wgsl.find(word).unwrap_or_else(|| panic!("{wgsl}"));
    assert!(at("first: vec4") < at("last: vec4"), "{wgsl}");
}

#[test]
fn an_array_of_arrays_has_the_lengths_of_its_elements() {
    let text = fragment(
        "",
        "const float all[2][2] = float[][](float[](1.0, 2.0), float[](3.0, 4.0));
    c = vec4(all[int(uv.x) & 1][int(uv.y) & 1]);",
    );
    let wgsl = wgsl(VERTEX, &text);
    assert!(wgsl.contains("array<array<f32, 2>, 2>"), "{wgsl}");
}

#[test]
fn scalars_are_reflected_and_refracted() {
    let text = fragment(
        "",
        "c = vec4(reflect(uv.x, uv.y), refract(uv.x, uv.y, 0.5), 0.0, 1.0);",
    );
    let wgsl = wgsl(VERTEX, &text);
    assert!(wgsl.contains("refract(vec2<f32>(uv.x, 0f)"), "{wgsl}");
    assert!(!wgsl.contains("reflect("), "{wgsl}");
}

#[test]
fn attributes_may_be_arrays() {
    let vertex = |length: &str| {
        VERTEX
            .replace("in vec4 p", &format!("in vec4 p[{length}]"))
            // naga reads the text by itself if it has no macros.
            .replace("void main", "#define ONE 1\nvoid main")
            .replace("p.xy; gl_Position = p", "p[0].xy; gl_Position = p[0]")
    };
    let plan_of = |length: &str| plan(read(&vertex(length), &fragment("", "c = vec4(1.0);")));
    // GLSL has no array of length 0, which one of length 1 was written as.
    assert!(written(&plan_of("1"), Target::Glsl450).contains("in vec4 p[1];"));
    let plan = plan_of("2");
    let text = written(&plan, Target::Glsl450);
    assert!(text.contains("in vec4 p[2];"), "{text}");
    // GLSL ES has no such attributes, and no choice between vectors of integers.
    let refused = |plan: &Plan| {
        emit::emit(plan, &[Target::GlslEs300], &emit::Options::default())
            .unwrap_err()
            .to_string()
    };
    let error = refused(&plan);
    assert!(error.contains("an array as an attribute"), "{error}");
    let text = fragment(
        "",
        "ivec2 a = ivec2(uv * 8.0); a = mix(a, a.yx, lessThan(uv, uv.yx)); c = vec4(a, a);",
    );
    let error = refused(&self::plan(read(VERTEX, &text)));
    assert!(error.contains("vectors of integers"), "{error}");
}

/// Vulkan's targets and GLSL 4.50 keep the bound of a written depth; others drop it with a note.
#[test]
fn the_bound_of_a_written_depth_is_kept() {
    let text = |bound: &str| {
        let declared = format!("layout({bound}) out float gl_FragDepth;");
        let body = "c = uv.xyxy; gl_FragDepth = gl_FragCoord.z;";
        plan(read(VERTEX, &fragment(&declared, body)))
    };
    for (bound, mode, word) in [
        ("depth_greater", 14, "greater_equal"),
        ("depth_less", 15, "less_equal"),
        ("depth_unchanged", 16, "unchanged"),
    ] {
        let plan = text(bound);
        for target in [Target::GlslVulkan, Target::Glsl450] {
            let glsl = written(&plan, target);
            let declared = format!("layout ({bound}) out float gl_FragDepth;");
            assert!(glsl.contains(&declared), "{glsl}");
        }
        let wgsl = written(&plan, Target::Wgsl);
        let attribute = format!("@early_depth_test({word})");
        assert!(wgsl.contains(&attribute), "{wgsl}");
        let modes = execution_modes(&plan);
        assert!(modes.contains(&mode), "{bound}: {modes:?}");

        let files = emit::emit(&plan, &[Target::GlslEs300], &emit::Options::default()).unwrap();
        let all: String = files
            .iter()
            .map(|f| String::from_utf8_lossy(&f.bytes).into_owned())
            .collect();
        assert!(!all.contains(&format!("({bound}) out")), "{all}");
        assert!(all.contains("the bound of the written depth"), "{all}");
    }
    let any = text("depth_any");
    assert!(!written(&any, Target::Wgsl).contains("early_depth_test"));
    assert!(execution_modes(&any).iter().all(|m| !(14..=16).contains(m)));
}

/// The execution modes of the fragment stage in SPIR-V.
fn execution_modes(plan: &Plan) -> Vec<u32> {
    let files = emit::emit(plan, &[Target::Spirv], &emit::Options::default()).unwrap();
    let file = files
        .iter()
        .find(|f| f.name.ends_with(".frag.spv"))
        .unwrap();
    let words = file.bytes.chunks_exact(4);
    let words: Vec<u32> = words
        .map(|w| u32::from_le_bytes([w[0], w[1], w[2], w[3]]))
        .collect();
    let mut at = 5;
    let mut modes = Vec::new();
    while let Some(word) = words.get(at) {
        if word & 0xffff == 16 {
            modes.push(words[at + 2]);
        }
        at += (word >> 16) as usize;
    }
    modes
}

/// A host sets constants and the visibility of resources for each stage.
#[test]
fn hoist_notes_what_the_vertex_stage_reads_now() {
    let declared = "layout(constant_id = 3) const float GAIN = 0.25;
layout(set = 1, binding = 2) uniform L { vec4 l[4]; } lights;
layout(push_constant) uniform P { vec4 tint; } pc;";
    let body = "vec3 a = vec3(0.0);
    for (int i = 0; i < 4; i++) a += exp(-dot(uv.xyx, lights.l[i].xyz) * GAIN) * pc.tint.xyz;
    c = vec4(a, 1.0);";
    let original = plan(read(VERTEX, &fragment(declared, body)));
    let recipe = Recipe::parse(["hoist:budget=0.1,finite=assumed"]).unwrap();
    let hoisted = recipe
        .apply(&original, &Facts::default())
        .unwrap_or_else(|r| panic!("{r}"));
    let notes = hoisted.notes.join("\n");
    for part in [
        "the constant 3, `GAIN`",
        "binding 2 of group 1",
        "the first 16 bytes of the push constants",
        "`VkSpecializationInfo`",
        "`stageFlags`",
    ] {
        assert!(notes.contains(part), "{part}: {notes}");
    }
    // What the vertex stage reads already needs no note.
    let vertex = VERTEX.replace(
        "void main() {",
        "layout(constant_id = 3) const float GAIN = 0.25;
layout(set = 1, binding = 2) uniform L { vec4 l[4]; } lights;
layout(push_constant) uniform P { vec4 tint; } pc;
void main() {",
    );
    let vertex = vertex.replace("= p; }", "= p * GAIN + lights.l[0] + pc.tint; }");
    let original = plan(read(&vertex, &fragment(declared, body)));
    let hoisted = recipe
        .apply(&original, &Facts::default())
        .unwrap_or_else(|r| panic!("{r}"));
    let notes = hoisted.notes.join("\n");
    assert!(!notes.contains("only the fragment stage"), "{notes}");
}

/// What has a name and still can't be set is refused by this name.
#[test]
fn final_constants_and_push_constants_are_refused_by_name() {
    let declared = "layout(constant_id = 7) const int TAPS = 4;
layout(constant_id = 8) const bool WARM = true;
layout(push_constant) uniform P { vec4 tint; int mode; } pc;
layout(binding = 0) uniform W { vec4 weights[TAPS + 1]; };";
    let body =
        "c = weights[0] * (WARM ? pc.tint : vec4(0.5)); if (pc.mode == 1) c.x = float(TAPS);";
    let original = plan(read(VERTEX, &fragment(declared, body)));
    let wrong = |set: &str| {
        let recipe = Recipe::parse([format!("specialize:set={set}").as_str()]).unwrap();
        let checked = recipe.check_names(std::slice::from_ref(&original));
        checked.map_err(|e| e.to_string())
    };
    let refused = wrong("TAPS=2").unwrap_err();
    assert!(
        refused.contains("`TAPS` has its default as its value, 4"),
        "{refused}"
    );
    assert!(
        refused.contains("change the default in the text"),
        "{refused}"
    );
    for name in ["mode", "pc.mode"] {
        let refused = wrong(&format!("{name}=1")).unwrap_err();
        assert!(
            refused.contains(&format!("`{name}` is a push constant")),
            "{refused}"
        );
    }
    assert!(wrong("TAP=2").unwrap_err().contains("is named `TAP`"));
    // Its own value may be set, beside another.
    assert_eq!(wrong("TAPS=4+WARM=false"), Ok(()));
    let recipe = Recipe::parse(["specialize:set=TAPS=4+WARM=false"]).unwrap();
    let plan = recipe
        .apply(&original, &Facts::default())
        .unwrap_or_else(|r| panic!("{r}"));
    assert!(!written(&plan, Target::Wgsl).contains("tint *"));
}

/// A visibility buffer's refusals say what to do about push constants and arrays of textures.
#[test]
fn a_visibility_buffer_refuses_split_push_constants_and_arrays_by_name() {
    let recipe = Recipe::parse(["visibility-buffer:budget=0.05"]).unwrap();
    let refused = |vertex: &str, text: &str| {
        let outcome = recipe.apply(&plan(read(vertex, text)), &Facts::default());
        format!("{:?}", outcome.unwrap_err())
    };
    let vertex = VERTEX.replace(
        "void main() { uv = p.xy; gl_Position = p; }",
        "layout(push_constant) uniform V { mat4 m; } pv;
void main() { uv = p.xy; gl_Position = pv.m * p; }",
    );
    let split = fragment(
        "layout(push_constant) uniform F { layout(offset = 64) vec4 tint; } pf;",
        "c = uv.xyxy * pf.tint;",
    );
    let split = refused(&vertex, &split);
    assert!(split.contains("one block of push constants"), "{split}");
    assert!(!split.contains("another binding"), "{split}");

    let array = fragment(
        "layout(binding = 0) uniform texture2D maps[4]; layout(binding = 1) uniform sampler s;
layout(binding = 2) uniform U { int n; } u;",
        "c = texture(sampler2D(maps[u.n], s), uv);",
    );
    let array = refused(VERTEX, &array);
    assert!(array.contains("an element of `maps`"), "{array}");
    assert!(array.contains("textureLod"), "{array}");
}

/// WebGPU needs four components of each output. Vulkan's targets have the author's.
#[test]
fn outputs_keep_their_components_in_vulkans_targets() {
    for (ty, is_float) in [
        ("float", true),
        ("vec2", true),
        ("uvec3", false),
        ("vec4", true),
    ] {
        let value = match is_float {
            true => format!("{ty}(uv.x)"),
            false => format!("{ty}(uint(uv.x))"),
        };
        let text = format!(
            "#version 450
layout(location = 0) in vec2 uv;
layout(location = 0) out {ty} coverage;
layout(depth_greater) out float gl_FragDepth;
void main() {{
    if (uv.y > 0.5) {{ coverage = {value}; gl_FragDepth = 0.5; return; }}
    coverage = {value} + {value};
    gl_FragDepth = gl_FragCoord.z;
}}
"
        );
        let plan = plan(read(VERTEX, &text));
        let glsl = written(&plan, Target::GlslVulkan);
        assert!(glsl.contains(&format!("out {ty} coverage;")), "{glsl}");
        // Both texts are read as their author wrote them.
        read(VERTEX, glsl_stage(&plan, ".frag").as_str());
        let wgsl = written(&plan, Target::Wgsl);
        assert!(wgsl.contains("@location(0) coverage"), "{wgsl}");
        written(&plan, Target::Spirv);
    }
}

/// The text of a stage in Vulkan's GLSL.
fn glsl_stage(plan: &Plan, ending: &str) -> String {
    let options = emit::Options::default();
    let files = emit::emit(plan, &[Target::GlslVulkan], &options).unwrap();
    let file = files.iter().find(|f| f.name.ends_with(ending)).unwrap();
    String::from_utf8_lossy(&file.bytes).into_owned()
}

/// A constant with another constant as its value has its length. A converted value is another one.
#[test]
fn an_alias_of_a_constant_gives_the_length_of_arrays() {
    let text = |alias: &str| {
        let declared = format!(
            "layout(constant_id = 7) const int TAPS = 4;
const int COUNT = TAPS;
{alias}
layout(binding = 0) uniform W {{ vec4 weights[SIZE]; }};"
        );
        let body = "c = vec4(0.0); for (int i = 0; i < COUNT; i++) c += weights[i];";
        read(VERTEX, &fragment(&declared, body))
    };
    let parsed = text("const int SIZE = COUNT;");
    let declared = parsed.program.declared();
    let named: Vec<&str> = declared.lengths.iter().map(|l| l.own.as_str()).collect();
    assert_eq!(named, ["TAPS"], "{:?}", declared.notes);
    let plan = plan(parsed);
    let glsl = written(&plan, Target::GlslVulkan);
    assert!(glsl.contains("vec4 weights[TAPS];"), "{glsl}");
    let words = fragment_words(&plan);
    assert_eq!(spec_lengths(&words), ["constant 7"]);
    for other in [
        "const uint SIZE = uint(COUNT);",
        "const int SIZE = min(COUNT, 100);",
    ] {
        let parsed = text(other);
        assert_eq!(parsed.program.declared().lengths, [], "{other}");
    }
}
