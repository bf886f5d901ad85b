//! The plan file of a visibility buffer drives the renderer: each value of it, changed to each
//! other that its type has, is refused or draws another picture. Nothing is picked by hand but what
//! is listed as surviving, with the reason; [`plan_is_enough`](../plan_is_enough.rs) does the same
//! for the schema's fields over all passes.

use std::collections::BTreeSet;

use preshade_compiler::emit;
use preshade_compiler::recipe::Recipe;
use preshade_draw::render::{self, FrameSettings, Prepared, Rendered, SceneInputs};
use preshade_draw::scene::DrawOrder;
use preshade_plan::pass::{Facts, Use};
use preshade_plan::plan_file::{PlanFile, Target};
use rayon::prelude::*;
use serde_json::{Value as Json, json};
use shader_text::files::File;

use crate::fixtures_support::recipes;
use crate::render_support::*;

/// Parts of the file that say nothing of a frame.
const NO_FRAME: [(&str, &str); 7] = [
    ("/steps", "how the plan was made"),
    ("/contract", "a promise: `verify` measures it"),
    ("/notes", "words"),
    ("/fallback", "what to draw in place of the plan"),
    ("/guard", "what a host checks before it draws the plan"),
    (
        "/original",
        "a plan of the same types, in place of the plan",
    ),
    ("/self_test", "run at load: `self_test.rs`"),
];

/// Values that may change to whatever their type has without another picture, and why. Passes and
/// attachments go by their names; `*` is any.
#[rustfmt::skip] // One row a value.
const SURVIVORS: &[(&str, &str)] = &[
    ("/attachments/scene-depth/sampled", "one usage more than is needed"),
    ("/attachments/visibility-draws/sampled", "one usage more than is needed"),
    ("/attachments/visibility-draws/format", "a depth of more bits tells draws apart as well"),
    ("/attachments/visibility-ids/clear/1", "the triangle of no draw"),
    ("/attachments/visibility-ids/clear/2", "a channel that ids do not have"),
    ("/attachments/visibility-ids/clear/3", "a channel that ids do not have"),
    ("/passes/*/program", "a name: `files` says which file each stage is in"),
    ("/passes/*/attributes/*/name", "a name for readers"),
    ("/passes/*/bindings/*/name", "a name for readers"),
    ("/passes/*/bindings/*/visibility/vertex", "one stage more than is needed"),
    ("/passes/*/bindings/*/visibility/fragment", "one stage more than is needed"),
    ("/passes/*/bindings/*/source/part/draw/formats", "the scene stores all attributes as they are \
        declared"),
    ("/passes/*/bindings/*/source/part/attribute/name", "a name for readers"),
    ("/passes/*/bindings/*/source/part/attribute/type", "with `formats=any` for readers"),
    ("/passes/ids/features/0 removed", "what a device has that is asked for no more: \
                                        `plan_needs.rs`"),
    ("/passes/*/depth/bias/clamp", "the largest of a bias that is none"),
    ("/passes/*/multisample/alpha_to_coverage", "there is one sample: `plan_is_enough` has more"),
    ("/passes/classify/draws", "drawn again, the numbers of draws are what they were"),
    ("/passes/classify/depth/bias/constant", "the pass writes the depth itself"),
    ("/passes/classify/depth/bias/slope_scale", "the pass writes the depth itself"),
    ("/passes/classify/primitive/front_face", "nothing is culled"),
    ("/passes/classify/primitive/cull removed", "by default the back is culled, and it shows its \
                                                 front"),
    ("/passes/classify/primitive/unclipped_depth", "what covers the screen is not clipped"),
    ("/passes/resolve/depth/bias/slope_scale", "over the screen depth has no slope"),
    ("/passes/resolve/depth/ops/load", "the classify pass has cleared it"),
    ("/passes/resolve/depth/ops/store", "no later pass reads it"),
    ("/passes/resolve/depth/read_only", "an EQUAL test writes what is there"),
    ("/passes/resolve/depth/write", "an EQUAL test writes what is there"),
    ("/passes/resolve/primitive/front_face", "nothing is culled"),
    ("/passes/resolve/primitive/cull removed", "by default the back is culled, and it shows its \
                                                front"),
    ("/passes/resolve/primitive/unclipped_depth", "what covers the screen is not clipped"),
    ("/passes/clear/draws", "it draws nothing"),
    ("/passes/clear/geometry removed", "it draws nothing"),
    ("/passes/clear/multisample/mask", "it draws nothing"),
    ("/passes/clear/primitive/*", "it draws nothing"),
    ("/passes/clear/primitive/cull removed", "it draws nothing"),
    ("/passes/clear/targets/0/write_mask", "it draws nothing"),
    ("/passes/clear/targets/0/write_mask removed", "it draws nothing"),
    ("/compute/*/program", "a name: `compute_files` says which file each stage is in"),
    ("/compute/*/bindings/*/name", "a name for readers"),
    ("/compute/*/bindings/*/visibility/vertex", "a compute pass has one stage"),
    ("/compute/*/bindings/*/visibility/fragment", "a compute pass has one stage"),
    ("/compute/*/bindings/*/source/part/draw/formats", "the scene stores all attributes as they \
        are declared"),
    ("/compute/*/bindings/*/source/part/attribute/name", "a name for readers"),
    ("/compute/*/bindings/*/source/part/attribute/type", "with `formats=any` for readers"),
    ("/compute/*/draws removed", "no draw of the material is blended"),
    ("/compute/tiles/draws", "tiles that are listed again are shaded again"),
    ("/compute/resolve/workgroup", "of an indirect call, which says how many there are"),
];

