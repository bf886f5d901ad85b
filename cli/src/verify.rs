//! `preshade verify`: a scene drawn with the original and its variants, what each costs in accuracy and gains in time.

use std::io::IsTerminal;
use std::path::{Path, PathBuf};
use std::time::Duration;

use indicatif::{ProgressBar, ProgressStyle};
use preshade::measure::sweep::{Point, Sweep};
use preshade::measure::{self, Settings, Timed, TimingSettings};
use preshade::passes::pass::Facts;
use preshade::recipe::Recipe;
use preshade::render::{AdapterChoice, Gpu, ShaderForm};
use preshade::report;
use preshade::scene::{self, DrawOrder, Scene, Variable, Variables};

use crate::input::ShaderArgs;
use crate::output;
use crate::{Failure, Format, Outcome};

/// Arguments of `verify`.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  preshade verify scene.toml
  preshade verify scene.toml --pass depth-prepass --pass early-discard:quad=lane,budget=0.02 --out report/
  preshade verify scene.toml --recipe depth-prepass:form=equal,early-discard --camera wall --order front-to-back
  preshade verify lit.wgsl --size 640x360 --time no      a scene is made up for a shader
  preshade verify grass.toml --sweep instances=50000..400000 --pass depth-prepass --pass visibility-buffer

Each --pass is a variant of its own; --recipe puts several passes into one.
Exit status 1: a variant broke its contract.")]
pub struct Args {
    /// A variant of one pass; may be given several times. Default: the depth passes in their main forms.
    #[arg(long = "pass", value_name = "NAME[:k=v,..]")]
    passes: Vec<String>,
    /// A variant of several passes, separated by commas.
    #[arg(long = "recipe", value_name = "NAME[:k=v,..],NAME..")]
    recipes: Vec<String>,
    /// Draw these cameras only; the first is the headline.
    #[arg(long, value_name = "NAME")]
    camera: Vec<String>,
    /// Draw in these orders only; the first is the headline.
    #[arg(long, value_name = "ORDER", value_enum)]
    order: Vec<OrderArg>,
    /// Resolution, `1920x1080` say.
    #[arg(long, value_name = "WxH", value_parser = parse_size)]
    size: Option<[u32; 2]>,
    /// Hold variants against the original with @invariant on its position.
    #[arg(long)]
    invariant: bool,
    /// Frames of each camera path to compare, evenly spaced.
    #[arg(long, value_name = "N", default_value_t = 8, value_parser = parse_frames)]
    frames: usize,
    /// Measure at several values of a scene's variable: 50000..400000 doubles, 1..9:5 takes five steps of one ratio. The times are the headline view's.
    #[arg(long, value_name = "NAME=A..B[:STEPS]", value_parser = parse_sweep)]
    sweep: Option<Axis>,
    /// Write what was measured as one JSON file that others can read, to send in: docs/results says how.
    #[arg(long, value_name = "FILE")]
    share: Option<PathBuf>,
    /// Views to time.
    #[arg(long, value_enum, default_value_t = TimeArg::FirstFrames)]
    time: TimeArg,
    /// Seconds to spend on timing each view.
    #[arg(long, value_name = "SECONDS", default_value_t = 4.0, value_parser = parse_seconds)]
    seconds: f64,
    /// Part of an adapter's name, driver or backend.
    #[arg(long, value_name = "TEXT")]
    adapter: Option<String>,
    /// Give shaders to the driver as emitted text, or as IR.
    #[arg(long, value_enum, default_value_t = FormArg::Text)]
    form: FormArg,
    /// Folder for pictures and `report.json`.
    #[arg(short, long, alias = "output", value_name = "DIR")]
    out: Option<PathBuf>,
    /// Output form.
    #[arg(long, value_enum, default_value_t = Format::Human)]
    format: Format,
    // Last, for its help heading holds for what follows it.
    #[command(flatten)]
    shader: ShaderArgs,
}

#[derive(Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum TimeArg {
    /// Nothing.
    No,
    /// The first camera in the first order.
    Headline,
    /// The first frame of every camera in every order.
    FirstFrames,
    /// Every compared frame in every order; camera paths then get their 95th percentile.
    Everything,
}

#[derive(Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum FormArg {
    /// What users ship.
    Text,
    /// naga IR.
    Ir,
}

