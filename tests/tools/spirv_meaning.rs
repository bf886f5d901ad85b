//! SPIR-V means what its text means: each text is held against what glslang and spirv-opt make of it.
//! The two are read by different readers. `FLOW_SEEDS=500` tries as many made-up control flows.

use std::path::{Path, PathBuf};

use preshade_compiler::emit::{self, EmitError};
use preshade_compiler::front::{self, Source};
use preshade_plan::plan::Plan;
use preshade_plan::plan_file::Target;
use preshade_plan::state::MaterialState;
use preshade_validate::Effort;
use preshade_validate::agree::{Class, Relation, agree};
use rayon::prelude::*;
use shader_text::options::{ClipSpace, Options};

use crate::fixtures_support::root;
use crate::flows::Flows;
use crate::spirv_in::{VERTEX, assembled, optimised_by, scratch, try_glslang};

/// What `spirv-opt` is asked for: each pass that moves control flow is in one of them.
const RECIPES: [&[&str]; 4] = [
    &["-O"],
    &["-Os"],
    &[
        "--inline-entry-points-exhaustive",
        "--ssa-rewrite",
        "--eliminate-dead-code-aggressive",
    ],
    &[
        "--merge-return",
        "--inline-entry-points-exhaustive",
        "--loop-unroll",
        "--simplify-instructions",
    ],
];

fn plan(sources: &[Source]) -> Result<Plan, String> {
    let options = Options {
        clip_space: Some(ClipSpace::AsWritten),
        ..Options::default()
    };
    let parsed =
        front::parse(sources, &options).map_err(|e| e.render(shader_text::error::Color::Never))?;
    Ok(parsed.plan("m", &MaterialState::default()))
}

pub(crate) fn of_bytes(files: [(&str, Vec<u8>); 2]) -> Result<Plan, String> {
    plan(&files.map(|(name, bytes)| Source::from_bytes(name, bytes).unwrap()))
}

/// What differs between two programs, in words. An optimiser may round otherwise.
pub(crate) fn differences(first: &Plan, second: &Plan, may_round: bool) -> Vec<String> {
    let effort = Effort {
        inputs: 60,
        ..Effort::default()
    };
    let agreement = match agree(first, second, Relation::Same.into(), &effort) {
        Ok(agreement) => agreement,
        Err(mismatch) => return vec![mismatch.to_string()],
    };
    let findings = agreement.findings.iter();
    let counted = findings.filter(|f| !(may_round && f.class == Class::Rounding));
    counted
        .map(|f| format!("{}: {}", f.class.name(), f.words))
        .collect()
}

/// What differs between a program and the GLSL written of it.
fn differences_of_glsl(plan: &Plan) -> Vec<String> {
    let targets = [Target::Glsl450, Target::GlslVulkan, Target::GlslEs300];
    let written = targets.map(|target| {
        emit::emit_compared(
            plan,
            &[target],
            &emit::Options::default(),
            emit::Meaning::QUICK,
        )
    });
    let errors = written.into_iter().filter_map(Result::err);
    let differ = errors.filter(|e| matches!(e, EmitError::Differs { .. }));
    differ.map(|e| e.to_string()).collect()
}

/// Holds a text against its modules. `None`: glslang does not take it for Vulkan.
fn check(label: &str, texts: [&Path; 2], dir: &Path) -> Option<Vec<String>> {
    std::fs::create_dir_all(dir).unwrap();
    let options = ["--auto-map-bindings", "--auto-map-locations"];
    let mut modules = Vec::new();
    for path in texts {
        modules.push(try_glslang(path, &options, dir).ok()?);
    }
    let first = of_bytes(texts.map(|path| {
        let is_vertex = path.extension().is_some_and(|e| e == "vert");
        let name = if is_vertex { "m.vert" } else { "m.frag" };
        (name, std::fs::read(path).unwrap())
    }));
    let first = match first {
        Ok(plan) => plan,
        Err(error) => return Some(vec![format!("{label}: {error}")]),
    };
    let mut found = Vec::new();
    for recipe in [&[][..]].iter().chain(&RECIPES) {
        let own = modules.iter().map(|module| match recipe.is_empty() {
            true => module.clone(),
            false => optimised_by(recipe, module, dir),
        });
        let [vertex, fragment] = own.collect::<Vec<_>>().try_into().unwrap();
        let second = of_bytes([("m.vert.spv", vertex), ("m.frag.spv", fragment)]);
        let differ = match second {
            Ok(second) => {
                let mut differ = differences(&first, &second, !recipe.is_empty());
                if *recipe == RECIPES[0] {
                    differ.extend(differences_of_glsl(&second));
                }
                differ
            }
            Err(error) => vec![error],
        };
        found.extend(
            differ
                .into_iter()
                .map(|d| format!("{label} {recipe:?}: {d}")),
        );
    }
    Some(found)
}

