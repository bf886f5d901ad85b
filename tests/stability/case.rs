//! What a case is, and how it is drawn and judged.

use std::collections::BTreeMap;
use std::ops::ControlFlow;

use preshade_compiler::recipe::Recipe;
use preshade_draw::render::{FrameSettings, Prepared, Rendered, SceneInputs, Variant as Host};
use preshade_draw::scene::{DrawOrder, Scene};
use preshade_lab::measure::verdict::breaks;
use preshade_lab::measure::{self, Counter, ErrorLadder, Session};
use preshade_plan::contract::{Assumption, Contract};
use preshade_plan::pass::Facts;
use preshade_plan::plan::{Plan, Role};
use preshade_plan::state::{DepthDirection, DepthFormat};
use preshade_scenes::ShaderForm;
use serde::{Deserialize, Serialize};

use super::mutate::{Moved, Mutation, Plain, judged, moved, seen};
use super::render_support::gpu;
use super::root;

/// One hard case.
pub struct Case {
    pub name: &'static str,
    /// The file in `fixtures/scenes/stability`, without its ending.
    pub scene: &'static str,
    /// The failure it guards against.
    pub guards: &'static str,
    /// Depth set-ups to draw it under.
    pub setups: &'static [Setup],
    /// Why it is drawn in no others, of [`ALL`] or of [`SAMPLED`]; empty where it is drawn in all
    /// of either.
    pub only: &'static str,
    /// What is drawn, and what becomes of it.
    pub recipes: &'static [(&'static str, Expect)],
    /// The guard taken away, in words, and how.
    pub mutation: (&'static str, Mutation),
}

impl Case {
    /// Of all that says what is drawn and how it is mutated, and of the scene's files: figures of
    /// another case are told apart by it.
    pub fn hash(&self) -> String {
        let folder = root().join("fixtures/scenes/stability");
        let read = |name: &str| std::fs::read_to_string(folder.join(name)).unwrap_or_default();
        let scene = read(&format!("{}.toml", self.scene));
        let setups: Vec<String> = self.setups.iter().map(ToString::to_string).collect();
        let (words, mutation) = &self.mutation;
        let mut all = format!(
            "{scene} {setups:?} {:?} {words} {}",
            self.recipes,
            mutation.words()
        );
        // Shaders are named by the scene and by the mutation.
        let names = all.split('"').map(str::to_owned);
        let is_shader = |name: &String| {
            [".wgsl", ".vert", ".frag"]
                .iter()
                .any(|e| name.ends_with(e))
                && !name.contains('\n')
        };
        for name in names.filter(is_shader).collect::<Vec<_>>() {
            all.push_str(&read(&name));
        }
        blake3::hash(all.as_bytes()).to_hex()[..16].to_owned()
    }
}

/// What a recipe does on a case's scene.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Expect {
    /// Some material takes it, and its contract holds.
    Holds,
    /// That, and it shades at most so many fragments a covered pixel.
    Shades(f64),
    /// That, or some materials refuse it for ties that were measured: which depths tie depends on
    /// the format and the adapter.
    Untied,
    /// That, or some materials refuse it for surfaces that were measured to lie on the near plane:
    /// what becomes of triangles of no area is the adapter's own.
    OffNearPlane,
    /// [`Expect::Holds`], also where the pre-pass computes its depth so many neighbouring floats
    /// apart, either way.
    Withstands(i32),
    /// It is refused by every material, under this code.
    Refused(&'static str),
}

/// A depth attachment.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Setup {
    pub format: DepthFormat,
    pub direction: DepthDirection,
    pub samples: u32,
}

pub const fn setup(format: DepthFormat, direction: DepthDirection, samples: u32) -> Setup {
    Setup {
        format,
        direction,
        samples,
    }
}

use DepthDirection::{Forward, Reversed};
use DepthFormat::{Depth16unorm, Depth24plus, Depth32float};

/// Both directions in the format that tells most depths apart.
pub const DIRECTIONS: &[Setup] = &[
    setup(Depth32float, Forward, 1),
    setup(Depth32float, Reversed, 1),
];
/// Of a case whose depths are those that its vertex stage gives, and to whose colours they are
/// nothing.
pub const COLORS: &str = "it is about colours alone";
/// Every format in every direction.
pub const ALL: &[Setup] = &[
    setup(Depth32float, Forward, 1),
    setup(Depth32float, Reversed, 1),
    setup(Depth24plus, Forward, 1),
    setup(Depth24plus, Reversed, 1),
    setup(Depth16unorm, Forward, 1),
    setup(Depth16unorm, Reversed, 1),
];
/// The same with four samples a pixel.
pub const SAMPLED: &[Setup] = &[
    setup(Depth32float, Forward, 4),
    setup(Depth32float, Reversed, 4),
    setup(Depth24plus, Forward, 4),
    setup(Depth24plus, Reversed, 4),
    setup(Depth16unorm, Forward, 4),
    setup(Depth16unorm, Reversed, 4),
];