/// Reads `WxH`.
pub fn parse_size(text: &str) -> Result<[u32; 2], String> {
    let (w, h) = text
        .split_once(['x', 'X'])
        .ok_or("expected WxH, 1920x1080 say")?;
    let side = |s: &str| match s.trim().parse::<u32>() {
        Ok(n @ 1..=8192) => Ok(n),
        _ => Err(format!("`{s}` is not a number from 1 to 8192")),
    };
    Ok([side(w)?, side(h)?])
}

/// A draw order, by its name in scene files.
#[derive(Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum OrderArg {
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

/// What a sweep moves.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Axis {
    variable: String,
    values: Vec<u32>,
}

/// Reads `NAME=A..B[:STEPS]`: steps of one ratio, as near to doubling as it goes where none are given.
fn parse_sweep(text: &str) -> Result<Axis, String> {
    let expected = "expected NAME=A..B[:STEPS], instances=50000..400000 say";
    let (variable, range) = text.split_once('=').ok_or(expected)?;
    let (range, steps) = match range.split_once(':') {
        Some((range, steps)) => (range, Some(steps)),
        None => (range, None),
    };
    let (low, high) = range.split_once("..").ok_or(expected)?;
    let number = |s: &str| match s.trim().replace('_', "").parse::<u32>() {
        Ok(n @ 1..) => Ok(n),
        _ => Err(format!("`{s}` is not a whole number from 1")),
    };
    let (low, high) = (number(low)?, number(high)?);
    if low > high {
        return Err(format!("{low} is more than {high}"));
    }
    let ratio = f64::from(high) / f64::from(low);
    let steps = match steps {
        Some(steps) => match number(steps)? {
            n @ 2..=64 => n,
            n => return Err(format!("{n} steps: 2 to 64 are allowed")),
        },
        None => ratio.log2().round() as u32 + 1,
    };
    let mut values: Vec<u32> = (0..steps)
        .map(|i| {
            let part = f64::from(i) / f64::from((steps - 1).max(1));
            (f64::from(low) * ratio.powf(part)).round() as u32
        })
        .collect();
    values.dedup();
    Ok(Axis {
        variable: variable.trim().to_owned(),
        values,
    })
}

