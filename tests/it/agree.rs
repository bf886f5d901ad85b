//! `agree` raises no false alarm: every fixture is held against the passes that preshade derives
//! from it, and against itself, renamed, formatted, and compiled to another language and back.
//! `AGREE_INPUTS=480` tries as many inputs as the command does.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use naga::back::wgsl;
use naga::{EntryPoint, Module, TypeInner};
use naga_edit::declared::Depth;
use preshade_compiler::emit;
use preshade_compiler::front::{self, Source};
use preshade_compiler::recipe::Recipe;
use preshade_plan::pass::Facts;
use preshade_plan::plan::{BindingSource, GpuPass, Plan, Role};
use preshade_plan::plan_file::Target;
use preshade_plan::program::Program;
use preshade_plan::state::MaterialState;
use preshade_validate::Effort;
use preshade_validate::agree::{Agreement, Outcome, Relation, agree};
use rayon::prelude::*;
use shader_text::options::{ClipSpace, Options};

use crate::fixtures_support::root;

/// Passes that draw the author's geometry and promise the author's bits.
const RECIPES: [&str; 5] = [
    "depth-prepass",
    "shadow",
    "early-discard",
    "early-alpha",
    "visibility-buffer",
];

/// Files of each fixture with a vertex stage: WGSL files, and pairs of GLSL files.
pub fn fixtures(folder: &Path, found: &mut Vec<Vec<PathBuf>>) {
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        // Inputs that broke a parser once.
        if path.is_dir() && !path.ends_with("crashes") {
            fixtures(&path, found);
        }
        match path.extension().and_then(|e| e.to_str()) {
            Some("wgsl") => found.push(vec![path]),
            Some("vert") if path.with_extension("frag").exists() => {
                found.push(vec![path.clone(), path.with_extension("frag")]);
            }
            _ => {}
        }
    }
}

fn plan(sources: &[Source], options: &Options) -> Option<Plan> {
    let parsed = front::parse(sources, options).ok()?;
    Some(parsed.plan("m", &MaterialState::default()))
}

pub fn read(files: &[PathBuf]) -> Option<Plan> {
    let sources = files.iter().map(|path| {
        let name = path.file_name().unwrap().to_string_lossy();
        Source::from_bytes(name, std::fs::read(path).unwrap()).unwrap()
    });
    plan(&sources.collect::<Vec<_>>(), &Options::default())
}

/// A pass as the text that is emitted of it.
fn emitted(plan_of_all: &Plan, pass: &GpuPass) -> Option<Plan> {
    let files = emit::emit(plan_of_all, &[Target::Wgsl], &emit::Options::default()).ok()?;
    let name = format!("m.{}.wgsl", pass.program);
    let file = files.into_iter().find(|f| f.name == name)?;
    let options = Options {
        vertex: Some(pass.vertex.clone()),
        fragment: pass.fragment.clone(),
        ..Options::default()
    };
    plan(&[Source::from_bytes(name, file.bytes).unwrap()], &options)
}

/// A material in another language.
fn compiled(original: &Plan, target: Target) -> Option<Plan> {
    let files = emit::emit(original, &[target], &emit::Options::default()).ok()?;
    let shaders = files.into_iter().filter(|f| !f.name.ends_with(".json"));
    let sources = shaders.map(|f| Source::from_bytes(f.name, f.bytes).unwrap());
    // GLSL keeps its author's clip space.
    let is_open_gl = |program: &Program| program.declared().depth == Depth::OpenGl;
    let clip_space = match original.programs.values().any(is_open_gl) {
        true => None,
        false => Some(ClipSpace::AsWritten),
    };
    let options = Options {
        clip_space,
        ..Options::default()
    };
    plan(&sources.collect::<Vec<_>>(), &options)
}

/// A material with other names for everything that a host does not bind by name, as naga writes it.
fn renamed(original: &Plan) -> Option<Plan> {
    // naga's writer leaves out `@early_depth_test`.
    let mut programs = original.programs.values();
    let is_early = |e: &EntryPoint| e.early_depth_test.is_some();
    if programs.any(|p| p.module().entry_points.iter().any(is_early)) {
        return None;
    }
    let pass = original.main()?;
    let mut module = original.program(pass)?.module().clone();
    rename(&mut module);
    let info = naga::valid::Validator::new(
        naga::valid::ValidationFlags::all(),
        naga::valid::Capabilities::all(),
    )
    .validate(&module)
    .ok()?;
    let text = wgsl::write_string(&module, &info, wgsl::WriterFlags::EXPLICIT_TYPES).ok()?;
    let options = Options {
        vertex: Some(pass.vertex.clone()),
        fragment: pass.fragment.clone(),
        ..Options::default()
    };
    plan(&[Source::new("renamed.wgsl", text)], &options)
}