impl std::fmt::Display for Setup {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let word = |v: serde_json::Value| v.as_str().unwrap_or_default().to_owned();
        let format = word(serde_json::to_value(self.format).unwrap());
        let direction = word(serde_json::to_value(self.direction).unwrap());
        write!(f, "{format} {direction}")?;
        match self.samples {
            1 => Ok(()),
            n => write!(f, " x{n}"),
        }
    }
}

/// One drawing of a case.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Run {
    pub setup: String,
    pub recipe: String,
    /// `exact`, `rounding` or what is promised; of a refusal its code.
    pub contract: String,
    /// `holds`, `refused`, or what is wrong.
    pub result: String,
    pub changed_pixels: u64,
    /// `None`: it has no bound.
    pub max_abs: Option<f64>,
}

/// What taking the guard away did.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case")]
pub enum Red {
    /// The judge found it.
    Seen { how: String },
    /// It did not.
    Unseen,
    /// This adapter has nothing for the guard to guard against.
    NotHere { why: String },
}

/// Why there is no guard to take away where what has it is not drawn.
pub const REFUSED: &str = "it is refused";

/// What drawing a case said.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Outcome {
    pub name: String,
    /// [`Case::hash`] of the case that was drawn; empty in files of before it was kept.
    #[serde(default)]
    pub case: String,
    pub runs: Vec<Run>,
    /// The least that was seen in any set-up.
    pub mutated: Red,
    /// In how many set-ups it was seen that the guard was gone; 1 in files of before all were
    /// tried.
    #[serde(default = "one")]
    pub mutations: usize,
}

fn one() -> usize {
    1
}

impl Outcome {
    pub fn wrong(&self) -> Vec<String> {
        let runs = self.runs.iter().filter(|r| !r.is_right());
        let mut wrong: Vec<String> = runs
            .map(|r| format!("{}: {}: {}: {}", self.name, r.setup, r.recipe, r.result))
            .collect();
        match &self.mutated {
            Red::Seen { .. } => {}
            Red::Unseen => wrong.push(format!("{}: without its guard nothing breaks", self.name)),
            Red::NotHere { why } if why == REFUSED => wrong.push(format!(
                "{}: what its guard is taken from is refused in every set-up",
                self.name
            )),
            Red::NotHere { .. } => {}
        }
        wrong
    }
}

impl Run {
    pub fn is_right(&self) -> bool {
        ["holds", "refused", UNMET].contains(&&*self.result)
    }
}

/// A scene, ready to be drawn.
pub struct Stage<'a> {
    pub inputs: &'a SceneInputs<'a>,
    pub originals: Vec<Plan>,
    pub reference: Vec<Rendered>,
    /// What `verify` would know of the scene.
    pub facts: Facts,
}

/// The scene of a case, small.
pub fn load(name: &str) -> Scene {
    let path = root().join(format!("fixtures/scenes/stability/{name}.toml"));
    let mut scene = preshade_scenes::load(&path).unwrap_or_else(|e| panic!("{}", e.render()));
    if scene.size[0] > 200 {
        scene = scene.resized([163, 91]);
    }
    for camera in &mut scene.cameras {
        camera.frames.truncate(1);
    }
    scene
}

fn under(scene: &Scene, setup: Setup) -> Scene {
    let scene = scene.clone().with_depth(setup.format, setup.direction);
    match setup.samples {
        1 => scene,
        n => scene.with_samples(n),
    }
}

/// Orders that hide nothing from the test: what is nearest drawn last, and as the file says.
const ORDERS: [DrawOrder; 2] = [DrawOrder::BackToFront, DrawOrder::AsGiven];

impl<'a> Stage<'a> {
    pub fn new(inputs: &'a SceneInputs<'a>) -> Self {
        let originals = measure::originals(inputs.scene());
        let host = preshade_scenes::variant(&originals, ShaderForm::Text).unwrap();
        let reference = pictures(inputs, &host).unwrap();
        let scene = inputs.scene();
        let facts = measure::facts(&Session::new(gpu(), scene, ShaderForm::Text).unwrap()).unwrap();
        Self {
            inputs,
            originals,
            reference,
            facts,
        }
    }

    /// What `verify` would make of a recipe.
    pub fn chosen(&self, recipe: &str) -> measure::Variant {
        let recipe = Recipe::parse_list(recipe).unwrap();
        if !measure::leaves_a_choice(&recipe) {
            return measure::variant(&self.originals, &recipe, &self.facts);
        }
        let session = Session::new(gpu(), self.inputs.scene(), ShaderForm::Text).unwrap();
        let mut facts = self.facts.clone();
        let detail = measure::Detail::Choice;
        let found =
            measure::frequencies(&session, &facts, detail, &mut |_| ControlFlow::Continue(()));
        facts.frequencies = found.unwrap();
        match measure::within_budget(&session, &recipe, &facts).unwrap() {
            Ok(chosen) => measure::variant(&self.originals, &chosen, &facts),
            Err(why) => measure::refused(&self.originals, &recipe, &why),
        }
    }

