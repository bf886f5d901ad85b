//! Writes a material's plans as a Rust module that depends only on wgpu.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write;

use preshade_plan::guard::{self, Place};
use preshade_plan::overrides::Constant;
use preshade_plan::plan::Plan;

use super::bindings::{BindingSettings, Shared};
use super::emitted::{EmittedPlan, included, json};
use super::{passes, wgpu_words as words};

/// The code that a host calls: `host.rs`, which is compiled with this crate's tests.
const HOST: &str = include_str!("host.rs");

/// The part of it in a file of its own, and the line that includes it.
const SELF_TEST: &str = include_str!("host/self_test.rs");
const SELF_TEST_IS: &str = "#[path = \"host/self_test.rs\"]\nmod preshade_self_test;\n";

const TYPES: [&str; 24] = [
    "Assumed",
    "Attachment",
    "Attribute",
    "Binding",
    "Color",
    "Compute",
    "DepthUse",
    "Draws",
    "NumberPlace",
    "Ops",
    "Override",
    "Pass",
    "Pending",
    "Phase",
    "PipelineOptions",
    "ResourceSource",
    "Run",
    "ScalarType",
    "SelfTest",
    "TestDraw",
    "Tested",
    "Unfit",
    "Variant",
    "VertexBuffers",
];

/// Lints that a host may deny and the module does not follow. Clippy's restrictions are named one
/// by one: a host that forbids any other restriction could not include a module that allows them
/// all.
const LINTS: [&str; 38] = [
    "dead_code",
    "unused_imports",
    "unused_qualifications",
    "unreachable_pub",
    "clippy::all",
    "clippy::pedantic",
    "clippy::nursery",
    "clippy::absolute_paths",
    "clippy::allow_attributes",
    "clippy::allow_attributes_without_reason",
    "clippy::arbitrary_source_item_ordering",
    "clippy::arithmetic_side_effects",
    "clippy::as_conversions",
    "clippy::decimal_literal_representation",
    "clippy::else_if_without_else",
    "clippy::exhaustive_enums",
    "clippy::exhaustive_structs",
    "clippy::field_scoped_visibility_modifiers",
    "clippy::impl_trait_in_params",
    "clippy::implicit_return",
    "clippy::let_underscore_must_use",
    "clippy::let_underscore_untyped",
    "clippy::little_endian_bytes",
    "clippy::min_ident_chars",
    "clippy::missing_docs_in_private_items",
    "clippy::missing_inline_in_public_items",
    "clippy::missing_trait_methods",
    "clippy::module_name_repetitions",
    "clippy::pattern_type_mismatch",
    "clippy::pub_use",
    "clippy::pub_with_shorthand",
    "clippy::question_mark_used",
    "clippy::shadow_reuse",
    "clippy::shadow_unrelated",
    "clippy::single_call_fn",
    "clippy::single_char_lifetime_names",
    "clippy::std_instead_of_alloc",
    "clippy::std_instead_of_core",
];

/// The host's settings for the module.
pub(super) struct Module<'b> {
    /// Path of the types, if they are not in the module.
    pub types: Option<&'b str>,
    /// Path of wgpu, if it is not the crate `wgpu`.
    pub wgpu: Option<&'b str>,
    /// Settings of the author's resources.
    pub said: &'b BindingSettings,
}

/// A path relative to the including module, made relative to the module inside that holds
/// everything.
fn from_within(path: &str) -> String {
    if let Some(rest) = path.strip_prefix("self::") {
        return format!("super::{rest}");
    }
    match path.starts_with("super::") {
        true => format!("super::{path}"),
        false => path.to_owned(),
    }
}

/// Something that the module cannot express.
pub(super) struct Wordless {
    /// Index of the plan that needs it. `None`: it concerns no single plan.
    pub of: Option<usize>,
    pub why: String,
}

