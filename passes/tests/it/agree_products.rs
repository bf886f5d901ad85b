//! A matrix of one program in place of a product of the other's.

use preshade_validate::agree::{Agreement, Class, Mismatch, Outcome, Relation};

use crate::agree::{classes, held};

/// A vertex stage with these declarations and this position.
fn material(declared: &str, position: &str) -> String {
    format!(
        "{declared}
        @vertex fn vs(@location(0) p: vec3<f32>, @location(1) w: vec2<f32>) -> @builtin(position) vec4<f32> {{
            {position}
        }}"
    )
}

const CAMERA: &str = "struct Camera { proj: mat4x4<f32>, view: mat4x4<f32> }
    @group(0) @binding(0) var<uniform> camera: Camera;
    @group(1) @binding(0) var<uniform> model: mat4x4<f32>;";
const LIGHT: &str = "struct Light { bias: f32, space: mat4x4<f32> }
    @group(2) @binding(0) var<uniform> light: Light;
    @group(0) @binding(3) var<uniform> model: mat4x4<f32>;";
const ONE: &str = "@group(0) @binding(0) var<uniform> mvp: mat4x4<f32>;";

/// Names the three matrices by other letters.
const OTHER: &str = "@group(3) @binding(0) var<uniform> p_of_light: mat4x4<f32>;
    @group(3) @binding(1) var<uniform> v_of_light: mat4x4<f32>;
    @group(1) @binding(0) var<uniform> model: mat4x4<f32>;";

fn is_held(found: &Agreement) -> bool {
    let is_rounding = |c: &Class| *c == Class::Rounding;
    let mut promises = found.promises.iter();
    let is_tried = promises.all(|h| !matches!(h.outcome, Outcome::NotEvaluated { .. }));
    is_tried && classes(found).iter().all(is_rounding)
}

#[test]
fn products_are_found_in_either_program() {
    let two = material(
        CAMERA,
        "let world = model * vec4(p, 1.0); return camera.proj * camera.view * world;",
    );
    let inner = material(
        CAMERA,
        "var eye = camera.view * (model * vec4(p, 1.0)); return camera.proj * eye;",
    );
    let whole = material(
        CAMERA,
        "return camera.proj * camera.view * model * vec4(p, 1.0);",
    );
    let light = material(LIGHT, "return light.space * model * vec4(p, 1.0);");
    let mvp = material(ONE, "return mvp * vec4(p, 1.0);");
    let other = material(
        OTHER,
        "return p_of_light * (v_of_light * (model * vec4(p, 1.0)));",
    );
    let pairs = [
        (
            &two,
            &light,
            "`light.space` stands for `camera.proj * camera.view`",
        ),
        (
            &inner,
            &light,
            "`light.space` stands for `camera.proj * camera.view`",
        ),
        (
            &whole,
            &light,
            "`light.space` stands for `camera.proj * camera.view`",
        ),
        (
            &light,
            &two,
            "`light.space` stands for `camera.proj * camera.view`",
        ),
        (
            &light,
            &other,
            "`light.space` stands for `p_of_light * v_of_light`",
        ),
        (
            &whole,
            &mvp,
            "`mvp` stands for `camera.proj * camera.view * model`",
        ),
        (
            &mvp,
            &whole,
            "`mvp` stands for `camera.proj * camera.view * model`",
        ),
    ];
    for (first, second, said) in pairs {
        let found = held(Relation::Shadow, first, second, &[]).unwrap();
        assert!(is_held(&found), "{said}: {found:#?}");
        assert!(
            found.notes.iter().any(|n| n.starts_with(said)),
            "{said}: {:?}",
            found.notes
        );
        // A fault is found all the same.
        let wrong = second.replace("vec4(p, 1.0)", "vec4(p.xzy, 1.0)");
        let found = held(Relation::Shadow, first, &wrong, &[]).unwrap();
        assert_eq!(classes(&found), [Class::Position], "{said}: {found:#?}");
    }
}

