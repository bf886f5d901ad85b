//! Locks are obeyed, and differences are reported.
#![allow(clippy::unwrap_used, clippy::panic)]

use preshade_plan::guard::{Assumed, Bounds, Place, ScalarType};
use preshade_plan::pass::{Constant, Facts};
use preshade_plan::plan::Plan;
use shader_text::options;

use super::inputs::hash;
use super::*;
use crate::front;
use crate::recipe::Recipe;

const TEXT: &str = "@vertex fn vs(@location(0) p: vec4<f32>) -> @builtin(position) vec4<f32> { \
                    return p; }\n\
                    @fragment fn fs() -> @location(0) vec4<f32> { return vec4<f32>(1.0); }\n";

fn sources(text: &str) -> [front::Source; 1] {
    [front::Source::new("shaders/lit.wgsl", text)]
}

fn original(text: &str) -> Plan {
    let parsed = front::parse(&sources(text), &options::Options::default()).unwrap();
    parsed.plan("lit", &MaterialState::default())
}

fn inputs(text: &str) -> Inputs {
    let parsed = front::parse(&sources(text), &options::Options::default()).unwrap();
    Inputs::of(&parsed, &[], &MaterialState::default())
}

fn locked() -> Lock {
    let recipe = Recipe::parse(["shadow", "depth-prepass:form=equal"]).unwrap();
    let facts = Facts::without_ties();
    let locked = Locked::resolve(&original(TEXT), &recipe, &facts, inputs(TEXT), None).unwrap();
    Lock {
        materials: BTreeMap::from([("lit".to_owned(), locked)]),
        ..Lock::default()
    }
}

#[test]
fn what_is_written_is_read_and_obeyed() {
    let lock = Lock::parse(&locked().to_json()).unwrap();
    assert_eq!(lock, locked());
    let chosen = lock.check("lit", &inputs(TEXT)).unwrap();
    assert!(chosen.recipe.steps.iter().all(|s| s.site.is_some()));
    let plan = chosen.apply(&original(TEXT)).unwrap();
    let roles: Vec<&str> = plan.passes.iter().map(|p| p.role.name()).collect();
    assert_eq!(roles, ["prepass", "shadow", "main"]);
}

#[test]
fn comments_and_line_endings_do_not_count() {
    let lock = locked();
    for text in [
        TEXT.replace('\n', "\r\n"),
        TEXT.replace('\n', "\r\r\n"),
        format!("// what it is\n\n/* of /* whom */ */\n{TEXT}\r// c"),
        TEXT.replace(" }\n", " } // as it is  \n\n\t \n"),
    ] {
        let chosen = lock.check("lit", &inputs(&text)).unwrap();
        assert!(chosen.apply(&original(&text)).is_ok(), "{text}");
    }
    let within = TEXT.replace("1.0", "1.0 /* and 2.0 */ + 1.0");
    assert!(lock.check("lit", &inputs(&within)).is_err());
}

#[test]
fn a_lock_of_another_preshade_is_told_from_garbage() {
    let text = locked().to_json();
    let later = text.replace("preshade.lock.v1", "preshade.lock.v2");
    let said = Lock::parse(&later).unwrap_err();
    assert!(matches!(said, LockError::Foreign { .. }), "{said}");
    let more = text.replace("\"shaders\"", "\"more\": 1, \"shaders\"");
    let said = Lock::parse(&more.replace(TOOL, "preshade 9.0.0")).unwrap_err();
    assert!(said.to_string().contains("preshade 9.0.0"), "{said}");
    let said = Lock::parse(&more).unwrap_err();
    assert!(matches!(said, LockError::Syntax { .. }), "{said}");
}

#[test]
fn each_difference_is_told_by_name() {
    let lock = locked();
    let with = |change: &dyn Fn(&mut Inputs)| {
        let mut now = inputs(TEXT);
        change(&mut now);
        lock.check("lit", &now).unwrap_err()
    };
    assert!(matches!(
        lock.check("toon", &inputs(TEXT)).unwrap_err(),
        Mismatch::NoMaterial { .. }
    ));
    let edited = lock
        .check("lit", &inputs(&TEXT.replace("1.0", "0.5")))
        .unwrap_err();
    assert_eq!(
        edited.to_string(),
        "lit.wgsl was edited after preshade.lock was written"
    );
    let defines = with(&|now| {
        now.defines.insert("FOG".to_owned(), "1".to_owned());
    });
    assert_eq!(
        defines.to_string(),
        "preshade.lock was written with other definitions (FOG)"
    );
    let state = with(&|now| {
        now.state.depth_write = false;
        now.state.multisample.count = 4;
    });
    assert_eq!(
        state.to_string(),
        "preshade.lock was written for another pipeline state: depth_write is false, and was true; \
         multisample.count is 4, and was 1"
    );
    assert_eq!(
        with(&|now| now.vertex = "vs_main".to_owned()),
        Mismatch::EntryPoints
    );
    let mut older = locked();
    let of_lit = older.materials.get_mut("lit").unwrap();
    of_lit.inputs.tool = "preshade 0.0.9".to_owned();
    let said = older.check("lit", &inputs(TEXT)).unwrap_err().to_string();
    assert!(said.contains("preshade 0.0.9"), "{said}");
}

#[test]
fn other_shaders_than_were_measured_are_not_shipped() {
    let mut lock = locked();
    let of_lit = lock.materials.get_mut("lit").unwrap();
    of_lit.shaders = hash("another");
    assert_eq!(
        of_lit.apply(&original(TEXT)).unwrap_err(),
        Mismatch::Shaders
    );
    of_lit.facts.depth_ties = Some(1);
    let refused = of_lit.apply(&original(TEXT)).unwrap_err();
    assert!(matches!(refused, Mismatch::Refused(_)), "{refused}");
}

#[test]
fn nothing_is_kept_of_other_materials() {
    let of = |material: &str| Constant {
        material: material.to_owned(),
        value: Assumed {
            name: "fog".to_owned(),
            place: Place::Override {
                name: "fog".to_owned(),
            },
            ty: ScalarType::F32,
            bounds: Bounds::one(0.5),
        },
    };
    let facts = Facts {
        constants: vec![of("lit"), of("toon")],
        ..Facts::default()
    };
    let recipe = Recipe::default();
    let locked = Locked::resolve(&original(TEXT), &recipe, &facts, inputs(TEXT), None).unwrap();
    assert_eq!(locked.facts.constants, [of("lit")]);
}

#[test]
fn a_key_that_is_not_known_is_an_error() {
    let text = locked().to_json().replace("\"shaders\"", "\"shader\"");
    let said = Lock::parse(&text).unwrap_err().to_string();
    assert!(said.contains("unknown field `shader`"), "{said}");
}
