//! Every fixture material, in every target: emitted text reads back (emission itself sees to that),
//! and other compilers take it.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use naga_edit::interface;
use preshade_compiler::emit;
use preshade_compiler::front::{self, Parsed, Source};
use preshade_compiler::recipe::Recipe;
use preshade_plan::pass::Facts;
use preshade_plan::plan::{Plan, Role};
use preshade_plan::plan_file::PlanFile;
use preshade_plan::plan_file::Target;
use preshade_plan::state::MaterialState;
use shader_text::error::{Code, Color};
use shader_text::files::File;
use shader_text::options;

use crate::accept;
use crate::emit::touched;

/// The materials under `fixtures/FOLDER`: a file, or two files of one folder or stem.
fn materials(folder: &str) -> BTreeMap<String, Vec<PathBuf>> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("fixtures")
        .join(folder);
    let mut found: BTreeMap<String, Vec<PathBuf>> = BTreeMap::new();
    let mut folders = vec![root.clone()];
    while let Some(dir) = folders.pop() {
        let Ok(entries) = std::fs::read_dir(&dir) else {
            continue;
        };
        for path in entries.map(|e| e.unwrap().path()) {
            let extension = path.extension().and_then(|e| e.to_str()).unwrap_or("");
            if path.is_dir() {
                folders.push(path);
            } else if ["wgsl", "vert", "frag"].contains(&extension) {
                // A pair is a GLSL stem, or a WGSL stem with the stage between (`a.vert.wgsl`).
                let name = path.file_name().unwrap().to_str().unwrap();
                let stem = name.split('.').next().unwrap();
                let place = path.parent().unwrap().strip_prefix(&root).unwrap();
                let key = place.join(stem).display().to_string();
                found.entry(key).or_default().push(path);
            }
        }
    }
    for paths in found.values_mut() {
        paths.sort();
    }
    found
}

fn parse(paths: &[PathBuf]) -> Vec<Parsed> {
    let sources: Vec<Source> = paths
        .iter()
        .map(|p| {
            let name = p.file_name().unwrap().to_str().unwrap();
            Source::new(name, std::fs::read_to_string(p).unwrap())
        })
        .collect();
    match front::parse(&sources, &options::Options::default()) {
        Ok(parsed) => vec![parsed],
        // A file of several materials: every pair of entry points whose interfaces fit.
        Err(e) if e.code() == Code::AmbiguousEntryPoint => pairs(&sources),
        Err(e) => panic!("{}", e.render(Color::Never)),
    }
}

fn pairs(sources: &[Source]) -> Vec<Parsed> {
    let module = naga::front::wgsl::parse_str(&sources[0].text).unwrap();
    let of = |stage| {
        let entries = module.entry_points.iter();
        let names = entries.filter(move |e| e.stage == stage);
        names.map(|e| e.name.clone()).collect::<Vec<_>>()
    };
    let mut all = Vec::new();
    for vertex in of(naga::ShaderStage::Vertex) {
        for fragment in of(naga::ShaderStage::Fragment) {
            let options = options::Options {
                vertex: Some(vertex.clone()),
                fragment: Some(fragment.clone()),
                ..shader_text::options::Options::default()
            };
            match front::parse(sources, &options) {
                Ok(parsed) => all.push(parsed),
                Err(e) => assert_eq!(e.code(), Code::Interface, "{}", e.render(Color::Never)),
            }
        }
    }
    assert!(!all.is_empty());
    all
}

/// All targets' files. GLSL may be unable to say a thing, but must say so; WGSL and SPIR-V may not.
fn emit_all(name: &str, parsed: &Parsed) -> Vec<File> {
    let plan = Plan::original(
        "material",
        touched(&parsed.program),
        &parsed.vertex,
        parsed.fragment.as_deref(),
        &MaterialState::default(),
    );
    let mut files = Vec::new();
    for target in Target::GENERAL {
        match emit::emit(&plan, &[target], &emit::Options::default()) {
            Ok(mut emitted) => files.append(&mut emitted),
            Err(e @ emit::EmitError::Inexpressible { .. })
                if matches!(target, Target::Glsl450 | Target::GlslEs300) =>
            {
                eprintln!("{name}: {e}");
            }
            Err(e) => panic!("{name}: {e}"),
        }
    }
    files
}

fn check(folder: &str) {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("fixtures")
        .join(folder);
    if !root.is_dir() {
        return;
    }
    let materials = materials(folder);
    assert!(!materials.is_empty(), "no material under fixtures/{folder}");
    let mut sets = Vec::new();
    for (name, paths) in &materials {
        for (i, parsed) in parse(paths).iter().enumerate() {
            let name = format!("{folder}/{name} {i}");
            sets.push((name.clone(), emit_all(&name, parsed)));
        }
    }
    let judged = accept::accept(&sets);
    assert!(judged.wgsl >= materials.len(), "{judged:?}");
    assert!(judged.spirv >= materials.len(), "{judged:?}");
}

