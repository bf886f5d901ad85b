//! What a frame asks for is counted off its plans; what is decided is what was measured.

use std::time::Duration;

use preshade_compiler::recipe::Recipe;
use preshade_draw::render::SceneInputs;
use preshade_draw::scene::{DrawOrder, Scene};
use preshade_lab::measure::{Session, TimingSettings};
use preshade_lab::search::plan::assign::{Assignment, FramePredictor, Taken};
use preshade_lab::search::plan::choose::WORTHWHILE;
use preshade_lab::search::plan::count::FragmentCounter;
use preshade_lab::search::plan::frame_work::{Counted, DrawCounts, Fragments, drawn};
use preshade_lab::search::plan::layers::Layers;
use preshade_lab::search::plan::model::Model;
use preshade_lab::search::plan::policy::{Hold, Rule};
use preshade_lab::search::plan::terms::{Term, Work};
use preshade_lab::search::plan::{
    Choices, Settings, Timed, choices, decide, partial_prepass, recipes, sorting,
};
use preshade_plan::contract::Verdict;
use preshade_plan::pass::Facts;
use preshade_plan::state::{ColorTarget, CompareFunction, DepthDirection, DepthFormat};
use preshade_scenes::ShaderForm;

use crate::render_support::*;

/// The frame of that recipe on every material that takes it.
fn with(choices: &[Choices], recipe: &str) -> Assignment {
    let of = |c: &Choices| c.position(recipe).unwrap_or(0);
    Assignment(choices.iter().map(of).collect())
}

fn weighed(scene: &Scene, list: &[&str]) -> Vec<Choices> {
    let recipes: Vec<Recipe> = list
        .iter()
        .map(|r| Recipe::parse_list(r).unwrap())
        .collect();
    choices(&originals(scene), &recipes, &Facts::without_ties())
}

const SIZE: [u32; 2] = [100, 50];
const PIXELS: f64 = 5000.0;

fn counted(materials: &[[f64; 3]]) -> Counted {
    let of = |[rasterised, drawn, visible]: &[f64; 3]| Fragments {
        rasterised: *rasterised,
        drawn: *drawn,
        visible: *visible,
    };
    Counted {
        size: SIZE,
        materials: materials.iter().map(of).collect(),
    }
}

fn work(choices: &[Choices], recipe: &str, drawn: &[DrawCounts], counted: &Counted) -> Work {
    let assignment = with(choices, recipe);
    assert!(
        recipe.is_empty() || !assignment.is_original(),
        "{recipe} is refused"
    );
    assignment.work(choices, drawn, counted).unwrap()
}

#[test]
fn a_prepass_draws_twice_and_shades_what_is_seen() {
    let scene = planes(SIZE, 4);
    let choices = weighed(
        &scene,
        &[
            "depth-prepass",
            "early-discard",
            "visibility-buffer:budget=1,select=id",
        ],
    );
    let drawn = drawn(&scene);
    assert_eq!(drawn[0].draws, 4.0);
    assert_eq!((drawn[0].vertices, drawn[0].triangles), (16.0, 8.0));
    // Back to front: all are shaded, a quarter is seen.
    let counted = counted(&[[4.0 * PIXELS, 4.0 * PIXELS, PIXELS]]);
    assert_eq!(counted.shaded_per_pixel(), 4.0);
    assert_eq!(counted.overdraw(), 4.0);
    let of = |recipe: &str| work(&choices, recipe, &drawn, &counted);
    let original = of("");
    assert_eq!(original.of(Term::Passes), 1.0);
    assert_eq!(original.of(Term::Draws), 4.0);
    assert_eq!(original.of(Term::Vertices), 16.0);
    assert_eq!(original.of(Term::Fragments), 4.0 * PIXELS);
    assert_eq!(original.of(Term::Dispatches), 0.0);
    // Colour and depth, four bytes each.
    assert_eq!(original.of(Term::Bytes), 4.0 * PIXELS * 8.0);

    let prepass = of("depth-prepass");
    assert_eq!(prepass.of(Term::Passes), 2.0);
    assert_eq!(prepass.of(Term::Draws), 8.0);
    assert_eq!(prepass.of(Term::Vertices), 32.0);
    assert_eq!(prepass.of(Term::Fragments), PIXELS);
    assert_eq!(
        prepass.of(Term::FragmentOps) * 4.0,
        original.of(Term::FragmentOps)
    );

    // The prologue is launched as often as the original, and what follows it is not.
    let prologue = of("early-discard");
    assert_eq!(prologue.of(Term::Fragments), 4.0 * PIXELS);
    assert!(prologue.of(Term::FragmentOps) > prepass.of(Term::FragmentOps));

    // Each draw's resolve looks at each pixel's id.
    let ids = of("visibility-buffer:budget=1,select=id");
    assert_eq!(ids.of(Term::Fragments), 4.0 * PIXELS + 4.0 * PIXELS);
}

