//! `preshade verify`: draws a scene with the original and its variants, and measures error and time.

use std::path::{Path, PathBuf};
use std::time::Duration;

use preshade_compiler::command::material::assumed;
use preshade_compiler::command::rewrite;
use preshade_compiler::recipe::Recipe;
use preshade_compiler::sweep::Sweep;
use preshade_draw::render::Gpu;
use preshade_draw::scene::{DrawOrder, Scene};
use preshade_lab::measure::crossover::{Point, Series};
use preshade_lab::measure::record::{Pictures, Report};
use preshade_lab::measure::{self, Settings, Timed, TimingSettings, parse_seconds};
use preshade_lab::search::candidates;
use preshade_lab::verify::{Answer, News, Request, grouped};
use preshade_lab::{isolated, report};
use preshade_plan::budget::Budget;
use preshade_scenes::ShaderForm;
use preshade_scenes::Variables;
use shader_text::files::File;

use crate::explain::largest_saving;
use crate::input::ShaderArgs;
use crate::materials::{self, Job};
use crate::output::{self, ProgressLine};
use crate::saved_results::Keeper;
use crate::share::share;
use crate::sweep_axis::Axis;
use crate::variants::VariantArgs;
use crate::view::ViewArgs;
use crate::{Ending, Failure, Table, color_on, guesses, worker};

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

impl VerifyArgs {
    pub fn sweeps(&self) -> Result<Vec<Sweep>, Failure> {
        let sweeps = self.variants.sweeps()?;
        match self.is_default() {
            true => Ok(candidates::by_default()?),
            false => Ok(sweeps),
        }
    }

