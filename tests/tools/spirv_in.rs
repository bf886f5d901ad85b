//! SPIR-V of other compilers is read: its interface stays, and every form of one shader is one
//! program.

use std::path::{Path, PathBuf};
use std::process::Command;

use naga::ShaderStage;
use preshade_compiler::emit;
use preshade_compiler::front::{self, Parsed, Source};
use preshade_plan::plan_file::Target;
use preshade_plan::state::MaterialState;
use shader_text::error::Error;
use shader_text::options;

use crate::reflection_support::{self, Interface};
use crate::{accept, fixtures_support};

/// Runs a tool of `scripts/setup.sh accept`.
fn run(tool: &str, arguments: &[&std::ffi::OsStr]) {
    let said = ran(tool, arguments);
    assert!(said.is_ok(), "{tool} {arguments:?}: {said:?}");
}

/// What the tool says if it fails.
fn ran(tool: &str, arguments: &[&std::ffi::OsStr]) -> Result<(), String> {
    let output = Command::new(tool).args(arguments).output();
    let output = output.unwrap_or_else(|e| panic!("{tool}: {e}; run scripts/setup.sh accept"));
    let said = [output.stdout, output.stderr].concat();
    match output.status.success() {
        true => Ok(()),
        false => Err(String::from_utf8_lossy(&said).into_owned()),
    }
}

pub(crate) fn scratch() -> PathBuf {
    let dir = accept::scratch();
    std::fs::create_dir_all(&dir).unwrap();
    dir
}

/// What glslang makes of a text, with its options.
pub(crate) fn glslang(source: &Path, options: &[&str], dir: &Path) -> Vec<u8> {
    try_glslang(source, options, dir).unwrap_or_else(|e| panic!("{}: {e}", source.display()))
}

/// The same, or what glslang says.
pub(crate) fn try_glslang(source: &Path, options: &[&str], dir: &Path) -> Result<Vec<u8>, String> {
    let out = dir.join("glslang.spv");
    let mut all: Vec<&std::ffi::OsStr> = options.iter().map(AsRef::as_ref).collect();
    all.extend([
        "-V".as_ref(),
        source.as_os_str(),
        "-o".as_ref(),
        out.as_os_str(),
    ]);
    ran("glslangValidator", &all)?;
    Ok(std::fs::read(out).unwrap())
}

/// The words of an assembly text.
pub(crate) fn assembled(text: &str, dir: &Path) -> Vec<u8> {
    let words = assembled_only(text, dir);
    let out = dir.join("a.spv");
    run(
        "spirv-val",
        &[
            "--target-env".as_ref(),
            "vulkan1.1".as_ref(),
            out.as_os_str(),
        ],
    );
    words
}

/// The same of a text that not every version of `spirv-val` takes.
pub(crate) fn assembled_only(text: &str, dir: &Path) -> Vec<u8> {
    let (source, out) = (dir.join("a.spvasm"), dir.join("a.spv"));
    std::fs::write(&source, text).unwrap();
    let environment: [&std::ffi::OsStr; 2] = ["--target-env".as_ref(), "vulkan1.1".as_ref()];
    let paths = [source.as_os_str(), "-o".as_ref(), out.as_os_str()];
    let keep = ["--preserve-numeric-ids".as_ref()];
    run("spirv-as", &[&environment[..], &keep, &paths].concat());
    std::fs::read(out).unwrap()
}

/// A module without names and debug information, as games ship them.
fn optimised(bytes: &[u8], dir: &Path) -> Vec<u8> {
    optimised_by(&["--strip-debug", "-O"], bytes, dir)
}

/// What spirv-opt makes of a module, with its options.
pub(crate) fn optimised_by(options: &[&str], bytes: &[u8], dir: &Path) -> Vec<u8> {
    let from = dir.join("from.spv");
    std::fs::write(&from, bytes).unwrap();
    std::fs::read(optimised_to(options, &from)).unwrap()
}

pub(crate) fn optimised_file(from: &Path) -> PathBuf {
    optimised_to(&["--strip-debug", "-O"], from)
}

fn optimised_to(options: &[&str], from: &Path) -> PathBuf {
    let to = from.with_extension("optimised.spv");
    let mut all: Vec<&std::ffi::OsStr> = options.iter().map(AsRef::as_ref).collect();
    all.extend([from.as_os_str(), "-o".as_ref(), to.as_os_str()]);
    run("spirv-opt", &all);
    to
}

fn read(modules: &[(&str, Vec<u8>)]) -> Result<Parsed, Error> {
    let sources = modules.iter().cloned();
    let sources = sources.map(|(name, bytes)| Source::from_bytes(name, bytes).unwrap());
    front::parse(&sources.collect::<Vec<_>>(), &options::Options::default())
}

