//! SPIR-V and Vulkan's GLSL, made of Vulkan's GLSL, fit the pipeline layout of their author: what
//! `spirv-cross` reflects of them is what it reflects of the author's text.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::process::Command;

use naga_edit::declared::{CombinedSampler, Declared};
use preshade_compiler::emit;
use preshade_compiler::front::{self, Source};
use preshade_compiler::recipe::Recipe;
use preshade_plan::pass::Facts;
use preshade_plan::plan::{BindingSource, Plan};
use preshade_plan::plan_file::{PlanFile, StageFile, Target};
use preshade_plan::state::MaterialState;
use shader_text::files::File;
use shader_text::options;

use crate::reflection_support::{self, Interface};
use crate::{accept, fixtures_support};

/// The recipes, `original` first.
const RECIPES: &[&str] = &["original", "depth-prepass", "early-discard", "hoist"];

fn reflected(spirv: &Path, is_vertex: bool) -> Interface {
    let reflected = reflection_support::reflect(spirv);
    let reflected = reflected.unwrap_or_else(|e| panic!("{e}: run scripts/setup.sh accept"));
    reflection_support::interface(&reflected, is_vertex)
}

pub(crate) fn compiled(source: &Path, dir: &Path) -> PathBuf {
    let out = dir
        .join(source.file_name().unwrap())
        .with_extension("author.spv");
    let mut command = Command::new("glslangValidator");
    let command = command.arg("-V").arg(source).arg("-o").arg(&out);
    let output = command.output().expect("glslangValidator");
    let said = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success(), "{}: {said}", source.display());
    out
}

/// The SPIR-V of a stage: what was written, or what glslang makes of it.
fn words(files: &[File], file: &StageFile, dir: &Path) -> PathBuf {
    let path = dir.join(&file.file);
    let bytes = &files.iter().find(|f| f.name == file.file).unwrap().bytes;
    std::fs::write(&path, bytes).unwrap();
    match file.file.ends_with(".spv") {
        true => path,
        false => compiled(&path, dir),
    }
}

pub(crate) fn names(files: &[File]) -> PlanFile {
    let plan = files
        .iter()
        .find(|f| f.name.ends_with(".plan.json"))
        .unwrap();
    serde_json::from_slice(&plan.bytes).unwrap()
}

/// The bindings that a pass has besides the author's.
fn added(plan: &Plan, pass: usize) -> Vec<String> {
    let own = |source: &BindingSource| matches!(source, BindingSource::Author);
    let bindings = plan.passes[pass].bindings.iter();
    bindings
        .filter(|b| !own(&b.source))
        .map(|b| format!("set {} binding {}:", b.group, b.binding))
        .collect()
}

#[test]
fn what_vulkan_gets_fits_the_layout_of_its_author() {
    let folder = fixtures_support::root().join("fixtures/glsl/vulkan");
    let entries = std::fs::read_dir(folder)
        .unwrap()
        .map(|e| e.unwrap().path());
    let vertex: BTreeSet<PathBuf> = entries
        .filter(|p| p.extension().is_some_and(|e| e == "vert"))
        .collect();
    let mut compared = BTreeMap::new();
    let mut sets = Vec::new();
    for source in vertex {
        let dir = accept::scratch();
        std::fs::create_dir_all(&dir).unwrap();
        let pair = [source.clone(), source.with_extension("frag")];
        let [vertex, fragment] = [0, 1].map(|stage| {
            // Both have the file name of the material.
            let dir = dir.join(stage.to_string());
            std::fs::create_dir_all(&dir).unwrap();
            reflected(&compiled(&pair[stage], &dir), stage == 0)
        });
        let original = fixtures_support::original(&[&pair[0], &pair[1]]);
        for recipe in RECIPES {
            let plan = match *recipe {
                "original" => original.clone(),
                _ => {
                    let recipe = Recipe::parse_list(recipe).unwrap();
                    match recipe.apply(&original, &Facts::without_ties()) {
                        Ok(plan) => plan,
                        Err(_) => continue,
                    }
                }
            };
            for target in [Target::Spirv, Target::GlslVulkan] {
                let label = format!("{} {recipe} {target}", plan.material);
                let files = emit::emit(&plan, &[target], &emit::Options::default());
                let files = files.unwrap_or_else(|e| panic!("{label}: {e}"));
                let mut lines = 0;
                for (i, pass) in names(&files).files.iter().enumerate() {
                    let stages = [
                        (pass.vertex.get(&target), &vertex),
                        (pass.fragment.get(&target), &fragment),
                    ];
                    for (stage, (file, wanted)) in stages.into_iter().enumerate() {
                        let Some(file) = file else { continue };
                        // GLSL out declares the transposes, which are the same memory.
                        let by_rows = |line: &String| match target {
                            Target::Spirv => line.clone(),
                            _ => line.replace(" by rows", ""),
                        };
                        let wanted = &wanted.iter().map(by_rows).collect::<Interface>();
                        let found = reflected(&words(&files, file, &dir), stage == 0);
                        let added = added(&plan, i);
                        let is_added = |line: &&String| added.iter().any(|a| line.starts_with(a));
                        let strange = found.difference(wanted).filter(|l| !is_added(l));
                        let strange: Vec<_> = strange.collect();
                        let file = match file.file.ends_with(".spv") {
                            true => file.file.clone(),
                            false => std::fs::read_to_string(dir.join(&file.file)).unwrap(),
                        };
                        assert!(
                            strange.is_empty(),
                            "{label} {file}: {strange:#?}\n{wanted:#?}"
                        );
                        if *recipe == "original" {
                            assert_eq!(&found, wanted, "{label} {file}");
                        }
                        lines += found.len();
                    }
                }
                compared.insert(label.clone(), lines);
                sets.push((label, files));
            }
        }
        std::fs::remove_dir_all(&dir).unwrap();
    }
    println!("{compared:#?}");
    assert!(compared.len() >= 18 && compared.values().all(|lines| *lines > 0));
    let judged = accept::accept(&sets);
    assert!(judged.spirv >= 14 && judged.glsl >= 14, "{judged:?}");
}