    /// Whether the user gave nothing to draw.
    fn is_default(&self) -> bool {
        self.variants.is_empty() && !self.every_pass
    }

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
pub fn run(args: &VerifyArgs, sweeps: &[Sweep]) -> Result<Ending, Failure> {
    let recipes = recipes(sweeps);
    let first = match &args.sweep {
        None => Variables::new(),
        Some(axis) => axis.at(axis.values.first().copied().unwrap_or(1)),
    };
    let first = grouped(scene(args, &args.shader, &first)?, &recipes)?;
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
    let is_apart = limits.isolates() && worker::mine().is_none();
    if is_apart && args.sweep.is_some() {
        return Err(Failure(
            "error: --sweep is measured in one process: it goes without `seconds` and `memory` \
             among the limits"
                .to_owned(),
        ));
    }
    let mut keeper = Keeper::new(args.out.as_deref());
    let alone = |variant| {
        let text = worker::run(variant, &limits, worker::OF_A_VARIANT)?;
        worker::printed(&text)
    };
    let bar = output::bar();
    let gpu = match is_apart {
        true => None,
        false => Some(open(args)?),
    };
    if worker::mine().is_none() {
        guesses::tell(&first);
        if first.is_made_up && args.shader.state.state.is_none() {
            let notes = first.materials.iter().filter_map(|m| assumed(&m.plan()));
            notes.for_each(|note| output::message(&note));
        }
    }
    let mut answer = match (gpu, &args.sweep) {
        (None, _) => Answer {
            verified: isolated::apart(&recipes, args.budget, &alone, &mut |so_far| {
                keeper.keep_report(so_far);
            })
            .map_err(Failure)?,
            variants: Vec::new(),
        },
        (Some(gpu), Some(axis)) => {
            return swept(args, &gpu, first, axis, sweeps, &bar, &mut keeper);
        }
        (Some(mut gpu), None) => {
            let measured = measured(args, &gpu, &first, &recipes, &bar, &mut keeper);
            let is_lost = measured
                .as_ref()
                .map_or(true, |a| a.verified.lost.is_some());
            let lost = gpu.lost();
            if is_lost || lost.is_some() {
                gpu.end_turns();
                // Closing a lost device that hangs may hang.
                std::mem::forget(gpu);
            }
            let mut answer = measured?;
            if let Some(why) = lost.filter(|_| worker::is_job()) {
                // A report that is completed after a loss may lack parts of a whole one.
                return Err(Failure(format!(
                    "error: the graphics device was lost: {why}"
                )));
            }
            if let (Some(why), None) = (&answer.verified.lost, worker::mine()) {
                output::message(&format!(
                    "warning: {why}; what is missing is measured on a device of its own, in a \
                     process each"
                ));
                let keep = &mut |so_far: &_| keeper.keep_report(so_far);
                answer.verified = isolated::resumed(answer.verified, &recipes, &alone, keep);
            }
            answer
        }
    };
    bar.finish_and_clear();
    if worker::mine().is_none() {
        let report = &mut answer.verified.report;
        report.add_sweeps(sweeps);
        if args.is_default() && report::nothing_pays(report) {
            let steps = recipes.iter().flat_map(|recipe| &recipe.steps);
            let drawn: Vec<&str> = steps.map(|s| s.pass.as_str()).collect();
            // It is a hint: the measurements are reported without it too.
            report.not_drawn = largest_saving(&args.shader, &drawn).ok().flatten();
        }
    }
    let ended = told(args, &answer, &first).map_err(|e| keeper.named(e))?;
    keeper.done();
    Ok(ended)
}

/// Opens the adapter of `--adapter`.
pub fn open(args: &VerifyArgs) -> Result<Gpu, Failure> {
    worker::open(args.adapter.as_deref(), &args.shader.limits.limits())
}

/// Measures at each value of a variable.
fn swept(
    args: &VerifyArgs,
    gpu: &Gpu,
    first: Scene,
    axis: &Axis,
    sweeps: &[Sweep],
    bar: &ProgressLine,
    keeper: &mut Keeper,
) -> Result<Ending, Failure> {
    let recipes = recipes(sweeps);
    let mut points = Vec::new();
    let mut pictures = Vec::new();
    let mut first = Some(first);
    for (i, value) in axis.values.iter().enumerate() {
        bar.suspend(|| output::message(&format!("{} = {value}", axis.variable)));
        let scene = match first.take() {
            Some(first) => first,
            None => grouped(scene(args, &args.shader, &axis.at(*value))?, &recipes)?,
        };
        let verified = measured(args, gpu, &scene, &recipes, bar, keeper)?.verified;
        pictures = verified.pictures;
        let mut report = verified.report;
        report.add_sweeps(sweeps);
        points.push(Point {
            value: *value,
            report,
        });
        if i + 1 < axis.values.len() {
            let so_far = Series::new(&axis.variable, points.clone()).to_json()?;
            keeper.keep("series.unfinished.json", so_far);
        }
    }
    bar.finish_and_clear();
    let series = Series::new(&axis.variable, points);
    let forms = output::Answer {
        table: report::crossover::render(&series),
        json: series.to_json()?,
        csv: report::csv::series(&series),
    };
    let printed = forms.print(args.format);
    let shared = share(args.share.as_deref(), &forms.json);
    let mut files = vec![
        File::text("series.json", forms.json),
        File::text("series.csv", forms.csv),
    ];
    files.extend(report::crossover::svg(&series).map(|svg| File::text("series.svg", svg)));
    let written = write(args, files, &pictures);
    output::both(printed, shared.and(written), args.out.as_deref()).map_err(|e| keeper.named(e))?;
    keeper.done();
    let is_open = series.points.iter().all(|p| is_open(&p.report));
    Ok(Ending::of(series.is_broken(), is_open))
}

/// Whether no verdict can be trusted.
fn is_open(report: &Report) -> bool {
    report.is_unmeasured() || !report.untested.is_empty()
}

/// Prints and writes the report of one scene.
fn told(args: &VerifyArgs, answer: &Answer, scene: &Scene) -> Result<Ending, Failure> {
    let (report, pictures) = (&answer.verified.report, &answer.verified.pictures);
    let plans = answer.variants.iter().flat_map(|v| &v.plans);
    for removed in plans.filter_map(rewrite::removed_discard) {
        output::message(&removed);
    }
    let forms = output::Answer {
        table: report::table::render(report, color_on(&std::io::stdout())),
        json: report.to_json()?,
        csv: report::csv::verify(report),
    };
    if worker::mine().is_some() {
        output::data(&forms.json)?;
        // The other process writes the report, from several workers.
        write(args, Vec::new(), pictures)?;
        return Ok(Ending::Fine);
    }
    // Printed before it is written: a full disk must not lose the measurements.
    let printed = forms.print(args.format);
    let shared = share(args.share.as_deref(), &forms.json);
    let mut files = vec![
        File::text("report.json", forms.json),
        File::text("report.csv", forms.csv),
    ];
    if args.out.is_some() {
        let effects = measure::effects(scene).unwrap_or_default();
        let variants = &answer.variants;
        let page = report::html::verify::page(report, pictures, variants, scene, &effects)?;
        files.push(File::text("report.html", page));
    }
    for sweep in &report.sweeps {
        files.extend(sweep.files(report, pictures)?);
    }
    let written = write(args, files, pictures);
    output::both(printed, shared.and(written), args.out.as_deref())?;
    Ok(Ending::of(report.is_broken(), is_open(report)))
}

/// Writes the files and the pictures to the folder of `--out`.
fn write(args: &VerifyArgs, mut files: Vec<File>, pictures: &[Pictures]) -> Result<(), Failure> {
    let Some(dir) = &args.out else { return Ok(()) };
    for pictures in pictures {
        for file in pictures.files()? {
            if !files.iter().any(|f| f.name == file.name) {
                files.push(file);
            }
        }
    }
    shader_text::files::write(dir, &files)?;
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

/// Measures one scene in this process.
fn measured(
    args: &VerifyArgs,
    gpu: &Gpu,
    scene: &Scene,
    recipes: &[Recipe],
    bar: &ProgressLine,
    keeper: &mut Keeper,
) -> Result<Answer, Failure> {
    let timed = match args.time {
        Some(TimeArg::No) => Timed::No,
        Some(TimeArg::Headline) => Timed::Headline,
        Some(TimeArg::FirstFrames) | None => Timed::FirstFrames,
        Some(TimeArg::Everything) => Timed::Everything,
    };
    let request = Request {
        recipes: match worker::mine() {
            None => recipes.to_vec(),
            Some(0) => Vec::new(),
            Some(n) => recipes.get(n - 1).cloned().into_iter().collect(),
        },
        budget: args.budget,
        form: args.shader_form(),
        settings: args.settings(scene, timed),
    };
    bar.set_message("looking for depth ties");
    let told = &mut |news| match news {
        News::Note(note) => bar.suspend(|| output::message(&note)),
        News::Progress(p) => {
            bar.set_position((p.done * 1000.0) as u64);
            bar.set_message(p.what);
            if let (Some(so_far), None) = (p.so_far, worker::mine()) {
                keeper.keep_report(&so_far);
            }
        }
    };
    Ok(preshade_lab::verify::request(gpu, scene, &request, told)?)
}

/// All requested recipes, in the order of the report's variants.
pub fn recipes(sweeps: &[Sweep]) -> Vec<Recipe> {
    let points = sweeps.iter().flat_map(|s| &s.points);
    points.map(|p| p.recipe.clone()).collect()
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