fn pairs(folder: &Path, found: &mut Vec<[PathBuf; 2]>) {
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        match path.extension().and_then(|e| e.to_str()) {
            None if path.is_dir() => pairs(&path, found),
            Some("vert") if path.with_extension("frag").exists() => {
                found.push([path.clone(), path.with_extension("frag")]);
            }
            _ => {}
        }
    }
}

#[test]
fn fixtures_mean_the_same_as_modules() {
    let mut all = Vec::new();
    pairs(&root().join("fixtures/glsl"), &mut all);
    let dir = scratch();
    let results: Vec<_> = all
        .par_iter()
        .enumerate()
        .map(|(n, [vertex, fragment])| {
            let label = vertex.file_stem().unwrap().to_string_lossy();
            check(&label, [vertex, fragment], &dir.join(n.to_string()))
        })
        .collect();
    let taken = results.iter().flatten().count();
    let found: Vec<_> = results.into_iter().flatten().flatten().collect();
    assert!(found.is_empty(), "{}", found.join("\n"));
    // It takes no loose uniforms, and no older dialects.
    assert!(taken >= 7, "glslang takes {taken} of {} pairs", all.len());
}

#[test]
fn control_flow_means_the_same_as_modules() {
    let seeds = std::env::var("FLOW_SEEDS").map_or(16, |n| n.parse().unwrap());
    let dir = scratch();
    let vertex = dir.join("m.vert");
    std::fs::write(&vertex, VERTEX).unwrap();
    let results: Vec<_> = (0..seeds)
        .into_par_iter()
        .map(|seed| {
            let own = dir.join(seed.to_string());
            std::fs::create_dir_all(&own).unwrap();
            let fragment = own.join("m.frag");
            std::fs::write(&fragment, Flows::new(seed).fragment()).unwrap();
            let found = check(&format!("seed {seed}"), [&vertex, &fragment], &own);
            found.unwrap_or_else(|| panic!("glslang refuses {}", fragment.display()))
        })
        .collect();
    let found: Vec<_> = results.concat();
    assert!(found.is_empty(), "{}", found.join("\n"));
}

/// The files of `fixtures/cases` whose first line says what is right: a module and its text.
#[test]
fn cases_mean_the_same_as_their_texts() {
    let dir = scratch();
    std::fs::create_dir_all(&dir).unwrap();
    let cases = root().join("fixtures/cases");
    let text = |name: &str| std::fs::read_to_string(cases.join(name)).unwrap();
    let vertex = assembled(&text("plain.vert.spvasm"), &dir);
    let of_text = |fragment: &str| {
        of_bytes([
            ("m.vert", text("plain450.vert").into()),
            ("m.frag", fragment.into()),
        ])
    };
    let of_module =
        |module: Vec<u8>| of_bytes([("m.vert.spv", vertex.clone()), ("m.frag.spv", module)]);
    let mut found = Vec::new();
    let own = CASES.map(|name| (name, text(&format!("{name}.source.frag"))));
    for (name, source) in own
        .into_iter()
        .chain(WRITTEN.map(|(name, text)| (name, text.to_owned())))
    {
        let first = of_text(&source).unwrap();
        let module = assembled(&text(&format!("{name}.spvasm")), &dir);
        let second = of_module(module).unwrap_or_else(|e| panic!("{name}: {e}"));
        let mut differ = differences(&first, &second, false);
        differ.extend(differences_of_glsl(&second));
        found.extend(differ.into_iter().map(|d| format!("{name}: {d}")));
    }
    assert!(found.is_empty(), "{}", found.join("\n"));
}

const CASES: [&str; 8] = [
    "adv/glsl-switch-empty-case",
    "adv/glsl-switch-empty-default",
    "glsl-out-phi-rotates",
    "spirv-outer-product",
    "spirv-return-without-outputs",
    "spirv-switch-case-is-default",
    "spirv-switch-leaves-inner-loop",
    "spirv-switch-leaves-loop",
];