#[test]
fn a_texture_read_with_another_sampler_stays_apart() {
    let source = |other: &str| {
        format!(
            "@group(1) @binding(2) var map: texture_2d<f32>;
             @group(1) @binding(0) var map_sampler: sampler;
             @group(1) @binding(1) var other: sampler;
             @vertex fn vs(@location(0) p: vec4<f32>) -> @builtin(position) vec4<f32> {{
                 return p;
             }}
             @fragment fn fs(@builtin(position) p: vec4<f32>) -> @location(0) vec4<f32> {{
                 return textureSample(map, map_sampler, p.xy)
                     + textureSample(map, {other}, p.yx) + textureLoad(map, vec2<u32>(p.xy), 0);
             }}"
        )
    };
    let written = |other: &str, target: Target| {
        let text = source(other);
        let parsed = front::parse(&[Source::new("m.wgsl", text)], &options::Options::default());
        let parsed =
            parsed.unwrap_or_else(|e| panic!("{}", e.render(shader_text::error::Color::Never)));
        let binding = |binding| naga::ResourceBinding { group: 1, binding };
        let declared = Declared {
            samplers: vec![CombinedSampler {
                path: "map".to_owned(),
                texture: binding(2),
                sampler: binding(0),
            }],
            ..Declared::default()
        };
        let program = parsed.program.with_declared(declared);
        let (vertex, fragment) = (&parsed.vertex, parsed.fragment.as_deref());
        let plan = Plan::original("m", program, vertex, fragment, &MaterialState::default());
        let files = emit::emit(&plan, &[target], &emit::Options::default()).unwrap();
        let dir = accept::scratch();
        std::fs::create_dir_all(&dir).unwrap();
        let plan = names(&files);
        let file = &plan.files[0].fragment[&target];
        let found = reflected(&words(&files, file, &dir), false);
        std::fs::remove_dir_all(&dir).unwrap();
        accept::accept(&[(format!("{other} {target}"), files)]);
        let notes = plan
            .plan
            .notes
            .iter()
            .filter(|n| n.contains("`map` stays a texture"));
        (
            found.into_iter().collect::<Vec<_>>(),
            notes.count(),
            file.textures.len(),
        )
    };
    for target in [Target::Spirv, Target::GlslVulkan] {
        let (found, notes, listed) = written("map_sampler", target);
        assert_eq!(
            found,
            ["set 1 binding 2: textures \"sampler2D\" []"],
            "{target}"
        );
        assert_eq!((notes, listed), (0, 1), "{target}");
        let (found, notes, listed) = written("other", target);
        assert_eq!(found.len(), 3, "{target}: {found:?}");
        assert_eq!((notes, listed), (1, 0), "{target}");
    }
}
