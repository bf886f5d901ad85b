//! Real Vulkan hosts (`tests/native`) draw the author's SPIR-V and ours with the same descriptor
//! set layouts, push-constant ranges, specialisation maps and vertex input: no pixel differs.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use preshade_compiler::emit;
use preshade_compiler::recipe::Recipe;
use preshade_plan::pass::Facts;
use preshade_plan::plan::{BindingSource, GpuPass, Plan};
use preshade_plan::plan_file::{PassFiles, Target};
use preshade_plan::state::CullMode;

use crate::reflection::{compiled, names};
use crate::{accept, fixtures_support, spirv_in};

/// The recipes that promise the same bits, `original` first.
const RECIPES: &[&str] = &[
    "original",
    "depth-prepass",
    "depth-prepass:form=equal",
    "early-discard",
];

fn folder() -> PathBuf {
    fixtures_support::root().join("tests/native")
}

/// A host and its material.
struct Host {
    dir: PathBuf,
    program: PathBuf,
    /// Of its GLSL, of the SPIR-V that glslang makes of it, and of that SPIR-V after spirv-opt,
    /// without names.
    plans: [(&'static str, Plan); 3],
    author: Vec<u8>,
}

impl Host {
    fn new(name: &'static str) -> Self {
        let dir = accept::scratch();
        std::fs::create_dir_all(&dir).unwrap();
        let program = dir.join(name);
        let mut command = Command::new("cc");
        command.args(["-std=c11", "-Wall", "-Wextra", "-Werror"]);
        command.arg("-Wno-missing-field-initializers");
        command.arg("-o").arg(&program);
        command.args([format!("{name}.c"), "host.c".to_owned()].map(|f| folder().join(f)));
        let output = command.arg("-lvulkan").output();
        let output = output.expect("a C compiler: run scripts/setup.sh native");
        let said = String::from_utf8_lossy(&output.stderr);
        assert!(
            output.status.success(),
            "Vulkan's headers and loader are needed (scripts/setup.sh native): {said}"
        );
        let sources = ["vert", "frag"].map(|stage| folder().join(format!("{name}.{stage}")));
        let words = sources.each_ref().map(|source| {
            let dir = dir.join(source.extension().unwrap());
            std::fs::create_dir_all(&dir).unwrap();
            compiled(source, &dir)
        });
        let optimised = words
            .each_ref()
            .map(|words| spirv_in::optimised_file(words));
        let plan = |[vertex, fragment]: &[PathBuf; 2]| {
            let mut plan = fixtures_support::original(&[vertex, fragment]);
            plan.material = name.to_owned();
            plan.passes[0].primitive.cull = CullMode::None;
            plan
        };
        let plans = [
            ("GLSL", plan(&sources)),
            ("SPIR-V", plan(&words)),
            ("optimised SPIR-V", plan(&optimised)),
        ];
        let mut host = Self {
            dir,
            program,
            plans,
            author: Vec::new(),
        };
        let stages = words.map(|f| format!("{} main", f.display()));
        let line = self::line(&stages, &host.plans[0].1.passes[0], &["scene-depth"]);
        host.author = host.drawn(&[line]).expect("the author's own words");
        host
    }

    /// The picture (PPM), or what the host says where it fails.
    fn drawn(&self, lines: &[String]) -> Result<Vec<u8>, String> {
        let [plan, picture] = ["plan", "picture.ppm"].map(|name| self.dir.join(name));
        std::fs::write(&plan, lines.join("\n")).unwrap();
        let _ = std::fs::remove_file(&picture);
        let mut command = Command::new(&self.program);
        let Output { status, stderr, .. } = command.arg(&picture).arg(&plan).output().unwrap();
        match status.success() {
            true => Ok(std::fs::read(&picture).unwrap()),
            false => Err(format!("{status}: {}", String::from_utf8_lossy(&stderr))),
        }
    }

    /// Writes a variant, each file changed by `change`. Returns a line for each GPU pass.
    fn written(
        &self,
        original: &Plan,
        recipe: &str,
        change: impl Fn(&str, Vec<u8>) -> Vec<u8>,
    ) -> Vec<String> {
        let plan = match recipe {
            "original" => original.clone(),
            _ => {
                let recipe = Recipe::parse_list(recipe).unwrap();
                recipe.apply(original, &Facts::without_ties()).unwrap()
            }
        };
        let files = emit::emit(&plan, &[Target::Spirv], &emit::Options::default()).unwrap();
        let written = names(&files);
        for file in files {
            let bytes = change(&file.name, file.bytes);
            std::fs::write(self.dir.join(&file.name), bytes).unwrap();
        }
        let attachments = plan.attachments.iter().map(|a| a.name.as_str());
        let attachments: Vec<&str> = attachments.collect();
        let passes = plan.passes.iter().zip(&written.files);
        passes
            .map(|(pass, files)| line(&stages(&self.dir, files), pass, &attachments))
            .collect()
    }

    /// How many pixels of a variant differ from the author's picture.
    fn differing(&self, lines: &[String]) -> Result<usize, String> {
        let picture = self.drawn(lines)?;
        assert_eq!(picture.len(), self.author.len());
        let pixels = picture.chunks(3).zip(self.author.chunks(3));
        Ok(pixels.filter(|(own, author)| own != author).count())
    }
}

impl Drop for Host {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.dir);
    }
}