#[test]
fn depth_that_is_ahead_spares_what_lies_behind_it() {
    let mut scene = planes(SIZE, 2);
    let mut second = scene.materials[0].clone();
    second.name = "second".to_owned();
    scene.materials.push(second);
    scene.draws[1].material = 1;
    let choices = weighed(&scene, &["depth-prepass"]);
    let drawn = drawn(&scene);
    // Each fills half of what is seen; the second is drawn first, and hidden by half.
    let counted = counted(&[[2500.0, 2500.0, 2500.0], [5000.0, 5000.0, 2500.0]]);
    let shaded = |picks: [usize; 2]| {
        let work = Assignment(picks.to_vec()).work(&choices, &drawn, &counted);
        work.unwrap().of(Term::Fragments)
    };
    assert_eq!(shaded([0, 0]), 7500.0);
    assert_eq!(shaded([0, 1]), 5000.0);
    // Half of the picture is ahead: half of what is hidden goes.
    assert_eq!(shaded([1, 0]), 6250.0);
    assert_eq!(shaded([1, 1]), 5000.0);
}

#[test]
fn neighbours_that_do_not_fit_stay_as_written() {
    let mut scene = planes(SIZE, 2);
    // A sky that writes depth without comparing it forbids what trusts depth drawn ahead.
    let mut sky = scene.materials[0].clone();
    sky.name = "sky".to_owned();
    sky.state.depth_compare = Some(CompareFunction::Always);
    scene.materials.push(sky);
    scene.draws[1].material = 1;
    let choices = weighed(&scene, &["depth-prepass:form=equal", "depth-prepass"]);
    assert!(choices[0].position("depth-prepass:form=equal").is_none());
    let refused = &choices[0].refused;
    assert!(
        refused
            .iter()
            .any(|r| r.why.contains("neighbour-moves-depth")),
        "{refused:?}"
    );
    let model = Model::nominal();
    let seen = FramePredictor {
        choices: &choices,
        drawn: &drawn(&scene),
        counted: &[counted(&[[5000.0, 5000.0, 0.0], [5000.0, 5000.0, 5000.0]])],
        model: &model,
        taken: Taken::All,
    };
    let frames = seen.frames();
    assert!(frames[0].assignment.is_original());
    for frame in &frames {
        let (mended, notes) = frame.assignment.clone().mended(&choices);
        assert_eq!((&mended, notes.len()), (&frame.assignment, 0));
    }
    // No frame twice.
    for (i, a) in frames.iter().enumerate() {
        assert!(frames[..i].iter().all(|b| a.assignment != b.assignment));
    }
}

#[test]
fn fragments_of_stacked_planes() {
    for (samples, direction) in [
        (1, DepthDirection::Forward),
        (4, DepthDirection::Forward),
        (1, DepthDirection::Reversed),
    ] {
        let scene = with_samples(planes([64, 64], 5), samples);
        let scene = with_depth(scene, DepthFormat::Depth32float, direction);
        let inputs = SceneInputs::new(gpu(), &scene).unwrap();
        let mut counter = FragmentCounter::new(&inputs, &originals(&scene)).unwrap();
        let frame = &scene.cameras[0].frames[0];
        for (order, drawn) in [(DrawOrder::FrontToBack, 1.0), (DrawOrder::BackToFront, 5.0)] {
            let counted = counter.count(frame, order).unwrap();
            let of = counted.materials[0];
            assert_eq!(
                [of.rasterised, of.drawn, of.visible],
                [5.0, drawn, 1.0].map(|n| n * 4096.0),
                "{samples} samples, {direction:?}, {order:?}"
            );
        }
    }
}

#[test]
fn each_material_is_counted_by_itself() {
    // Four: more than one target's channels.
    let mut scene = planes([32, 32], 4);
    for i in 1..4 {
        let mut more = scene.materials[0].clone();
        more.name = format!("material {i}");
        scene.materials.push(more);
        scene.draws[i].material = i;
    }
    let inputs = SceneInputs::new(gpu(), &scene).unwrap();
    let mut counter = FragmentCounter::new(&inputs, &originals(&scene)).unwrap();
    let frame = &scene.cameras[0].frames[0];
    let counted = counter.count(frame, DrawOrder::FrontToBack).unwrap();
    for (i, of) in counted.materials.iter().enumerate() {
        let seen = if i == 0 { 1024.0 } else { 0.0 };
        assert_eq!(
            [of.rasterised, of.drawn, of.visible],
            [1024.0, seen, seen],
            "{i}"
        );
    }
}

