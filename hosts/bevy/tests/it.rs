//! Draws materials with the plugin, without it, and with pre-pass shaders by hand.
#![allow(missing_docs, clippy::unwrap_used, clippy::panic)]

mod support;

use bevy::asset::Assets;
use bevy_preshade::{Choice, Measurements, PreshadePlugin, State};
use support::materials::{self, Case, Holey, set_shader, set_up, set_up_holes};
use support::{Ahead, Drawn, Stage, covered, differ, greatest, picture};

/// What a case looks like, drawn by the main pass alone, by Bevy's pre-pass, with the plugin, and by
/// hand.
struct Compared {
    main: Drawn,
    bevy: Drawn,
    derived: Drawn,
    hand: Drawn,
}

const FRAMES: u32 = 3;

fn compared<const CASE: usize>() -> Compared {
    let draw = |mut stage: Stage| {
        stage.settle();
        stage.draw(FRAMES)
    };
    let main = draw(Stage::new(Ahead::default(), set_up::<CASE, false>));
    let bevy = draw(Stage::new(Ahead::ALL, set_up::<CASE, false>));
    let hand = draw(Stage::new(Ahead::ALL, set_up::<CASE, true>));
    let mut stage = Stage::new(Ahead::ALL, |app| {
        set_up::<CASE, false>(app);
        app.add_plugins(PreshadePlugin::<Case<CASE, false>>::default());
    });
    stage.settle();
    for row in stage.derivations().rows() {
        assert!(matches!(row.state, State::Derived { .. }), "{row:?}");
    }
    if std::env::var_os("PRINT").is_some() {
        stage
            .derivations()
            .texts()
            .for_each(|text| println!("{text}"));
    }
    let derived = stage.draw(FRAMES);
    Compared {
        main,
        bevy,
        derived,
        hand,
    }
}

fn check<const CASE: usize>() {
    let (name, ..) = materials::CASES[CASE];
    let Compared {
        main,
        bevy,
        derived,
        hand,
    } = compared::<CASE>();
    let ahead = |drawn: &Drawn| drawn.ahead.clone().unwrap();
    let pixels = covered(&main.depth);
    let wrong = |drawn: &Drawn| differ(&main.depth, &ahead(drawn));
    let of_shadows = |drawn: &Drawn| [0, 1].map(|i| differ(&hand.shadows[i], &drawn.shadows[i]));
    let motion = |drawn: &Drawn| {
        let (drawn, hand) = (
            drawn.motion.as_ref().unwrap(),
            hand.motion.as_ref().unwrap(),
        );
        greatest(drawn, hand) * support::SIZE as f32
    };
    let normal = |drawn: &Drawn| {
        let (drawn, hand) = (
            drawn.normal.as_ref().unwrap(),
            hand.normal.as_ref().unwrap(),
        );
        greatest(drawn, hand)
    };
    println!(
        "{name}: {pixels} pixels (greatest difference {}); depths that differ: Bevy {}, derived {}, hand {}; shadows: Bevy {:?}, \
         derived {:?} of {:?}; motion: Bevy {} pixels, derived {}; normals: Bevy {}, derived {}",
        greatest(&main.depth, &ahead(&hand)),
        wrong(&bevy),
        wrong(&derived),
        wrong(&hand),
        of_shadows(&bevy),
        of_shadows(&derived),
        [0, 1].map(|i| covered(&hand.shadows[i])),
        motion(&bevy),
        motion(&derived),
        normal(&bevy),
        normal(&derived),
    );
    if let Some(folder) = std::env::var_os("PICTURES") {
        let [of_bevy, of_derived] = [&bevy, &derived].map(ahead);
        let shadows = [&hand, &bevy, &derived].map(|drawn| drawn.shadows[0].clone());
        let groups = [[main.depth.clone(), of_bevy, of_derived], shadows];
        picture::save(
            &groups,
            &std::path::Path::new(&folder).join(format!("{name}.png")),
        );
    }
    assert!(pixels > 1000);
    assert_eq!(wrong(&derived), 0, "depths of {name}");
    assert_eq!(of_shadows(&derived), [0, 0], "shadows of {name}");
    assert!(motion(&derived) <= 1.0 / 256.0, "motion of {name}");
    // In steps of the format, `rgb10a2unorm`.
    let steps = (normal(&derived) * 1023.0).round();
    assert!(steps <= 1.0, "normals of {name}");
}

