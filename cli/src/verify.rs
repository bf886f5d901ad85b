//! `preshade verify`: draws a scene with the original and its variants, and measures error and time.

use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::time::Duration;

use preshade_compiler::command::material::assumed;
use preshade_compiler::command::rewrite;
use preshade_compiler::parameters::parameters;
use preshade_compiler::recipe::Recipe;
use preshade_compiler::sweep::Sweep;
use preshade_draw::render::{AdapterChoice, Gpu};
use preshade_draw::scene::{DrawOrder, Scene};
use preshade_geometry::{examples, pass_named};
use preshade_lab::measure::crossover::{Point, Series};
use preshade_lab::measure::record::{Chosen, Pictures, Report, SweepReport};
use preshade_lab::measure::{self, Detail, Session, Settings, Timed, TimingSettings, Variant};
use preshade_lab::report;
use preshade_plan::budget::{Budget, Metric};
use preshade_plan::pass::{Facts, Use};
use preshade_plan::plan::Plan;
use preshade_scenes::ShaderForm;
use preshade_scenes::Variables;

use crate::explain::largest_saving;
use crate::input::ShaderArgs;
use crate::isolated::{apart, resumed};
use crate::materials::{self, Job};
use crate::output::{self, ProgressLine};
use crate::saved_results::Keeper;
use crate::share::share;
use crate::variable::Axis;
use crate::variants::VariantArgs;
use crate::view::ViewArgs;
use crate::{Ending, Failure, Table, color_on, guesses, promises, worker};

#[derive(clap::Args)]
#[command(after_help = "\
                        Examples:
  preshade verify scene.toml
  preshade verify scene.toml --variant depth-prepass --variant early-discard:quad=lane,budget=0.02 \
      --out report/
  preshade verify scene.toml --pass depth-prepass:form=equal --pass early-discard --camera wall \
      --order front-to-back
  preshade verify scene.toml --variant hoist:budget=1,threshold=1,tessellate:level=1..8 --budget \
      flip_mean=0.02
  preshade verify grass.toml --sweep instances=50000..400000 --pass visibility-buffer
  preshade verify lit.wgsl --size 640x360 --time no      a scene is made up for a shader
  preshade verify scenes/ shaders/ --every-pass --size 160x90

Several --pass are one variant, \"a, then b\", as in `rewrite`. Several --variant are several
variants. Without either, the depth passes are drawn in their main forms. A pass that a material
refuses is skipped and reported.
Folders, several scenes, or more than two shader files are several inputs: they are compared, not
timed, with one line each and one for each broken promise. Two shader files are one material.
level=1..8 is eight variants, form=pulled/shared is two, form=all is one for each form. A range
works for any whole number and any choice of any pass. It gets a table, a plot and rows of pictures.
Exit status 1: a variant broke its contract. 3: not measured, because every variant is refused or
fails, nothing is drawn, or a variant decides where a material discards and no fragment of it is
discarded.")]
pub struct VerifyArgs {
    #[command(flatten)]
    pub variants: VariantArgs,
    /// Draw every recipe that a pass declares as an example, each once. One line an input tells how
    /// many promises (a recipe on a material) hold, are refused, not measured or broken.
    #[arg(long)]
    pub every_pass: bool,
    /// Name the fastest variant whose error is within this in all views, and the arguments of `rewrite`
    /// for it: flip_mean, flip_p99, flip_tile or max_abs.
    #[arg(long, value_name = "METRIC=NUMBER", value_parser = Budget::parse)]
    pub budget: Option<Budget>,
    /// Measure at several values of a scene's variable, and find where variants cross: 50000..400000
    /// doubles, 1..9:5 takes five values at a constant ratio.
    #[arg(long, value_name = "NAME=A..B[:STEPS]", value_parser = Axis::parse)]
    sweep: Option<Axis>,
    /// Write the measurements as one JSON file to share: see docs/results.
    #[arg(long, value_name = "FILE")]
    share: Option<PathBuf>,
    #[command(flatten)]
    view: ViewArgs,
    /// Draw only in these orders; the first is the headline.
    #[arg(long, value_name = "ORDER", value_enum)]
    pub order: Vec<OrderArg>,
    /// Compare variants with the original with @invariant on its position.
    #[arg(long)]
    invariant: bool,
    /// Frames of each camera path to compare, evenly spaced.
    #[arg(long, value_name = "N", default_value_t = 8, value_parser = parse_frames)]
    pub frames: usize,
    /// Views to time; default: first-frames, and no for several inputs.
    #[arg(long, value_enum)]
    pub time: Option<TimeArg>,
    /// Seconds to spend on timing each view.
    #[arg(long, value_name = "SECONDS", default_value_t = 4.0, value_parser = parse_seconds)]
    pub seconds: f64,
    /// Part of an adapter's name, driver or backend.
    #[arg(long, value_name = "TEXT")]
    pub adapter: Option<String>,
    /// Give shaders to the driver as emitted text, or as IR.
    #[arg(long, value_enum, default_value_t = FormArg::Text)]
    form: FormArg,
    /// Folder for `report.html`, `report.json`, `report.csv` and pictures.
    #[arg(short, long, alias = "output", value_name = "DIR")]
    out: Option<PathBuf>,
    /// Output form.
    #[arg(long, value_enum, default_value_t = Table::Human)]
    pub format: Table,
    // Last: its help heading applies to the flags after it.
    #[command(flatten)]
    pub shader: ShaderArgs,
    /// The flags in effect, as words.
    #[arg(skip)]
    pub flags: Vec<String>,
}

