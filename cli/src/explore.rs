//! `preshade explore`: finds the recipes with the best trade between accuracy and time.

use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

use preshade_draw::render::{self};
use preshade_draw::scene::DrawOrder;
use preshade_lab::measure::parse_seconds;
use preshade_lab::measure::record::Report;
use preshade_lab::search::explore::{self, Journal, Settings};
use preshade_lab::verify::grouped;
use preshade_lab::{measure, report};
use preshade_passes::transforms::specialize::SpecializeParams;
use preshade_plan::budget::{Budget, Metric};
use preshade_scenes::ShaderForm;
use shader_text::files::File;
use shader_text::limits::Limits;

use crate::input::ShaderArgs;
use crate::variants::VariantArgs;
use crate::verify::{FormArg, OrderArg, check_budget, check_folder, command, recipes};
use crate::view::ViewArgs;
use crate::{Ending, Failure, Table, evaluate, flags, guesses, materials, output, results, worker};

#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  preshade explore scene.toml
  preshade explore scene.toml --budget flip_mean=0.02 --out report/     report/report.html
  preshade explore lit.wgsl --seconds 20
  preshade explore scenes/ --results results.json         over all adapters of `merge`, no GPU
  preshade explore scene.toml --variant hoist:budget=1,threshold=1,tessellate:level=1..12,form=all

Looks at ways to shade fewer fragments and at ways to compute less in one, alone and then the best
of them together; drops on the way what another beats in both error and time, beyond the intervals;
verifies what is left along every camera's path. With --out what was measured is kept: the same
command again goes on where it ended, also after Ctrl-C.
Exit status 1: a finalist broke its contract. 3: nothing was measured but the original.")]
pub struct ExploreArgs {
    /// Search only as far as this error: flip_mean, flip_p99, flip_tile or max_abs. It is the metric of the
    /// frontier too; default: flip_mean, without an end.
    #[arg(long, value_name = "METRIC=NUMBER", value_parser = Budget::parse)]
    budget: Option<Budget>,
    #[command(flatten)]
    variants: VariantArgs,
    #[command(flatten)]
    view: ViewArgs,
    /// Draw in this order; default: the scene's first.
    #[arg(long, value_name = "ORDER", value_enum)]
    order: Option<OrderArg>,
    /// Seconds to spend in all, on each scene.
    #[arg(long, value_name = "SECONDS", default_value_t = 45.0, value_parser = parse_seconds)]
    seconds: f64,
    /// Most candidates to draw.
    #[arg(long, value_name = "N", default_value_t = 64)]
    candidates: usize,
    /// Most of them to verify at the end.
    #[arg(long, value_name = "N", default_value_t = 8)]
    finalists: usize,
    /// Frames of each camera path to verify them on, evenly spaced.
    #[arg(long, value_name = "N", default_value_t = 8)]
    frames: usize,
    /// Seed of the confidence intervals.
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// Draw nothing: take the worst error and the mean speedup over the adapters of these merged results.
    #[arg(long, value_name = "FILE", conflicts_with_all = MEASURES)]
    results: Option<PathBuf>,
    /// Part of an adapter's name, driver or backend.
    #[arg(long, value_name = "TEXT")]
    adapter: Option<String>,
    /// Give shaders to the driver as emitted text, or as IR.
    #[arg(long, value_enum, default_value_t = FormArg::Text)]
    form: FormArg,
    /// Folder for `report.html`, `report.json`, `report.csv`, and what was measured.
    #[arg(short, long, alias = "output", value_name = "DIR")]
    out: Option<PathBuf>,
    /// Output form.
    #[arg(long, value_enum, default_value_t = Table::Human)]
    format: Table,
    /// Of a folder, scenes at once, each in a process of its own. While one is timed, the others compile and
    /// compare. Waiting counts as time.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..))]
    workers: Option<u16>,
    // Last, because its help heading applies to all following arguments.
    #[command(flatten)]
    pub shader: ShaderArgs,
    /// The flags in effect, as words.
    #[arg(skip)]
    pub flags: Vec<String>,
}

impl ExploreArgs {
    /// The folder of a scene below `--out`.
    fn folder_of(&self, scene: &Path) -> Option<PathBuf> {
        let out = self.out.as_ref();
        out.map(|out| materials::folder_of(out, scene))
    }
}

/// Flags that choose the measurements.
const MEASURES: [&str; 15] = [
    "adapter",
    "camera",
    "candidates",
    "finalists",
    "form",
    "frames",
    "order",
    "passes",
    "recipes",
    "seconds",
    "seed",
    "set",
    "size",
    "variants",
    "workers",
];