/// Writes all of Vulkan's targets and WGSL, which are read back, and has `spirv-val` judge.
fn written(parsed: &Parsed, label: &str, dir: &Path) -> Written {
    let mut written = Written::default();
    let plan = parsed.clone().plan("m", &MaterialState::default());
    let targets = [Target::Wgsl, Target::Spirv, Target::GlslVulkan];
    let files = emit::emit(&plan, &targets, &emit::Options::default());
    let files = files.unwrap_or_else(|e| panic!("{label}: {e}"));
    for file in &files {
        if file.name.ends_with(".wgsl") {
            written.wgsl += &String::from_utf8_lossy(&file.bytes);
        }
        if !file.name.ends_with(".spv") {
            continue;
        }
        let path = dir.join(&file.name);
        std::fs::write(&path, &file.bytes).unwrap();
        let environment: [&std::ffi::OsStr; 2] = ["--target-env".as_ref(), "vulkan1.1".as_ref()];
        run(
            "spirv-val",
            &[&environment[..], &[path.as_os_str()]].concat(),
        );
        let is_vertex = file.name.contains(".vert.");
        let reflected = reflection_support::reflect(&path).unwrap();
        let interface = reflection_support::interface(&reflected, is_vertex);
        written.interface.extend(interface);
    }
    written
}

/// What [`written`] writes.
#[derive(Default)]
struct Written {
    wgsl: String,
    interface: Interface,
}

/// A text without the ids in names: debug information moves them.
fn without_ids(wgsl: &str) -> String {
    let words = wgsl.split_inclusive(|c: char| !c.is_ascii_alphanumeric() && c != '_');
    let changed = words.map(|word| {
        let name = word.trim_end_matches(|c: char| !c.is_ascii_alphanumeric() && c != '_');
        let id = name.strip_prefix("phi").unwrap_or(name).strip_prefix('_');
        let is_id = |id: &str| !id.is_empty() && id.bytes().all(|b| b.is_ascii_digit());
        match id {
            Some(id) if is_id(id) => word.replace(id, ""),
            _ => word.to_owned(),
        }
    });
    changed.collect()
}

/// The sets and bindings of an interface, and its locations: what is left without names.
fn places(interface: &Interface) -> Vec<&str> {
    let all = interface.iter();
    let all = all.filter_map(|line| line.split(':').next());
    all.filter(|place| place.starts_with("set") || place.starts_with("input"))
        .collect()
}

/// The pairs that glslang takes for Vulkan.
fn pairs() -> Vec<[PathBuf; 2]> {
    let folder = fixtures_support::root().join("fixtures/glsl/vulkan");
    let entries = std::fs::read_dir(folder).unwrap();
    let paths = entries.map(|e| e.unwrap().path());
    let vertex = paths.filter(|p| p.extension().is_some_and(|e| e == "vert"));
    let mut all: Vec<_> = vertex
        .map(|v| [v.clone(), v.with_extension("frag")])
        .collect();
    all.sort();
    all
}

#[test]
fn every_form_of_glslangs_modules_is_read() {
    let dir = scratch();
    let mut read_pairs = 0;
    for pair in pairs() {
        let mut first: Option<Written> = None;
        for options in [&[][..], &["-g"], &["-gVS"], &["--target-env", "vulkan1.3"]] {
            let words = [0, 1].map(|stage| glslang(&pair[stage], options, &dir));
            // spirv-opt ended without a message on some of the other forms.
            let stripped = match options.is_empty() {
                true => [0, 1].map(|stage| optimised(&words[stage], &dir)),
                false => words.clone(),
            };
            for (form, [vertex, fragment]) in [("as compiled", words), ("stripped", stripped)] {
                let label = format!("{} {options:?} {form}", pair[0].display());
                let modules = [("m.vert.spv", vertex), ("m.frag.spv", fragment)];
                let parsed = read(&modules).unwrap_or_else(|e| panic!("{label}: {e}\n{e:?}"));
                let own = written(&parsed, &label, &dir);
                let first = first.get_or_insert_with(|| written(&parsed, &label, &dir));
                // Only debug information differs.
                if form == "as compiled" && options.first().is_none_or(|o| o.starts_with("-g")) {
                    let [wgsl, of_first] = [&own.wgsl, &first.wgsl].map(|w| without_ids(w));
                    assert_eq!(wgsl, of_first, "{label}");
                    assert_eq!(own.interface, first.interface, "{label}");
                }
                assert_eq!(places(&own.interface), places(&first.interface), "{label}");
                read_pairs += 1;
            }
        }
    }
    assert!(read_pairs >= 8 * 3, "{read_pairs} pairs");
}

/// The text of a module of `tests/spirv`.
fn module(name: &str) -> String {
    let path = fixtures_support::root().join("tests/spirv").join(name);
    std::fs::read_to_string(path).unwrap()
}