#[test]
fn wgsl_fixtures_are_accepted_everywhere() {
    check("shaders");
}

#[test]
fn glsl_fixtures_are_accepted_everywhere() {
    check("glsl");
}

#[test]
fn the_handwritten_reference_is_accepted_everywhere() {
    check("handwritten");
}

/// WebGL links no program without a fragment stage: a pass that draws depth alone has an empty one
/// there, and nowhere else.
#[test]
fn a_depth_only_pass_has_an_empty_fragment_stage_in_glsl_es() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/shaders/textured.wgsl");
    let parsed = parse(&[path]).remove(0);
    let original = Plan::original(
        "material",
        parsed.program,
        &parsed.vertex,
        parsed.fragment.as_deref(),
        &MaterialState::default(),
    );
    for recipe in ["depth-prepass", "depth-prepass:form=equal", "shadow"] {
        let plan = Recipe::parse([recipe])
            .unwrap()
            .apply(&original, &Facts::without_ties())
            .unwrap();
        let files = emit::emit(&plan, &Target::GENERAL, &emit::Options::default()).unwrap();
        let depth = plan
            .passes
            .iter()
            .position(|p| p.fragment.is_none())
            .unwrap();
        let name = format!("material.{}.es.frag", plan.passes[depth].role.name());
        let file = files.iter().filter(|f| f.name == name).collect::<Vec<_>>();
        let [file] = file[..] else {
            panic!("{recipe}: {} files {name}", file.len());
        };
        let text = String::from_utf8(file.bytes.clone()).unwrap();
        assert!(text.starts_with("#version 300 es\n") && text.contains("void main() {}"));
        let json = files
            .iter()
            .find(|f| f.name.ends_with(".plan.json"))
            .unwrap();
        let json: PlanFile = serde_json::from_slice(&json.bytes).unwrap();
        assert_eq!(json.plan.passes[depth].fragment, None);
        let fragment = &json.files[depth].fragment;
        assert_eq!(
            fragment.keys().collect::<Vec<_>>(),
            [&Target::GlslEs300],
            "{recipe}"
        );
        assert_eq!(fragment[&Target::GlslEs300].file, name);
        assert_eq!(fragment[&Target::GlslEs300].entry_point, "main");
        accept::accept(&[(recipe.to_owned(), files)]);
    }
}

/// The walk that finds what decides a position in SPIR-V, held against the slicer of the IR: it may
/// take in more, never less.
#[test]
fn all_that_decides_an_invariant_position_is_not_contracted() {
    /// Float arithmetic (SPIR-V's opcodes from `OpFNegate` to `OpDot`), and how much of it is
    /// decorated with `NoContraction`.
    fn arithmetic(bytes: &[u8]) -> (usize, usize) {
        let words: Vec<u32> = bytes
            .chunks(4)
            .map(|c| u32::from_le_bytes(c.try_into().unwrap()))
            .collect();
        let (mut all, mut decorated, mut at) = (0, 0, 5);
        while at < words.len() {
            let opcode = words[at] & 0xffff;
            all += usize::from(matches!(
                opcode,
                127 | 129 | 131 | 133 | 136 | 140 | 141 | 142..=148
            ));
            decorated += usize::from(opcode == 71 && words[at + 2] == 42);
            at += (words[at] >> 16) as usize;
        }
        (all, decorated)
    }
    let (mut compared, mut spared) = (0, 0);
    for (name, paths) in materials("shaders") {
        for parsed in parse(&paths) {
            let program = &parsed.program;
            let (index, _) = program
                .entry_point(naga::ShaderStage::Vertex, &parsed.vertex)
                .unwrap();
            let module = interface::with_invariant_position(program.module(), index);
            let original = Plan::original(
                "m",
                program.with_module(module).unwrap(),
                &parsed.vertex,
                parsed.fragment.as_deref(),
                &MaterialState::default(),
            );
            let recipe = Recipe::parse(["shadow"]).unwrap();
            let Ok(plan) = recipe.apply(&original, &Facts::without_ties()) else {
                continue;
            };
            let files = emit::emit(&plan, &[Target::Spirv], &emit::Options::default()).unwrap();
            let of = |name: &str| {
                let file = files.iter().find(|f| f.name == name).unwrap();
                arithmetic(&file.bytes)
            };
            let ((all, decorated), (needed, _)) = (of("m.main.vert.spv"), of("m.shadow.vert.spv"));
            // A fragment slice may ask for varyings, which are no part of the position.
            if plan
                .passes
                .iter()
                .any(|p| p.role == Role::Shadow && p.fragment.is_none())
            {
                assert!(decorated >= needed, "{name}: {decorated} of {needed}");
                compared += 1;
            }
            assert!(decorated > 0 || needed == 0, "{name}");
            spared += all - decorated;
        }
    }
    assert!(
        compared > 10 && spared > 10,
        "{compared} compared, {spared} spared"
    );
}