    /// Whether a recipe's promise is about an original whose position is marked `@invariant`.
    fn rests_on_marks(&self, recipe: &str) -> bool {
        let recipe = Recipe::parse_list(recipe).unwrap();
        let variant = measure::variant(&self.originals, &recipe, &self.facts);
        contract(&variant.plans)
            .given()
            .contains(&Assumption::InvariantOriginal)
    }

    /// The worst difference of `host`'s pictures, or why there are none.
    pub fn compare(&self, host: &Host) -> Result<ErrorLadder, String> {
        let drawn = pictures(self.inputs, host)?;
        let errors = self.reference.iter().zip(&drawn);
        Ok(errors
            .map(|(a, b)| measure::compare(a, b).unwrap())
            .fold(ErrorLadder::default(), |a, b| a.worst(&b)))
    }

    /// Fragments shaded a covered pixel, farthest drawn first.
    pub fn shaded(&self, plans: &[Plan]) -> f64 {
        let mut counter =
            Counter::shaded(self.inputs, plans, ShaderForm::Text, measure::counting).unwrap();
        let (_, frame) = self.inputs.scene().frames().next().unwrap();
        self.inputs.set_frame(frame).unwrap();
        let counted = counter.count(frame, DrawOrder::BackToFront).unwrap();
        counted.summary().per_pixel
    }
}

pub fn pictures(inputs: &SceneInputs<'_>, host: &Host) -> Result<Vec<Rendered>, String> {
    let scene = inputs.scene();
    let mut prepared =
        Prepared::new(inputs, host, &FrameSettings::of(scene)).map_err(|e| e.to_string())?;
    let mut pictures = Vec::new();
    for (_, frame) in scene.frames() {
        inputs.set_frame(frame).map_err(|e| e.to_string())?;
        for order in ORDERS {
            prepared.aim(frame, order);
            pictures.push(prepared.render().map_err(|e| e.to_string())?);
        }
    }
    Ok(pictures)
}

/// What older figures say of a contract that broke where what it names as assumed was not so.
pub const UNMET: &str = "assumption unmet";

/// What all plans together promise.
pub fn contract(plans: &[Plan]) -> Contract {
    plans
        .iter()
        .fold(Contract::exact(), |c, p| c.and(p.contract.clone()))
}

fn draw(stage: &Stage<'_>, setup: Setup, recipe: &str, expect: Expect) -> Run {
    let variant = stage.chosen(recipe);
    let mut run = Run {
        setup: setup.to_string(),
        recipe: recipe.to_owned(),
        contract: String::new(),
        result: "holds".to_owned(),
        changed_pixels: 0,
        max_abs: Some(0.0),
    };
    let kept: Vec<&str> = variant.kept.iter().map(|k| k.why.as_str()).collect();
    let all_kept = variant.is_refused();
    if let Expect::Refused(code) = expect {
        run.contract = code.to_owned();
        run.result = match all_kept && kept.iter().all(|why| why.contains(&format!("[{code}]"))) {
            true => "refused".to_owned(),
            false => format!("it is not refused with {code}: {kept:?}"),
        };
        return run;
    }
    let measured = match expect {
        Expect::Untied => Some("depth-ties"),
        Expect::OffNearPlane => Some("near-plane"),
        _ => None,
    };
    let refused_for = |code: &&str| kept.iter().all(|why| why.contains(&format!("[{code}]")));
    if let Some(code) = measured.filter(|code| all_kept && refused_for(code)) {
        run.contract = code.to_owned();
        run.result = "refused".to_owned();
        return run;
    }
    if all_kept {
        run.result = format!("it is refused: {}", kept.join("; "));
        return run;
    }
    let contract = contract(&variant.plans);
    run.contract = contract.kind().to_owned();
    let host = preshade_scenes::variant(&variant.plans, ShaderForm::Text).unwrap();
    match stage.compare(&host) {
        Err(e) => run.result = e,
        Ok(error) => {
            run.changed_pixels = error.changed_pixels;
            run.max_abs = Some(error.max_abs).filter(|m| m.is_finite());
            if let Some(how) = breaks(&contract, &error) {
                run.result = how;
            }
        }
    }
    if let (Expect::Withstands(steps), "holds") = (expect, &*run.result) {
        for steps in [steps, -steps] {
            let mut plans = variant.plans.clone();
            moved(&mut plans, Role::Prepass, Moved::Depth(steps));
            if let Red::Seen { how } = judged(stage, &plans, &contract) {
                run.result = format!("with the pre-pass {steps} floats away: {how}");
            }
        }
    }
    if let (Expect::Shades(most), "holds") = (expect, &*run.result) {
        let shaded = stage.shaded(&variant.plans);
        if shaded > most {
            run.result = format!("it shades {shaded:.2} fragments a pixel, not {most:.2}");
        }
    }
    run
}

