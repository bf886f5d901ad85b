//! What is emitted with tessellation stages, and what is refused.

use std::collections::BTreeMap;
use std::path::Path;

use preshade_compiler::emit::{self, ClipSpace, EmitError};
use preshade_compiler::recipe::Recipe;
use preshade_plan::pass::Facts;
use preshade_plan::plan::Plan;
use preshade_plan::plan_file::{PlanFile, Target};
use shader_text::files::File;

use crate::fixtures_support;

fn plan(fixture: &str, recipe: &[&str]) -> Plan {
    let path = Path::new("fixtures/shaders").join(fixture);
    let original = fixtures_support::original(&[&path]);
    let recipe = Recipe::parse(recipe).unwrap();
    recipe
        .apply(&original, &Facts::default())
        .unwrap_or_else(|r| panic!("{r}"))
}

const HOIST: &str = "hoist:budget=0.05,finite=assumed,jumps=carried";

fn text<'a>(files: &'a [File], name: &str) -> &'a str {
    let file = files.iter().find(|f| f.name == name);
    let file = file.unwrap_or_else(|| panic!("there is no {name}"));
    std::str::from_utf8(&file.bytes).unwrap()
}

#[test]
fn a_hoisted_highlight() {
    let hoisted = plan("specular.wgsl", &[HOIST]);
    let mut all = String::new();
    for (target, infix) in [
        (Target::GlslTess, "tess"),
        (Target::GlslVulkanTess, "vulkan"),
    ] {
        let files = emit::emit(&hoisted, &[target], &emit::Options::default()).unwrap();
        for stage in ["vert", "tesc", "tese", "frag"] {
            let name = format!("specular.main.{infix}.{stage}");
            all += &format!("==== {name}\n{}\n", text(&files, &name));
        }
    }
    insta::assert_snapshot!(all);
}

#[test]
fn the_plan_names_the_stages_and_what_each_binds() {
    let hoisted = plan("specular.wgsl", &[HOIST]);
    let files = emit::emit(&hoisted, &[Target::GlslTess], &emit::Options::default()).unwrap();
    let host: PlanFile = serde_json::from_str(text(&files, "specular.plan.json")).unwrap();
    let stages = &host.files[0].tessellation[&Target::GlslTess];
    assert_eq!(stages.control.file, "specular.main.tess.tesc");
    assert_eq!(stages.evaluation.file, "specular.main.tess.tese");
    let evaluation = text(&files, &stages.evaluation.file);
    assert!(!stages.evaluation.blocks.is_empty());
    for block in &stages.evaluation.blocks {
        let declared = format!("uniform {} {{", block.block);
        assert_eq!(evaluation.matches(&declared).count(), 1, "{declared}");
    }
    // What it falls back to is the author's, in two stages.
    let original = host.original.unwrap();
    assert!(original.files[0].tessellation.is_empty());
    let vertex = &original.files[0].vertex[&Target::GlslTess].file;
    assert!(text(&files, vertex).starts_with("#version 400 core\n"));
}

#[test]
fn stages_agree_on_bindings() {
    let hoisted = plan("specular.wgsl", &[HOIST]);
    let options = emit::Options::default();
    let files = emit::emit(&hoisted, &[Target::GlslVulkanTess], &options).unwrap();
    let host: PlanFile = serde_json::from_str(text(&files, "specular.plan.json")).unwrap();
    let (of, target) = (&host.files[0], Target::GlslVulkanTess);
    let evaluation = &of.tessellation[&target].evaluation;
    let mut slots = BTreeMap::new();
    for block in [&of.vertex[&target], evaluation, &of.fragment[&target]]
        .into_iter()
        .flat_map(|s| &s.blocks)
    {
        assert_eq!(
            *slots.entry(block.slot.unwrap()).or_insert(block.binding),
            block.binding
        );
    }
    assert_eq!(slots.len(), 4, "{slots:?}");
}

#[test]
fn the_clip_space_is_turned_once() {
    let hoisted = plan("specular.wgsl", &[HOIST]);
    let options = emit::Options {
        glsl_clip_space: ClipSpace::OpenGl,
    };
    let files = emit::emit(&hoisted, &[Target::GlslTess], &options).unwrap();
    let turns = |stage: &str| {
        let name = format!("specular.main.tess.{stage}");
        text(&files, &name).matches("gl_Position.yz = ").count()
    };
    assert_eq!(["vert", "tesc", "tese"].map(turns), [0, 0, 1]);
}

#[test]
fn what_was_not_hoisted_is_refused() {
    let refused = |plan: &Plan| {
        let error = emit::emit(plan, &[Target::GlslTess], &emit::Options::default()).unwrap_err();
        match error {
            EmitError::Inexpressible { what, remedy, .. } => format!("{what}; {remedy}"),
            other => panic!("{other}"),
        }
    };
    let refusals = [
        refused(&plan("specular.wgsl", &[])),
        refused(&plan("specular.wgsl", &[HOIST, "tessellate:level=2"])),
        refused(&plan("specular.wgsl", &[HOIST, "depth-prepass"])),
    ];
    insta::assert_snapshot!(refusals.join("\n"));
}