/// Size on a software adapter, if none is given: a search then takes less than a minute on two cores.
const SOFTWARE_SIZE: [u32; 2] = [480, 270];

/// Name of the journal's file.
const JOURNAL: &str = "measured.jsonl";

/// How often Ctrl-C was pressed.
static INTERRUPTS: AtomicU32 = AtomicU32::new(0);

/// Explores a scene or a shader, or each scene of a folder.
pub fn run(args: &ExploreArgs) -> Result<Ending, Failure> {
    if let Some(file) = &args.results {
        let to = results::To {
            format: args.format,
            out: args.out.as_deref(),
        };
        return results::explore(
            file,
            &materials::drawn(args.shader.clone())?,
            args.budget,
            &to,
        );
    }
    if !args.shader.files.iter().any(|f| f.is_dir()) {
        return one(args, &args.shader, args.out.as_deref());
    }
    let scenes = materials::scenes(&args.shader.files)?;
    if scenes.len() > 1 && args.format != Table::Human {
        return Err(Failure(
            "error: --format json and csv are of one scene; of several --out keeps one each"
                .to_owned(),
        ));
    }
    if args.out.is_some() {
        materials::told_apart(&scenes)?;
    }
    let count = scenes.len();
    let ended = match args.workers {
        None | Some(1) => in_order(args, scenes),
        Some(n) => side_by_side(args, scenes, usize::from(n))?,
    };
    let (mut outcome, mut failed) = (Ending::Fine, Vec::new());
    for (name, ended) in ended {
        match ended {
            Ok(Ending::Fine | Ending::NotMeasured) => {}
            Ok(Ending::ContractBroken) => outcome = Ending::ContractBroken,
            Err(_) => failed.push(name),
        }
    }
    match failed.is_empty() {
        true => Ok(outcome),
        false => Err(Failure::of_inputs(&failed, count)),
    }
}

/// How the search of a scene ended, by the scene's path.
type Ended = (String, Result<Ending, Failure>);

/// A failing scene is reported and does not stop the others.
fn tell_failure(name: &str, ended: &Result<Ending, Failure>) {
    if let Err(Failure(why)) = ended {
        let why = why.strip_prefix("error: ").unwrap_or(why);
        output::message(&format!("error: {name}: {why}"));
    }
}

/// Explores scenes one after the other.
fn in_order(args: &ExploreArgs, scenes: Vec<PathBuf>) -> Vec<Ended> {
    let mut all = Vec::new();
    for scene in scenes {
        let name = scene.display().to_string();
        let out = args.folder_of(&scene);
        let shader = ShaderArgs {
            files: vec![scene],
            ..args.shader.clone()
        };
        let ended = one(args, &shader, out.as_deref());
        tell_failure(&name, &ended);
        all.push((name, ended));
        if INTERRUPTS.load(Ordering::Relaxed) > 0 {
            break;
        }
    }
    all
}

/// Explores scenes in processes of their own, which take turns on the cards.
fn side_by_side(
    args: &ExploreArgs,
    scenes: Vec<PathBuf>,
    workers: usize,
) -> Result<Vec<Ended>, Failure> {
    let models = evaluate::models(render::cards(), args.adapter.as_deref())?;
    let model = models
        .first()
        .ok_or_else(|| Failure("error: there is no adapter".to_owned()))?;
    end_on_interrupt();
    let words = flags::without(&args.flags, &["adapter", "out", "workers"]);
    let all = Mutex::new(Vec::new());
    worker::each(workers, &scenes, |_, scene| {
        if INTERRUPTS.load(Ordering::Relaxed) > 0 {
            return ControlFlow::Break(());
        }
        let out = args.folder_of(scene);
        let ended = elsewhere(model, &words, scene, (out.as_deref(), args.seconds));
        let name = scene.display().to_string();
        let mut all = all.lock().unwrap_or_else(PoisonError::into_inner);
        tell_failure(&name, &ended);
        all.push((name, ended));
        ControlFlow::Continue(())
    });
    Ok(all.into_inner().unwrap_or_else(PoisonError::into_inner))
}