#[test]
fn a_mapping_gives_a_product() {
    let whole = material(
        CAMERA,
        "return camera.proj * camera.view * model * vec4(p, 1.0);",
    );
    let light = material(LIGHT, "return light.space * model * vec4(p, 1.0);");
    let mvp = material(ONE, "return mvp * vec4(p, 1.0);");
    let good = [
        (&whole, &light, "light.space=camera.proj*camera.view"),
        (&light, &whole, "camera.proj*camera.view=light.space"),
        (&whole, &mvp, "mvp=camera.proj*camera.view*model"),
        (&mvp, &whole, "camera.proj*camera.view*model=mvp"),
    ];
    for (first, second, map) in good {
        let found = held(Relation::Shadow, first, second, &[map]).unwrap();
        assert!(is_held(&found), "{map}: {found:#?}");
        let (theirs, ours) = map.split_once('=').unwrap();
        let turned = |side: &str| {
            let factors: Vec<&str> = side.split('*').collect();
            factors.into_iter().rev().collect::<Vec<_>>().join("*")
        };
        let turned = format!("{}={}", turned(theirs), turned(ours));
        let found = held(Relation::Shadow, first, second, &[&turned]).unwrap();
        assert_eq!(classes(&found), [Class::Position], "{turned}: {found:#?}");
    }
    for (map, why) in [
        ("light.space=camera.proj*eye", "there is no `eye`"),
        (
            "light.bias=camera.proj*camera.view",
            "a product is of square matrices of one size",
        ),
    ] {
        match held(Relation::Shadow, &whole, &light, &[map]) {
            Err(Mismatch::Map { why: told, .. }) => assert!(told.starts_with(why), "{told}"),
            other => panic!("{map}: {other:?}"),
        }
    }
}

/// What a message suggests can be given.
#[test]
fn suggestions_of_products_help() {
    // Nothing follows the matrix that follows the other one.
    let whole = material(
        CAMERA,
        "return camera.proj * camera.view * model * vec4(p, 1.0);",
    );
    let light = material(
        &format!("{LIGHT} @group(0) @binding(4) var<uniform> bones: mat4x4<f32>;"),
        "return light.space * bones * model * vec4(p, 1.0);",
    );
    let found = held(Relation::Shadow, &whole, &light, &[]).unwrap();
    let lost = found
        .findings
        .iter()
        .find(|f| f.words.contains("light.space"))
        .unwrap();
    assert_eq!(lost.class, Class::Unmatched);
    let suggested = lost
        .words
        .split('`')
        .find(|word| word.contains('*'))
        .unwrap();
    assert_eq!(suggested, "camera.proj*camera.view");
    let map = format!("light.space={suggested}");
    let found = held(Relation::Shadow, &whole, &light, &[&map]).unwrap();
    let mut words = found.findings.iter().map(|f| &f.words);
    assert!(words.all(|w| !w.contains("light.space")), "{found:#?}");
}

/// A pass that forgot the model matrix does not agree, whatever its matrix is called.
#[test]
fn an_objects_matrix_is_no_lights() {
    let declared = |names: [&str; 3]| {
        let [a, b, c] = names;
        format!(
            "@group(0) @binding(0) var<uniform> {a}: mat4x4<f32>;
            @group(0) @binding(1) var<uniform> {b}: mat4x4<f32>;
            @group(0) @binding(2) var<uniform> {c}: mat4x4<f32>;"
        )
    };
    let three = |names: [&str; 3]| {
        let [a, b, c] = names;
        material(
            &declared(names),
            &format!("return {a} * {b} * {c} * vec4(p, 1.0);"),
        )
    };
    let light = |name: &str| {
        let declared = format!("@group(1) @binding(0) var<uniform> {name}: mat4x4<f32>;");
        material(&declared, &format!("return {name} * vec4(p, 1.0);"))
    };
    let is_agreed = |first: &str, second: &str| {
        let found = held(Relation::Shadow, first, second, &[]).unwrap();
        is_held(&found)
    };
    for factors in [
        ["projection", "view", "model"],
        ["P", "V", "M"],
        ["uProj", "uView", "uObject"],
    ] {
        for name in [
            "lightSpaceMatrix",
            "lightVP",
            "u_light_view_proj",
            "toShadow",
        ] {
            assert!(
                !is_agreed(&three(factors), &light(name)),
                "{factors:?}, {name}"
            );
        }
        assert!(
            is_agreed(&three(factors), &light("light_mvp")),
            "{factors:?}"
        );
    }
    // A vertex in the world's axes follows both.
    let skinned = |matrices: &str, product: &str| {
        let declared =
            format!("{matrices} @group(2) @binding(0) var<uniform> joints: array<mat4x4<f32>, 4>;");
        material(
            &declared,
            &format!(
                "let m = joints[1] * w.x + joints[2] * w.y; return {product} * (m * vec4(p, 1.0));"
            ),
        )
    };
    let camera = "@group(0) @binding(0) var<uniform> P: mat4x4<f32>; @group(0) @binding(1) var<uniform> V: mat4x4<f32>;";
    let one = |name: &str| format!("@group(1) @binding(0) var<uniform> {name}: mat4x4<f32>;");
    let light = skinned(&one("lamp"), "lamp");
    assert!(is_agreed(&skinned(camera, "P * V"), &light));
}