fn settings(model: &Model, timed: Timed) -> Settings<'_> {
    Settings {
        timed,
        timing: TimingSettings {
            budget: Duration::ZERO,
            ..TimingSettings::default()
        },
        frames_per_camera: 1,
        runners: 2,
        refinements: 2,
        hold: Hold::Switching,
        model,
        command: "test".to_owned(),
    }
}

#[test]
fn nothing_is_chosen_but_what_was_measured_to_be_faster() {
    let mut scene = planes([32, 32], 3);
    scene.orders = vec![DrawOrder::BackToFront, DrawOrder::FrontToBack];
    let model = Model::nominal();
    let facts = Facts::without_ties();
    let list = recipes(None).unwrap();
    let decision = decide(
        &Session::new(gpu(), &scene, ShaderForm::Text).unwrap(),
        &list,
        &facts,
        &settings(&model, Timed::Yes),
        &mut |_| {},
    )
    .unwrap();
    assert_eq!(decision.plans[0].name, "original");
    assert!(decision.plans.len() <= 3);
    assert!(!decision.is_broken());
    assert_eq!(decision.views.len(), 2);
    for (i, view) in decision.views.iter().enumerate() {
        for plan in [view.plan, view.alone] {
            let chosen = &decision.plans[plan];
            assert_eq!(chosen.verdict, Verdict::Holds);
            let speedup = chosen.by_view[i].speedup.unwrap();
            assert!(
                plan == 0 || speedup.high >= 1.0,
                "{} {speedup:?}",
                chosen.name
            );
        }
        let alone = decision.plans[view.alone].by_view[i].speedup.unwrap();
        assert!(view.alone == 0 || alone.low > WORTHWHILE);
    }
    assert!(!decision.materials[0].reasons.is_empty());
    let json: serde_json::Value = serde_json::from_str(&decision.to_json().unwrap()).unwrap();
    assert_eq!(json["schema"], "preshade.decision.v2");
}

#[test]
fn a_budget_takes_no_measurement_from_what_changes_nothing() {
    let scene = planes([32, 32], 3);
    // There is room for one plan, whichever the model likes.
    let mut model = Model::nominal();
    model.nanoseconds = [(Term::Passes, 1.0)].into();
    let measured = |recipes: &[&str]| -> Vec<String> {
        let list: Vec<Recipe> = recipes
            .iter()
            .map(|r| Recipe::parse_list(r).unwrap())
            .collect();
        let settings = Settings {
            runners: 1,
            ..settings(&model, Timed::Yes)
        };
        let decision = decide(
            &Session::new(gpu(), &scene, ShaderForm::Text).unwrap(),
            &list,
            &Facts::without_ties(),
            &settings,
            &mut |_| {},
        )
        .unwrap();
        let others = decision.plans.into_iter().skip(1);
        others.map(|plan| plan.name).collect()
    };
    let [kept, within] = ["depth-prepass", "visibility-buffer:budget=1,select=id"];
    assert_eq!(measured(&[kept]), [kept]);
    assert_eq!(measured(&[kept, within]).len(), 2);
    assert_eq!(measured(&[within, kept])[0], kept);
}

#[test]
fn without_a_clock_the_choice_is_a_prediction() {
    let mut scene = planes([32, 32], 8);
    scene.orders = vec![DrawOrder::BackToFront, DrawOrder::FrontToBack];
    // A model in which shading is all that costs: what lies in front decides.
    let mut model = Model::nominal();
    model.nanoseconds = [(Term::Fragments, 1.0), (Term::Draws, 10.0)].into();
    let facts = Facts::without_ties();
    let list = vec![Recipe::parse_list("depth-prepass").unwrap()];
    let of = |hold| {
        let settings = Settings {
            hold,
            ..settings(&model, Timed::No)
        };
        decide(
            &Session::new(gpu(), &scene, ShaderForm::Text).unwrap(),
            &list,
            &facts,
            &settings,
            &mut |_| {},
        )
        .unwrap()
    };
    let decision = of(Hold::Switching);
    assert_eq!(decision.clock, None);
    assert!(
        decision
            .plans
            .iter()
            .all(|p| p.by_view.iter().all(|v| v.time_ms.is_none()))
    );
    let [held] = &decision.policy.0[..] else {
        panic!("{:?}", decision.policy)
    };
    let Rule::Switch(switch) = held.rule else {
        panic!("{:?}", decision.policy)
    };
    assert_eq!((switch.below, switch.above), (0, 1));
    assert!(1.0 < switch.off && switch.off < switch.on && switch.on < 8.0);
    // It loses front to back: held to one plan, it is the original.
    assert_eq!(of(Hold::One).policy.plans(), [0]);
}