#[derive(Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum TimeArg {
    /// Nothing.
    No,
    /// The first camera in the first order.
    Headline,
    /// The first frame of every camera in every order.
    FirstFrames,
    /// Every compared frame in every order, with the 95th percentile of camera paths.
    Everything,
}

#[derive(Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum FormArg {
    /// The emitted text, which users ship.
    Text,
    /// naga IR.
    Ir,
}

/// A draw order, by its name in scene files.
#[derive(Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum OrderArg {
    /// By the distance of objects, nearest first, as a good engine draws.
    FrontToBack,
    /// Farthest first: the worst case.
    BackToFront,
    /// A fixed pseudo-random order.
    Shuffled,
    /// As in the file.
    AsGiven,
}

impl From<OrderArg> for DrawOrder {
    fn from(order: OrderArg) -> Self {
        match order {
            OrderArg::FrontToBack => Self::FrontToBack,
            OrderArg::BackToFront => Self::BackToFront,
            OrderArg::Shuffled => Self::Shuffled,
            OrderArg::AsGiven => Self::AsGiven,
        }
    }
}

/// Reads a number of frames.
pub fn parse_frames(text: &str) -> Result<usize, String> {
    match text.trim().parse::<usize>() {
        Ok(n @ 1..) => Ok(n),
        _ => Err("expected a whole number from 1".to_owned()),
    }
}

/// Reads a number of seconds.
pub fn parse_seconds(text: &str) -> Result<f64, String> {
    match text.trim().parse::<f64>() {
        Ok(n) if (0.0..=3600.0).contains(&n) => Ok(n),
        _ => Err("expected a number of seconds from 0 to 3600".to_owned()),
    }
}

impl VerifyArgs {
    /// The inputs, if each gets one line. `None`: one input, with its own report.
    pub fn jobs(&self) -> Result<Option<Vec<Job>>, Failure> {
        let several = materials::inputs(&self.shader)?;
        Ok(several.or_else(|| {
            self.every_pass.then(|| {
                vec![Job {
                    shader: self.shader.clone(),
                    folder: None,
                    chosen: materials::Chosen::Given,
                }]
            })
        }))
    }

    /// Refuses flags of a report. `is_list`: they are made jobs of, and may be timed.
    pub fn check_many(&self, is_list: bool) -> Result<(), Failure> {
        let timed = self.time.is_some_and(|time| time != TimeArg::No);
        let given = [
            ("--budget", self.budget.is_some() && !is_list),
            ("--sweep", self.sweep.is_some()),
            ("--share", self.share.is_some()),
            ("--out", self.out.is_some()),
            ("--time", timed && !is_list),
            ("--format csv", self.format == Table::Csv),
        ];
        match given.iter().find(|(_, given)| *given) {
            None => Ok(()),
            Some((flag, _)) => Err(Failure(format!(
                "error: {flag} is for one input: several inputs, and --every-pass, print one line \
                 each"
            ))),
        }
    }