#[test]
fn a_module_in_the_style_of_dxc_is_read() {
    let dir = scratch();
    let modules = ["lit.vert", "lit.frag"].map(|stage| {
        let name = format!("{stage}.spvasm");
        (stage, assembled(&module(&name), &dir))
    });
    let parsed =
        read(&modules).unwrap_or_else(|e| panic!("{}", e.render(shader_text::error::Color::Never)));
    assert_eq!(
        (&*parsed.vertex, parsed.fragment.as_deref()),
        ("VSMain", Some("PSMain"))
    );
    written(&parsed, "lit", &dir);
    let plan = parsed.clone().plan("lit", &MaterialState::default());
    let files = emit::emit(&plan, &[Target::Wgsl], &emit::Options::default()).unwrap();
    let wgsl = String::from_utf8_lossy(&files[0].bytes).into_owned();
    insta::assert_snapshot!(wgsl);
    // A texture and a sampler of one binding are one resource again.
    let declared = parsed.program.declared();
    assert_eq!(declared.samplers.len(), 1);
    assert_eq!(declared.samplers[0].path, "albedo");
    assert_eq!(declared.notes.len(), 1, "{:?}", declared.notes);
}

#[test]
fn one_module_may_hold_both_stages_and_others() {
    let dir = scratch();
    let both = module("both.spvasm");
    let words = assembled(&both, &dir);
    let parsed = read(&[("both.spv", words.clone())]).unwrap();
    assert_eq!(
        (&*parsed.vertex, parsed.fragment.as_deref()),
        ("vs", Some("fs"))
    );
    // The other byte order is the same module.
    let (all, _) = words.as_chunks::<4>();
    let swapped: Vec<u8> = all.iter().flat_map(|w| w.iter().rev().copied()).collect();
    let other = read(&[("both.spv", swapped)]).unwrap();
    let wgsl = |parsed: &Parsed| {
        let plan = parsed.clone().plan("both", &MaterialState::default());
        emit::emit(&plan, &[Target::Wgsl], &emit::Options::default()).unwrap()[0]
            .bytes
            .clone()
    };
    assert_eq!(wgsl(&parsed), wgsl(&other));
    // A stage that is named takes only that stage of the file.
    let source = |stage| {
        Source::from_bytes("both.spv", words.clone())
            .unwrap()
            .with_stage(stage)
    };
    let sources = [source(ShaderStage::Vertex), source(ShaderStage::Fragment)];
    assert!(front::parse(&sources, &options::Options::default()).is_ok());
}

#[test]
fn a_refusal_names_the_authors_line_or_the_instruction() {
    let dir = scratch();
    let text = "#version 450\nlayout(location = 0) out vec4 c;\nlayout(binding = 0) uniform sampler2D map;\n\
                layout(location = 0) in vec2 uv;\nvoid main() {\n    c = textureQueryLod(map, uv).xxyy;\n}\n";
    let source = dir.join("level.frag");
    std::fs::write(&source, text).unwrap();
    let vertex = &pairs()[0][0];
    for options in [&["-g"][..], &["-gVS"], &[]] {
        let modules = [
            ("m.vert.spv", glslang(vertex, &[], &dir)),
            ("m.frag.spv", glslang(&source, options, &dir)),
        ];
        let error = read(&modules).unwrap_err();
        assert_eq!(error.code(), shader_text::error::Code::Unsupported);
        assert!(error.message().contains("`OpImageQueryLod`"), "{error}");
        let at = error.location().unwrap();
        match options.is_empty() {
            true => assert_eq!(at.file, "m.frag.spv"),
            false => assert!(at.file.ends_with("level.frag") && at.line == 6, "{at:?}"),
        }
        let shown = error.render(shader_text::error::Color::Never);
        assert!(shown.contains("OpImageQueryLod %"), "{shown}");
    }
}

#[test]
fn what_naga_would_ignore_is_refused() {
    let dir = scratch();
    let both = module("both.spvasm");
    let sample = "%150 = OpImageSampleImplicitLod %6 %149 %148";
    assert!(both.contains(sample));
    for (with, expected) in [
        (
            "%150 = OpImageSampleImplicitLod %6 %149 %148 Bias|MinLod %41 %41",
            "a lower limit",
        ),
        (
            "%150 = OpImageGather %6 %149 %148 %44 ConstOffsets %59",
            "four offsets",
        ),
    ] {
        let text = both.replace(sample, with);
        let words = assembled(&text, &dir);
        let error = read(&[("both.spv", words)]).unwrap_err();
        assert!(error.message().contains(expected), "{error}");
    }
}

pub(crate) const VERTEX: &str = "#version 450\nlayout(location=0) in vec3 p; layout(location=0) out vec2 v;\n\
                      void main(){ v=p.xy; gl_Position=vec4(p,1); }";

/// A material of a fragment shader's declarations and its `main`, with `v` and `o`.
fn of_fragment(text: &str, options: &[&str], dir: &Path) -> Result<Parsed, Error> {
    let text = format!(
        "#version 450\nlayout(location=0) in vec2 v; layout(location=0) out vec4 o;\n{text}\n"
    );
    of_texts(VERTEX, &text, options, dir)
}