#[test]
fn a_prepass_has_the_draws_that_hide_most() {
    for direction in [DepthDirection::Forward, DepthDirection::Reversed] {
        // The last plane is the nearest, and hides all others.
        let mut scene = with_depth(planes([32, 32], 5), DepthFormat::Depth32float, direction);
        scene.orders = vec![DrawOrder::AsGiven];
        scene.draws.reverse();
        let measured = |scene: &Scene| {
            let session = Session::new(gpu(), scene, ShaderForm::Text).unwrap();
            let frame = &scene.cameras[0].frames[0];
            session.inputs().set_frame(frame).unwrap();
            let layers = Layers::draw(&session, frame, &Facts::default()).unwrap();
            let choices = weighed(scene, &[partial_prepass::RECIPE]);
            let plans = with(&choices, partial_prepass::RECIPE).plans(&choices);
            let timing = settings(&Model::nominal(), Timed::Yes).timing;
            partial_prepass::measured(
                &session,
                frame,
                (&layers, &plans),
                &Facts::default(),
                &timing,
            )
            .unwrap()
        };
        let found = measured(&scene).unwrap();
        assert_eq!(
            (found.draws, found.of, found.changed_pixels),
            (vec![4], 5, 0)
        );
        // In front of everything else, nothing is shaded in vain.
        scene.draws.reverse();
        assert_eq!(measured(&scene), None);
        // A single draw is no part of the draws.
        scene.draws.truncate(1);
        assert_eq!(measured(&scene), None);
    }
}

#[test]
fn draws_are_sorted_by_what_they_hide() {
    for direction in [DepthDirection::Forward, DepthDirection::Reversed] {
        // The first plane is the nearest.
        let mut scene = with_depth(planes([32, 32], 5), DepthFormat::Depth32float, direction);
        scene.orders = vec![DrawOrder::AsGiven];
        let sorted = |scene: &Scene| {
            let session = Session::new(gpu(), scene, ShaderForm::Text).unwrap();
            let frame = &scene.cameras[0].frames[0];
            session.inputs().set_frame(frame).unwrap();
            let timing = settings(&Model::nominal(), Timed::Yes).timing;
            let layers = Layers::draw(&session, frame, &Facts::default()).unwrap();
            sorting::measured(&session, frame, &layers, &timing).unwrap()
        };
        assert_eq!(sorted(&scene), None);
        scene.draws.reverse();
        let found = sorted(&scene).unwrap();
        assert_eq!(
            (found.draws, found.changed_pixels),
            (vec![4, 3, 2, 1, 0], 0)
        );
        assert_eq!(found.moved.len(), 4);
        // Nothing moves past what is drawn without a test.
        let mut sky = scene.materials[0].clone();
        sky.name = "sky".to_owned();
        sky.state.depth_compare = Some(CompareFunction::Always);
        scene.materials.push(sky);
        scene.draws[2].material = 1;
        let found = sorted(&scene).unwrap();
        assert_eq!(
            (found.draws, found.changed_pixels),
            (vec![1, 0, 2, 4, 3], 0)
        );
        // Masked channels stay as they were, unless only some of the draws write them.
        let masked = |write_mask| {
            let target = ColorTarget::opaque("rgba8unorm");
            vec![Some(ColorTarget {
                write_mask,
                ..target
            })]
        };
        let mut pair = scene.clone();
        pair.materials[1] = pair.materials[0].clone();
        pair.materials[1].name = "other".to_owned();
        pair.materials[0].state.targets = masked(0b0111);
        pair.materials[1].state.targets = masked(0b0111);
        let found = sorted(&pair).unwrap();
        let whole = (vec![4, 3, 2, 1, 0], 0);
        assert_eq!((found.draws, found.changed_pixels), whole);
        pair.materials[1].state.targets = masked(0b0110);
        let found = sorted(&pair).unwrap();
        let apart = (vec![1, 0, 2, 4, 3], 0);
        assert_eq!((found.draws, found.changed_pixels), apart);
    }
}