    /// The form in which shaders reach the driver.
    pub fn shader_form(&self) -> ShaderForm {
        match self.form {
            FormArg::Text => ShaderForm::Text,
            FormArg::Ir => ShaderForm::Ir,
        }
    }

    /// How to measure a scene, with these views timed.
    pub fn settings(&self, scene: &Scene, timed: Timed) -> Settings {
        // A made-up scene shows no time worth waiting for: its views share the seconds of one.
        let views = match scene.is_made_up {
            true => scene.orders.len().max(1),
            false => 1,
        };
        Settings {
            timed,
            timing: TimingSettings {
                budget: Duration::from_secs_f64(self.seconds / views as f64),
                ..TimingSettings::default()
            },
            frames_per_camera: self.frames,
            command: command(),
        }
    }
}

/// Verifies a scene or a shader.
pub fn run(args: &VerifyArgs) -> Result<Ending, Failure> {
    let mut sweeps = args.variants.sweeps()?;
    let is_default = sweeps.is_empty() && !args.every_pass;
    if is_default {
        sweeps = by_default()?;
    }
    if let Some(jobs) = args.jobs()? {
        args.check_many(false)?;
        return promises::run(args, &jobs, &recipes(&sweeps));
    }
    let first = match &args.sweep {
        None => Variables::new(),
        Some(axis) => axis.at(axis.values.first().copied().unwrap_or(1)),
    };
    let first = grouped(scene(args, &args.shader, &first)?, &sweeps)?;
    check_budget(&first, args.budget)?;
    let shared = args.share.as_deref().and_then(Path::parent);
    for dir in args.out.as_deref().into_iter().chain(shared) {
        check_folder(dir)?;
    }
    if let Some(dir) = &args.out {
        args.shader.on(args.adapter.as_deref()).write_frame(dir)?;
    }
    let between = materials::between(&args.shader.files);
    between.iter().for_each(|note| output::message(note));
    for material in &first.materials {
        for note in material.plan().notes {
            output::message(&format!("note: `{}`: {note}", material.name));
        }
    }
    let limits = args.shader.limits.limits();
    let mut keeper = Keeper::new(args.out.as_deref());
    let bar = output::bar();
    let (mut outcome, variants) = match (limits.isolates() && worker::mine().is_none(), &args.sweep)
    {
        (true, Some(_)) => {
            return Err(Failure(
                "error: --sweep is measured in one process: it goes without `seconds` and `memory` \
                 among the limits"
                    .to_owned(),
            ));
        }
        (true, None) => {
            tell_made_up(args, &first);
            let outcome = apart(&recipes(&sweeps), args.budget, &limits, &mut keeper)?;
            (outcome, Vec::new())
        }
        (false, Some(axis)) => {
            return swept(
                args,
                &Opened::new(args, &first)?,
                &first,
                axis,
                &sweeps,
                &bar,
                &mut keeper,
            );
        }
        (false, None) => {
            let opened = Opened::new(args, &first)?;
            let measured = measured(args, &opened.0, &first, &sweeps, &bar, &mut keeper);
            let (outcome, variants) = match measured {
                Ok(measured) => measured,
                Err(e) => {
                    opened.abandon();
                    return Err(e);
                }
            };
            if let Some(why) = opened.0.lost().filter(|_| worker::is_job()) {
                // A report that is put together from the rest may lack what the whole one has.
                opened.abandon();
                return Err(Failure(format!(
                    "error: the graphics device was lost: {why}"
                )));
            }
            let outcome = match (&outcome.lost, worker::mine()) {
                (Some(why), None) => {
                    output::message(&format!(
                        "warning: {why}; what is missing is measured on a device of its own, in a \
                         process each"
                    ));
                    opened.abandon();
                    resumed(outcome, &recipes(&sweeps), &limits, &mut keeper)
                }
                _ => outcome,
            };
            (outcome, variants)
        }
    };
    bar.finish_and_clear();
    if worker::mine().is_none() {
        tell_sweeps(&mut outcome.report, &sweeps);
        if is_default && report::nothing_pays(&outcome.report) {
            let steps = sweeps.iter().flat_map(|s| &s.points);
            let drawn: Vec<&str> = steps
                .flat_map(|p| &p.recipe.steps)
                .map(|s| s.pass.as_str())
                .collect();
            // It is a hint: the measurements are told without it too.
            outcome.report.not_drawn = largest_saving(&args.shader, &drawn).ok().flatten();
        }
    }
    let ended = told(args, &outcome, &variants, &first).map_err(|e| keeper.named(e))?;
    keeper.done();
    Ok(ended)
}

