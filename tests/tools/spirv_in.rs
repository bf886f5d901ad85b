//! SPIR-V of other compilers is read: its interface stays, and every form of one shader is one
//! program.

use std::path::{Path, PathBuf};
use std::process::Command;

use preshade::unstable::emit::{self, Target};
use preshade::unstable::front::{self, Error, Parsed, Source};
use preshade_passes::naga::ShaderStage;
use preshade_passes::state::MaterialState;

use crate::accept;
use crate::fixtures_support;

/// Runs a tool of `scripts/setup.sh accept`.
fn run(tool: &str, arguments: &[&std::ffi::OsStr]) {
    let output = Command::new(tool).args(arguments).output();
    let output = output.unwrap_or_else(|e| panic!("{tool}: {e}; run scripts/setup.sh accept"));
    let said = [output.stdout, output.stderr].concat();
    let said = String::from_utf8_lossy(&said);
    assert!(output.status.success(), "{tool} {arguments:?}: {said}");
}

fn scratch() -> PathBuf {
    let dir = accept::scratch();
    std::fs::create_dir_all(&dir).unwrap();
    dir
}

/// What glslang makes of a text, with its options.
fn glslang(source: &Path, options: &[&str], dir: &Path) -> Vec<u8> {
    let out = dir.join("glslang.spv");
    let mut all: Vec<&std::ffi::OsStr> = options.iter().map(AsRef::as_ref).collect();
    all.extend([
        "-V".as_ref(),
        source.as_os_str(),
        "-o".as_ref(),
        out.as_os_str(),
    ]);
    run("glslangValidator", &all);
    std::fs::read(out).unwrap()
}

/// The words of an assembly text.
fn assembled(text: &str, dir: &Path) -> Vec<u8> {
    let (source, out) = (dir.join("a.spvasm"), dir.join("a.spv"));
    std::fs::write(&source, text).unwrap();
    let environment: [&std::ffi::OsStr; 2] = ["--target-env".as_ref(), "vulkan1.1".as_ref()];
    let paths = [source.as_os_str(), "-o".as_ref(), out.as_os_str()];
    let keep = ["--preserve-numeric-ids".as_ref()];
    run("spirv-as", &[&environment[..], &keep, &paths].concat());
    run("spirv-val", &[&environment[..], &paths[2..]].concat());
    std::fs::read(out).unwrap()
}

/// A module without names and debug information, as games ship them.
fn optimised(bytes: &[u8], dir: &Path) -> Vec<u8> {
    let from = dir.join("from.spv");
    std::fs::write(&from, bytes).unwrap();
    std::fs::read(optimised_file(&from)).unwrap()
}

pub(crate) fn optimised_file(from: &Path) -> PathBuf {
    let to = from.with_extension("optimised.spv");
    let options: [&std::ffi::OsStr; 2] = ["--strip-debug".as_ref(), "-O".as_ref()];
    let paths = [from.as_os_str(), "-o".as_ref(), to.as_os_str()];
    run("spirv-opt", &[&options[..], &paths[..]].concat());
    to
}

fn read(modules: &[(&str, Vec<u8>)]) -> Result<Parsed, Error> {
    let sources = modules.iter().cloned();
    let sources = sources.map(|(name, bytes)| Source::from_bytes(name, bytes).unwrap());
    front::parse(&sources.collect::<Vec<_>>(), &front::Options::default())
}

/// Writes all of Vulkan's targets and WGSL, which are read back, and has `spirv-val` judge.
fn written(parsed: &Parsed, label: &str, dir: &Path) {
    let plan = parsed.clone().plan("m", &MaterialState::default());
    let targets = [Target::Wgsl, Target::Spirv, Target::GlslVulkan];
    let files = emit::emit(&plan, &targets, &emit::Options::default());
    let files = files.unwrap_or_else(|e| panic!("{label}: {e}"));
    for file in files.iter().filter(|f| f.name.ends_with(".spv")) {
        let path = dir.join(&file.name);
        std::fs::write(&path, &file.bytes).unwrap();
        let environment: [&std::ffi::OsStr; 2] = ["--target-env".as_ref(), "vulkan1.1".as_ref()];
        run(
            "spirv-val",
            &[&environment[..], &[path.as_os_str()]].concat(),
        );
    }
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
                written(&parsed, &label, &dir);
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
    let parsed = read(&modules).unwrap_or_else(|e| panic!("{}", e.render(front::Color::Never)));
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
    assert!(front::parse(&sources, &front::Options::default()).is_ok());
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
        assert_eq!(error.code(), front::Code::Unsupported);
        assert!(error.message().contains("`OpImageQueryLod`"), "{error}");
        let at = error.location().unwrap();
        match options.is_empty() {
            true => assert_eq!(at.file, "m.frag.spv"),
            false => assert!(at.file.ends_with("level.frag") && at.line == 6, "{at:?}"),
        }
        let shown = error.render(front::Color::Never);
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
}