/// Texts of modules that no GLSL compiler writes.
const WRITTEN: [(&str, &str); 2] = [
    (
        "spirv-nclamp-of-nan",
        "#version 450
layout(location=0) in vec2 vUv; layout(location=0) out vec4 c;
void main() {
    float q = vUv.x / (vUv.y - vUv.y) * 0.0;
    float r = (floatBitsToUint(q) & 0x7fffffffu) > 0x7f800000u ? 0.25 : clamp(q, 0.25, 0.75);
    if (r > 0.5) discard;
    c = vec4(r, vUv, 1.0);
}",
    ),
    (
        "spirv-cbuffer-float3-behind-float",
        "#version 450
layout(location=0) in vec2 vUv; layout(location=0) out vec4 c;
layout(set=0, binding=1) uniform B { float strength; float tint_x; float tint_y; float tint_z; };
void main() {
    if (strength - vUv.x < 0.0) discard;
    c = vec4(vec3(tint_x, tint_y, tint_z) * strength, vUv.y);
}",
    ),
];

/// What is written of `NMin` and its like has them again.
#[test]
fn functions_that_know_nan_are_written_as_such() {
    let dir = scratch();
    std::fs::create_dir_all(&dir).unwrap();
    let cases = root().join("fixtures/cases");
    let text = |name: &str| std::fs::read_to_string(cases.join(name)).unwrap();
    let vertex = assembled(&text("plain.vert.spvasm"), &dir);
    let clamp = text("spirv-nclamp-of-nan.spvasm");
    let other = clamp.replace("NClamp %35 %float_0_25 %float_0_75", "NMax %35 %27");
    for (module, function) in [(&clamp, "NClamp"), (&other, "NMax")] {
        let module = assembled(module, &dir);
        let plan = of_bytes([("m.vert.spv", vertex.clone()), ("m.frag.spv", module)]).unwrap();
        let files = emit::emit(
            &plan,
            &[Target::Wgsl, Target::Spirv],
            &emit::Options::default(),
        );
        for file in files.unwrap() {
            if file.name.ends_with(".frag.spv") {
                let read = rspirv::dr::load_bytes(&file.bytes).unwrap();
                let text = rspirv::binary::Disassemble::disassemble(&read);
                assert!(text.contains(&format!(" {function} ")), "{text}");
                assert!(!text.contains("OpSelect "), "{text}");
            }
            if file.name.ends_with(".wgsl") {
                let text = String::from_utf8_lossy(&file.bytes);
                assert!(text.contains("select("), "{text}");
            }
        }
    }
}

/// `spirv-opt -Os` drops the members of a block that a stage does not read.
#[test]
fn a_block_is_whole_if_each_stage_has_a_part_of_it() {
    let dir = scratch();
    std::fs::create_dir_all(&dir).unwrap();
    let block = "struct L { vec4 a; vec4 b; };\n\
                 layout(set=0, binding=0) uniform U { mat4 m; vec4 a; vec4 b; L l[2]; } u;\n";
    let vertex = format!(
        "#version 450\nlayout(location=0) in vec3 p; layout(location=0) out vec2 v;\n{block}\
         void main() {{ v = p.xy * u.a.x; gl_Position = u.m * vec4(p, 1); }}"
    );
    let fragment = format!(
        "#version 450\nlayout(location=0) in vec2 v; layout(location=0) out vec4 o;\n{block}\
         void main() {{ if (v.x > u.b.x) discard; o = u.l[1].b * v.y; }}"
    );
    let texts = [("m.vert", vertex), ("m.frag", fragment)].map(|(name, text)| {
        let path = dir.join(name);
        std::fs::write(&path, text).unwrap();
        path
    });
    let first =
        of_bytes([0, 1].map(|n| (["m.vert", "m.frag"][n], std::fs::read(&texts[n]).unwrap())))
            .unwrap();
    for options in [&["-Os"][..], &["-Os", "--strip-debug"]] {
        let own = [0, 1].map(|n| {
            let words = try_glslang(&texts[n], &[], &dir).unwrap();
            (
                ["m.vert.spv", "m.frag.spv"][n],
                optimised_by(options, &words, &dir),
            )
        });
        let second = of_bytes(own).unwrap_or_else(|e| panic!("{options:?}: {e}"));
        // Without names the members are partners by their places alone.
        let found = differences(&first, &second, true);
        assert!(found.is_empty(), "{options:?}: {found:?}");
    }
}