struct Opened(Gpu);

/// Tells what of the scene is made up, and the pipeline state where nothing says it.
fn tell_made_up(args: &VerifyArgs, scene: &Scene) {
    guesses::tell(scene);
    if scene.is_made_up && args.shader.state.state.is_none() {
        let notes = scene.materials.iter().filter_map(|m| assumed(&m.plan()));
        notes.for_each(|note| output::message(&note));
    }
}

pub fn open(args: &VerifyArgs) -> Result<Gpu, Failure> {
    let choice = args.adapter.clone();
    let choice = choice.map_or(AdapterChoice::Best, AdapterChoice::Matching);
    let trust = args.shader.limits.limits().trust();
    worker::in_turns(Gpu::with_trust(&choice, trust)?)
}

impl Opened {
    /// Opens it, and then tells what of the scene is made up.
    fn new(args: &VerifyArgs, scene: &Scene) -> Result<Self, Failure> {
        let gpu = open(args)?;
        if worker::mine().is_none() {
            tell_made_up(args, scene);
        }
        Ok(Self(gpu))
    }

    /// Leaks a lost device: closing one that hangs may hang.
    fn abandon(mut self) {
        self.0.end_turns();
        std::mem::forget(self.0);
    }
}

/// Measures at each value of a variable.
fn swept(
    args: &VerifyArgs,
    opened: &Opened,
    first: &Scene,
    axis: &Axis,
    sweeps: &[Sweep],
    bar: &ProgressLine,
    keeper: &mut Keeper,
) -> Result<Ending, Failure> {
    let mut points = Vec::new();
    let mut pictures = Vec::new();
    for (i, value) in axis.values.iter().enumerate() {
        bar.suspend(|| output::message(&format!("{} = {value}", axis.variable)));
        let (outcome, _) = match i {
            0 => measured(args, &opened.0, first, sweeps, bar, keeper)?,
            _ => {
                let scene = grouped(scene(args, &args.shader, &axis.at(*value))?, sweeps)?;
                measured(args, &opened.0, &scene, sweeps, bar, keeper)?
            }
        };
        pictures = outcome.pictures;
        let mut outcome_report = outcome.report;
        tell_sweeps(&mut outcome_report, sweeps);
        points.push(Point {
            value: *value,
            report: outcome_report,
        });
        if i + 1 < axis.values.len() {
            let so_far = Series::new(&axis.variable, points.clone()).to_json()?;
            keeper.keep("series.unfinished.json", so_far);
        }
    }
    bar.finish_and_clear();
    let series = Series::new(&axis.variable, points);
    let json = series.to_json()?;
    let printed = match args.format {
        Table::Human => output::table(&report::crossover::render(&series)),
        Table::Json => output::data(&json),
        Table::Csv => output::data(&report::csv::series(&series)),
    };
    let shared = share(args.share.as_deref(), &json);
    let mut files = vec![
        file("series.json", json),
        file("series.csv", report::csv::series(&series)),
    ];
    files.extend(report::crossover::svg(&series).map(|svg| file("series.svg", svg)));
    let written = write(args, files, &pictures);
    output::both(printed, shared.and(written), args.out.as_deref()).map_err(|e| keeper.named(e))?;
    keeper.done();
    let is_open = series.points.iter().all(|p| is_open(&p.report));
    Ok(match series.is_broken() {
        true => Ending::ContractBroken,
        false if is_open => Ending::NotMeasured,
        false => Ending::Fine,
    })
}

