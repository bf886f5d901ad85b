//! `preshade plan`: decides by measurement which recipe each material of a scene needs on an
//! adapter.

use std::path::{Path, PathBuf};
use std::time::Duration;

use preshade_compiler::command::explain::EffectUse;
use preshade_compiler::command::rewrite;
use preshade_compiler::emit;
use preshade_compiler::recipe::Recipe;
use preshade_draw::render::Gpu;
use preshade_draw::scene::{DrawOrder, Rows, Scene};
use preshade_lab::measure::{self, Session, TimingSettings, Variant, parse_seconds};
use preshade_lab::report;
use preshade_lab::report::html::plan::Redrawn;
use preshade_lab::search::plan as decide;
use preshade_lab::search::plan::regret::Choosing;
use preshade_lab::search::plan::{Decision, Hold, Model, SceneSoFar, Settings, Timed};
use preshade_passes::transforms::specialize;
use preshade_plan::budget::Budget;
use preshade_plan::pass::Facts;
use preshade_plan::plan::Plan;
use preshade_plan::plan_file::Target;
use preshade_scenes::ShaderForm;
use shader_text::files::File;
use shader_text::read_limited;

use crate::input::{self, FrameArgs, ShaderArgs};
use crate::limits::LimitArgs;
use crate::lock::{self, Locks};
use crate::materials::{self, Job};
use crate::output::{self, ProgressLine};
use crate::rewrite::check_name;
use crate::scenes::{KeptScenes, reopened};
use crate::verify::{OrderArg, check_budget, check_folder, parse_frames};
use crate::view::ViewArgs;
use crate::{Ending, Failure, Table, guesses, results, worker};