#[test]
fn grass() {
    check::<{ materials::GRASS }>();
}

#[test]
fn fence() {
    check::<{ materials::FENCE }>();
}

#[test]
fn jelly() {
    check::<{ materials::JELLY }>();
}

#[test]
fn skin() {
    check::<{ materials::SKIN }>();
}

#[test]
fn morph() {
    check::<{ materials::MORPH }>();
}

#[test]
fn sign() {
    check::<{ materials::SIGN }>();
}

/// It has no normal: that of the triangle is drawn.
#[test]
fn bubble() {
    check::<{ materials::BUBBLE }>();
}

/// Bevy's targets have their places with and without each other.
#[test]
fn normals_and_motion_alone() {
    let all = with_plugin::<{ materials::GRASS }>(Ahead::ALL).draw(FRAMES);
    let motion = with_plugin::<{ materials::GRASS }>(Ahead::MOTION).draw(FRAMES);
    let normal = with_plugin::<{ materials::GRASS }>(Ahead::NORMAL).draw(FRAMES);
    assert_eq!(
        (motion.normal.is_none(), normal.motion.is_none()),
        (true, true)
    );
    let [of_all, alone] = [&all, &motion].map(|drawn| drawn.motion.clone().unwrap());
    assert!(covered(&of_all) > 1000);
    assert_eq!(differ(&of_all, &alone), 0);
    let [of_all, alone] = [&all, &normal].map(|drawn| drawn.normal.clone().unwrap());
    assert!(covered(&of_all) > 1000);
    assert_eq!(differ(&of_all, &alone), 0);
}

/// Bevy has one key for a mask, which the shader itself cuts, and for alpha that covers.
#[test]
fn alpha_modes_of_one_material() {
    let mut stage = with_plugin::<{ materials::LEAF }>(Ahead::DEPTH);
    let covers = stage.draw(FRAMES);
    let mut materials = stage
        .app
        .world_mut()
        .resource_mut::<Assets<Case<{ materials::LEAF }, false>>>();
    let ids: Vec<_> = materials.ids().collect();
    for id in ids {
        materials.get_mut(id).unwrap().values.w = -1.0;
    }
    stage.settle();
    let masks = stage.draw(FRAMES);
    // The shader discards nothing.
    for (covers, masks) in covers.shadows.iter().zip(&masks.shadows) {
        assert!(covered(covers) > 1000);
        assert!(covered(masks) > covered(covers));
    }
}

/// A case with the plugin.
fn with_plugin<const CASE: usize>(ahead: Ahead) -> Stage {
    let mut stage = Stage::new(ahead, |app| {
        set_up::<CASE, false>(app);
        app.add_plugins(PreshadePlugin::<Case<CASE, false>>::default());
    });
    stage.settle();
    stage
}

fn drawn_by_main<const CASE: usize>(ahead: Ahead) -> Drawn {
    let mut stage = Stage::new(ahead, set_up::<CASE, false>);
    stage.settle();
    stage.draw(FRAMES)
}

/// What cuts nothing and writes depth alone has no fragment stage.
#[test]
fn depth_alone() {
    let mut stage = with_plugin::<{ materials::JELLY }>(Ahead::DEPTH);
    for row in stage.derivations().rows() {
        let alone = State::Derived {
            has_fragment: false,
            reads_material: true,
            is_flat: false,
        };
        assert_eq!(row.state, alone);
    }
    let main = drawn_by_main::<{ materials::JELLY }>(Ahead::default());
    assert_eq!(differ(&main.depth, &stage.draw(FRAMES).ahead.unwrap()), 0);
}

/// Motion is that of the picture without the shift of temporal antialiasing; depth has the shift.
#[test]
fn jitter() {
    let all = Ahead {
        jitter: true,
        ..Ahead::ALL
    };
    let derived = with_plugin::<{ materials::GRASS }>(all).draw(FRAMES);
    let mut hand = Stage::new(all, set_up::<{ materials::GRASS }, true>);
    hand.settle();
    let hand = hand.draw(FRAMES);
    let main = drawn_by_main::<{ materials::GRASS }>(Ahead {
        jitter: true,
        ..Ahead::default()
    });
    assert_eq!(differ(&main.depth, &derived.ahead.unwrap()), 0);
    let still = drawn_by_main::<{ materials::GRASS }>(Ahead::default());
    assert_ne!(differ(&main.depth, &still.depth), 0, "nothing is shifted");
    let motion = greatest(&derived.motion.unwrap(), &hand.motion.unwrap());
    assert!(motion * support::SIZE as f32 <= 1.0 / 256.0, "{motion}");
}