/// Whether no verdict can be trusted.
fn is_open(report: &Report) -> bool {
    report.is_unmeasured() || !report.untested.is_empty()
}

/// Prints and writes the report of one scene. `variants` is empty if other processes drew them.
fn told(
    args: &VerifyArgs,
    outcome: &measure::Verified,
    variants: &[Variant],
    scene: &Scene,
) -> Result<Ending, Failure> {
    // Printed before it is written: a full disk must not lose the measurements.
    let json = outcome.report.to_json()?;
    let is_worker = worker::mine().is_some();
    let plans = variants.iter().flat_map(|v| &v.plans);
    for removed in plans.filter_map(rewrite::removed_discard) {
        output::message(&removed);
    }
    let printed = match args.format {
        _ if is_worker => output::data(&json),
        Table::Human => output::table(&report::table::render(
            &outcome.report,
            color_on(&std::io::stdout()),
        )),
        Table::Json => output::data(&json),
        Table::Csv => output::data(&report::csv::verify(&outcome.report)),
    };
    if is_worker {
        printed?;
        // The other process writes the report, from several workers.
        write(args, Vec::new(), &outcome.pictures)?;
        return Ok(Ending::Fine);
    }
    let shared = share(args.share.as_deref(), &json);
    let mut files = vec![
        file("report.json", json),
        file("report.csv", report::csv::verify(&outcome.report)),
    ];
    if args.out.is_some() {
        let effects = measure::effects(scene).unwrap_or_default();
        let (report, pictures) = (&outcome.report, &outcome.pictures);
        let page = report::html::verify::page(report, pictures, variants, scene, &effects)?;
        files.push(file("report.html", page));
    }
    for sweep in &outcome.report.sweeps {
        files.extend(sweep.files(&outcome.report, &outcome.pictures)?);
    }
    let written = write(args, files, &outcome.pictures);
    output::both(printed, shared.and(written), args.out.as_deref())?;
    let report = &outcome.report;
    Ok(match report.is_broken() {
        true => Ending::ContractBroken,
        false if is_open(report) => Ending::NotMeasured,
        false => Ending::Fine,
    })
}

fn file(name: &str, text: String) -> shader_text::files::File {
    shader_text::files::File {
        name: name.to_owned(),
        bytes: text.into_bytes(),
    }
}

/// Writes the files and the pictures to the folder of `--out`.
fn write(
    args: &VerifyArgs,
    mut files: Vec<shader_text::files::File>,
    pictures: &[Pictures],
) -> Result<(), Failure> {
    let Some(dir) = &args.out else { return Ok(()) };
    for pictures in pictures {
        for file in pictures.files()? {
            if !files.iter().any(|f| f.name == file.name) {
                files.push(file);
            }
        }
    }
    shader_text::files::write(dir, &files).map_err(|e| Failure(format!("error: {e}")))?;
    let beside = match args.shader.limits.limits().isolates() && worker::mine().is_none() {
        true => ", beside the pictures that each variant's own process wrote",
        false => "",
    };
    output::message(&format!(
        "wrote {} files to {}{beside}",
        files.len(),
        dir.display()
    ));
    Ok(())
}