fn rename(module: &mut Module) {
    let mut count = 0;
    let mut next = move || {
        count += 1;
        Some(format!("item{count}"))
    };
    let types: Vec<_> = module.types.iter().map(|(h, ty)| (h, ty.clone())).collect();
    for (handle, mut ty) in types {
        // Results of built-in functions have names of their own.
        let is_predeclared = ty.name.as_deref().is_none_or(|n| n.starts_with("__"));
        if let (TypeInner::Struct { members, .. }, false) = (&mut ty.inner, is_predeclared) {
            ty.name = next();
            members.iter_mut().for_each(|m| m.name = next());
            module.types.replace(handle, ty);
        }
    }
    for (_, constant) in module.constants.iter_mut() {
        constant.name = next();
    }
    for (_, global) in module.global_variables.iter_mut() {
        if global.binding.is_some() {
            global.name = next();
        }
    }
    let entries = module.entry_points.iter_mut().map(|e| &mut e.function);
    let functions = module.functions.iter_mut().map(|(_, f)| f);
    for function in functions.chain(entries) {
        function.name = next();
        function.arguments.iter_mut().for_each(|a| a.name = next());
        function
            .local_variables
            .iter_mut()
            .for_each(|(_, l)| l.name = next());
        let names = function.named_expressions.iter_mut();
        names.for_each(|(_, name)| *name = next().unwrap_or_default());
    }
}

/// Whether naga wrote a uniform for the host to set: OpenGL does not count instances from the draw's
/// first one.
fn needs_first_instance(plan: &Plan) -> bool {
    let mut programs = plan.programs.values();
    programs.any(|program| {
        let types = program.module().types.iter();
        let structs = types.filter_map(|(_, ty)| match &ty.inner {
            TypeInner::Struct { members, .. } => Some(members.iter()),
            _ => None,
        });
        let mut names = structs.flatten().filter_map(|m| m.name.as_deref());
        names.any(|name| name == "naga_vs_first_instance")
    })
}

/// The second programs that a material must agree with.
fn partners(original: &Plan) -> Vec<(String, Relation, Plan)> {
    let mut all = Vec::new();
    for recipe in RECIPES {
        let parsed = Recipe::parse_list(recipe).unwrap();
        let Ok(variant) = parsed.apply(original, &Facts::without_ties()) else {
            continue;
        };
        for pass in &variant.passes {
            let relation = match pass.role {
                Role::Prepass | Role::Ids => Relation::Prepass,
                Role::Shadow => Relation::Shadow,
                Role::Main => Relation::Same,
                _ => continue,
            };
            // Such a pass is a program beside others: it reads what they have drawn.
            if pass
                .bindings
                .iter()
                .any(|b| b.source != BindingSource::Author)
            {
                continue;
            }
            let role = pass.role.name();
            let other = emitted(&variant, pass);
            all.extend(other.map(|p| (format!("{recipe}, {role}"), relation, p)));
        }
    }
    let itself = [
        ("renamed", renamed(original)),
        (
            "as GLSL",
            compiled(original, Target::Glsl450).filter(|p| !needs_first_instance(p)),
        ),
        ("as SPIR-V", compiled(original, Target::Spirv)),
    ];
    for (how, other) in itself {
        all.extend(other.map(|p| (how.to_owned(), Relation::Same, p)));
    }
    all
}

/// What counts: an alarm, or the words of each promise.
fn judged(agreement: &Agreement) -> Vec<Result<&'static str, String>> {
    let breaks = agreement.findings.iter();
    let breaks = breaks.filter(|f| f.class.breaks(agreement.relation));
    let alarms = breaks.map(|f| Err(format!("{}: {}", f.class.name(), f.words)));
    let promises = agreement.promises.iter().map(|held| match &held.outcome {
        Outcome::Proved { .. } => Ok("proved"),
        Outcome::Agreed { .. } => Ok("agreed"),
        Outcome::Differs => Ok("differs where it does not matter"),
        Outcome::NotEvaluated { why } if std::env::var_os("AGREE_WHY").is_some() => {
            eprintln!("{}: {why}", held.promise);
            Ok("not evaluated")
        }
        Outcome::NotEvaluated { .. } => Ok("not evaluated"),
    });
    alarms.chain(promises).collect()
}

