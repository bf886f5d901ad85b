//! Generated modules agree with their plans.
#![allow(clippy::unwrap_used, clippy::panic)]

use preshade_plan::guard;
use shader_text::options;

use preshade_plan::pass::Facts;
use preshade_plan::plan::Plan;
use preshade_plan::state::MaterialState;

use super::{BuildError, choose, generate};
use crate::front;
use crate::recipe::Recipe;

use super::host::{Assumed, NumberPlace, Override, ScalarType, Unfit, constants_with};

/// A generated module's guard agrees with the plan's guard.
#[test]
fn a_host_checks_what_the_guard_does() {
    let types = [
        (guard::ScalarType::F32, ScalarType::F32),
        (guard::ScalarType::I32, ScalarType::I32),
        (guard::ScalarType::U32, ScalarType::U32),
    ];
    let (group, binding, offset) = (1, 2, 4);
    let words = [0.0_f32, -0.0, 0.5, 1.0, 1.5, f32::NAN, f32::INFINITY]
        .map(f32::to_bits)
        .into_iter()
        .chain([1, 2, u32::MAX]);
    for (word, (ty, hosts)) in words.flat_map(|w| types.map(|t| (w, t))) {
        let place = guard::Place::Uniform {
            group,
            binding,
            offset,
        };
        let of = guard::Guard {
            values: vec![guard::Assumed {
                name: "u.n".to_owned(),
                place,
                ty,
                bounds: guard::Bounds {
                    low: 0.0,
                    high: 1.0,
                },
            }],
        };
        let host = Assumed {
            name: "u.n",
            place: NumberPlace::Uniform {
                group,
                binding,
                offset,
            },
            ty: hosts,
            low: 0.0,
            high: 1.0,
        };
        let bytes = [[0; 4], word.to_le_bytes()].concat();
        for given in [&bytes[..], &bytes[..7]] {
            let at = |g, b| ((g, b) == (group, binding)).then_some(given);
            assert_eq!(host.holds(&[], at), of.holds(at), "{word:x} as {ty:?}");
        }
    }
}

/// A variant's pipelines only accept the constants that it was made for.
#[test]
fn a_host_cannot_set_what_a_variant_has_decided() {
    let of = |name, key, ty, value: f64, is_default| Assumed {
        name,
        place: NumberPlace::Override { key, is_default },
        ty,
        low: value,
        high: value,
    };
    let tenth = f64::from(0.1_f32);
    let guard = [
        of("N", "7", ScalarType::U32, 1.0, false),
        of("K", "K", ScalarType::F32, tenth, false),
        of("M", "M", ScalarType::U32, 2.0, true),
    ];
    let overrides = [Override {
        key: "K",
        is_needed: false,
    }];
    let given = |constants: &[(&str, f64)]| {
        let holds = guard.iter().all(|a| a.holds(constants, |_, _| None));
        let own = constants_with(&overrides, &["7", "M"], &guard, constants)
            .map(|own| own.iter().map(|(key, v)| ((*key).to_owned(), *v)).collect());
        assert_eq!(holds, own.is_ok(), "{constants:?}");
        own.map_err(|unfit| match unfit {
            Unfit::Guard(assumed) => assumed.name,
            Unfit::Host(why) => panic!("{why}"),
        })
    };
    let own: Vec<(String, f64)> = vec![("K".to_owned(), 0.1)];
    // As `f32` both are the same number.
    assert_eq!(given(&[("7", 1.0), ("K", 0.1)]), Ok(own.clone()));
    assert_eq!(given(&[("K", 0.1), ("M", 2.0), ("7", 1.0)]), Ok(own));
    assert_eq!(given(&[]), Err("N"));
    assert_eq!(given(&[("7", 4.0), ("K", 0.1)]), Err("N"));
    assert_eq!(given(&[("7", 1.0), ("K", 0.5)]), Err("K"));
    assert_eq!(given(&[("7", 1.0), ("K", f64::NAN)]), Err("K"));
    assert_eq!(given(&[("7", 1.0), ("K", 0.1), ("M", 3.0)]), Err("M"));
    // The last of a key counts.
    assert_eq!(given(&[("7", 1.0), ("K", 0.1), ("7", 4.0)]), Err("N"));
}

/// A variant that cannot be made is reported and replaced by the original, which alone can fail
/// a build.
#[test]
fn a_variant_that_cannot_be_made_is_the_original() {
    let text = include_str!("../../../../fixtures/shaders/toon.wgsl");
    let sources = [front::Source::new("toon.wgsl", text)];
    let parsed = front::parse(&sources, &options::Options::default()).unwrap();
    let state = MaterialState::default();
    let original = parsed.plan("toon", &state);
    let variant = |pass| {
        let recipe = Recipe::parse([pass]).unwrap();
        recipe.apply(&original, &Facts::default()).unwrap()
    };
    let mut unwritable = variant("shadow");
    unwritable.passes[0].program = "none".to_owned();
    let mut wordless = variant("depth-prepass");
    wordless.passes[0].features.push("telepathy".to_owned());
    let plans = |original: &Plan| {
        let all = [
            ("original", original),
            ("variant", &unwritable),
            ("b", &wordless),
        ];
        all.map(|(name, plan)| (name.to_owned(), (plan.clone(), Vec::new())))
            .to_vec()
    };
    let builder = super::configure();
    let mut warnings = Vec::new();
    let mut drawn = choose::made(&builder, plans(&original), &sources, &mut warnings).unwrap();
    let module = generate::Module {
        types: None,
        wgpu: None,
        said: &builder.said,
    };
    let text = super::worded("toon", &mut drawn, &module, &sources, &mut warnings).unwrap();
    let [emit, words] = &warnings[..] else {
        panic!("{warnings:?}");
    };
    assert!(
        emit.starts_with("toon.wgsl: `variant` cannot be made: "),
        "{emit}"
    );
    assert!(emit.ends_with("The original is shipped"), "{emit}");
    assert!(
        words.contains("`b` cannot be made: ") && words.contains("telepathy"),
        "{words}"
    );
    for (one, why) in drawn[1..].iter().zip(["`none`", "`telepathy`"]) {
        assert!(one.plan.steps.is_empty());
        assert_eq!(one.files, drawn[0].files);
        assert!(one.left_out[0].contains(why), "{:?}", one.left_out);
    }
    assert!(!text.contains("Phase::Depth,"));
    let failed = choose::made(&builder, plans(&unwritable), &sources, &mut warnings);
    assert!(matches!(failed, Err(BuildError::Emit(_))));
}