/// Measures one scene in this process. Returns the outcome and the variants with their plans.
fn measured(
    args: &VerifyArgs,
    gpu: &Gpu,
    scene: &Scene,
    sweeps: &[Sweep],
    bar: &ProgressLine,
    keeper: &mut Keeper,
) -> Result<(measure::Verified, Vec<Variant>), Failure> {
    let all = recipes(sweeps);
    let mine: Vec<Recipe> = match worker::mine() {
        None => all,
        Some(n) => all.into_iter().take(n).skip(n.max(1) - 1).collect(),
    };
    bar.set_message("looking for depth ties");
    let session = Session::new(gpu, scene, args.shader_form())?;
    let mut facts = measure::facts(&session).unwrap_or_else(|e| {
        bar.suspend(|| {
            let why = e.reason();
            output::message(&format!("warning: depth ties were not measured: {why}"));
        });
        Facts::default()
    });
    let mine = match args.budget {
        None => mine,
        Some(budget) => mine
            .into_iter()
            .map(|recipe| budgeted(recipe, session.originals(), &facts, budget))
            .collect(),
    };
    let (recipes, variants) = choose(&session, mine, &mut facts, bar)?;
    let timed = match args.time {
        Some(TimeArg::No) => Timed::No,
        Some(TimeArg::Headline) => Timed::Headline,
        Some(TimeArg::FirstFrames) | None => Timed::FirstFrames,
        Some(TimeArg::Everything) => Timed::Everything,
    };
    let settings = args.settings(session.scene(), timed);
    let mut outcome = measure::verify(&session, &variants, &settings, &mut |p| {
        bar.set_position((p.done * 1000.0) as u64);
        bar.set_message(p.what);
        if let (Some(so_far), None) = (p.so_far, worker::mine()) {
            keeper.keep_report(&so_far);
        }
    })?;
    outcome.report.chosen = args.budget.map(|budget| {
        Chosen::among(&outcome.report.variants, budget).made_by(|name| {
            let drawn = variants.iter().position(|v| v.name == name)?;
            measure::promised(&recipes[drawn], budget, &facts)
        })
    });
    Ok((outcome, variants))
}

/// What is drawn if no variant is named.
pub fn by_default() -> Result<Vec<Sweep>, Failure> {
    let named = examples().filter(|(_, used)| **used == Use::Verify);
    let sweeps = named.map(|(recipe, _)| Sweep::parse_list(recipe));
    Ok(sweeps.collect::<Result<_, _>>()?)
}

/// All requested recipes, in the order of the report's variants.
pub fn recipes(sweeps: &[Sweep]) -> Vec<Recipe> {
    let points = sweeps.iter().flat_map(|s| &s.points);
    points.map(|p| p.recipe.clone()).collect()
}

/// Adds to a report which of its variants are the points of which sweep.
fn tell_sweeps(report: &mut Report, sweeps: &[Sweep]) {
    let names: Vec<String> = report
        .variants
        .iter()
        .skip(1)
        .map(|v| v.name.clone())
        .collect();
    let mut names = names.into_iter();
    for sweep in sweeps {
        let names: Vec<String> = names.by_ref().take(sweep.points.len()).collect();
        if sweep.varies() {
            report.sweeps.push(SweepReport::new(sweep, &names));
        }
    }
}

/// Gives the budget of `--budget` to each step that a material refuses without one.
fn budgeted(recipe: Recipe, originals: &[Plan], facts: &Facts, budget: Budget) -> Recipe {
    let refusals = |recipe: &Recipe| measure::variant(originals, recipe, facts).kept.len();
    let mut recipe = recipe;
    for i in 0..recipe.steps.len() {
        let step = &recipe.steps[i];
        let taken = pass_named(&step.pass).map_or(Vec::new(), parameters);
        let takes = |name: &str| taken.iter().any(|p| p.name == name);
        let is_its_metric = takes("metric") || budget.metric == Metric::FlipMean;
        if !takes("budget") || !is_its_metric || step.params.contains_key("budget") {
            continue;
        }
        let mut within = recipe.clone();
        let params = &mut within.steps[i].params;
        params.insert("budget".to_owned(), budget.limit.into());
        if takes("metric") {
            params.insert("metric".to_owned(), budget.metric.to_string().into());
        }
        if refusals(&within) < refusals(&recipe) {
            recipe = within;
        }
    }
    recipe
}

