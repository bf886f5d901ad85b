//! Dawn draws the author's WGSL and ours on SwiftShader. Neither shares code with naga or wgpu, so a
//! text that preshade reads or writes wrongly gives another picture here, while the renderer's own
//! pictures agree.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use preshade_compiler::emit;
use preshade_compiler::recipe::Recipe;
use preshade_draw::scene::bind::{self, DrawBindings, TextureContent};
use preshade_draw::scene::{Address, Filter, Sampler, Scene};
use preshade_lab::measure;
use preshade_plan::contract::{Assumption, Contract};
use preshade_plan::geometry::Geometry;
use preshade_plan::pass::{Facts, Use};
use preshade_plan::plan::{BindingKind, BindingSource, Plan};
use preshade_plan::plan_file::Target;
use preshade_plan::state::MaterialState;
use preshade_scenes::synthesise;
use rayon::prelude::*;
use serde_json::{Value, json};

use crate::emit::touched;
use crate::swiftshader_support::{VARIABLE, swiftshader};
use crate::{accept, fixtures_support};

/// Width and height of every picture, in pixels.
const SIZE: [u32; 2] = [96, 64];

/// Recipes whose promise these scenes can be held to.
const USES: [Use; 4] = [
    Use::Exact,
    Use::ExactWithoutTies,
    Use::ExactWhereApplied,
    Use::Snapshot,
];

/// What the made-up scene of a fixture does not keep of what a promise assumes, as `preshade verify`
/// measures it: several surfaces share the nearest depth, or one has the depth of the cleared buffer;
/// a surface lies on the near plane.
const NOT_ASSUMED: [(&str, Assumption); 5] = [
    ("at-far-plane.wgsl", Assumption::NoDepthTies),
    ("steady-texels.wgsl", Assumption::NoDepthTies),
    ("instanced.wgsl", Assumption::NoDepthTies),
    ("instanced.wgsl", Assumption::BeyondNearPlane),
    ("depth-below-zero.wgsl", Assumption::BeyondNearPlane),
];

/// Of the variants of one fixture, every so many are drawn: the next fixture's begin one later.
const SHARE: usize = 3;