/// Draws a case under all its set-ups, and once without its guard. A panic is what is wrong with
/// that case alone.
pub fn run(case: &Case) -> Outcome {
    std::panic::catch_unwind(|| drawn(case)).unwrap_or_else(|panic| {
        let text = panic.downcast_ref::<String>().cloned();
        let text = text.or_else(|| panic.downcast_ref::<&str>().map(|s| (*s).to_owned()));
        Outcome {
            name: case.name.to_owned(),
            case: case.hash(),
            runs: vec![Run {
                setup: String::new(),
                recipe: String::new(),
                contract: String::new(),
                result: text.unwrap_or_else(|| "it panicked".to_owned()),
                changed_pixels: 0,
                max_abs: None,
            }],
            mutated: Red::Unseen,
            mutations: 0,
        }
    })
}

fn drawn(case: &Case) -> Outcome {
    let scene = load(case.scene);
    let mut runs = Vec::new();
    let mut mutated: Vec<(Setup, Red)> = Vec::new();
    for setup in case.setups {
        let scene = under(&scene, *setup);
        let inputs = SceneInputs::new(gpu(), &scene).unwrap();
        let stage = Stage::new(&inputs);
        assert!(
            stage.reference.iter().all(is_drawn),
            "{} draws nothing",
            case.name
        );
        // What promises to equal an original with `@invariant` positions is held against that, as
        // `verify --invariant` does.
        let marked = scene.clone().with_invariant_positions();
        let marked = SceneInputs::new(gpu(), &marked).unwrap();
        let mut on_marked: Option<Stage<'_>> = None;
        for (recipe, expect) in case.recipes {
            let stage = match stage.rests_on_marks(recipe) {
                true => on_marked.get_or_insert_with(|| Stage::new(&marked)),
                false => &stage,
            };
            runs.push(draw(stage, *setup, recipe, *expect));
        }
        mutated.push((*setup, red(case, &stage)));
    }
    // What the adapter may refuse in one set-up or another proves nothing where it does in all.
    for (recipe, expect) in case.recipes {
        let mut of_recipe = runs.iter().filter(|r| r.recipe == *recipe);
        if !matches!(expect, Expect::Refused(_)) && of_recipe.all(|r| r.result == "refused") {
            runs.push(Run {
                setup: "all set-ups".to_owned(),
                recipe: (*recipe).to_owned(),
                contract: String::new(),
                result: "it is refused in each".to_owned(),
                changed_pixels: 0,
                max_abs: None,
            });
        }
    }
    for (setup, red) in &mutated {
        if *red == Red::Unseen {
            eprintln!("{}: {setup}: without its guard nothing breaks", case.name);
        }
    }
    // What is not seen in one set-up is not seen; of those that are the first is told.
    let first = |wanted: fn(&Red) -> bool| mutated.iter().position(|(_, red)| wanted(red));
    let unseen = first(|red| *red == Red::Unseen);
    let seen = first(|red| matches!(red, Red::Seen { .. }));
    let is_seen = |(_, red): &&(Setup, Red)| matches!(red, Red::Seen { .. });
    let mutations = mutated.iter().filter(is_seen).count();
    let told = unseen.or(seen).unwrap_or(0);
    Outcome {
        name: case.name.to_owned(),
        case: case.hash(),
        runs,
        mutated: mutated.swap_remove(told).1,
        mutations,
    }
}

/// What taking the guard away does, where what is mutated holds as it is: else the judge would see
/// that.
fn red(case: &Case, stage: &Stage<'_>) -> Red {
    match case.mutation.1.plain(stage) {
        Plain::Original => {}
        Plain::Refused => {
            return Red::NotHere {
                why: REFUSED.to_owned(),
            };
        }
        Plain::Drawn(host, contract) => {
            if let Red::Seen { how } = seen(stage, &host, &contract) {
                panic!("{}: broken with its guard: {how}", case.name);
            }
        }
    }
    case.mutation.1.red(stage)
}

/// Whether a picture is of more than one colour.
fn is_drawn(picture: &Rendered) -> bool {
    let mut colors: BTreeMap<&[u8], usize> = BTreeMap::new();
    for image in picture.colors.iter().flatten() {
        for texel in image.bytes.chunks(4) {
            *colors.entry(texel).or_default() += 1;
        }
    }
    colors.len() > 1
}