#[derive(clap::Args)]
#[command(after_help = "\
                        Examples:
  preshade plan scene.toml
  preshade plan scene.toml --camera wall --order front-to-back --out chosen/
  preshade plan scene.toml --budget flip_mean=0.02 --one
  preshade plan scene.toml --one --lock              kept in preshade.lock, for build scripts
  preshade plan scene.toml --model adapter.json      fitted once, read afterwards
  preshade plan scene.toml --time no                 predictions of a nominal model, no clock
  preshade plan scenes/ --out chosen/                a folder each
  preshade plan scenes/*.toml --exhaustive --out regret/
  preshade plan scenes/ --results results.json       over all adapters of `merge`, no GPU

A recipe is taken where it was measured to be faster than the original beyond noise, and by 1 % at
least; where none is, nothing is, and the reasons are told. docs/guides/plan.md says how. With \
    --out what is
measured is kept on the way, in plan.unfinished.json, until all of it is told. With --exhaustive it is
kept in outcomes/, and the same command goes on where it ended.
Of several scenes one that cannot be read or drawn is told, and the others are planned.
Exit status 1: a plan broke its contract (it is not taken); 2: an input failed.")]
pub struct PlanArgs {
    /// Scenes (.toml), captured frames, folders of them, or bare shaders: a WGSL file, or a vertex and a fragment file
    /// of one name. Of several each has a folder of its own below --out.
    #[arg(required = true, value_name = "SCENE", value_parser = input::given())]
    scenes: Vec<PathBuf>,
    /// Set a variable of the scene; may be given several times.
    #[arg(long = "set", value_name = "NAME=VALUE")]
    set: Vec<String>,
    #[command(flatten)]
    capture: FrameArgs,
    #[command(flatten)]
    pub limits: LimitArgs,
    #[command(flatten)]
    pub view: ViewArgs,
    /// Draw in these orders only.
    #[arg(long, value_name = "ORDER", value_enum)]
    order: Vec<OrderArg>,
    /// Weigh recipes that may differ by so much too: flip_mean, flip_p99, flip_tile or max_abs.
    #[arg(long, value_name = "METRIC=NUMBER", value_parser = Budget::parse)]
    pub budget: Option<Budget>,
    /// Hold to one plan: no switch between views.
    #[arg(long)]
    one: bool,
    /// Frames of each camera path to look at, evenly spaced.
    #[arg(long, value_name = "N", default_value_t = FRAMES, value_parser = parse_frames)]
    frames: usize,
    /// Plans to measure beside the original.
    #[arg(long, value_name = "N", default_value_t = 4, value_parser = parse_frames)]
    runners: usize,
    /// Whether to measure; without, the choice is a prediction, and is marked as one.
    #[arg(long, value_enum, default_value_t = TimeArg::Yes)]
    time: TimeArg,
    /// Seconds to spend on timing each view.
    #[arg(long, value_name = "SECONDS", default_value_t = SECONDS, value_parser = parse_seconds)]
    seconds: f64,
    /// Read the adapter's cost model from here; where there is no such file, fit one and write it.
    #[arg(long, value_name = "FILE")]
    model: Option<PathBuf>,
    /// Measure every candidate in every view of every scene, and tell what the choices regret.
    /// Every other scene is held out of the fit.
    #[arg(long)]
    pub exhaustive: bool,
    /// Draw nothing: choose the variant that holds everywhere and pays on most adapters of these merged
    /// results, and the best for each adapter alone.
    #[arg(long, value_name = "FILE", conflicts_with_all = MEASURES)]
    results: Option<PathBuf>,
    /// Part of an adapter's name, driver or backend.
    #[arg(long, value_name = "TEXT")]
    pub adapter: Option<String>,
    /// Folder for the chosen plans' shaders, a `plan.json` each, `decision.json`, `report.html` and
    /// `report.csv`; with --exhaustive for `regret.json` and `regret.csv`.
    #[arg(short, long, alias = "output", value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Keep the choice in `preshade.lock` beside each material's shader: build scripts obey it. Of
    /// a policy with a switch, the plan below it.
    #[arg(long)]
    pub lock: bool,
    /// With --exhaustive, scenes at once; default: one for each card. While one times, the others compile
    /// and compare.
    #[arg(long, value_name = "N", requires = "exhaustive", value_parser = clap::value_parser!(u16).range(1..))]
    pub workers: Option<u16>,
    /// With --exhaustive, read the frames that the cost model is fitted to from here, or measure and write them.
    #[arg(long, value_name = "FILE", hide = true, requires = "exhaustive")]
    pub probes: Option<PathBuf>,
    /// Output form.
    #[arg(long, value_enum, default_value_t = Table::Human)]
    pub format: Table,
    /// The flags in effect, as words.
    #[arg(skip)]
    pub flags: Vec<String>,
}

/// Flags that choose the measurements, or the part of the result to write.
const MEASURES: [&str; 15] = [
    "adapter",
    "budget",
    "camera",
    "exhaustive",
    "frames",
    "lock",
    "model",
    "one",
    "order",
    "runners",
    "seconds",
    "set",
    "size",
    "time",
    "workers",
];

/// Frames of a camera path, by default.
pub const FRAMES: usize = 3;

/// Seconds for each view, by default.
pub const SECONDS: f64 = 1.0;

impl PlanArgs {
    fn hold(&self) -> Hold {
        match self.one || self.lock {
            true => Hold::One,
            false => Hold::Switching,
        }
    }

    /// The files that it reads.
    pub fn reads(&self) -> Vec<PathBuf> {
        let jobs = self.jobs().unwrap_or_default();
        let below = jobs.iter().flat_map(|job| job.shader.reads());
        let scenes = self.scenes.iter().chain(&self.results).cloned();
        scenes.chain(below).collect()
    }

    fn jobs(&self) -> Result<Vec<Job>, Failure> {
        materials::drawn(ShaderArgs {
            files: self.scenes.clone(),
            set: self.set.clone(),
            capture: self.capture.clone(),
            limits: self.limits.clone(),
            replay_on: self.adapter.clone(),
            ..ShaderArgs::default()
        })
    }

    /// The scenes and the bare shaders with their paths, each with a folder of its own below `--out`.
    pub fn inputs(&self) -> Result<(Vec<Job>, Vec<PathBuf>), Failure> {
        let jobs = self.jobs()?;
        let scenes: Vec<PathBuf> = jobs.iter().map(path_of).collect();
        if let Some(out) = &self.out {
            check_folder(out)?;
            materials::told_apart(&scenes)?;
        }
        Ok((jobs, scenes))
    }

    pub fn is_timed(&self) -> bool {
        self.time == TimeArg::Yes
    }

    /// The folders that it finds scenes in.
    pub fn folders(&self) -> Vec<PathBuf> {
        self.scenes.iter().filter(|s| s.is_dir()).cloned().collect()
    }
}

#[derive(Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum TimeArg {
    /// Predictions only.
    No,
    /// Everything the choice depends on.
    Yes,
}

/// Plans a scene, or several.
pub fn run(args: &PlanArgs) -> Result<Ending, Failure> {
    let (jobs, scenes) = args.inputs()?;
    if let Some(file) = &args.results {
        let to = results::To {
            format: args.format,
            out: args.out.as_deref(),
        };
        return results::plan(file, &jobs, &to);
    }
    if scenes.len() > 1 && args.format != Table::Human {
        return Err(Failure(
            "error: --format json and csv are of one scene; of several --out keeps one each"
                .to_owned(),
        ));
    }
    if args.lock && scenes.len() > 1 {
        return Err(Failure(
            "error: --lock keeps one choice beside each material's shader, which scenes that share \
             it would overwrite: plan them one after the other".to_owned(),
        ));
    }
    if args.lock && !args.is_timed() {
        return Err(Failure(
            "error: a prediction is not kept: --lock goes without --time no".to_owned(),
        ));
    }
    let bar = output::bar();
    // Scenes that cannot be read are reported before anything is drawn. The others are planned.
    let read = |job: &Job| {
        let scene = scene(args, &job.shader)?;
        let mut written = scene.materials.iter().filter(|_| args.out.is_some());
        written.try_for_each(|m| check_name(&m.name))?;
        Ok(scene)
    };
    let mut loaded: Vec<Loaded<'_>> = scenes
        .iter()
        .zip(&jobs)
        .map(|(path, job)| Loaded {
            path,
            shader: &job.shader,
            scene: read(job),
        })
        .collect();
    if let [
        Loaded {
            scene: Err(Failure(why)),
            ..
        },
    ] = &mut loaded[..]
    {
        return Err(Failure(std::mem::take(why)));
    }
    let gpu = open(args)?;
    let names = scenes.iter().map(|path| path.display().to_string());
    let kept = KeptScenes::new(args.out.as_deref(), &gpu, names.collect());
    each(args, loaded, gpu, kept, &bar)
}

/// Opens the adapter of `--adapter`.
pub fn open(args: &PlanArgs) -> Result<Gpu, Failure> {
    worker::open(args.adapter.as_deref(), &args.limits.limits())
}

/// The path that stands for a scene or a bare shader: its first file.
pub fn path_of(job: &Job) -> PathBuf {
    job.shader.files.first().cloned().unwrap_or_default()
}

/// A scene, or why it was not read.
struct Loaded<'a> {
    path: &'a PathBuf,
    shader: &'a ShaderArgs,
    scene: Result<Scene, Failure>,
}

/// Plans each scene, of those that could be read.
fn each(
    args: &PlanArgs,
    scenes: Vec<Loaded<'_>>,
    mut gpu: Gpu,
    mut kept: KeptScenes,
    bar: &ProgressLine,
) -> Result<Ending, Failure> {
    let model = match args.time {
        TimeArg::No if args.model.is_none() => Model::nominal(),
        _ => model(args, &gpu, bar)?.0,
    };
    let (mut outcome, count) = (Ending::Fine, scenes.len());
    for Loaded {
        path,
        shader,
        scene,
    } in scenes
    {
        bar.reset();
        let name = path.display().to_string();
        let out = match (&args.out, count) {
            (Some(out), 2..) => Some(materials::folder_of(out, path)),
            (out, _) => out.clone(),
        };
        let planned = scene.and_then(|scene| {
            let mut keep = |so_far: &SceneSoFar| kept.keep(&name, so_far);
            let on = (&gpu, &model);
            one(args, (shader, scene), out.as_deref(), on, bar, &mut keep)
        });
        match planned {
            Ok(Ending::Fine | Ending::NotMeasured) => {}
            Ok(Ending::ContractBroken) => outcome = Ending::ContractBroken,
            Err(failure) if count == 1 => return Err(kept.named(failure)),
            Err(failure) => {
                bar.suspend(|| kept.fail(&name, failure));
                reopened(&mut gpu, || open(args))?;
            }
        }
    }
    kept.end()?;
    Ok(outcome)
}

fn one(
    args: &PlanArgs,
    (shader, scene): (&ShaderArgs, Scene),
    out: Option<&Path>,
    (gpu, model): (&Gpu, &Model),
    bar: &ProgressLine,
    keep: &mut dyn FnMut(&SceneSoFar),
) -> Result<Ending, Failure> {
    let locks = match args.lock {
        true => Some(Locks::read(&scene)?),
        false => None,
    };
    guesses::tell(&scene);
    let effects = measure::effects(&scene).unwrap_or_default();
    let scene = grouped(args, scene)?;
    let settings = settings(args, model);
    let session = Session::new(gpu, &scene, ShaderForm::Text)?;
    let (recipes, facts) = prepare(args, &session, bar)?;
    let recipes = writable(recipes, shader.target(), (&session, &facts));
    let decision = decide::decide(&session, &recipes, &facts, &settings, &mut |p| {
        bar.set_position((p.done * 1000.0) as u64);
        bar.set_message(p.what);
        p.so_far.into_iter().for_each(&mut *keep);
    })?;
    bar.finish_and_clear();
    let planned = Planned {
        shader,
        session: &session,
        facts: &facts,
        decision: &decision,
    };
    for variant in planned.variants()? {
        for removed in variant.plans.iter().filter_map(rewrite::removed_discard) {
            output::message(&removed);
        }
    }
    let forms = output::Answer {
        table: report::decision::render(&decision),
        json: decision.to_json()?,
        csv: report::csv::decision(&decision),
    };
    forms.tell(args.format, out, |dir| {
        let page = planned.page(&effects)?;
        planned.write(dir, &forms, page)
    })?;
    if let Some(locks) = locks {
        lock::keep(&scene, &facts, &decision, locks)?;
    }
    Ok(Ending::of(decision.is_broken(), false))
}

pub fn choosing(args: &PlanArgs) -> Choosing {
    Choosing {
        runners: args.runners,
        hold: args.hold(),
    }
}

pub fn settings<'a>(args: &PlanArgs, model: &'a Model) -> Settings<'a> {
    Settings {
        timed: match args.time {
            TimeArg::No => Timed::No,
            TimeArg::Yes => Timed::Yes,
        },
        timing: TimingSettings {
            budget: Duration::from_secs_f64(args.seconds),
            min_samples: if args.exhaustive { 16 } else { 8 },
            submission: Duration::from_millis(if args.exhaustive { 5 } else { 10 }),
            ..TimingSettings::default()
        },
        frames_per_camera: args.frames,
        runners: args.runners,
        refinements: 6,
        hold: args.hold(),
        model,
        command: crate::verify::command(),
    }
}

/// The cost model: read from a file, or fitted to the built-in probes and then written if
/// requested.
pub fn model(
    args: &PlanArgs,
    gpu: &Gpu,
    bar: &ProgressLine,
) -> Result<(Model, Vec<decide::model::Observation>), Failure> {
    let told =
        |path: &Path, e: &dyn std::fmt::Display| Failure(format!("error: {}: {e}", path.display()));
    if let Some(path) = args.model.as_deref().filter(|p| p.exists()) {
        let text = read_limited::text(path, &args.limits.limits(), "file-bytes")
            .map_err(|e| Failure::unread(path, &e))?;
        let model = Model::from_json(&text).map_err(|e| told(path, &e))?;
        if let decide::ModelOrigin::Fitted { adapter, .. } = &model.origin
            && *adapter != gpu.adapter().title()
        {
            output::message(&format!(
                "warning: {} was fitted on {adapter}, and this is {}",
                path.display(),
                gpu.adapter().title()
            ));
        }
        return Ok((model, Vec::new()));
    }
    bar.set_message("fitting the cost model");
    let (model, observations) = decide::probes::fit(gpu, &mut |done| {
        bar.set_position((done * 1000.0) as u64);
    })?;
    if let Some(path) = &args.model {
        let json = model.to_json()? + "\n";
        shader_text::files::write_file(path, json.into_bytes()).map_err(|e| told(path, &e))?;
        bar.suspend(|| output::message(&format!("wrote {}", path.display())));
    }
    Ok((model, observations))
}

/// The recipes to try, with measured choices made, and the facts of the scene.
pub fn prepare(
    args: &PlanArgs,
    session: &Session<'_>,
    bar: &ProgressLine,
) -> Result<(Vec<Recipe>, Facts), Failure> {
    bar.set_message("looking for depth ties");
    let mut facts = measure::facts_for_choice(session)?;
    let mut recipes = decide::recipes(args.budget)?;
    if session.scene().is_made_up {
        // Errors measured with made-up values choose nothing.
        recipes.retain(|recipe| !measure::leaves_a_choice(recipe));
    }
    let settled = measure::settled(session, recipes, &mut facts, &mut |done, what| {
        bar.set_position((done * 1000.0) as u64);
        bar.set_message(what);
    })?;
    let mut chosen = Vec::new();
    for settled in settled {
        let recipe = settled.asked;
        match settled.chosen {
            Ok(recipe) => chosen.push(recipe),
            Err(why) => bar.suspend(|| output::message(&format!("left out {recipe}: {why}"))),
        }
    }
    Ok((chosen, facts))
}

/// The recipes that a host can draw with WebGL, of a frame of WebGL. It has no compute shaders, and its viewports have no
/// fractions of a pixel, which a smaller attachment needs.
fn writable(
    mut recipes: Vec<Recipe>,
    target: Target,
    (session, facts): (&Session<'_>, &Facts),
) -> Vec<Recipe> {
    if !matches!(target, Target::GlslEs100 | Target::GlslEs300) {
        return recipes;
    }
    recipes.retain(|recipe| {
        let variant = measure::variant(session.originals(), recipe, facts);
        let emitted = |plan: &Plan| emit::emit(plan, &[target], &emit::Options::default());
        let failed = |plan: &Plan| match emitted(plan) {
            _ if plan.attachments.iter().any(|a| a.divisor > 1) => {
                Some("WebGL's viewports have no fractions of a pixel".to_owned())
            }
            Err(error @ emit::EmitError::Inexpressible { .. }) => Some(error.to_string()),
            _ => None,
        };
        let mut changed = variant.plans.iter().filter(|p| !p.steps.is_empty());
        let why = changed.find_map(failed);
        if let Some(why) = &why {
            output::message(&format!("left out {recipe}: {why}"));
        }
        why.is_none()
    });
    recipes
}

/// Reads a scene, or makes one up for a shader.
pub fn scene(args: &PlanArgs, shader: &ShaderArgs) -> Result<Scene, Failure> {
    let scene = shader.scene()?;
    check_budget(&scene, args.budget)?;
    let mut scene = args.view.of(scene)?;
    if !args.order.is_empty() {
        scene.orders = args.order.iter().map(|o| DrawOrder::from(*o)).collect();
    }
    Ok(scene)
}

/// Splits the draws of a material that need different versions into materials of their own, which
/// get their own decisions.
pub fn grouped(args: &PlanArgs, scene: Scene) -> Result<Scene, Failure> {
    match args.lock {
        true => Ok(scene),
        false => Ok(measure::grouped(
            &scene,
            &specialize::SpecializeParams::default(),
            measure::MOST_GROUPS,
        )?),
    }
}

/// A decision and its inputs.
struct Planned<'a> {
    shader: &'a ShaderArgs,
    session: &'a Session<'a>,
    facts: &'a Facts,
    decision: &'a Decision,
}

impl Planned<'_> {
    /// The plans of every material, in one of the decision's plans.
    fn plans(&self, plan: usize) -> Result<Vec<Plan>, Failure> {
        self.of(plan, self.session.originals())
    }

    /// The same of other originals.
    fn of(&self, plan: usize, originals: &[Plan]) -> Result<Vec<Plan>, Failure> {
        let recipes = &self.decision.plans[plan].recipes;
        let of = |original: &Plan| -> Result<Plan, Failure> {
            let recipe = match recipes.get(&original.material) {
                Some(recipe) => Recipe::parse_list(recipe)?,
                None => Recipe::default(),
            };
            let plan = recipe.apply(original, self.facts);
            plan.map_err(|r| Failure(format!("error: {r}")))
        };
        originals.iter().map(of).collect()
    }

    /// The materials as the author wrote them: those of a frame of WebGL are drawn with another sign of y.
    fn authored(&self) -> Result<Vec<Plan>, Failure> {
        let drawn = self.session.originals();
        if self.session.scene().rows == Rows::FromTop {
            return Ok(drawn.to_vec());
        }
        let written = self.shader.plans(&Recipe::default())?.asked;
        for of in drawn
            .iter()
            .filter(|d| written.iter().all(|w| w.material != d.material))
        {
            output::message(&format!(
                "note: `{}` is a part of a material, whose text is not written: see `preshade rewrite`",
                of.material
            ));
        }
        Ok(written)
    }

    /// The plans that the policy draws with, but for the original.
    fn variants(&self) -> Result<Vec<Variant>, Failure> {
        let mut drawn = self.decision.drawn();
        drawn.retain(|plan| *plan > 0);
        let variant = |plan: usize| {
            let report = &self.decision.plans[plan];
            let recipes: Vec<String> = report
                .recipes
                .iter()
                .map(|(material, recipe)| format!("{material}: {recipe}"))
                .collect();
            Ok(Variant {
                name: report.name.clone(),
                recipe: recipes.join("; "),
                plans: self.plans(plan)?,
                kept: Vec::new(),
            })
        };
        drawn.into_iter().map(variant).collect()
    }

    /// The page. Draws the chosen plans once more for their pictures.
    fn page(&self, effects: &[EffectUse]) -> Result<String, Failure> {
        let variants = self.variants()?;
        let settings = measure::Settings {
            timed: measure::Timed::No,
            timing: TimingSettings::default(),
            frames_per_camera: 1,
            command: self.decision.command.clone(),
        };
        let outcome = match variants.is_empty() {
            true => None,
            // Without pictures it is still a report.
            false => measure::verify(self.session, &variants, &settings, &mut |_| ()).ok(),
        };
        let drawn = Redrawn {
            variants: &variants,
            outcome: outcome.as_ref(),
        };
        Ok(report::html::plan::page(
            self.decision,
            drawn,
            self.session.scene(),
            effects,
        )?)
    }

    /// Writes the shaders and `plan.json` of each plan of the policy, and the reports. Several
    /// plans have a folder each.
    fn write(&self, dir: &Path, forms: &output::Answer, page: String) -> Result<(), Failure> {
        let files = [
            File::text("decision.json", forms.json.clone()),
            File::text("report.csv", forms.csv.clone()),
            File::text("report.html", page),
        ];
        shader_text::files::write(dir, &files)?;
        let mut written = files.len();
        let (authored, target) = (self.authored()?, self.shader.target());
        for (folder, plan) in self.decision.folders() {
            let mut files = Vec::new();
            let plans = self.of(plan, &authored)?;
            for plan in &plans {
                files.extend(emit::emit(plan, &[target], &emit::Options::default())?);
            }
            let plans: Vec<&Plan> = plans.iter().collect();
            let versions = measure::versions(self.session.scene(), &plans);
            files.extend(versions.iter().map(emit::versions));
            written += files.len();
            shader_text::files::write(&dir.join(folder), &files)?;
        }
        output::message(&format!("wrote {written} files to {}", dir.display()));
        Ok(())
    }
}