/// Reads a number of frames.
fn parse_frames(text: &str) -> Result<usize, String> {
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

/// The variants `verify` draws when none are named.
const DEFAULT: [&str; 3] = ["depth-prepass", "depth-prepass:form=equal", "early-discard"];

/// Verifies a scene or a shader.
pub fn run(args: &Args) -> Result<Outcome, Failure> {
    let recipes = recipes(args)?;
    let first = match &args.sweep {
        None => scene(args, &Variables::new())?,
        Some(axis) => scene_at(args, axis, axis.values.first().copied().unwrap_or(1))?,
    };
    let shared = args.share.as_deref().and_then(Path::parent);
    for dir in args.out.as_deref().into_iter().chain(shared) {
        check_folder(dir)?;
    }
    if !args.shader.is_scene()
        && let Some(note) = guesses(&first)
    {
        output::message(&note);
    }
    let choice = args
        .adapter
        .clone()
        .map_or(AdapterChoice::Best, AdapterChoice::Matching);
    let gpu = Gpu::new(&choice)?;
    let bar = bar();
    let Some(axis) = &args.sweep else {
        let outcome = measure(args, &gpu, &first, recipes, &bar)?;
        bar.finish_and_clear();
        return told(args, &outcome);
    };
    let mut points = Vec::new();
    let mut pictures = Vec::new();
    for value in &axis.values {
        let scene = scene_at(args, axis, *value)?;
        let outcome = measure(args, &gpu, &scene, recipes.clone(), &bar)?;
        bar.suspend(|| output::message(&format!("{} = {value}", axis.variable)));
        pictures = outcome.pictures;
        points.push(Point {
            value: *value,
            report: outcome.report,
        });
    }
    bar.finish_and_clear();
    let sweep = Sweep::new(&axis.variable, points);
    match args.format {
        Format::Human => output::data(&report::sweep::render(&sweep))?,
        Format::Json => output::data(&sweep.to_json()?)?,
    }
    share(args, &sweep.to_json()?)?;
    let mut files = vec![file("sweep.json", sweep.to_json()?)];
    files.extend(report::sweep::svg(&sweep).map(|svg| file("sweep.svg", svg)));
    write(args, files, &pictures)?;
    Ok(if sweep.is_broken() {
        Outcome::ContractBroken
    } else {
        Outcome::Fine
    })
}

fn file(name: &str, text: String) -> preshade::emit::File {
    preshade::emit::File {
        name: name.to_owned(),
        bytes: text.into_bytes(),
    }
}

/// Tells of one scene.
fn told(args: &Args, outcome: &measure::Outcome) -> Result<Outcome, Failure> {
    // Told before it is written: a full disk does not lose what was measured.
    let json = outcome.report.to_json()?;
    match args.format {
        Format::Human => output::data(&report::table::render(&outcome.report))?,
        Format::Json => output::data(&json)?,
    }
    share(args, &json)?;
    write(args, vec![file("report.json", json)], &outcome.pictures)?;
    Ok(if outcome.report.is_broken() {
        Outcome::ContractBroken
    } else {
        Outcome::Fine
    })
}

/// Writes what `--share` asks for.
fn share(args: &Args, json: &str) -> Result<(), Failure> {
    let Some(path) = &args.share else {
        return Ok(());
    };
    std::fs::write(path, json).map_err(|e| Failure(format!("error: {}: {e}", path.display())))?;
    output::message(&format!("wrote {}", path.display()));
    Ok(())
}

/// Writes what `--out` asks for.
fn write(
    args: &Args,
    mut files: Vec<preshade::emit::File>,
    pictures: &[report::Pictures],
) -> Result<(), Failure> {
    let Some(dir) = &args.out else { return Ok(()) };
    for pictures in pictures {
        for file in pictures.files()? {
            if !files.iter().any(|f| f.name == file.name) {
                files.push(file);
            }
        }
    }
    preshade::emit::write(dir, &files).map_err(|e| Failure(format!("error: {e}")))?;
    output::message(&format!("wrote {} files to {}", files.len(), dir.display()));
    Ok(())
}

/// The scene at one value of a sweep.
fn scene_at(args: &Args, axis: &Axis, value: u32) -> Result<Scene, Failure> {
    let set = Variables::from([(axis.variable.clone(), Variable::Number(value))]);
    scene(args, &set)
}

/// Measures one scene.
fn measure(
    args: &Args,
    gpu: &Gpu,
    scene: &Scene,
    recipes: Vec<Recipe>,
    bar: &ProgressBar,
) -> Result<measure::Outcome, Failure> {
    let form = match args.form {
        FormArg::Text => ShaderForm::Text,
        FormArg::Ir => ShaderForm::Ir,
    };
    bar.set_message("looking for depth ties");
    let mut facts = measure::facts(gpu, scene, form, measure::counting).unwrap_or_else(|e| {
        bar.suspend(|| {
            output::message(&format!("warning: depth ties were not measured: {e}"));
        });
        Facts::default()
    });
    let recipes = choose(gpu, scene, form, recipes, &mut facts, bar)?;
    let originals = measure::originals(scene);
    let variants: Vec<_> = recipes
        .iter()
        .map(|r| measure::variant(&originals, r, &facts))
        .collect();
    let settings = Settings {
        form,
        timed: match args.time {
            TimeArg::No => Timed::No,
            TimeArg::Headline => Timed::Headline,
            TimeArg::FirstFrames => Timed::FirstFrames,
            TimeArg::Everything => Timed::Everything,
        },
        timing: TimingSettings {
            budget: Duration::from_secs_f64(args.seconds),
            ..TimingSettings::default()
        },
        frames_per_camera: args.frames,
        count: &measure::counting,
        command: command(),
    };
    Ok(measure::verify(
        gpu,
        scene,
        &variants,
        &settings,
        &mut |p| {
            bar.set_position((p.done * 1000.0) as u64);
            bar.set_message(p.what);
        },
    )?)
}

/// Recipes whose choices are left to measurement, chosen.
fn choose(
    gpu: &Gpu,
    scene: &Scene,
    form: ShaderForm,
    recipes: Vec<Recipe>,
    facts: &mut Facts,
    bar: &ProgressBar,
) -> Result<Vec<Recipe>, Failure> {
    if !recipes.iter().any(measure::leaves_a_choice) {
        return Ok(recipes);
    }
    bar.set_message("measuring what can be interpolated");
    facts.frequencies = measure::frequencies(gpu, scene, form, &mut |done| {
        bar.set_position((done * 1000.0) as u64);
    })?;
    recipes
        .into_iter()
        .map(|recipe| {
            bar.set_message(format!("choosing within the budget of {recipe}"));
            match measure::leaves_a_choice(&recipe) {
                true => {
                    let chosen = measure::within_budget(gpu, scene, &recipe, facts, form)?;
                    if let Some(written) = measure::written_out(&chosen, facts) {
                        let steps: Vec<String> = written
                            .steps
                            .iter()
                            .map(|step| format!("--pass {step}"))
                            .collect();
                        bar.suspend(|| {
                            output::message(&format!(
                                "{recipe}: chosen by measurement; `rewrite` makes the same of {}",
                                steps.join(" ")
                            ));
                        });
                    }
                    Ok(chosen)
                }
                false => Ok(recipe),
            }
        })
        .collect()
}

/// Whether `dir` is a folder that can be written to, or can become one: before anything is drawn, so that a slip costs no minute. Nothing is left
/// behind.
fn check_folder(dir: &Path) -> Result<(), Failure> {
    let here = Path::new(".");
    let there = dir
        .ancestors()
        .map(|d| if d.as_os_str().is_empty() { here } else { d })
        .find(|d| d.exists())
        .unwrap_or(here);
    if !there.is_dir() {
        return Err(Failure(format!(
            "error: {}: {} is not a folder",
            dir.display(),
            there.display()
        )));
    }
    // Permissions say less than trying: file systems are mounted read-only, and some users may do anything.
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

/// What a bare shader was given without having said so.
fn guesses(scene: &Scene) -> Option<String> {
    let guessed = scene::bind::guessed(scene);
    let widest = guessed.iter().map(|g| g.name.len()).max()?;
    let mut lines = vec![format!(
        "note: a scene was made up for `{}`, with these inputs guessed (a scene file says them: docs/scenes.md)",
        scene.name
    )];
    lines.extend(
        guessed
            .iter()
            .map(|g| format!("  {:<widest$}  {}", g.name, g.guess)),
    );
    Some(lines.join("\n"))
}

fn recipes(args: &Args) -> Result<Vec<Recipe>, Failure> {
    let mut recipes = args
        .passes
        .iter()
        .map(|p| Recipe::parse([p]))
        .collect::<Result<Vec<_>, _>>()?;
    for list in &args.recipes {
        recipes.push(Recipe::parse_list(list)?);
    }
    if recipes.is_empty() {
        recipes = DEFAULT
            .iter()
            .map(|p| Recipe::parse([p]))
            .collect::<Result<_, _>>()?;
    }
    Ok(recipes)
}

/// The scene asked for, under the set-up asked for.
fn scene(args: &Args, variables: &Variables) -> Result<Scene, Failure> {
    let mut scene = args.shader.scene_with(variables)?;
    if let Some(size) = args.size {
        scene = scene.resized(size);
    }
    if args.invariant {
        scene = scene.with_invariant_positions();
    }
    if !args.camera.is_empty() {
        let all = std::mem::take(&mut scene.cameras);
        for name in &args.camera {
            match all.iter().find(|c| c.name == *name) {
                Some(camera) => scene.cameras.push(camera.clone()),
                None => {
                    let names: Vec<_> = all.iter().map(|c| c.name.as_str()).collect();
                    return Err(Failure::unknown("camera", name, &names));
                }
            }
        }
    }
    if !args.order.is_empty() {
        scene.orders = args.order.iter().map(|o| DrawOrder::from(*o)).collect();
    }
    Ok(scene)
}

fn bar() -> ProgressBar {
    if !std::io::stderr().is_terminal() {
        return ProgressBar::hidden();
    }
    let bar = ProgressBar::new(1000);
    if let Ok(style) = ProgressStyle::with_template("{bar:30} {elapsed} {wide_msg}") {
        bar.set_style(style);
    }
    bar
}

/// The command as it was typed, without the folder of the binary.
fn command() -> String {
    let mut words = vec!["preshade".to_owned()];
    words.extend(std::env::args().skip(1));
    words.join(" ")
}