/// Every WGSL fixture: its text against what the writer makes of the same program, and against
/// every variant that promises the same picture.
#[test]
fn dawn_draws_our_texts_as_the_author_s() {
    let dir = accept::scratch();
    std::fs::create_dir_all(dir.join("data")).unwrap();
    let fixtures = fixtures_support::wgsl_files();
    let made: Vec<Made> = fixtures
        .par_iter()
        .enumerate()
        .map(|(number, path)| Made::of(number, path, &dir))
        .collect();
    let mut left_out: BTreeMap<String, usize> = BTreeMap::new();
    for why in made.iter().flat_map(|m| &m.left_out) {
        *left_out.entry(why.clone()).or_default() += 1;
    }
    let subjects: Vec<Subject> = made.into_iter().flat_map(|m| m.subjects).collect();
    let plans: Vec<&Path> = subjects.iter().map(|s| s.plan.as_path()).collect();
    let verdicts = accept::judged_with("draw.mjs", &plans, &[(VARIABLE, &swiftshader())]);
    // The author's picture; `None`: Dawn does not draw it.
    let mut original: Option<Vec<Vec<u8>>> = None;
    let (mut wrong, mut compared, mut blank) = (Vec::new(), 0, 0);
    for (subject, verdict) in subjects.iter().zip(&verdicts) {
        let label = &subject.label;
        let adapter = verdict["adapter"].as_str().unwrap_or_default();
        assert!(adapter.contains("SwiftShader"), "drawn on `{adapter}`");
        if subject.tolerance.is_none() {
            original = None;
        }
        if let Some(feature) = verdict["lacking"].as_array().and_then(|l| l.first()) {
            *left_out.entry(format!("Dawn lacks {feature}")).or_default() += 1;
            continue;
        }
        let errors = verdict["errors"].as_array().unwrap();
        if !errors.is_empty() {
            match subject.tolerance {
                // naga takes more than browsers do, and some fixtures are about that.
                None => {
                    *left_out
                        .entry("Dawn refuses the author's text".to_owned())
                        .or_default() += 1
                }
                Some(_) if original.is_none() => {}
                Some(_) => wrong.push(format!("{label}: {errors:?}")),
            }
            continue;
        }
        let files = verdict["colors"].as_array().unwrap().iter();
        let colors = files.map(|f| std::fs::read(f.as_str().unwrap()).unwrap());
        let colors: Vec<Vec<u8>> = colors.collect();
        let Some(tolerance) = subject.tolerance else {
            let first = colors.first().and_then(|c| c.get(..4));
            blank += usize::from(colors.iter().all(|c| c.chunks(4).all(|t| Some(t) == first)));
            original = Some(colors);
            continue;
        };
        let Some(original) = &original else {
            continue;
        };
        let differ = |a: &[u8], b: &[u8]| a.iter().zip(b).any(|(a, b)| a.abs_diff(*b) > tolerance);
        let pairs = colors.iter().zip(original);
        let pixels = pairs.map(|(a, b)| {
            let texels = a.chunks(4).zip(b.chunks(4));
            texels.filter(|(a, b)| differ(a, b)).count()
        });
        let pixels: usize = pixels.sum();
        compared += 1;
        if pixels > 0 || colors.len() != original.len() {
            wrong.push(format!("{label}: {pixels} pixels differ"));
        }
    }
    println!("{compared} variants compared, {blank} blank originals, left out: {left_out:#?}");
    assert!(
        wrong.is_empty(),
        "{} differ\n{}",
        wrong.len(),
        wrong.join("\n")
    );
    assert!(compared > 250, "{compared}");
    std::fs::remove_dir_all(&dir).unwrap();
}

/// A plan to draw, written to a folder of its own.
struct Subject {
    label: String,
    plan: PathBuf,
    /// The largest difference of a channel from the author's picture, of 255; `None`: this is the
    /// author's.
    tolerance: Option<u8>,
}

/// The plans of one fixture.
#[derive(Default)]
struct Made {
    /// The author's text first, then ours.
    subjects: Vec<Subject>,
    /// Why Dawn is not asked, for each plan that is not drawn.
    left_out: Vec<String>,
}

impl Made {
    fn of(number: usize, path: &Path, dir: &Path) -> Self {
        let mut made = Self::default();
        if let Err(why) = made.fill(number, path, dir) {
            made.left_out.push(why);
        }
        made
    }

    fn fill(&mut self, number: usize, path: &Path, dir: &Path) -> Result<(), String> {
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        let scene =
            synthesise(fixtures_support::drawable(path)?, MaterialState::default()).resized(SIZE);
        let original = measure::originals(&scene).remove(0);
        let mut written = original.clone();
        for program in written.programs.values_mut() {
            *program = touched(program);
        }
        let mut plans = vec![
            (name.clone(), None, original.clone()),
            (format!("{name}, written"), Some(0), written),
        ];
        let mut recipes = fixtures_support::recipes(&USES);
        recipes.sort_unstable();
        recipes.dedup();
        for recipe in recipes.into_iter().skip(number % SHARE).step_by(SHARE) {
            let applied = Recipe::parse([recipe])
                .unwrap()
                .apply(&original, &Facts::default());
            let Ok(plan) = applied else { continue };
            let is_assumed = |a: &Assumption| {
                NOT_ASSUMED
                    .iter()
                    .any(|(fixture, not)| *fixture == name && not == a)
            };
            if plan.contract.given().iter().any(is_assumed) {
                self.left_out
                    .push("the made-up scene does not keep what is assumed".to_owned());
                continue;
            }
            if let Some(tolerance) = tolerance(&plan) {
                plans.push((format!("{name}, {recipe}"), Some(tolerance), plan));
            }
        }
        for (i, (label, tolerance, plan)) in plans.into_iter().enumerate() {
            let inputs = match inputs(&scene, &plan, dir) {
                Ok(inputs) => inputs,
                Err(why) if tolerance.is_none() => return Err(why),
                Err(why) => {
                    self.left_out.push(why);
                    continue;
                }
            };
            let files = emit::emit(&plan, &[Target::Wgsl], &emit::Options::default())
                .unwrap_or_else(|e| panic!("{label}: {e}"));
            let folder = path
                .parent()
                .and_then(Path::file_name)
                .unwrap()
                .to_string_lossy();
            let folder = dir.join(format!("{folder}-{name}-{i}"));
            std::fs::create_dir_all(&folder).unwrap();
            for file in &files {
                std::fs::write(folder.join(&file.name), &file.bytes).unwrap();
            }
            let text = serde_json::to_vec(&inputs).unwrap();
            std::fs::write(folder.join("inputs.json"), text).unwrap();
            let json = files.iter().find(|f| f.name.ends_with(".plan.json"));
            self.subjects.push(Subject {
                label,
                plan: folder.join(&json.unwrap().name),
                tolerance,
            });
        }
        Ok(())
    }
}