/// A material with a texture that decides a discard, one for the colour, and others.
fn combined(order: &[&str], is_vulkan: bool, discards_by: &str) -> Plan {
    let (version, numbered) = match is_vulkan {
        true => ("#version 450\n", true),
        false => ("#version 300 es\nprecision highp float;\n", false),
    };
    let place = |location: u32| match numbered {
        true => format!("layout(location = {location}) "),
        false => String::new(),
    };
    let samplers: String = (0..order.len())
        .map(|i| match numbered {
            true => format!(
                "layout(set = 1, binding = {i}) uniform sampler2D {};\n",
                order[i]
            ),
            false => format!("uniform sampler2D {};\n", order[i]),
        })
        .collect();
    let matrix = match numbered {
        true => "layout(set = 0, binding = 0) uniform Draw { mat4 mvp; };",
        false => "uniform mat4 mvp;",
    };
    let [zero, one] = [place(0), place(1)];
    let vertex = format!(
        "{version}{zero}in vec3 position;\n{one}in vec2 uv;\n{zero}out vec2 v;\n{matrix}\n\
         void main() {{ v = uv; gl_Position = mvp * vec4(position, 1.0); }}\n"
    );
    let fragment = format!(
        "{version}{zero}in vec2 v;\n{zero}out vec4 color;\n{samplers}\
         float alpha(sampler2D map, vec2 at) {{ return texture(map, at).a; }}\n\
         void main() {{ if (alpha({discards_by}, v) < 0.5) discard; color = texture(base, v); }}\n"
    );
    let sources = [
        Source::new("m.vert", vertex),
        Source::new("m.frag", fragment),
    ];
    plan(&sources, &Options::default()).unwrap()
}

/// As the combined samplers of [`combined`], with one sampler for all textures.
const SHARED: &str = "
@group(0) @binding(0) var<uniform> mvp: mat4x4<f32>;
@group(1) @binding(0) var mask: texture_2d<f32>;
@group(1) @binding(1) var base: texture_2d<f32>;
@group(1) @binding(2) var filtering: sampler;
struct Varyings { @builtin(position) position: vec4<f32>, @location(0) v: vec2<f32> }
@vertex fn vs(@location(0) position: vec3<f32>, @location(1) uv: vec2<f32>) -> Varyings {
    return Varyings(mvp * vec4(position, 1.0), uv);
}
@fragment fn fs(in: Varyings) -> @location(0) vec4<f32> {
    if textureSample(mask, filtering, in.v).a < 0.5 { discard; }
    return textureSample(base, filtering, in.v);
}
";

fn agrees(first: &Plan, second: &Plan, relation: Relation) -> bool {
    let effort = Effort {
        inputs: 24,
        ..Effort::default()
    };
    agree(first, second, relation.into(), &effort)
        .unwrap()
        .holds()
}

/// The pre-passes that preshade writes as GLSL.
fn derived(original: &Plan, is_vulkan: bool) -> Vec<Plan> {
    let recipe = Recipe::parse_list("depth-prepass").unwrap();
    let variant = recipe.apply(original, &Facts::without_ties()).unwrap();
    let options = Options {
        clip_space: is_vulkan.then_some(ClipSpace::AsWritten),
        ..Options::default()
    };
    let targets = [Target::Glsl450, Target::GlslVulkan, Target::GlslEs300];
    let passes = targets.map(|target| {
        let files = emit::emit(&variant, &[target], &emit::Options::default()).unwrap();
        let files = files.into_iter().filter(|f| f.name.contains("prepass"));
        let sources: Vec<_> = files
            .map(|f| Source::from_bytes(f.name, f.bytes).unwrap())
            .collect();
        // A host sets the clip space of Vulkan's GLSL, whoever wrote it.
        let options = match target {
            Target::GlslVulkan => Options {
                clip_space: Some(ClipSpace::AsWritten),
                ..Options::default()
            },
            _ => options.clone(),
        };
        plan(&sources, &options).unwrap()
    });
    passes.into()
}