/// Depth that reads nothing of the material is drawn without its bind group, so that Bevy can draw
/// objects of several materials at once.
#[test]
fn unread_material() {
    let mut stage = with_plugin::<{ materials::FENCE }>(Ahead::DEPTH);
    assert_eq!(
        stage.binds_material::<Case<{ materials::FENCE }, false>>(),
        [false]
    );
    // A change that reads it gets it back.
    let text = materials::CASES[materials::FENCE].1;
    let text = text.replace("< 0.3", "< 0.3 * values.rate");
    set_shader(&mut stage.app, materials::FENCE, text.clone());
    stage.settle();
    assert_eq!(
        stage.binds_material::<Case<{ materials::FENCE }, false>>(),
        [true]
    );
    let mut main = Stage::new(Ahead::default(), set_up::<{ materials::FENCE }, false>);
    set_shader(&mut main.app, materials::FENCE, text);
    main.settle();
    let main = main.draw(FRAMES);
    let derived = stage.draw(FRAMES);
    assert_eq!(differ(&main.depth, &derived.ahead.unwrap()), 0);
}

/// The pre-pass is drawn or left out as it is measured, and the picture is the same.
#[test]
fn measured() {
    let mut stage = Stage::new(Ahead::DEPTH, |app| {
        set_up::<{ materials::GRASS }, false>(app);
        app.add_plugins(PreshadePlugin::<Case<{ materials::GRASS }, false>>::measured());
    });
    stage.settle();
    let choice = |stage: &Stage| {
        let rows = stage.app.world().resource::<Measurements>().rows();
        rows.map(|(_, choice)| choice).next().unwrap()
    };
    for _ in 0..1000 {
        stage.app.update();
        if choice(&stage) != Choice::Waiting {
            break;
        }
    }
    let choice = choice(&stage);
    println!("{choice:?}");
    assert!(
        matches!(choice, Choice::On(_) | Choice::Off(_)),
        "{choice:?}"
    );
    let after = stage.draw(FRAMES);
    assert_eq!(
        stage.has_prepass::<Case<{ materials::GRASS }, false>>(),
        [matches!(choice, Choice::On(_))]
    );
    let main = drawn_by_main::<{ materials::GRASS }>(Ahead::default());
    assert_eq!(main.depth, after.depth);
}

/// A lost graphics device is replaced, and all shaders are derived for the new one.
#[test]
fn lost_device() {
    let mut kept = with_plugin::<{ materials::JELLY }>(Ahead::DEPTH);
    let mut lost = with_plugin::<{ materials::JELLY }>(Ahead::DEPTH);
    let before = [&mut kept, &mut lost].map(|stage| stage.draw(FRAMES));
    assert_eq!(before[0].ahead, before[1].ahead);
    lost.lose_device();
    lost.settle();
    assert!(lost.derivations().rows().next().is_some());
    let after = [&mut kept, &mut lost].map(|stage| stage.draw(FRAMES));
    assert_ne!(before[1].ahead, after[1].ahead, "nothing is drawn");
    assert_eq!(after[0].ahead, after[1].ahead);
    assert_eq!(after[0].depth, after[1].depth);
}

/// Nothing is turned off that an effect needs.
#[test]
fn needed() {
    let mut stage = Stage::new(Ahead::ALL, |app| {
        set_up::<{ materials::GRASS }, false>(app);
        app.add_plugins(PreshadePlugin::<Case<{ materials::GRASS }, false>>::measured());
    });
    stage.settle();
    let rows: Vec<_> = stage
        .app
        .world()
        .resource::<Measurements>()
        .rows()
        .collect();
    assert!(matches!(rows[..], [(_, Choice::Needed)]), "{rows:?}");
    assert_eq!(
        stage.has_prepass::<Case<{ materials::GRASS }, false>>(),
        [true]
    );
}

