//! Two variables at one group and binding, each in a stage of its own: legal WGSL. The plan's
//! layout serves both, or the material is refused by name.

use preshade_compiler::front::{self, Source};
use preshade_compiler::recipe::Recipe;
use preshade_plan::pass::Facts;
use preshade_plan::plan::{BindingLayout, Plan};
use preshade_plan::state::MaterialState;
use shader_text::error::{Code, Color};
use shader_text::options::Options;

const TEXT: &str = include_str!("../materials/shared-binding.wgsl");

fn parse(text: &str) -> Result<Plan, shader_text::error::Error> {
    let parsed = front::parse(&[Source::new("shared.wgsl", text)], &Options::default())?;
    let fragment = parsed.fragment.as_deref();
    let state = MaterialState::default();
    let plan = Plan::original("m", parsed.program, &parsed.vertex, fragment, &state);
    Ok(plan)
}

#[test]
fn the_layout_is_large_enough_for_both_stages() {
    let original = parse(TEXT).unwrap();
    let recipes = ["depth-prepass", "depth-prepass:form=equal", "early-discard"];
    let variants = recipes.map(|recipe| {
        let recipe = Recipe::parse([recipe]).unwrap();
        recipe.apply(&original, &Facts::without_ties()).unwrap()
    });
    let mut seen = 0;
    for plan in std::iter::once(&original).chain(&variants) {
        for pass in &plan.passes {
            let binding = &pass.bindings[0];
            let (name, size) = match binding.visibility.fragment {
                true => ("lit", 96),
                false => ("turned", 64),
            };
            let layout = BindingLayout::Buffer {
                ty: "uniform".to_owned(),
                min_binding_size: size,
            };
            assert_eq!(binding.name, name, "{}", pass.role.name());
            assert_eq!(binding.layout, Some(layout), "{}", pass.role.name());
            seen += 1;
        }
    }
    assert!(seen > 4, "{seen} passes");
}

#[test]
fn a_pass_that_would_join_the_stages_refuses_by_name() {
    let original = parse(TEXT).unwrap();
    let recipe = Recipe::parse(["hoist"]).unwrap();
    let refusal = recipe.apply(&original, &Facts::default()).unwrap_err();
    assert_eq!(refusal.code, "shared-binding");
    let reason = "`turned` and `lit` both have group 0 binding 0, so no stage can use both";
    assert_eq!(refusal.reason, reason);
    assert_eq!(refusal.location.map(|at| at.line), Some(12));
}

#[test]
fn kinds_that_no_layout_serves_are_an_error() {
    let shared = "@group(0) @binding(0) var<uniform> lit: Lit;";
    for (other, read) in [
        ("var<storage, read> lit: Lit;", "lit.speed"),
        (
            "var lit: texture_2d<f32>;",
            "textureLoad(lit, vec2<i32>(v.uv), 0).x",
        ),
    ] {
        let body = "sin(lit.speed) * cos(lit.phase) + 0.5";
        let text = TEXT
            .replace(shared, &format!("@group(0) @binding(0) {other}"))
            .replace(body, read)
            .replace(" * lit.color", "");
        let error = parse(&text).unwrap_err();
        assert_eq!(error.code(), Code::Interface);
        let said = error.render(Color::Never);
        for part in ["`turned`", "`lit`", "group 0 binding 0", "shared.wgsl:11"] {
            assert!(said.contains(part), "{said}");
        }
    }
}
