//! `preshade verify`: a scene drawn with the original and its variants, what each costs in accuracy and gains in time.

use std::io::IsTerminal;
use std::path::{Path, PathBuf};
use std::time::Duration;

use indicatif::{ProgressBar, ProgressStyle};
use preshade::measure::{self, Settings, Timed, TimingSettings};
use preshade::passes::pass::Facts;
use preshade::passes::state::DepthDirection;
use preshade::recipe::Recipe;
use preshade::render::{AdapterChoice, Gpu, ShaderForm};
use preshade::report;
use preshade::scene::{self, DrawOrder, Scene};

use crate::input::ShaderArgs;
use crate::{Failure, Format, Outcome};

/// Arguments of `verify`.
#[derive(clap::Args)]
pub struct Args {
    /// A scene (.toml), or a shader to synthesise one for.
    #[command(flatten)]
    shader: ShaderArgs,
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
    #[arg(long, value_name = "ORDER", value_parser = parse_order)]
    order: Vec<DrawOrder>,
    /// Resolution, `1920x1080` say.
    #[arg(long, value_name = "WxH", value_parser = parse_size)]
    size: Option<[u32; 2]>,
    /// Hold variants against the original with @invariant on its position.
    #[arg(long)]
    invariant: bool,
    /// Frames of each camera path to compare, evenly spaced.
    #[arg(long, value_name = "N", default_value_t = 8)]
    frames: usize,
    /// Views to time.
    #[arg(long, value_enum, default_value_t = TimeArg::FirstFrames)]
    time: TimeArg,
    /// Seconds to spend on timing each view.
    #[arg(long, value_name = "SECONDS", default_value_t = 4.0)]
    seconds: f64,
    /// Part of an adapter's name, driver or backend.
    #[arg(long, value_name = "TEXT")]
    adapter: Option<String>,
    /// Give shaders to the driver as emitted text, or as IR.
    #[arg(long, value_enum, default_value_t = FormArg::Text)]
    form: FormArg,
    /// Folder for pictures and `report.json`.
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Output form.
    #[arg(long, value_enum, default_value_t = Format::Human)]
    format: Format,
}

#[derive(Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum TimeArg {
    /// Nothing.
    No,
    /// The first camera in the first order.
    Headline,
    /// The first frame of every camera in every order.
    FirstFrames,
    /// Every frame in every order.
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

fn parse_order(text: &str) -> Result<DrawOrder, String> {
    serde_json::from_value(serde_json::Value::String(text.to_owned())).map_err(|e| e.to_string())
}

/// The variants `verify` draws when none are named.
const DEFAULT: [&str; 3] = ["depth-prepass", "depth-prepass:form=equal", "early-discard"];

/// Verifies a scene or a shader.
pub fn run(args: &Args) -> Result<Outcome, Failure> {
    let recipes = recipes(args)?;
    let scene = scene(args)?;
    let choice = args
        .adapter
        .clone()
        .map_or(AdapterChoice::Best, AdapterChoice::Matching);
    let gpu = Gpu::new(&choice)?;
    let bar = bar();
    let form = match args.form {
        FormArg::Text => ShaderForm::Text,
        FormArg::Ir => ShaderForm::Ir,
    };
    bar.set_message("looking for depth ties");
    let facts = measure::facts(&gpu, &scene, form, measure::counting).unwrap_or_else(|e| {
        eprintln!("warning: depth ties were not measured: {e}");
        Facts::default()
    });
    let originals = measure::originals(&scene);
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
            budget: Duration::from_secs_f64(args.seconds.clamp(0.0, 3600.0)),
            ..TimingSettings::default()
        },
        frames_per_camera: args.frames,
        count: &measure::counting,
        command: command(),
    };
    let outcome = measure::verify(&gpu, &scene, &variants, &settings, &mut |p| {
        bar.set_position((p.done * 1000.0) as u64);
        bar.set_message(p.what);
    })?;
    bar.finish_and_clear();
    if let Some(dir) = &args.out {
        let mut files = vec![preshade::emit::File {
            name: "report.json".to_owned(),
            bytes: outcome.report.to_json()?.into_bytes(),
        }];
        for pictures in &outcome.pictures {
            for file in pictures.files()? {
                if !files.iter().any(|f| f.name == file.name) {
                    files.push(file);
                }
            }
        }
        preshade::emit::write(dir, &files)
            .map_err(|e| Failure(format!("error: {}: {e}", dir.display())))?;
        eprintln!("wrote {} files to {}", files.len(), dir.display());
    }
    match args.format {
        Format::Human => print!("{}", report::table::render(&outcome.report)),
        Format::Json => print!("{}", outcome.report.to_json()?),
    }
    Ok(if outcome.report.is_broken() {
        Outcome::ContractBroken
    } else {
        Outcome::Fine
    })
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
fn scene(args: &Args) -> Result<Scene, Failure> {
    let toml = args
        .shader
        .files
        .iter()
        .find(|f| f.extension().is_some_and(|e| e == "toml"));
    let state = &args.shader.state;
    let mut scene = match toml {
        Some(path) if args.shader.files.len() == 1 => {
            scene::load(Path::new(path)).map_err(|e| Failure(e.render()))?
        }
        Some(_) => {
            return Err(Failure(
                "error: a scene file stands alone: its materials name their shaders".to_owned(),
            ));
        }
        None => scene::synthesise(args.shader.parse()?, state.state()?),
    };
    if toml.is_some() {
        let format = state.depth_format.unwrap_or(scene.depth_format);
        let direction = if state.reversed_z {
            DepthDirection::Reversed
        } else {
            scene.depth_direction
        };
        if (format, direction) != (scene.depth_format, scene.depth_direction) {
            scene = scene.with_depth(format, direction);
        }
        if let Some(samples) = &state.samples {
            scene = scene.with_samples(if samples == "4" { 4 } else { 1 });
        }
    }
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
                    return Err(Failure(format!(
                        "error: the scene has no camera `{name}`; it has: {}",
                        names.join(", ")
                    )));
                }
            }
        }
    }
    if !args.order.is_empty() {
        scene.orders = args.order.clone();
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