/// A shader that changes while the app runs is derived again.
#[test]
fn hot_reload() {
    let text = materials::CASES[materials::GRASS]
        .1
        .replace("* values.amount", "* 2.5 * values.amount");
    let mut stage = with_plugin::<{ materials::GRASS }>(Ahead::DEPTH);
    let before = stage.draw(FRAMES);
    set_shader(&mut stage.app, materials::GRASS, text.clone());
    stage.settle();
    let after = stage.draw(0);
    assert_eq!(before.depth, after.depth, "nothing is drawn in between");
    let after = stage.draw(FRAMES);
    let mut main = Stage::new(Ahead::default(), set_up::<{ materials::GRASS }, false>);
    main.settle();
    main.draw(FRAMES);
    set_shader(&mut main.app, materials::GRASS, text);
    main.settle();
    let main = main.draw(FRAMES);
    assert_ne!(differ(&before.depth, &main.depth), 0);
    assert_eq!(differ(&main.depth, &after.ahead.unwrap()), 0);
}

/// What alpha covers is drawn from the alpha on that Bevy's own pre-pass takes.
#[test]
fn alpha_to_coverage() {
    let Compared {
        bevy,
        derived,
        hand,
        ..
    } = compared::<{ materials::LEAF }>();
    let ahead = |drawn: &Drawn| drawn.ahead.clone().unwrap();
    assert_eq!(differ(&ahead(&hand), &ahead(&derived)), 0);
    assert_eq!(hand.shadows, derived.shadows);
    assert_ne!(differ(&ahead(&hand), &ahead(&bevy)), 0);
    assert_ne!(hand.shadows, bevy.shadows);
}

/// Bevy's pre-pass stays where a discard reads what the pre-pass does not have.
#[test]
fn refused() {
    let mut stage = with_plugin::<{ materials::LIT }>(Ahead::DEPTH);
    let rows: Vec<_> = stage.derivations().rows().collect();
    assert!(!rows.is_empty());
    for row in rows {
        let State::Refused(refused) = &row.state else {
            panic!("{row:?}")
        };
        assert_eq!(refused.code, "view-lacks");
        assert!(refused.reason.contains("`lights`"), "{refused:?}");
    }
    let with = stage.draw(FRAMES);
    let without = drawn_by_main::<{ materials::LIT }>(Ahead::DEPTH);
    assert_eq!(with.ahead, without.ahead);
    assert_eq!(with.shadows, without.shadows);
}

/// The holes are those of the main pass, and the normals those of Bevy's own pre-pass.
#[test]
fn physically_based() {
    let draw = |ahead, width, has_plugin| {
        let mut stage = Stage::new(ahead, |app| {
            set_up_holes(app, width);
            if has_plugin {
                app.add_plugins(PreshadePlugin::<Holey>::default());
            }
        });
        stage.settle();
        if has_plugin {
            for row in stage.derivations().rows() {
                assert!(matches!(row.state, State::Derived { .. }), "{row:?}");
            }
        }
        stage.draw(FRAMES)
    };
    let main = draw(Ahead::default(), 0.3, false);
    let derived = draw(Ahead::ALL, 0.3, true);
    assert_eq!(differ(&main.depth, derived.ahead.as_ref().unwrap()), 0);
    let whole = draw(Ahead::ALL, 0.0, false);
    assert_ne!(differ(&main.depth, whole.ahead.as_ref().unwrap()), 0);
    let own = draw(Ahead::ALL, 0.0, true);
    // Without a normal map, Bevy's pre-pass does not normalise what it interpolates. The main shader does.
    let unit = |texels: Option<support::read::Texels>| {
        let mut texels = texels.unwrap();
        for value in &mut texels.values {
            let vector = bevy::math::Vec3::new(value[0], value[1], value[2]) * 2.0 - 1.0;
            let [x, y, z] = vector.normalize().to_array();
            *value = [x, y, z, value[3]];
        }
        texels
    };
    let normals = greatest(&unit(own.normal), &unit(whole.normal));
    // One step of the format in each of the two pictures; a step is 2 in 1023 of the vector.
    assert!(normals <= 4.0 / 1023.0, "{normals}");
    let motion = greatest(&own.motion.unwrap(), &whole.motion.unwrap());
    assert!(motion * support::SIZE as f32 <= 1.0 / 256.0, "{motion}");
}