/// Explores one scene in a process of its own.
fn elsewhere(
    model: &evaluate::Model,
    words: &[String],
    scene: &Path,
    (out, seconds): (Option<&Path>, f64),
) -> Result<Ending, Failure> {
    let failed = |why: String| Failure(format!("error: {why}"));
    let seat = model.take()?;
    let mut command = seat.command()?;
    command.arg("explore").arg(seat.adapter()).args(words);
    if let Some(out) = out {
        command.arg("--out").arg(out);
    }
    command.arg("--").arg(scene);
    // Only a measurement that hangs goes on for so long.
    let seconds = worker::OF_AN_INPUT + seconds as u64;
    let ended = worker::watched(command, &Limits::default(), seconds).map_err(failed)?;
    let status = ended.status.clone().map_err(failed)?;
    ended.told.iter().for_each(|line| output::message(line));
    output::table(ended.out.trim_end())?;
    match status.code() {
        Some(0) => Ok(Ending::Fine),
        Some(1) => Ok(Ending::ContractBroken),
        Some(3) => Ok(Ending::NotMeasured),
        _ => Err(failed(format!("its process ended with {status}"))),
    }
}

/// The first Ctrl-C ends the search and prints its results; the second ends the process. Without a
/// handler, the first does.
fn end_on_interrupt() {
    let _ = ctrlc::set_handler(|| {
        if INTERRUPTS.fetch_add(1, Ordering::Relaxed) > 0 {
            std::process::exit(130);
        }
    });
}

/// Explores one scene or shader.
fn one(args: &ExploreArgs, shader: &ShaderArgs, out: Option<&Path>) -> Result<Ending, Failure> {
    let recipes = recipes(&args.variants.sweeps()?);
    let mut scene = args.view.of(shader.on(args.adapter.as_deref()).scene()?)?;
    if let Some(order) = args.order {
        scene.orders = vec![DrawOrder::from(order)];
    }
    check_budget(&scene, args.budget)?;
    let effects = measure::effects(&scene).unwrap_or_default();
    // Without a list of recipes, the search tries to specialise.
    scene = match recipes.is_empty() {
        true => measure::grouped(&scene, &SpecializeParams::default(), measure::MOST_GROUPS)?,
        false => grouped(scene, &recipes)?,
    };
    if let Some(dir) = out {
        check_folder(dir)?;
    }
    let gpu = worker::open(args.adapter.as_deref(), &args.shader.limits.limits())?;
    guesses::tell(&scene);
    scene = args.view.reduced(scene, &gpu, SOFTWARE_SIZE);
    let mut journal = match out {
        None => Journal::new(),
        Some(dir) => Journal::open(&dir.join(JOURNAL))
            .map_err(|e| Failure(format!("error: {}: {e}", dir.join(JOURNAL).display())))?,
    };
    let missing = journal.missing();
    if !missing.is_empty() {
        output::message(&format!(
            "note: a search before this one ended without {} of its candidates: {}",
            missing.len(),
            missing.join(", ")
        ));
    }
    let settings = Settings {
        form: match args.form {
            FormArg::Text => ShaderForm::Text,
            FormArg::Ir => ShaderForm::Ir,
        },
        metric: args.budget.map_or_else(Metric::default, |b| b.metric),
        budget: args.budget.map(|b| b.limit),
        recipes,
        time: Duration::from_secs_f64(args.seconds),
        most: args.candidates,
        finalists: args.finalists,
        frames_per_camera: args.frames,
        seed: args.seed,
        command: command(),
    };
    end_on_interrupt();
    let bar = output::bar();
    let found = explore::explore(&gpu, &scene, &settings, &mut journal, &mut |p| {
        bar.set_position((p.done * 1000.0) as u64);
        bar.set_message(format!("{:.0} s left, {}", p.left.as_secs_f64(), p.what));
        match INTERRUPTS.load(Ordering::Relaxed) {
            0 => ControlFlow::Continue(()),
            _ => ControlFlow::Break(()),
        }
    })?;
    bar.finish_and_clear();
    if let Some(trouble) = journal.trouble() {
        output::message(&format!(
            "warning: what was measured is not kept: {trouble}"
        ));
    }
    let exploration = &found.exploration;
    let forms = output::Answer {
        table: report::frontier::table(exploration),
        json: serde_json::to_string_pretty(exploration)? + "\n",
        csv: report::frontier::csv(exploration),
    };
    forms.tell(args.format, out, |dir| {
        let page = report::html::explore::page(&found, &scene, &effects)?;
        let files = [
            File::text("report.html", page),
            File::text("report.json", forms.json.clone()),
            File::text("report.csv", forms.csv.clone()),
        ];
        shader_text::files::write(dir, &files)?;
        output::message(&format!("wrote {}", dir.join("report.html").display()));
        Ok(())
    })?;
    let is_broken = exploration.report.as_ref().is_some_and(Report::is_broken);
    let is_unmeasured = report::frontier::is_unmeasured(exploration);
    Ok(Ending::of(is_broken, is_unmeasured))
}