/// Writes bytes once, whatever draws name them, and returns the file's name.
fn data(dir: &Path, bytes: &[u8]) -> String {
    let name = blake3::hash(bytes).to_hex().to_string();
    let path = dir.join("data").join(&name);
    if !path.exists() {
        std::fs::write(path, bytes).unwrap();
    }
    name
}

/// The largest difference of a channel that a plan's promise allows, of 255; `None`: the promise
/// needs a measurement.
fn tolerance(plan: &Plan) -> Option<u8> {
    match &plan.contract {
        Contract::Exact { .. } => Some(0),
        Contract::Rounding { turned: None, .. } => Some(1),
        _ => None,
    }
}

/// The inputs of every pass, for `tests/accept/draw.mjs`. An error is what that script cannot draw.
fn inputs(scene: &Scene, plan: &Plan, dir: &Path) -> Result<Value, String> {
    if !plan.compute.is_empty() {
        return Err("compute work".to_owned());
    }
    let frame = &scene.cameras[0].frames[0];
    let mut passes = Vec::new();
    for pass in &plan.passes {
        let is_offscreen = pass
            .targets
            .iter()
            .flatten()
            .any(|t| t.attachment.is_some());
        if pass.geometry != Geometry::AsGiven || is_offscreen {
            return Err("geometry or colour targets of its own".to_owned());
        }
        let known = |s: &BindingSource| {
            matches!(s, BindingSource::Author | BindingSource::Attachment { .. })
        };
        if let Some(other) = pass.bindings.iter().find(|b| !known(&b.source)) {
            return Err(format!("a binding of {:?}", other.source));
        }
        let mut draws = Vec::new();
        for draw in &scene.draws {
            let bound = bind::draw(scene, &scene.materials[0], pass, draw, frame);
            draws.push(draw_inputs(&bound.map_err(|e| e.to_string())?, dir)?);
        }
        passes.push(Value::from(draws));
    }
    let targets = plan
        .passes
        .iter()
        .map(|p| &p.targets)
        .max_by_key(|t| t.len());
    let bytes_per_texel: Vec<u32> = targets
        .into_iter()
        .flatten()
        .map(|t| t.as_ref().map_or(0, |t| bytes_per_texel(&t.format)))
        .collect();
    Ok(json!({
        "size": SIZE,
        "clear": scene.clear_color,
        "depth": 1.0,
        "bytesPerTexel": bytes_per_texel,
        "passes": passes,
    }))
}

