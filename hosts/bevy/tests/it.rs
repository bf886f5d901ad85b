//! Draws materials with the plugin, without it, and with pre-pass shaders by hand.
#![allow(missing_docs, clippy::unwrap_used, clippy::panic)]

mod support;

use bevy_preshade::{PreshadePlugin, State};
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
    // A step of the format, `rgb10a2unorm`.
    assert!(normal(&derived) <= 1.0 / 1023.0, "normals of {name}");
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
    let depth = Ahead {
        depth: true,
        ..Ahead::default()
    };
    let mut stage = with_plugin::<{ materials::JELLY }>(depth);
    for row in stage.derivations().rows() {
        let alone = State::Derived {
            has_fragment: false,
            reads_material: true,
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

/// A shader that changes while the app runs is derived again.
#[test]
fn hot_reload() {
    let depth = Ahead {
        depth: true,
        ..Ahead::default()
    };
    let text = materials::CASES[materials::GRASS]
        .1
        .replace("* values.amount", "* 2.5 * values.amount");
    let mut stage = with_plugin::<{ materials::GRASS }>(depth);
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

/// Bevy's pre-pass stays where a discard reads what the pre-pass does not have.
#[test]
fn refused() {
    let depth = Ahead {
        depth: true,
        ..Ahead::default()
    };
    let mut stage = with_plugin::<{ materials::LIT }>(depth);
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
    let without = drawn_by_main::<{ materials::LIT }>(depth);
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