/// Values that a type does not suggest, and which do harm.
const HARMFUL: &[(&str, f64)] = &[
    // The depth that stands for the first draw.
    ("/attachments/2/clear", 1.25 / 65535.0),
    // An id of one word.
    ("/attachments/1/clear/0", 1000.0),
];

/// A JSON value changed: a pointer to it, and what is there instead; `None`: it is removed.
type Mutation = (String, Option<Json>);

/// Every value of `value` changed, as its schema lets it.
fn mutations(root: &Json, schemas: &[&Json], value: &Json, at: &str, out: &mut Vec<Mutation>) {
    let schemas = opened(root, schemas);
    let mut to = |new: Json| {
        if new != *value {
            out.push((at.to_owned(), Some(new)));
        }
    };
    match value {
        // What is not there is what `plan_is_enough` puts there.
        Json::Null => {}
        Json::Bool(b) => to(json!(!b)),
        Json::Number(n) => match n.as_u64() {
            Some(n) if schemas.iter().any(|s| s["type"] == "integer") => {
                to(json!(n + 1));
                to(json!(n.saturating_sub(1)));
                to(json!(n + 100));
                to(json!(0));
            }
            _ => {
                to(json!(n.as_f64().unwrap() + 0.25));
                to(json!(n.as_f64().unwrap() + 1.0));
                for (_, harmful) in HARMFUL.iter().filter(|(pointer, _)| *pointer == at) {
                    to(json!(harmful));
                }
            }
        },
        Json::String(_) => {
            let words: BTreeSet<&str> = schemas.iter().flat_map(|s| words(s)).collect();
            if words.is_empty() {
                to(json!("elsewhere"));
            }
            for word in words {
                to(json!(word));
            }
        }
        Json::Array(items) => {
            for (index, item) in items.iter().enumerate() {
                let inner: Vec<&Json> = schemas.iter().map(|s| &s["items"]).collect();
                mutations(root, &inner, item, &format!("{at}/{index}"), out);
                out.push((format!("{at}/{index}"), None));
            }
        }
        Json::Object(members) => {
            for (name, member) in members {
                let inner: Vec<&Json> = schemas
                    .iter()
                    .flat_map(|s| [&s["properties"][name], &s["additionalProperties"]])
                    .collect();
                let at = format!("{at}/{name}");
                mutations(root, &inner, member, &at, out);
                if !member.is_null() {
                    out.push((at, None));
                }
            }
        }
    }
}