/// Resolves recipes that leave choices to measurement, and applies them.
pub fn choose(
    session: &Session<'_>,
    recipes: Vec<Recipe>,
    facts: &mut Facts,
    bar: &ProgressLine,
) -> Result<(Vec<Recipe>, Vec<Variant>), Failure> {
    if recipes.iter().any(measure::leaves_a_choice) {
        bar.set_message("measuring what can be interpolated");
        facts.frequencies = measure::frequencies(session, facts, Detail::Choice, &mut |step| {
            bar.set_position((step.done * 1000.0) as u64);
            ControlFlow::Continue(())
        })?;
    }
    let originals = session.originals();
    let choices = recipes.into_iter().map(|recipe| {
        if !measure::leaves_a_choice(&recipe) {
            let variant = measure::variant(originals, &recipe, facts);
            return Ok((recipe, variant));
        }
        bar.set_message(format!("choosing within the budget of {recipe}"));
        let chosen = match measure::within_budget(session, &recipe, facts)? {
            Ok(chosen) => chosen,
            Err(why) => {
                let variant = measure::refused(originals, &recipe, &why);
                return Ok((recipe, variant));
            }
        };
        let variant = measure::variant(originals, &chosen, facts);
        let written = measure::written_out(&chosen, facts).filter(|_| !variant.is_refused());
        if let Some(written) = written {
            bar.suspend(|| {
                output::message(&format!(
                    "{recipe}: chosen by measurement; `rewrite` makes the same of {}",
                    written.as_passes()
                ));
            });
        }
        Ok((chosen, variant))
    });
    choices
        .collect::<Result<Vec<_>, Failure>>()
        .map(|c| c.into_iter().unzip())
}

/// Checks before anything is drawn that the folder `dir` can be written to or created. Leaves nothing
/// behind.
pub fn check_folder(dir: &Path) -> Result<(), Failure> {
    let here = Path::new(".");
    let there = dir
        .ancestors()
        .map(|d| if d.as_os_str().is_empty() { here } else { d })
        .find(|d| d.exists())
        .unwrap_or(here);
    if !there.is_dir() {
        return Err(Failure(format!(
            "error: {} is a file, not a folder",
            there.display()
        )));
    }
    // Try it: permissions do not cover read-only file systems and privileged users.
    let probe = there.join(format!(".preshade.{}.tmp", std::process::id()));
    std::fs::write(&probe, [])
        .and_then(|()| std::fs::remove_file(&probe))
        .map_err(|e| {
            Failure(format!(
                "error: {}: {} cannot be written to: {e}",
                dir.display(),
                there.display()
            ))
        })
}

/// Refuses a choice within an error budget if the scene's values are made up.
pub fn check_budget(scene: &Scene, budget: Option<Budget>) -> Result<(), Failure> {
    match (scene.is_made_up, budget) {
        (true, Some(_)) => Err(Failure(
            "error: --budget chooses by measured errors, and preshade made up the values of a bare \
             shader: give a scene (docs/reference/scenes.md)"
                .to_owned(),
        )),
        _ => Ok(()),
    }
}

/// The scene of `shader`, with the requested settings.
pub fn scene(
    args: &VerifyArgs,
    shader: &ShaderArgs,
    variables: &Variables,
) -> Result<Scene, Failure> {
    let mut scene = args
        .view
        .of(shader.on(args.adapter.as_deref()).scene_with(variables)?)?;
    if args.invariant {
        scene = scene.with_invariant_positions();
    }
    if !args.order.is_empty() {
        scene.orders = args.order.iter().map(|o| DrawOrder::from(*o)).collect();
    }
    Ok(scene)
}

/// If a recipe specialises, splits each material into groups of draws that get versions of their own.
pub fn grouped(scene: Scene, sweeps: &[Sweep]) -> Result<Scene, Failure> {
    let steps = sweeps
        .iter()
        .flat_map(|s| &s.points)
        .flat_map(|p| p.recipe.steps.clone());
    let all = Recipe {
        steps: steps.collect(),
    };
    all.check_names(&measure::originals(&scene))?;
    Ok(measure::grouped_for(scene, &all)?)
}

/// The command line, without the folder of the binary.
pub fn command() -> String {
    let mut words = vec!["preshade".to_owned()];
    words.extend(
        std::env::args_os()
            .skip(1)
            .map(|word| word.to_string_lossy().into_owned()),
    );
    shell_words::join(words)
}