/// The module of one material. `original` comes first among `drawn`. The module's own names refer
/// to the second, unless that has a guard.
///
/// # Errors
/// Something cannot be expressed.
pub(super) fn material(
    name: &str,
    drawn: &[EmittedPlan],
    module: &Module<'_>,
) -> Result<String, Wordless> {
    let nowhere = |why| Wordless { of: None, why };
    let shared = Shared::of(drawn.iter().map(|d| &d.plan), module.said).map_err(nowhere)?;
    let mut overrides = BTreeSet::new();
    for (index, one) in drawn.iter().enumerate() {
        let of = Some(index);
        let own = one.overrides().map_err(|why| Wordless { of, why })?;
        overrides.extend(own.into_values().flatten().map(|o| o.key));
    }
    let of_author = drawn.first().map(|original| &original.plan);
    let mut text = match module.wgpu {
        None => String::new(),
        Some(path) => format!("use {} as wgpu;\n", from_within(path)),
    };
    match module.types {
        None => {
            let wgpu = module.wgpu.map_or("", |_| "use super::wgpu;\n");
            let module = format!("mod preshade_self_test {{\n{wgpu}{SELF_TEST}}}\n");
            text.push_str(&HOST.replace(SELF_TEST_IS, &module));
        }
        Some(path) => {
            let path = from_within(path);
            let _ = writeln!(text, "use {path}::{{{}}};", TYPES.join(", "));
        }
    }
    let _ = writeln!(
        text,
        "\n/// Every attribute that the author's shader reads, one after the other in one buffer: \
         for a host that has no layout of its own."
    );
    text.push_str(&interleaved(drawn));
    for (index, one) in drawn.iter().enumerate() {
        let constants = constants(&one.plan, of_author);
        let of = Some(index);
        let own = variant(name, one, &shared, &overrides, &constants);
        text.push_str(&own.map_err(|why| Wordless { of, why })?);
    }
    if let Some(chosen) = drawn.get(1) {
        let name = &chosen.name;
        // A host never gets a guarded variant by default.
        let names = match guard(&chosen.plan).is_empty() {
            true => format!("pub use {name}::*;"),
            false => format!(
                "pub use original::*;\npub use {name}::{{CHOICES, CONSTANTS, GUARD, guard_holds, \
                 variant_for}};"
            ),
        };
        let _ = writeln!(text, "{names}");
    }
    // An included file cannot have inner attributes.
    let lints = format!("#[allow({})]\n", LINTS.join(", "));
    Ok(format!(
        "// Generated by preshade; edits will be lost.\n{lints}mod preshade_generated {{\n\
         {text}}}\n{lints}pub use preshade_generated::*;\n"
    ))
}

fn interleaved(drawn: &[EmittedPlan]) -> String {
    let passes = drawn.iter().flat_map(|d| &d.plan.passes);
    let mut all: BTreeMap<u32, (&'static str, u64)> = BTreeMap::new();
    for attribute in passes.flat_map(|p| &p.attributes) {
        if let Some(format) = words::vertex_format(&attribute.ty) {
            all.insert(attribute.location, format);
        }
    }
    let (mut offset, mut attributes) = (0, Vec::new());
    for (location, (format, bytes)) in all {
        attributes.push(format!(
            "wgpu::VertexAttribute {{ format: wgpu::VertexFormat::{format}, offset: {offset}, \
             shader_location: {location} }}"
        ));
        // A vertex buffer's offsets and stride are multiples of four.
        offset += bytes.next_multiple_of(4);
    }
    format!(
        "pub const INTERLEAVED: wgpu::VertexBufferLayout<'static> = wgpu::VertexBufferLayout {{ \
         array_stride: {offset}, step_mode: wgpu::VertexStepMode::Vertex, attributes: &[{}] }};\n",
        attributes.join(", ")
    )
}

/// A plan's assumptions about overrides, which are the original's.
fn constants<'p>(plan: &'p Plan, original: Option<&Plan>) -> Vec<Constant<'p>> {
    let programs = original.iter().flat_map(|o| o.programs.values());
    let all = programs.flat_map(|program| {
        let guard = plan.guard.as_ref();
        guard.map_or(Vec::new(), |g| g.constants(program.module()))
    });
    all.collect()
}

