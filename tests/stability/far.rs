//! A world far from the origin, handed over as it is and relative to the eye: how far both are from
//! the truth.
//!
//! The host of both keeps positions in `f64`. One rounds them to `f32` and multiplies its matrices
//! in `f32`; the other subtracts the eye first, and so hands over the position of each object
//! relative to it, a view without a translation, and lights relative to the eye. The shader is the
//! same: it takes differences of positions alone.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use glam::{DMat4, DVec3, Mat4, Vec3};
use preshade_compiler::recipe::Recipe;
use preshade_draw::render::SceneInputs;
use preshade_draw::scene::{Draw, Scene, Value};
use preshade_lab::measure;
use preshade_scenes::ShaderForm;

use super::case::{Red, Stage, load};
use super::reference::{Points, Spread, Truth, truth_beyond};
use super::render_support::gpu;

/// What the host hands over.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Form {
    /// Positions in the world.
    World,
    /// Positions relative to the eye.
    Relative,
}

/// How far the surfaces are from the origin, along x and z.
pub const DISTANCES: [f64; 6] = [0.0, 1e3, 1e4, 1e5, 1e6, 1e7];

/// A scene, and what its host knew of it in `f64`.
struct Moved {
    scene: Scene,
    /// World to clip, and the eye, as handed over but for the rounding.
    view_proj: DMat4,
    eye: DVec3,
    /// What is taken off all positions, and added.
    by: DVec3,
    base: Scene,
}

fn doubles(m: &Mat4) -> DMat4 {
    DMat4::from_cols_array(&m.to_cols_array().map(f64::from))
}

fn singles(m: &DMat4) -> Mat4 {
    Mat4::from_cols_array(&m.to_cols_array().map(|x| x as f32))
}

fn single(v: DVec3) -> Vec3 {
    v.as_vec3()
}

const LAMP: &str = "object.lamp";

/// Where the lamp is in the file.
fn lamp(scene: &Scene) -> DVec3 {
    let Some(Value::Numbers(numbers)) = scene.materials[0].values.get(LAMP) else {
        panic!("the lamp has a place");
    };
    DVec3::from_slice(numbers)
}

impl Moved {
    /// A scene's surfaces, lamp and eye moved by `distance`.
    fn new(base: &Scene, distance: f64, form: Form) -> Self {
        let frame = base.cameras[0].frames[0];
        let away = DVec3::new(distance, 0.0, distance);
        let eye = frame.eye.as_dvec3();
        let by = match form {
            Form::World => away,
            Form::Relative => -eye,
        };
        let turn = DMat4::from_mat3(glam::DMat3::from_mat4(doubles(&frame.view)));
        let mut moved = Self {
            scene: base.clone(),
            view_proj: doubles(&frame.projection) * turn * DMat4::from_translation(-(eye + by)),
            eye: eye + by,
            by,
            base: base.clone(),
        };
        for (draw, of) in moved.scene.draws.iter_mut().zip(&base.draws) {
            draw.transform = singles(&(DMat4::from_translation(by) * doubles(&of.transform)));
        }
        let numbers = (lamp(base) + by).to_array().to_vec();
        for material in &mut moved.scene.materials {
            let numbers = Value::Numbers(numbers.clone());
            material.values.insert(LAMP.to_owned(), numbers);
        }
        moved.scene.cameras.truncate(1);
        let camera = &mut moved.scene.cameras[0];
        camera.frames.truncate(1);
        camera.frames[0].eye = single(moved.eye);
        camera.frames[0].view = singles(&turn) * Mat4::from_translation(-single(moved.eye));
        moved
    }

    /// The numbers of the uniforms of `far.wgsl`, in the order of their declaration.
    fn exactly(&self, draw: &Draw) -> BTreeMap<(u32, u32), Vec<f64>> {
        let at = self.scene.draws.iter().position(|d| d.name == draw.name);
        let of = &self.base.draws[at.unwrap()];
        let model = DMat4::from_translation(self.by) * doubles(&of.transform);
        let Some(Value::Numbers(tint)) = draw.values.get("object.tint") else {
            panic!("each draw has a tint");
        };
        let tint = tint.iter().map(|x| f64::from(*x as f32));
        let mut camera = self.view_proj.to_cols_array().to_vec();
        camera.extend(self.eye.to_array());
        let mut object = model.to_cols_array().to_vec();
        object.extend(tint);
        object.extend((lamp(&self.base) + self.by).to_array());
        BTreeMap::from([((0, 0), camera), ((1, 0), object)])
    }