fn stages(dir: &Path, files: &PassFiles) -> [String; 2] {
    [&files.vertex, &files.fragment].map(|stage| match stage.get(&Target::Spirv) {
        Some(file) => format!("{} {}", dir.join(&file.file).display(), file.entry_point),
        None => "- -".to_owned(),
    })
}

/// A GPU pass as host.c reads it.
fn line(stages: &[String; 2], pass: &GpuPass, attachments: &[&str]) -> String {
    let number = |name: &str| attachments.iter().position(|a| *a == name).unwrap();
    let depth = pass.depth.as_ref().unwrap();
    let attached = pass.bindings.iter().find_map(|b| match &b.source {
        BindingSource::Attachment { name } => Some((number(name), b.group, b.binding)),
        _ => None,
    });
    let read = match attached {
        Some((attachment, set, binding)) => format!("{attachment} {set} {binding}"),
        None => "-1 0 0".to_owned(),
    };
    format!(
        "{} {} {} {} {} {} {} {} {read}",
        stages[0],
        stages[1],
        number(&depth.attachment),
        // Vulkan has WebGPU's comparisons in the same order.
        depth.compare as u32,
        u32::from(depth.write),
        pass.targets.len(),
        depth.bias.constant,
        depth.bias.slope_scale,
    )
}

/// Decorations of SPIR-V.
const SPEC_ID: u32 = 1;
const BINDING: u32 = 33;
const DESCRIPTOR_SET: u32 = 34;
const OFFSET: u32 = 35;

/// The words with other operands in one decoration of a variable, or of a member.
fn planted(bytes: &[u8], decoration: u32, from: u32, to: u32) -> Vec<u8> {
    let words = bytes.chunks_exact(4);
    let mut words: Vec<u32> = words
        .map(|w| u32::from_le_bytes(w.try_into().unwrap()))
        .collect();
    let (mut at, mut found) = (5, Vec::new());
    while at < words.len() {
        let length = (words[at] >> 16) as usize;
        let is_decoration = matches!(words[at] & 0xffff, 71 | 72);
        if is_decoration && words[at + length - 2..at + length] == [decoration, from] {
            found.push(at + length - 1);
        }
        at += length;
    }
    let [at] = found[..] else {
        panic!("{} decorations {decoration} {from}", found.len());
    };
    words[at] = to;
    words.into_iter().flat_map(u32::to_le_bytes).collect()
}

/// A host draws each variant as its author's words, and sees each fault that is planted:
/// decorations, each with the extension of its file.
fn draws_the_same(name: &'static str, faults: &[(&str, u32, u32, u32)]) {
    let host = Host::new(name);
    let background = host.author[host.author.len() - 3..].to_vec();
    let drawn = host.author.chunks(3).filter(|p| *p != background).count();
    assert!(drawn > 10_000, "{name}: {drawn} pixels are drawn");
    for (source, plan) in &host.plans {
        for recipe in RECIPES {
            let lines = host.written(plan, recipe, |_, bytes| bytes);
            let differing = host.differing(&lines);
            assert_eq!(differing, Ok(0), "{name} of {source}: {recipe}");
        }
    }
    let plan = &host.plans[0].1;
    for (stage, decoration, from, to) in faults {
        let change = |file: &str, bytes: Vec<u8>| match file.ends_with(&format!("{stage}.spv")) {
            true => planted(&bytes, *decoration, *from, *to),
            false => bytes,
        };
        let lines = host.written(plan, "original", change);
        let differing = host.differing(&lines);
        println!("{name} {stage} {decoration} {from} -> {to}: {differing:?}");
        assert_ne!(differing, Ok(0), "{name} {stage} {decoration} {from} {to}");
    }
    // A pre-pass of the plan that is not drawn.
    let lines = host.written(plan, "depth-prepass:form=equal", |_, bytes| bytes);
    assert!(host.differing(&lines[1..]) > Ok(0), "{name}");
}

#[test]
fn textures_blocks_and_push_constants_stay_where_a_host_puts_them() {
    let faults = [
        // The array's place for the texture.
        ("frag", DESCRIPTOR_SET, 0, 2),
        // Push constants of each stage.
        ("frag", OFFSET, 68, 48),
        ("vert", OFFSET, 16, 20),
    ];
    draws_the_same("textured", &faults);
}

#[test]
fn instances_and_specialisation_constants_stay_what_a_host_makes_them() {
    let faults = [
        ("vert", SPEC_ID, 3, 12),
        ("vert", SPEC_ID, 4, 13),
        ("frag", SPEC_ID, 7, 8),
        ("frag", SPEC_ID, 9, 10),
        ("frag", SPEC_ID, 3, 4),
        // The length of an array, too.
        ("frag", SPEC_ID, 5, 6),
        ("vert", BINDING, 5, 2),
    ];
    draws_the_same("instanced", &faults);
}