fn of_texts(vertex: &str, fragment: &str, options: &[&str], dir: &Path) -> Result<Parsed, Error> {
    let words = [("m.vert", vertex), ("m.frag", fragment)].map(|(name, text)| {
        let path = dir.join(name);
        std::fs::write(&path, text).unwrap();
        glslang(&path, options, dir)
    });
    let [vertex, fragment] = words;
    read(&[("m.vert.spv", vertex), ("m.frag.spv", fragment)])
}

#[test]
fn what_glslang_writes_is_read() {
    const NEW: &[&str] = &["--target-env", "vulkan1.3"];
    let dir = scratch();
    let mut all = String::new();
    for (name, options, text) in [
        ("structs of 8 bytes in std140", &[][..], "struct L { float a; float b; };
layout(binding=0,std140) uniform B { L l[4]; } u;
void main(){ o=vec4(u.l[1].a,u.l[int(v.x)].b,v); }"),
        ("structs of 24 bytes before others", &[], "struct L { vec2 a; vec2 b; float c; };
layout(binding=0,std140) uniform B { L l[4]; vec4 z; L one; float y; } u;
void main(){ L w=u.l[2]; o=vec4(u.l[1].a,u.l[int(v.x)].b)+u.z*u.y*u.one.c*w.c; }"),
        ("structs with strides, read and written whole", &[], "struct I { float f[4]; vec2 g; };
layout(binding=0,std140) uniform B { I i[2]; } u;
layout(binding=1,std140) buffer S { I w[2]; } s;
void main(){ I t=u.i[1]; t.f[2]=3.; o=vec4(t.f[1],t.f[int(v.y)],t.g); s.w[0]=t; }"),
        ("a matrix by rows in a struct, read whole", &[], "struct I { mat2 b; };
layout(row_major,binding=0,std140) uniform B { I i[2]; } u;
void main(){ I t=u.i[1]; o.xy=t.b*v; o.zw=v; }"),
        ("a vector of a specialisation constant", &[], "layout(constant_id=7) const float F=1.5;
const vec2 C=vec2(F,2.0);
void main(){ o=C.xyxy*v.xyxy+vec4(F); }"),
        ("a function that ends nowhere", &[], "float g(float a){ while(true){ a*=2.; if(a>9.) return a; } }
void main(){ o=vec4(g(v.x),0,0,1); }"),
        ("a choice of matrices", NEW, "void main(){ mat2 a=mat2(v,v),b=mat2(1.); mat2 q=v.x>.2?a:b; o=vec4(q[0],q[1]); }"),
        ("a choice of structs", NEW, "struct S { vec2 a; float b[2]; };
void main(){ S x=S(v,float[2](1.,2.)); S y=S(v.yx,float[2](3.,4.)); S z=v.x>.5?x:y; o=vec4(z.a,z.b[0],z.b[1]); }"),
        ("a negative unsigned integer", &[], "void main(){ uint k=uint(v.x); uint n=-k; o=vec4(float(n&255u)); }"),
        ("tests of floats", &[], "void main(){ o=vec4(isnan(v.x)?1:0,isinf(v.y)?1:0,any(isnan(v))?1:0,0); }"),
        ("coherent memory", &[], "layout(binding=0,rgba8) uniform coherent image2D im;
layout(binding=1,std430) coherent volatile buffer S { uint a; } s;
void main(){ imageStore(im,ivec2(v),vec4(s.a)); s.a=3u; o=imageLoad(im,ivec2(0)); }"),
        ("a case that falls into a default", &[], "void main(){ float r=0.;
switch(int(v.x)){ case 1: r+=2.; case 2: default: r+=4.; break; case 4: r+=16.; } o=vec4(r); }"),
        ("a default that falls into a case", &[], "void main(){ float r=0.;
switch(int(v.x)){ case 1: r+=2.; break; default: r+=4.; case 4: r+=16.; } o=vec4(r); }"),
    ] {
        let parsed = of_fragment(text, options, &dir);
        let parsed = parsed.unwrap_or_else(|e| panic!("{name}: {}", e.render(shader_text::error::Color::Never)));
        let written = written(&parsed, name, &dir);
        let start = written.wgsl.find("@fragment").unwrap();
        let structs = written.wgsl.find("struct").unwrap();
        let end = written.wgsl.find("@vertex").unwrap_or(start);
        all += &format!(
            "// {name}\n{}{}\n",
            &written.wgsl[structs..end],
            &written.wgsl[start..]
        );
    }
    insta::assert_snapshot!(all);
}

#[test]
fn what_cannot_be_read_is_refused_by_name() {
    let dir = scratch();
    for (text, expected, remedy) in [
        ("void main(){ int e; float f=frexp(v.x,e); o=vec4(f,e,0,0); }", "`FrexpStruct`", "floatBitsToInt"),
        ("layout(binding=1) uniform sampler2DShadow s; void main(){ o=vec4(texture(s,vec3(v,.5),.5)); }", "a comparison with a bias", ""),
        ("layout(binding=0) uniform isampler2D t; void main(){ o=vec4(texture(t,v)); }", "`OpImageSampleImplicitLod`", "texelFetch"),
        ("layout(binding=0) uniform sampler2D t[3]; vec4 f(sampler2D s[3],vec2 u){ return texture(s[1],u); }
void main(){ o=f(t,v); }", "array of textures or samplers as an argument", "one by one"),
        ("layout(binding=3) uniform sampler2D t[2][2]; void main(){ o=texture(t[1][0],v); }", "an array of arrays", ""),
    ] {
        let error = of_fragment(text, &[], &dir).unwrap_err();
        assert_eq!(error.code(), shader_text::error::Code::Unsupported, "{error}");
        assert!(error.message().contains(expected), "{error}");
        let shown = error.render(shader_text::error::Color::Never);
        assert!(shown.contains(remedy) && shown.contains("m.frag.spv:"), "{shown}");
    }
}

#[test]
fn built_ins_and_parts_of_varyings_are_read() {
    let dir = scratch();
    let fragment = "#version 450\nlayout(location=0) in vec2 v; layout(location=0) out vec4 o;\n\
                    void main(){ o=v.xyxy; }";
    for (text, expected) in [
        (
            "#version 450\n#extension GL_EXT_multiview : require\nlayout(location=0) in vec3 p; \
             layout(location=0) out vec2 v; void main(){ v=p.xy; gl_Position=vec4(p,1+gl_ViewIndex); }",
            "@builtin(view_index)",
        ),
        // Names of two underscores are reserved in GLSL, and two parts may have one name.
        (
            "#version 450\nstruct A { float _m0; float c; };\nlayout(location=0) out vec2 v;\n\
             layout(location=2) out A _9; layout(location=4) out float _9_m0;\n\
             layout(location=0) in vec3 p;\nvoid main(){ v=p.xy; _9._m0=p.x; _9.c=p.y; _9_m0=p.z; \
             gl_Position=vec4(p,1); }",
            "@location(3)",
        ),
    ] {
        let words = [("m.vert", text), ("m.frag", fragment)].map(|(name, text)| {
            std::fs::write(dir.join(name), text).unwrap();
            glslang(&dir.join(name), &[], &dir)
        });
        let [vertex, fragment] = words;
        let parsed = read(&[("m.vert.spv", vertex), ("m.frag.spv", fragment)]);
        let parsed =
            parsed.unwrap_or_else(|e| panic!("{}", e.render(shader_text::error::Color::Never)));
        let plan = parsed.plan("m", &MaterialState::default());
        let files = emit::emit(&plan, &[Target::Wgsl], &emit::Options::default()).unwrap();
        let wgsl = String::from_utf8_lossy(&files[0].bytes).into_owned();
        assert!(wgsl.contains(expected), "{wgsl}");
        assert!(!wgsl.contains("_9__m0"), "{wgsl}");
    }
}

/// A module with a fragment shader of these definitions and instructions. Its vertex shader writes
/// the position.
fn assembly(decorations: &str, globals: &str, interface: &str, body: &str) -> String {
    format!(
        "OpCapability Shader
OpMemoryModel Logical GLSL450
OpEntryPoint Vertex %vs \"main\" %p %pos %vo
OpEntryPoint Fragment %fs \"main\" %v %o {interface}
OpExecutionMode %fs OriginUpperLeft
OpDecorate %p Location 0
OpDecorate %pos BuiltIn Position
OpDecorate %vo Location 0
OpDecorate %v Location 0
OpDecorate %o Location 0
{decorations}
%void = OpTypeVoid
%fn = OpTypeFunction %void
%float = OpTypeFloat 32
%int = OpTypeInt 32 1
%v2 = OpTypeVector %float 2
%v4 = OpTypeVector %float 4
%piv2 = OpTypePointer Input %v2
%piv4 = OpTypePointer Input %v4
%pov2 = OpTypePointer Output %v2
%pov4 = OpTypePointer Output %v4
%p = OpVariable %piv4 Input
%pos = OpVariable %pov4 Output
%vo = OpVariable %pov2 Output
%v = OpVariable %piv2 Input
%o = OpVariable %pov4 Output
%f1 = OpConstant %float 1
%i0 = OpConstant %int 0
%i1 = OpConstant %int 1
%n2 = OpConstant %int 2
%v4one = OpConstantComposite %v4 %f1 %f1 %f1 %f1
{globals}
%vs = OpFunction %void None %fn
%vsl = OpLabel
%pp = OpLoad %v4 %p
OpStore %pos %pp
%pv = OpVectorShuffle %v2 %pp %pp 0 1
OpStore %vo %pv
OpReturn
OpFunctionEnd
%fs = OpFunction %void None %fn
%fsl = OpLabel
{body}
OpReturn
OpFunctionEnd
"
    )
}

const BLOCK: &str = "OpDecorate %S Block\nOpDecorate %b DescriptorSet 0\nOpDecorate %b Binding 0\n";

#[test]
fn modules_that_glslang_does_not_write_are_read() {
    let dir = scratch();
    let mut chain = "%s0 = OpSpecConstant %int 0\n".to_owned();
    for n in 1..=40 {
        chain += &format!("%s{n} = OpSpecConstantOp %int IAdd %s{0} %s{0}\n", n - 1);
    }
    chain += "%len = OpSpecConstantOp %int IAdd %s40 %n2\n%A = OpTypeArray %float %len\n\
              %pA = OpTypePointer Private %A\n%a = OpVariable %pA Private\n\
              %pf = OpTypePointer Private %float";
    for (decorations, globals, interface, body, expected) in [
        // An output that only has an initial value.
        (
            "OpDecorate %od Location 1",
            "%pof = OpTypePointer Output %float\n%od = OpVariable %pof Output %f1",
            "%od",
            "OpStore %o %v4one",
            "@location(1)",
        ),
        // What no instruction defines.
        (
            "",
            "",
            "",
            "%un = OpUndef %v4\n%e = OpCompositeInsert %v4 %f1 %un 1\nOpStore %o %e",
            "@fragment",
        ),
        // Doubles forty times: time must not double as often.
        (
            "OpDecorate %s0 SpecId 0",
            &chain,
            "",
            "%x = OpAccessChain %pf %a %i1\n%y = OpLoad %float %x\n\
             %z = OpCompositeConstruct %v4 %y %y %y %y\nOpStore %o %z",
            "array<f32, 2>",
        ),
        // Members that are not in the order of their offsets.
        (
            &format!(
                "{BLOCK}OpMemberDecorate %S 0 Offset 0\nOpMemberDecorate %T 0 Offset 16\n\
                 OpMemberDecorate %T 1 Offset 0"
            ),
            "%T = OpTypeStruct %v4 %v4\n%S = OpTypeStruct %T\n%pS = OpTypePointer Uniform %S\n\
             %b = OpVariable %pS Uniform\n%pt = OpTypePointer Uniform %v4",
            "",
            "%x = OpAccessChain %pt %b %i0 %i1\n%y = OpLoad %v4 %x\nOpStore %o %y",
            "_m1: vec4<f32>,\n    _m0: vec4<f32>,",
        ),
    ] {
        let text = assembly(decorations, globals, interface, body);
        // Ids without names.
        let words = assembled(&text, &dir);
        let parsed = read(&[("m.spv", words)]);
        let parsed =
            parsed.unwrap_or_else(|e| panic!("{}", e.render(shader_text::error::Color::Never)));
        let wgsl = written(&parsed, expected, &dir).wgsl;
        assert!(wgsl.contains(expected), "{wgsl}");
    }
}

/// A combined sampler by value is the same as by its pointer.
#[test]
fn samplers_are_passed_by_value() {
    let dir = scratch();
    let globals = "%img = OpTypeImage %float 2D 0 0 0 1 Unknown\n%si = OpTypeSampledImage %img\n\
                   %psi = OpTypePointer UniformConstant %si\n%t = OpVariable %psi UniformConstant\n\
                   %ft = OpTypeFunction %v4 %si %v2";
    let body = "%a = OpLoad %v2 %v\n%im = OpLoad %si %t\n%e = OpFunctionCall %v4 %fun %im %a\n\
                OpStore %o %e";
    let decorations = "OpDecorate %t DescriptorSet 0\nOpDecorate %t Binding 0";
    let text = assembly(decorations, globals, "", body)
        + "%fun = OpFunction %v4 None %ft\n%p1 = OpFunctionParameter %si\n\
           %p2 = OpFunctionParameter %v2\n%fl = OpLabel\n\
           %r = OpImageSampleImplicitLod %v4 %p1 %p2\nOpReturnValue %r\nOpFunctionEnd\n";
    let parsed = read(&[("m.spv", assembled(&text, &dir))]);
    let parsed =
        parsed.unwrap_or_else(|e| panic!("{}", e.render(shader_text::error::Color::Never)));
    written(&parsed, "by value", &dir);
}

#[test]
fn limits_come_before_work() {
    let dir = scratch();
    let block = |of: &str, offset: &str, stride: &str| {
        let decorations = format!(
            "{BLOCK}OpMemberDecorate %S 0 Offset {offset}\nOpDecorate %A ArrayStride {stride}"
        );
        let globals = format!(
            "%A = OpTypeArray {of} %n2\n%S = OpTypeStruct %A\n%pS = OpTypePointer Uniform %S\n\
             %b = OpVariable %pS Uniform\n%pA = OpTypePointer Uniform %A"
        );
        let body = "%x = OpAccessChain %pA %b %i0\n%y = OpLoad %A %x\nOpStore %o %v4one";
        assembly(&decorations, &globals, "", body)
    };
    let input = assembly(
        "OpDecorate %in Location 1",
        "%big = OpConstant %int 1000000000\n%A = OpTypeArray %float %big\n\
         %pA = OpTypePointer Input %A\n%in = OpVariable %pA Input\n\
         %pf = OpTypePointer Input %float",
        "%in",
        "%x = OpAccessChain %pf %in %i1\n%y = OpLoad %float %x\nOpStore %o %v4one",
    );
    for (text, expected) in [
        (block("%v4", "0", "2000000000"), "1 GiB"),
        (block("%v4", "2000000000", "16"), "1 GiB"),
        (input, "more than 64 parts"),
    ] {
        let error = read(&[("m.spv", assembled(&text, &dir))]).unwrap_err();
        assert_eq!(
            error.code(),
            shader_text::error::Code::Unsupported,
            "{error}"
        );
        assert!(error.message().contains(expected), "{error}");
    }
}

#[test]
fn entry_points_are_chosen_by_the_authors_names() {
    let dir = scratch();
    let text = assembly("", "", "", "OpStore %o %v4one")
        .replace(
            "OpEntryPoint Fragment %fs \"main\"",
            "OpEntryPoint Vertex %vs \"vertex_main\" %p %pos %vo\n\
             OpEntryPoint Fragment %fs2 \"other\" %o %flat\nOpEntryPoint Fragment %fs \"main\"",
        )
        .replace(
            "OpExecutionMode",
            "OpExecutionMode %fs2 OriginUpperLeft\nOpExecutionMode",
        )
        .replace(
            "OpDecorate %o",
            "OpDecorate %flat Location 0\nOpDecorate %flat Flat\nOpDecorate %o",
        )
        .replace("%f1 =", "%flat = OpVariable %piv2 Input\n%f1 =")
        + "%fs2 = OpFunction %void None %fn\n%fs2l = OpLabel\n%fl = OpLoad %v2 %flat\n\
           %fo = OpVectorShuffle %v4 %fl %fl 0 1 0 1\nOpStore %o %fo\nOpReturn\nOpFunctionEnd\n";
    let words = assembled(&text, &dir);
    let read = |vertex: Option<&str>, fragment: Option<&str>| {
        let options = options::Options {
            vertex: vertex.map(str::to_owned),
            fragment: fragment.map(str::to_owned),
            ..shader_text::options::Options::default()
        };
        let source = Source::from_bytes("m.spv", words.clone()).unwrap();
        front::parse(&[source], &options)
    };
    for (vertex, fragment) in [("main", "main"), ("vertex_main", "main"), ("main", "other")] {
        let parsed = read(Some(vertex), Some(fragment));
        let parsed =
            parsed.unwrap_or_else(|e| panic!("{}", e.render(shader_text::error::Color::Never)));
        let wgsl = written(&parsed, fragment, &dir).wgsl;
        assert_eq!(
            wgsl.contains("@interpolate(flat"),
            fragment == "other",
            "{wgsl}"
        );
    }
    let error = read(None, None)
        .unwrap_err()
        .render(shader_text::error::Color::Never);
    assert!(
        error.contains("`main`") && error.contains("`other`"),
        "{error}"
    );
}

/// naga may panic on an invalid module, which `front` reports. Nothing ends the process.
#[test]
fn broken_modules_are_errors() {
    let dir = scratch();
    let words = assembled(&module("both.spvasm"), &dir);
    // The compute shader is the last function, of nine words. A material is whole without it.
    for end in (4..words.len() - 9 * 4).step_by(4) {
        assert!(
            read(&[("cut.spv", words[..end].to_vec())]).is_err(),
            "{end}"
        );
    }
    let mut kept = 0;
    for at in (20..words.len()).step_by(4) {
        for number in [0_u32, 1, 7, 0xffff_ffff] {
            let mut words = words.clone();
            words[at..at + 4].copy_from_slice(&number.to_le_bytes());
            kept += usize::from(read(&[("changed.spv", words)]).is_ok());
        }
    }
    // Some words are names, numbers and ids that may change.
    assert!(kept > 0);
    // Ids that are part of themselves, or follow their uses, and widths that no number has.
    let good = assembly(
        "",
        "%x = OpTypeStruct %float\n%y = OpTypeFloat 16",
        "",
        "OpStore %o %v4one",
    );
    for (from, to) in [
        ("%x = OpTypeStruct %float", "%x = OpTypeStruct %x"),
        (
            "%x = OpTypeStruct %float",
            "%x = OpSpecConstantOp %int IAdd %x %i1",
        ),
        ("%x = OpTypeStruct %float", "%x = OpTypeStruct %y"),
        ("%y = OpTypeFloat 16", "%y = OpTypeFloat 4"),
    ] {
        let (source, out) = (dir.join("bad.spvasm"), dir.join("bad.spv"));
        std::fs::write(&source, good.replace(from, to)).unwrap();
        let paths = [source.as_os_str(), "-o".as_ref(), out.as_os_str()];
        run("spirv-as", &paths);
        let error = read(&[("bad.spv", std::fs::read(out).unwrap())]).unwrap_err();
        assert_eq!(
            error.code(),
            shader_text::error::Code::Parse,
            "{to}: {error}"
        );
    }
}

/// `spirv-opt` makes constants of specialisation constants, and leaves the operations on them.
#[test]
fn frozen_constants_are_read() {
    let dir = scratch();
    let text = "#version 450
layout(location=0) in vec2 v; layout(location=0) out vec4 o;
layout(constant_id=0) const int N = 4;
layout(constant_id=1) const bool B = true;
const int M = N * 2 + 1;
layout(binding=1) uniform L { vec4 l[M]; } u;
layout(binding=2) uniform K { vec4 k[N / 2 + (N & 3)]; } w;
void main() {
    vec3 a = vec3(0.0);
    for (int i = 0; i < M; i++) a += u.l[i].xyz * w.k[1].x;
    if (!B) a = vec3(M) * v.x;
    o = vec4(a, 1.0);
}
";
    let path = dir.join("frozen.frag");
    std::fs::write(&path, text).unwrap();
    let words = glslang(&path, &[], &dir);
    let (from, to) = (dir.join("from.spv"), dir.join("frozen.spv"));
    std::fs::write(&from, words).unwrap();
    let options = [
        "--set-spec-const-default-value",
        "0:6",
        "--freeze-spec-const",
    ];
    let mut all: Vec<&std::ffi::OsStr> = options.iter().map(AsRef::as_ref).collect();
    all.extend([from.as_os_str(), "-o".as_ref(), to.as_os_str()]);
    run("spirv-opt", &all);
    let vertex = dir.join("frozen.vert");
    std::fs::write(&vertex, VERTEX).unwrap();
    let vertex = glslang(&vertex, &[], &dir);
    let parsed = read(&[
        ("m.vert.spv", vertex),
        ("m.frag.spv", std::fs::read(to).unwrap()),
    ]);
    let parsed =
        parsed.unwrap_or_else(|e| panic!("{}", e.render(shader_text::error::Color::Never)));
    let wgsl = written(&parsed, "frozen", &dir).wgsl;
    assert!(wgsl.contains("array<vec4<f32>, 13>"), "{wgsl}");
    assert!(wgsl.contains("array<vec4<f32>, 5>"), "{wgsl}");
}

/// Also where the IR fills it up to four components.
#[test]
fn an_output_keeps_its_components() {
    let dir = scratch();
    for (ty, bound) in [
        ("float", ""),
        ("vec2", ""),
        ("float", "depth_less"),
        ("vec3", "depth_less"),
    ] {
        let depth = match bound {
            "" => ["", ""],
            _ => [
                "layout(depth_less) out float gl_FragDepth;",
                "gl_FragDepth = 0.5;",
            ],
        };
        let text = format!(
            "#version 450
layout(set=0, binding=0) uniform sampler2D maps[2];
layout(location=0) in vec2 v; layout(location=0) out {ty} coverage;
{}
void main() {{
    if (v.y > 0.5) {{ coverage = {ty}(v.x); return; }}
    coverage = {ty}(texture(maps[1], v).x);
    {}
}}
",
            depth[0], depth[1]
        );
        let sources = [Source::new("m.vert", VERTEX), Source::new("m.frag", text)];
        let parsed = front::parse(&sources, &options::Options::default());
        let parsed =
            parsed.unwrap_or_else(|e| panic!("{}", e.render(shader_text::error::Color::Never)));
        written(&parsed, "narrow", &dir);
        let reflected = reflection_support::reflect(&dir.join("m.main.frag.spv")).unwrap();
        let outputs = format!("{:?}", reflected["outputs"]);
        assert!(outputs.contains(&format!("{ty:?}")), "{outputs}");
        assert!(outputs.contains("\"coverage\""), "{outputs}");
    }
}

/// Also the only one.
#[test]
fn an_output_keeps_its_name() {
    let dir = scratch();
    let text = "#version 450
layout(location=0) in vec2 v; layout(location=0) out float coverage;
void main() { coverage = v.x; }
";
    let parsed = of_texts(VERTEX, text, &[], &dir);
    let parsed =
        parsed.unwrap_or_else(|e| panic!("{}", e.render(shader_text::error::Color::Never)));
    let plan = parsed.plan("m", &MaterialState::default());
    let targets = [Target::GlslVulkan, Target::Spirv];
    let files = emit::emit(&plan, &targets, &emit::Options::default()).unwrap();
    let fragments: Vec<_> = files.iter().filter(|f| f.name.contains(".frag")).collect();
    assert_eq!(fragments.len(), 2);
    for file in fragments {
        let text = String::from_utf8_lossy(&file.bytes);
        let name = match file.name.ends_with(".spv") {
            true => "coverage\0",
            false => "out float coverage;",
        };
        assert!(text.contains(name), "{}: {text}", file.name);
    }
}