fn draw_inputs(bound: &DrawBindings, dir: &Path) -> Result<Value, String> {
    if bound.immediates.is_some() {
        return Err("immediate data".to_owned());
    }
    let text = |bytes: &[u8]| data(dir, bytes);
    let buffers = bound.buffers.iter().map(|b| {
        let kind = match b.kind {
            BindingKind::Uniform => "uniform",
            _ => "storage",
        };
        json!({"group": b.group, "binding": b.binding, "kind": kind, "bytes": text(&b.data.bytes)})
    });
    let mut textures = Vec::new();
    for t in &bound.textures {
        let (group, binding, view) = (t.group, t.binding, name(&t.view));
        if t.multisampled {
            return Err("a multisampled texture".to_owned());
        }
        let layers = match t.view {
            wgpu::TextureViewDimension::Cube => 6,
            _ => 1,
        };
        textures.push(match &t.content {
            TextureContent::Image(image) => json!({
                "group": group, "binding": binding, "view": view, "size": image.size,
                "format": name(&image.format), "layers": image.layers,
                "levels": image.levels.iter().map(|l| text(l)).collect::<Vec<_>>(),
            }),
            TextureContent::Depth { size, value } => json!({
                "group": group, "binding": binding, "view": view, "size": size,
                "value": value, "layers": layers,
            }),
            TextureContent::Storage { .. } => return Err("a storage texture".to_owned()),
        });
    }
    let samplers = bound.samplers.iter().map(
        |s| json!({"group": s.group, "binding": s.binding, "descriptor": sampler(&s.sampler)}),
    );
    let vertex_buffers = bound.vertex_buffers.iter().map(|v| {
        let attributes = v.attributes.iter().map(|a| {
            let (location, offset) = (a.location, a.offset);
            json!({"shaderLocation": location, "offset": offset, "format": name(&a.format)})
        });
        let attributes: Vec<Value> = attributes.collect();
        let layout =
            json!({"arrayStride": v.stride, "stepMode": name(&v.step), "attributes": attributes});
        json!({"bytes": text(&v.data.bytes), "layout": layout})
    });
    let indices = bound.indices.as_ref();
    let indices = indices.map(|i| json!({"format": name(&i.format), "bytes": text(&i.data.bytes)}));
    Ok(json!({
        "buffers": buffers.collect::<Vec<_>>(),
        "textures": textures,
        "samplers": samplers.collect::<Vec<_>>(),
        "vertexBuffers": vertex_buffers.collect::<Vec<_>>(),
        "indices": indices,
        "first": bound.call.first,
        "count": bound.call.count,
        "baseVertex": bound.call.base_vertex,
        "firstInstance": bound.call.first_instance,
        "instances": bound.instances,
    }))
}

fn bytes_per_texel(format: &str) -> u32 {
    let format: wgpu::TextureFormat = serde_json::from_value(format.into()).unwrap();
    format.block_copy_size(None).unwrap()
}

/// WebGPU's name of a value.
fn name(value: &impl serde::Serialize) -> Value {
    serde_json::to_value(value).unwrap()
}

fn sampler(s: &Sampler) -> Value {
    let filter = |f: Filter| match f {
        Filter::Nearest => "nearest",
        Filter::Linear => "linear",
    };
    let address = |a: Address| match a {
        Address::Repeat => "repeat",
        Address::MirrorRepeat => "mirror-repeat",
        Address::ClampToEdge => "clamp-to-edge",
    };
    let [least, most] = s.lod.unwrap_or([0.0, 32.0]);
    let mut descriptor = json!({
        "addressModeU": address(s.address),
        "addressModeV": address(s.address_v.unwrap_or(s.address)),
        "addressModeW": address(s.address_w.unwrap_or(s.address)),
        "magFilter": filter(s.filter),
        "minFilter": filter(s.min_filter.unwrap_or(s.filter)),
        "mipmapFilter": filter(s.mip_filter.unwrap_or(s.filter)),
        "lodMinClamp": least,
        "lodMaxClamp": most,
    });
    if let Some(compare) = &s.compare {
        descriptor["compare"] = name(compare);
    }
    descriptor
}