/// Schemas with their references followed and their choices opened.
fn opened<'a>(root: &'a Json, schemas: &[&'a Json]) -> Vec<&'a Json> {
    let mut all = Vec::new();
    for schema in schemas {
        if let Some(name) = schema["$ref"].as_str() {
            let definition = root.pointer(name.trim_start_matches('#')).unwrap();
            all.extend(opened(root, &[definition]));
        }
        for choices in ["anyOf", "oneOf", "allOf"] {
            for choice in schema[choices].as_array().into_iter().flatten() {
                all.extend(opened(root, &[choice]));
            }
        }
        if schema.is_object() {
            all.push(schema);
        }
    }
    all
}

/// The strings that a schema lists.
fn words(schema: &Json) -> impl Iterator<Item = &str> {
    let listed = schema["enum"].as_array().into_iter().flatten();
    listed.chain([&schema["const"]]).filter_map(Json::as_str)
}

fn put(json: &mut Json, (pointer, value): &Mutation) {
    let (parent, key) = pointer.rsplit_once('/').unwrap();
    match (json.pointer_mut(parent).unwrap(), value) {
        (Json::Array(items), Some(value)) => items[key.parse::<usize>().unwrap()] = value.clone(),
        (Json::Array(items), None) => drop(items.remove(key.parse().unwrap())),
        (Json::Object(members), Some(value)) => drop(members.insert(key.to_owned(), value.clone())),
        (Json::Object(members), None) => drop(members.remove(key)),
        (other, _) => panic!("{pointer}: {other} has no members"),
    }
}

fn matches(pattern: &str, pointer: &str) -> bool {
    let (wanted, given) = (pattern.split('/'), pointer.split('/'));
    wanted.clone().count() == given.clone().count()
        && wanted.zip(given).all(|(w, g)| w == "*" || w == g)
}

fn drawn(inputs: &SceneInputs<'_>, files: Vec<File>) -> Result<Rendered, render::Error> {
    let scene = inputs.scene();
    let variant = preshade_scenes::from_files(&[files])?;
    let mut prepared = Prepared::new(inputs, &variant, &FrameSettings::of(scene))?;
    prepared.aim(&scene.cameras[0].frames[0], DrawOrder::AsGiven);
    prepared.render()
}

/// A pointer with passes and attachments by name.
fn named(plan: &Json, pointer: &str) -> String {
    let mut segments: Vec<&str> = pointer.split('/').collect();
    if let [_, of, index, ..] = segments[..] {
        let key = match of {
            "attachments" => "name",
            "passes" => "role",
            _ => "program",
        };
        let name = plan[of].get(index.parse().unwrap_or(usize::MAX));
        if let Some(name) = name.and_then(|item| item[key].as_str()) {
            segments[2] = name;
        }
    }
    segments.join("/")
}

/// The pass, attachment or other item that a pointer leads into, and the pointer within it.
fn owner(plan: &Json, pointer: &str) -> (String, String) {
    let parts: Vec<&str> = pointer.splitn(4, '/').collect();
    let [_, of, index, within] = parts[..] else {
        return (plan.to_string(), pointer.to_owned());
    };
    let item = plan.pointer(&format!("/{of}/{index}")).unwrap();
    (item.to_string(), within.to_owned())
}

/// Mutates the plan of the material of [`parts::parts_of_one`], split by `recipe`: of each value at
/// least one mutation must be refused or draw another picture. What an earlier recipe has `done` is
/// left out. Returns what is drawn alike.
fn unseen(recipe: &str, done: &mut BTreeSet<(String, String)>) -> Vec<String> {
    let scene = parts::parts_of_one();
    let recipe = Recipe::parse_list(recipe).unwrap();
    let plan = recipe
        .apply(&originals(&scene)[0], &Facts::default())
        .unwrap();
    let files = emit::emit(&plan, &[Target::Wgsl], &emit::Options::default()).unwrap();
    let inputs = SceneInputs::new(gpu(), &scene).unwrap();
    let picture = drawn(&inputs, files.clone()).unwrap();
    let schema = schemars::schema_for!(PlanFile).to_value();
    let place = files.iter().position(|f| f.name.ends_with(".plan.json"));
    let place = place.unwrap();
    let bytes = &files[place].bytes;
    let plan: Json = serde_json::from_slice(bytes).unwrap();
    let read = |bytes: &[u8]| {
        let file: PlanFile = serde_json::from_slice(bytes).ok()?;
        Some(serde_json::to_value(file).unwrap())
    };
    let original = read(bytes).unwrap();
    let mut all = Vec::new();
    mutations(&schema, &[&schema], &plan, "", &mut all);
    all.retain(|(pointer, _)| !NO_FRAME.iter().any(|(part, _)| pointer.starts_with(part)));
    all.sort_by_key(|(pointer, value)| (pointer.clone(), value.is_none()));
    let mut looked_at = Vec::new();
    for of_one in all.chunk_by(|a, b| (&a.0, a.1.is_some()) == (&b.0, b.1.is_some())) {
        let pointer = match &of_one[0] {
            (pointer, Some(_)) => pointer.clone(),
            (pointer, None) => format!("{pointer} removed"),
        };
        if SURVIVORS
            .iter()
            .any(|(s, _)| matches(s, &named(&plan, &pointer)))
            || !done.insert(owner(&plan, &pointer))
        {
            continue;
        }
        let changed = of_one.iter().filter_map(|mutation| {
            let mut changed = plan.clone();
            put(&mut changed, mutation);
            let bytes = serde_json::to_vec(&changed).unwrap();
            // What a reader does not take, or takes for the same, is no mutation.
            (read(&bytes)? != original).then_some(bytes)
        });
        let changed: Vec<Vec<u8>> = changed.collect();
        looked_at.push((named(&plan, &pointer), changed));
    }
    let is_alike = |bytes: &Vec<u8>| {
        let mut files = files.clone();
        files[place].bytes = bytes.clone();
        drawn(&inputs, files).is_ok_and(|drawn| drawn == picture)
    };
    let unseen = looked_at.into_par_iter().filter_map(|(name, changed)| {
        (!changed.is_empty() && changed.iter().all(is_alike)).then_some(name)
    });
    unseen.collect()
}

#[test]
fn every_value_is_needed() {
    let mut done = BTreeSet::new();
    for recipe in recipes(&[Use::Mutate]) {
        let unseen = unseen(recipe, &mut done);
        assert!(
            unseen.is_empty(),
            "{recipe} is drawn alike with other values of\n{}",
            unseen.join("\n")
        );
    }
    assert!(done.len() > 1000, "{}", done.len());
}