    fn truth(&self, recipe: &str) -> Truth {
        let originals = measure::originals(&self.scene);
        let facts = measure::known(&self.scene);
        let recipe = Recipe::parse_list(recipe).unwrap();
        let variant = recipe.apply(&originals[0], &facts).unwrap();
        let points = Points {
            count: 500,
            seed: 3,
        };
        let exactly = |draw: &Draw| self.exactly(draw);
        let mut told =
            truth_beyond(&self.scene, 0, &originals[0], &variant, points, &exactly).unwrap();
        told.remove(0)
    }
}

/// The scene in the size that pixels are told of.
fn base() -> Scene {
    let mut scene = load("far");
    scene.size = [1920, 1080];
    let names = (0..).map(|n| format!("draw {n}"));
    for (draw, name) in scene.draws.iter_mut().zip(names) {
        draw.name = name;
    }
    scene
}

pub const HOISTED: &str = "hoist:budget=0.05,finite=assumed,jumps=carried";

/// The table of `docs/results/stability.md`.
pub fn table() -> String {
    let mut out = "| from the origin | positions | corners, pixels of 1920x1080 | original, steps \
                   | hoisted, steps |\n|--:|---|--:|--:|--:|\n"
        .to_owned();
    let base = base();
    for distance in DISTANCES {
        for form in [Form::World, Form::Relative] {
            let truth = Moved::new(&base, distance, form).truth(HOISTED);
            let form = match form {
                Form::World => "in the world",
                Form::Relative => "relative to the eye",
            };
            let _ = writeln!(
                out,
                "| {distance} | {form} | {} | {} | {} |",
                spread(truth.positions.original),
                spread(truth.original.steps),
                spread(truth.variant.steps)
            );
        }
    }
    out
}

/// Median, 99th percentile and largest, of one digit: what a C library computes otherwise does not
/// show.
fn spread(of: Spread) -> String {
    let digit = |n: f64| match n {
        0.0 => "0".to_owned(),
        n if (0.01..1e4).contains(&n) => {
            let unit = 10_f64.powf(n.log10().floor());
            let rounded = (n / unit).round() * unit;
            match unit < 1.0 {
                true => format!("{rounded:.2}"),
                false => format!("{rounded:.0}"),
            }
        }
        n => format!("{n:.0e}"),
    };
    [of.median, of.p99, of.max].map(digit).join(" / ")
}

#[test]
fn positions_relative_to_the_eye_are_as_exact_anywhere() {
    let base = base();
    let of = |distance, form| Moved::new(&base, distance, form).truth(HOISTED);
    let near = of(0.0, Form::World);
    let far = of(1e7, Form::World);
    let relative = of(1e7, Form::Relative);
    assert!(near.positions.original.p99 < 0.01, "{near:?}");
    assert!(far.positions.original.p99 > 10.0, "{far:?}");
    assert!(relative.positions.original.p99 < 0.01, "{relative:?}");
    assert!(relative.original.steps.p99 < 0.01, "{relative:?}");
    assert!(far.original.steps.p99 > 10.0, "{far:?}");
    // Hoisting moves no corner.
    assert_eq!(relative.positions.variant, relative.positions.original);
}

/// The same world at 10,000,000: relative to the eye it is the picture at the origin, but for
/// pixels at edges; in the world it is not.
pub fn jitters(stage: &Stage<'_>) -> Red {
    let base = stage.inputs.scene();
    let changed = |form| {
        let moved = Moved::new(base, 1e7, form).scene;
        let inputs = SceneInputs::new(gpu(), &moved).unwrap();
        let originals = measure::originals(&moved);
        let host = preshade_scenes::variant(&originals, ShaderForm::Text).unwrap();
        let pictures = super::case::pictures(&inputs, &host).unwrap();
        let compared = stage.reference.iter().zip(&pictures);
        let errors = compared.map(|(a, b)| measure::compare(a, b).unwrap());
        errors.map(|e| e.flip_mean).fold(0.0, f64::max)
    };
    let (world, relative) = (changed(Form::World), changed(Form::Relative));
    match relative < 0.002 && world > 0.05 {
        true => Red::Seen {
            how: format!("flip_mean {world:.3}; relative to the eye {relative:.4}"),
        },
        false => Red::Unseen,
    }
}
