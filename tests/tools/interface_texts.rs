//! Every builtin, interpolation, resource, target and state, in pairs and with every recipe: each
//! text is compiled by compilers that are not ours, or refused by name.

use std::collections::BTreeMap;

use preshade_compiler::emit::{self, EmitError};
use preshade_compiler::front::{self, Source};
use preshade_plan::plan::Plan;
use preshade_plan::plan_file::Target;
use preshade_plan::state::MaterialState;
use rayon::prelude::*;
use shader_text::error::Color;
use shader_text::files::File;
use shader_text::options;

use crate::interfaces::{Es100, Interface, interfaces, of_es_100, varied};
use crate::{accept, webgl};

/// What becomes of an interface in each target.
#[derive(Default)]
struct Made {
    /// What other compilers are to judge, by a label.
    sets: Vec<(String, Vec<File>)>,
    /// Refusals of recipes and targets.
    refused: Vec<String>,
    /// Errors that are no refusals.
    wrong: Vec<String>,
}

fn made(interface: &Interface) -> Made {
    let mut made = Made::default();
    let label = interface.names().join(", ");
    let plan = match varied(interface.recipe(), &interface.original()) {
        Ok(plan) => plan,
        Err(refusal) if refusal.code == "internal" => {
            let text = interface.text();
            made.wrong
                .push(format!("{label}: {}\n{text}", refusal.reason));
            return made;
        }
        Err(refusal) => {
            made.refused
                .push(format!("{}: {}", refusal.pass, refusal.code));
            return made;
        }
    };
    for target in targets(interface, &plan) {
        match emit::emit(&plan, &[target], &emit::Options::default()) {
            Ok(_) if target == Target::Wgsl && interface.is_native() => {}
            Ok(files) => made.sets.push((format!("{label} {target}"), files)),
            Err(EmitError::Inexpressible { what, .. }) => {
                made.refused.push(format!("{target}: {what}"));
            }
            Err(e) => made
                .wrong
                .push(format!("{label} {target}: {e}\n{}", interface.text())),
        }
    }
    made
}

/// Tessellation stages are for what was hoisted, and nothing behind that.
fn targets(interface: &Interface, plan: &Plan) -> Vec<Target> {
    let is_hoisted = plan.steps.last().is_some_and(|s| s.pass == "hoist");
    let is_for = |t: &Target| match t {
        Target::GlslTess | Target::GlslVulkanTess => is_hoisted && !interface.is_for_es,
        Target::Wgsl | Target::GlslEs300 => true,
        _ => !interface.is_for_es,
    };
    Target::ALL.into_iter().filter(is_for).collect()
}

/// As many more at random with `PRESHADE_INTERFACES=5000`.
fn every_interface() -> Vec<Interface> {
    let more = std::env::var("PRESHADE_INTERFACES");
    interfaces(1, more.ok().and_then(|n| n.parse().ok()).unwrap_or(0))
}

#[test]
fn every_interface_compiles_or_is_refused_by_name() {
    let all = every_interface();
    let made: Vec<Made> = all.par_iter().map(made).collect();
    let mut sets = Vec::new();
    let mut refused = BTreeMap::<String, usize>::new();
    let mut wrong = Vec::new();
    for of in made {
        sets.extend(of.sets);
        wrong.extend(of.wrong);
        for what in of.refused {
            *refused.entry(what).or_default() += 1;
        }
    }
    println!(
        "{} interfaces, {} sets, {refused:#?}",
        all.len(),
        sets.len()
    );
    assert!(
        wrong.is_empty(),
        "{} are wrong:\n{}",
        wrong.len(),
        wrong.join("\n\n")
    );
    let judged = accept::accept(&sets);
    let linked = webgl::link(&sets);
    let plans: Vec<_> = sets
        .into_iter()
        .filter(|(label, _)| label.ends_with(" wgsl"))
        .collect();
    let created = accept::create(&plans);
    println!(
        "{} interfaces: {judged:?}, {linked:?}, {created:?}",
        all.len()
    );
    // They are not all refused.
    assert!(
        judged.wgsl > 200 && judged.spirv > 1000 && judged.glsl > 400,
        "{judged:?}"
    );
    assert!(
        judged.linked >= 10 && linked.webgl2 > 200,
        "{judged:?}, {linked:?}"
    );
    assert!(created.pipelines > 400, "{created:?}");
}

/// What WebGL 1 was given comes back in words that it takes, and that WebGL 2 takes.
#[test]
fn every_interface_of_webgl_1_comes_back() {
    let all = of_es_100(1);
    let made: Vec<Made> = all.par_iter().map(made_of_es_100).collect();
    let wrong: Vec<&String> = made.iter().flat_map(|m| &m.wrong).collect();
    assert!(wrong.is_empty(), "{} are wrong: {wrong:#?}", wrong.len());
    let mut refused = BTreeMap::<&str, usize>::new();
    for what in made.iter().flat_map(|m| &m.refused) {
        *refused.entry(what).or_default() += 1;
    }
    println!("{refused:#?}");
    let sets: Vec<_> = made.iter().flat_map(|m| m.sets.clone()).collect();
    let judged = accept::accept(&sets);
    let linked = webgl::link(&sets);
    println!("{} interfaces: {judged:?}, {linked:?}", all.len());
    assert!(linked.webgl1 > 100 && linked.webgl2 > 100, "{linked:?}");
}