/// The IR has one precision of floats, so the text is asked.
#[test]
fn another_precision_is_told() {
    let vertex = "#version 300 es\nin vec3 position; uniform mat4 mvp; out vec2 v;\n\
                  void main() { v = position.xy; gl_Position = mvp * vec4(position, 1.0); }\n";
    let material = |precision: &str, of_cut: &str| {
        let fragment = format!(
            "#version 300 es\nprecision {precision} float;\nin vec2 v; uniform {of_cut} float cut;\n\
             out vec4 color; void main() {{ if (v.x * 100.0 < cut) discard; color = vec4(1.0); }}\n"
        );
        let sources = [
            Source::new("m.vert", vertex),
            Source::new("m.frag", fragment),
        ];
        plan(&sources, &Options::default()).unwrap()
    };
    let high = material("highp", "");
    let effort = Effort {
        inputs: 24,
        ..Effort::default()
    };
    for (other, expected) in [
        (material("highp", "highp"), None),
        (material("mediump", ""), Some("in `mediump`")),
        (
            material("highp", "mediump"),
            Some("has `mediump` variables"),
        ),
    ] {
        let agreement = agree(&high, &other, Relation::Shadow.into(), &effort).unwrap();
        assert!(agreement.holds());
        let said = agreement.notes.join("\n");
        match expected {
            None => assert_eq!(said, ""),
            Some(words) => assert!(said.contains(words), "{said}"),
        }
    }
}

/// Each takes seconds: `make check` skips them.
mod slow {
    use super::*;

    #[test]
    fn no_fixture_raises_a_false_alarm_against_itself() {
        let inputs = std::env::var("AGREE_INPUTS").ok();
        let effort = Effort {
            inputs: inputs.map_or(12, |n| n.parse().unwrap()),
            ..Effort::default()
        };
        let mut all = Vec::new();
        fixtures(&root().join("fixtures"), &mut all);
        all.sort();
        let results: Vec<_> = all
            .par_iter()
            .filter_map(|files| Some((files, read(files)?)))
            .flat_map_iter(|(files, original)| {
                let name = files[0].file_name().unwrap().to_string_lossy().into_owned();
                let mut results = Vec::new();
                for (how, relation, other) in partners(&original) {
                    let held = agree(&original, &other, relation.into(), &effort);
                    let judged = match &held {
                        Ok(agreement) => judged(agreement),
                        Err(mismatch) => vec![Err(mismatch.to_string())],
                    };
                    let judged = judged
                        .into_iter()
                        .map(|j| j.map_err(|e| format!("{name}, {how}: {e}")));
                    let judged: Vec<_> = judged.collect();
                    results.push((how, judged));
                }
                results
            })
            .collect();
        let mut counts: BTreeMap<(String, &str), usize> = BTreeMap::new();
        let mut alarms = Vec::new();
        for (how, judged) in &results {
            *counts.entry((how.clone(), "pairs")).or_default() += 1;
            for result in judged {
                match result {
                    Ok(word) => *counts.entry((how.clone(), word)).or_default() += 1,
                    Err(alarm) => alarms.push(alarm.as_str()),
                }
            }
        }
        eprintln!("{} pairs: {counts:#?}", results.len());
        assert!(alarms.is_empty(), "{}", alarms.join("\n"));
        assert!(results.len() > 400, "{}", results.len());
    }

    /// The sampler of a combined one has a number of ours, which depends on the order of declarations.
    #[test]
    fn combined_samplers_follow_their_textures() {
        let orders: [&[&str]; 5] = [
            &["base", "mask"],
            &["mask", "base"],
            &["base", "unused", "mask"],
            &["mask", "unused", "base"],
            &["unused", "mask", "base"],
        ];
        let shared = plan(&[Source::new("shared.wgsl", SHARED)], &Options::default()).unwrap();
        for is_vulkan in [false, true] {
            // A host binds Vulkan's sets by number, so another order is another picture there.
            let relation = match is_vulkan {
                false => Relation::Same,
                true => Relation::Prepass,
            };
            for first in orders {
                let ours = combined(first, is_vulkan, "mask");
                for second in orders {
                    let theirs = combined(second, is_vulkan, "mask");
                    assert!(
                        agrees(&ours, &theirs, relation),
                        "{first:?} {second:?} {is_vulkan}"
                    );
                    let wrong = combined(second, is_vulkan, "base");
                    assert!(
                        !agrees(&ours, &wrong, relation),
                        "{first:?} {second:?} {is_vulkan}"
                    );
                }
                if is_vulkan {
                    assert!(agrees(&ours, &shared, Relation::Same), "{first:?}");
                    assert!(agrees(&shared, &ours, Relation::Same), "{first:?}");
                }
                for pass in derived(&ours, is_vulkan) {
                    assert!(agrees(&ours, &pass, Relation::Prepass), "{first:?}");
                }
            }
        }
    }
}
