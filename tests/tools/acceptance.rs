//! Nothing a back end writes is shipped on faith: every fixture through every pass, in every
//! target, compiled by compilers that are not ours.

use std::path::{Path, PathBuf};

use preshade_compiler::emit;
use preshade_compiler::recipe::Recipe;
use preshade_passes::analysis::uniformity::non_uniform;
use preshade_plan::pass::{Facts, Use};
use preshade_plan::plan::Plan;
use preshade_plan::plan_file::Target;
use rayon::prelude::*;
use shader_text::files::File;

use crate::{accept, fixtures_support, uniformity_cases, wgsl_in_cases};

#[test]
fn other_compilers_take_every_variant_of_every_fixture() {
    let materials = fixtures_support::materials();
    let made: Vec<(Sets, Vec<String>)> = materials.par_iter().map(|m| variants(m)).collect();
    let (sets, left_out): (Vec<Sets>, Vec<Vec<String>>) = made.into_iter().unzip();
    let left_out = left_out.concat();
    let sets = sets.concat();
    let judged = accept::accept(&sets);
    let created = accept::create(&sets);
    println!("{judged:?}, {created:?}");
    assert!(
        judged.wgsl > 100 && judged.spirv > 200 && judged.glsl > 100 && judged.linked > 20,
        "{judged:?}"
    );
    assert!(created.pipelines > 500, "{created:?}");
    // What GLSL cannot say is refused by name, never written wrong: storage buffers and primitive
    // indices in ES 3.00, and the indices of vertices and instances, which naga
    // writes in OpenGL's words alone; blocks and unsigned integers in ES 1.00.
    let known = |text: &str| {
        (text.contains("glsl-es") && text.contains("storage buffers"))
            || (text.contains("glsl-es-100")
                && (text.contains("the block `") || text.contains("an unsigned integer")))
            || (text.contains("glsl-es") && text.contains("primitive_index"))
            || (text.contains("glsl-tess") && text.contains("a storage buffer"))
            || (text.contains("glsl-vulkan-tess") && text.contains("index"))
            || (text.contains("glsl-vulkan") && text.contains("passed to a function together"))
    };
    let unknown: Vec<_> = left_out.iter().filter(|l| !known(l)).collect();
    assert!(unknown.is_empty(), "{unknown:#?}");
}

#[test]
fn tint_says_of_uniformity_what_the_cases_say() {
    use uniformity_cases::{CASES, Verdict, text};
    let texts: Vec<String> = CASES.iter().map(text).collect();
    let mut wrong = Vec::new();
    for (case, errors) in CASES.iter().zip(accept::tint_says(&texts)) {
        let is_rejected = errors.iter().any(|e| e.contains("uniform control flow"));
        let other = errors.iter().find(|e| !e.contains("uniform control flow"));
        if is_rejected != (case.verdict == Verdict::MayBeNonUniform) || other.is_some() {
            wrong.push(format!("{}: {errors:?}", case.name));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn tint_takes_of_wgsl_what_the_cases_say() {
    use wgsl_in_cases::{CASES, text};
    let texts: Vec<String> = CASES.iter().map(text).collect();
    let judged = CASES.iter().zip(accept::tint_says(&texts));
    let wrong = judged.filter(|(case, errors)| errors.is_empty() == case.refused.is_some());
    let wrong: Vec<String> = wrong
        .map(|(case, errors)| format!("{}{}: {errors:?}", case.declarations, case.statements))
        .collect();
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

/// What was emitted, by what it is.
type Sets = Vec<(String, Vec<File>)>;

/// A material through every recipe in every target, and what a target could not say.
fn variants(files: &[PathBuf]) -> (Sets, Vec<String>) {
    let mut sets = Vec::new();
    let mut left_out = Vec::new();
    let paths: Vec<&Path> = files.iter().map(AsRef::as_ref).collect();
    let original = fixtures_support::original(&paths);
    let mut variants = vec![("original", original.clone())];
    for recipe in fixtures_support::recipes(&[Use::Snapshot, Use::Compile]) {
        // Ties measured to be none: the main pass of `equal` loses its discard, the hardest text of
        // the two.
        let facts = Facts::without_ties();
        if let Ok(plan) = Recipe::parse_list(recipe).unwrap().apply(&original, &facts) {
            variants.push((recipe, plan));
        }
    }
    let is_uniform = |plan: &Plan| {
        plan.programs
            .values()
            .all(|p| non_uniform(p.module()).is_empty())
    };
    let was_uniform = is_uniform(&original);
    for (recipe, plan) in variants {
        let label = format!("{} {recipe}", plan.material);
        assert!(
            !was_uniform || is_uniform(&plan),
            "{label}: what needs uniform control flow no longer has it"
        );
        let mut set = Vec::new();
        // Tessellation stages are for what was hoisted, and nothing behind that.
        let last = plan.steps.last().map(|s| s.pass.as_str());
        let targets = match last {
            Some("hoist") => Target::ALL.to_vec(),
            _ => [&Target::GENERAL[..], &[Target::GlslVulkan]].concat(),
        };
        for target in targets {
            match emit::emit(&plan, &[target], &emit::Options::default()) {
                Ok(files) => {
                    // The plan with the files in WGSL, of which Dawn creates pipelines.
                    let is_wanted = |f: &File| target == Target::Wgsl || !f.name.ends_with(".json");
                    set.extend(files.into_iter().filter(is_wanted));
                }
                Err(e) if !matches!(target, Target::Wgsl | Target::Spirv) => {
                    left_out.push(format!("{label} {}: {e}", target.name()))
                }
                Err(e) => panic!("{label} {}: {e}", target.name()),
            }
        }
        sets.push((label, set));
    }
    (sets, left_out)
}