fn made_of_es_100(of: &Es100) -> Made {
    let mut made = Made::default();
    let [vertex, fragment] = &of.texts;
    let sources = [
        Source::new("m.vert", vertex),
        Source::new("m.frag", fragment),
    ];
    let label = format!("{}\n{vertex}\n{fragment}", of.recipe);
    let parsed = match front::parse(&sources, &options::Options::default()) {
        Ok(parsed) => parsed,
        Err(e) => {
            made.wrong
                .push(format!("{}\n{label}", e.render(Color::Never)));
            return made;
        }
    };
    let (vertex, fragment) = (&parsed.vertex, parsed.fragment.as_deref());
    let state = MaterialState::default();
    let original = Plan::original("m", parsed.program, vertex, fragment, &state);
    let plan = match varied(of.recipe, &original) {
        Ok(plan) => plan,
        Err(refusal) => {
            made.refused
                .push(format!("{}: {}", refusal.pass, refusal.code));
            return made;
        }
    };
    for target in [Target::GlslEs100, Target::GlslEs300, Target::Glsl450] {
        match emit::emit(&plan, &[target], &emit::Options::default()) {
            Ok(files) => made.sets.push((format!("{target} {label}"), files)),
            Err(EmitError::Inexpressible { what, .. }) => {
                made.refused.push(format!("{target}: {what}"));
            }
            Err(e) => made.wrong.push(format!("{target}: {e}\n{label}")),
        }
    }
    made
}

/// A judge that takes everything is none.
#[test]
fn the_judges_refuse_what_is_wrong() {
    let text = include_str!("../materials/shared-binding.wgsl");
    let parsed =
        front::parse(&[Source::new("m.wgsl", text)], &options::Options::default()).unwrap();
    let (vertex, fragment) = (&parsed.vertex, parsed.fragment.as_deref());
    let state = MaterialState::default();
    let original = Plan::original("m", parsed.program, vertex, fragment, &state);
    let emitted = |target| emit::emit(&original, &[target], &emit::Options::default()).unwrap();
    // The layout of the smaller of two variables at one binding.
    let plan = emitted(Target::Wgsl);
    assert_eq!(
        accept::create(&[("sound".to_owned(), plan.clone())]).pipelines,
        1
    );
    let smaller = changed(
        plan,
        ".plan.json",
        "\"min_binding_size\": 96",
        "\"min_binding_size\": 64",
    );
    refused("minBindingSize", || {
        accept::create(&[("m".to_owned(), smaller)]).pipelines
    });
    // An input of the fragment stage that the vertex stage does not write.
    let program = emitted(Target::GlslEs300);
    assert_eq!(
        webgl::link(&[("sound".to_owned(), program.clone())]).webgl2,
        1
    );
    let unlinked = changed(
        program,
        ".es.frag",
        "smooth in",
        "smooth in vec3 other; smooth in",
    );
    let unlinked = changed(
        unlinked,
        ".es.frag",
        "void main() {",
        "void main() { other.x;",
    );
    refused("other", || {
        webgl::link(&[("m".to_owned(), unlinked)]).webgl2
    });
}

/// One wrong text for each compiler.
#[test]
fn the_compilers_refuse_wrong_texts() {
    let text = include_str!("../materials/shared-binding.wgsl");
    let parsed =
        front::parse(&[Source::new("m.wgsl", text)], &options::Options::default()).unwrap();
    let (vertex, fragment) = (&parsed.vertex, parsed.fragment.as_deref());
    let state = MaterialState::default();
    let original = Plan::original("m", parsed.program, vertex, fragment, &state);
    let emitted = |target| emit::emit(&original, &[target], &emit::Options::default()).unwrap();
    let judge = |words: &str, files: Vec<File>| {
        refused(words, || accept::accept(&[("m".to_owned(), files)]).spirv);
    };
    let wgsl = changed(
        emitted(Target::Wgsl),
        ".wgsl",
        "@fragment",
        "const c: u32 = 1.5;\n@fragment",
    );
    judge("u32", wgsl);
    let glsl = changed(
        emitted(Target::Glsl450),
        ".frag",
        "void main() {",
        "void main() { int i = 1.5;",
    );
    judge("'='", glsl);
    let mut spirv = emitted(Target::Spirv);
    let words = spirv.iter_mut().find(|f| f.name.ends_with(".spv")).unwrap();
    // Without its last instruction, `OpFunctionEnd`.
    words.bytes.truncate(words.bytes.len() - 4);
    judge("OpFunctionEnd", spirv);
}

/// The files with other words in one of them.
fn changed(mut files: Vec<File>, name: &str, from: &str, to: &str) -> Vec<File> {
    let file = files.iter_mut().find(|f| f.name.ends_with(name)).unwrap();
    let text = String::from_utf8(std::mem::take(&mut file.bytes)).unwrap();
    assert!(text.contains(from), "{text}");
    file.bytes = text.replacen(from, to, 1).into_bytes();
    files
}

/// Asserts that a judge panics, with these words.
fn refused(words: &str, judge: impl FnOnce() -> usize) {
    let result = std::panic::catch_unwind(std::panic::AssertUnwindSafe(judge));
    let said = result.expect_err("it takes what is wrong");
    let said = said.downcast_ref::<String>().unwrap();
    assert!(said.contains(words), "{said}");
}