/// The module of one plan. `keys` are those of all overrides of the material, `constants` are the
/// values that the plan was made for.
fn variant(
    material: &str,
    drawn: &EmittedPlan,
    shared: &Shared<'_>,
    keys: &BTreeSet<String>,
    constants: &[Constant<'_>],
) -> Result<String, String> {
    let plan = &drawn.plan;
    // Relative to the module's own file, so that both can be moved together.
    let folder = format!("{material}/{}/", drawn.name);
    let guard = guard(plan);
    let (visible, choices) = match guard.is_empty() {
        true => ("pub ", "&VARIANT"),
        // A guarded variant is reached only through its guard.
        false => ("", "&VARIANT, &super::original::VARIANT"),
    };
    let recipe: Vec<String> = plan.steps.iter().map(ToString::to_string).collect();
    let recipe = match recipe.is_empty() {
        true => "as its author wrote it".to_owned(),
        false => recipe.join(" + "),
    };
    let mut text = format!(
        "\n/// The material {}.\npub mod {} {{\nuse super::*;\n",
        recipe.replace('\n', " "),
        drawn.name
    );
    let assumed = guard.iter().map(|a| assumed(a, constants));
    let assumed: Vec<String> = assumed.collect::<Result<_, _>>()?;
    let given = constants.iter();
    let given = given.map(|c| format!("({:?}, {})", c.key, number(c.assumed.bounds.low)));
    let given: Vec<String> = given.collect();
    let contract = json(&plan.contract);
    let item = |text: &mut String, doc: &str, code: String| {
        let _ = writeln!(text, "/// {doc}\n{code};");
    };
    item(
        &mut text,
        "The applied steps.",
        format!("pub const RECIPE: &str = {recipe:?}"),
    );
    item(
        &mut text,
        "Its contract, as the plan's JSON.",
        format!("pub const CONTRACT: &str = {contract:?}"),
    );
    item(
        &mut text,
        "The reasons of skipped steps.",
        format!("pub const LEFT_OUT: &[&str] = &{:?}", drawn.left_out),
    );
    item(
        &mut text,
        "The values that it is valid for. Empty: all values.",
        format!("pub const GUARD: &[Assumed] = &[{}]", assumed.join(", ")),
    );
    item(
        &mut text,
        "Values of pipeline-overridable constants that it was made for. Set them in \
         [`PipelineOptions::constants`] of its pipelines and of the original's.",
        format!(
            "pub const CONSTANTS: &[(&str, f64)] = &[{}]",
            given.join(", ")
        ),
    );
    text.push_str(GUARDED);
    item(
        &mut text,
        "The variants that [`variant_for`] may return, for a host that creates pipelines in \
         advance.",
        format!("pub static CHOICES: &[&Variant] = &[{choices}]"),
    );
    item(
        &mut text,
        "The variant.",
        format!(
            "{visible}static VARIANT: Variant = Variant {{ \
             recipe: RECIPE, guard: GUARD, passes: PASSES, compute: COMPUTE, attachments: \
             ATTACHMENTS, self_test: SELF_TEST.as_ref() }}"
        ),
    );
    item(
        &mut text,
        "Notes for the host.",
        format!("pub const NOTES: &[&str] = &{:?}", plan.notes),
    );
    let plan_file = included("str", &folder, &format!("{}.plan.json", plan.material));
    item(
        &mut text,
        "The whole plan.",
        format!("pub const PLAN: &str = {plan_file}"),
    );
    let files = drawn.files.iter();
    let files = files.map(|f| format!("({:?}, {})", f.name, included("bytes", &folder, &f.name)));
    let files: Vec<String> = files.collect();
    item(
        &mut text,
        "Every written file, by name.",
        format!(
            "pub const FILES: &[(&str, &[u8])] = &[{}]",
            files.join(", ")
        ),
    );
    for (doc, code) in passes::items(drawn, &folder, visible, shared, keys)? {
        item(&mut text, &doc, code);
    }
    text.push_str("}\n");
    Ok(text)
}

/// The part of each plan's module that checks its guard.
const GUARDED: &str = "\
/// Whether constants and the uniforms of a draw are as [`GUARD`] says: see
/// [`Variant::guard_holds`].
pub fn guard_holds<'b>(
    constants: &[(&str, f64)],
    bytes: impl Fn(u32, u32) -> Option<&'b [u8]>,
) -> bool {
    VARIANT.guard_holds(constants, bytes)
}
/// The variant to draw with: this one if its guard holds, else the original.
pub fn variant_for<'b>(
    constants: &[(&str, f64)],
    bytes: impl Fn(u32, u32) -> Option<&'b [u8]>,
) -> &'static Variant {
    match guard_holds(constants, bytes) {
        true => &VARIANT,
        false => &super::original::VARIANT,
    }
}
";

/// A plan's assumptions about values.
fn guard(plan: &Plan) -> &[guard::Assumed] {
    plan.guard.as_ref().map_or(&[], |g| &g.values)
}

fn assumed(assumed: &guard::Assumed, constants: &[Constant<'_>]) -> Result<String, String> {
    let place = match &assumed.place {
        Place::Uniform {
            group,
            binding,
            offset,
        } => format!("Uniform {{ group: {group}, binding: {binding}, offset: {offset} }}"),
        Place::Attribute {
            location,
            component,
        } => format!("Attribute {{ location: {location}, component: {component} }}"),
        Place::Texture {
            group,
            binding,
            channel,
        } => format!("Texture {{ group: {group}, binding: {binding}, channel: {channel} }}"),
        Place::Override { name } => {
            let found = constants.iter().find(|c| c.assumed.place == assumed.place);
            let Some(Constant {
                key, is_default, ..
            }) = found
            else {
                return Err(format!("the material has no override `{name}`"));
            };
            format!("Override {{ key: {key:?}, is_default: {is_default} }}")
        }
    };
    let guard::Bounds { low, high } = assumed.bounds;
    Ok(format!(
        "Assumed {{ name: {:?}, place: NumberPlace::{place}, ty: ScalarType::{:?}, low: {}, high: \
         {} }}",
        assumed.name,
        assumed.ty,
        number(low),
        number(high),
    ))
}

/// A number as Rust writes it.
fn number(number: f64) -> String {
    match number.is_finite() {
        true => format!("{number:?}"),
        false if number.is_nan() => "f64::NAN".to_owned(),
        false if number > 0.0 => "f64::INFINITY".to_owned(),
        false => "f64::NEG_INFINITY".to_owned(),
    }
}
