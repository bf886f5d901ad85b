//! `xtask bench`: the yardstick. Times the frozen hand-written shaders of `fixtures/handwritten`
//! against generated ones from the same forward entry points, A B B A in one process.

use std::collections::BTreeMap;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::Duration;

use preshade_compiler::front::{self, Parsed, Source};
use preshade_compiler::recipe::Recipe;
use preshade_draw::render::{AdapterChoice, Gpu};
use preshade_draw::scene::{Material, Mesh, Scene, Value};
use preshade_lab::measure::{
    self, Estimate, Session, TimingSettings, handmade, parse_seconds, parse_size,
};
use preshade_plan::pass::Facts;
use preshade_plan::plan::{
    Attachment, BindingKind, BindingSource, BindingUse, Draws, Phase, Plan, Role,
};
use preshade_plan::reflect;
use preshade_plan::state::{CompareFunction, CullMode, DepthBias, MaterialState};
use preshade_scenes::ShaderForm;
use serde::Serialize;
use shader_text::options::Options;

use crate::Failure;

mod grass;
mod museum;

/// Compares frozen hand-written shaders with preshade's variants of the same entry points.
#[derive(clap::Args)]
#[command(after_help = "\
Examples, from the root of the repository:
  cargo run --release -p xtask -- bench
  cargo run --release -p xtask -- bench --layers 4 --size 320x180 --seconds 0.2 --format json")]
pub struct BenchArgs {
    /// The hand-written reference.
    #[arg(
        long,
        value_name = "FILE",
        default_value = "fixtures/handwritten/bounds.wgsl"
    )]
    reference: PathBuf,
    /// Resolution; default 1920x1080, or 320x180 on a software adapter.
    #[arg(long, value_name = "WxH", allow_hyphen_values = true, value_parser = parse_size)]
    size: Option<[u32; 2]>,
    /// Layers of noise, one over the other.
    #[arg(long, value_delimiter = ',', default_value = "4,16", value_name = "N,..", value_parser = clap::value_parser!(u32).range(1..=256))]
    layers: Vec<u32>,
    /// Quads along each side of the layer that is hoisted.
    #[arg(long, value_delimiter = ',', default_value = "16,64,256", value_name = "N,..", value_parser = clap::value_parser!(u32).range(1..=1024))]
    grids: Vec<u32>,
    /// Instances of grass: hand-written visibility buffers beside generated ones. Default: none.
    #[arg(long, value_delimiter = ',', value_name = "N,..", value_parser = clap::value_parser!(u32).range(1..=4_000_000))]
    grass: Vec<u32>,
    /// Exhibits of this scene: hand-specialised materials, beside the reference, against generated
    /// ones. Default: none.
    #[arg(long, value_name = "SCENE")]
    museum: Option<PathBuf>,
    /// Seconds to spend on each pair.
    #[arg(long, value_name = "SECONDS", default_value_t = 1.5, value_parser = parse_seconds)]
    seconds: f64,
    /// Part of an adapter's name, driver or backend.
    #[arg(long, env = "PRESHADE_ADAPTER", value_name = "TEXT")]
    adapter: Option<String>,
    /// Output form.
    #[arg(long, value_enum, default_value_t = Format::Human)]
    format: Format,
}

#[derive(Clone, Copy, clap::ValueEnum)]
enum Format {
    /// For people.
    Human,
    /// For programs.
    Json,
}

#[derive(Serialize)]
struct Yardstick {
    schema: &'static str,
    resolution: [u32; 2],
    adapter: preshade_draw::render::AdapterReport,
    rows: Vec<BenchRow>,
}

#[derive(Serialize)]
struct BenchRow {
    /// Quads along each side of a layer.
    grid: u32,
    layers: u32,
    order: &'static str,
    form: &'static str,
    recipe: &'static str,
    /// Milliseconds a frame, of the forward entry points.
    forward_ms: Estimate,
    handwritten_ms: Estimate,
    generated_ms: Estimate,
    /// Time of the hand-written form over the generated one's: 1.00 is as good, more is better.
    ratio: Estimate,
    changed_pixels: u64,
}

/// The hand-written forms, and the recipe that should match each.
const FORMS: [(&str, &str); 4] = [
    ("pre-pass EQUAL", "depth-prepass:form=equal"),
    ("pre-pass biased", "depth-prepass:form=biased"),
    ("prologue", "early-discard:quad=lane,tolerance=0.0001"),
    ("quad vote", "early-discard:quad=vote,tolerance=0.0001"),
];

/// The hand-written hoist, and the recipe that should match it.
const HOISTED: [(&str, &str); 1] = [(
    "vertex hoist",
    "hoist:budget=1,finite=assumed,jumps=carried",
)];

const ORDERS: [(&str, u32); 3] = [("back to front", 0), ("shuffled", 2), ("front to back", 1)];

pub fn run(args: &BenchArgs) -> Result<(), Failure> {
    let gpu = Gpu::new(
        &args
            .adapter
            .clone()
            .map_or(AdapterChoice::Best, AdapterChoice::Matching),
    )?;
    let size = args.size.unwrap_or(if gpu.adapter().kind == "software" {
        [320, 180]
    } else {
        [1920, 1080]
    });
    let text = read(&args.reference)?;
    let timing = TimingSettings {
        budget: Duration::from_secs_f64(args.seconds),
        ..TimingSettings::default()
    };
    let mut rows = Vec::new();
    let unknown = Facts::without_ties();
    for layers in &args.layers {
        for (order, number) in ORDERS {
            let stack = Stack {
                grid: 16,
                layers: *layers,
                order,
                number,
            };
            let scene = scene(&text, size, &stack)?;
            rows.extend(compare(
                &gpu,
                &scene,
                (&stack, &unknown),
                &FORMS,
                handwritten,
                &timing,
            )?);
        }
    }
    for grid in &args.grids {
        let stack = Stack {
            grid: *grid,
            layers: 1,
            order: "-",
            number: 0,
        };
        let scene = scene(&text, size, &stack)?;
        rows.extend(compare(
            &gpu,
            &scene,
            (&stack, &unknown),
            &HOISTED,
            handwritten,
            &timing,
        )?);
    }
    for count in &args.grass {
        let stack = Stack {
            grid: 1,
            layers: *count,
            order: "grass",
            number: 0,
        };
        let scene = grass::scene(&text, size, *count)?;
        rows.extend(compare(
            &gpu,
            &scene,
            (&stack, &unknown),
            &grass::FORMS,
            grass::handwritten,
            &timing,
        )?);
    }
    for kind in args.museum.iter().flat_map(|_| museum::KINDS) {
        let Some(path) = &args.museum else { continue };
        let folder = args.reference.parent().unwrap_or_else(|| Path::new("."));
        let (scene, facts) = museum::scene(path, size, kind)?;
        let stack = Stack {
            grid: 1,
            layers: scene.draws.len() as u32,
            order: "museum",
            number: 0,
        };
        rows.extend(compare(
            &gpu,
            &scene,
            (&stack, &facts),
            &[(kind, museum::RECIPE)],
            |_, kind| museum::handwritten(&scene, folder, kind),
            &timing,
        )?);
    }
    let report = Yardstick {
        schema: "preshade.bench.v1",
        resolution: size,
        adapter: gpu.adapter().clone(),
        rows,
    };
    let text = match args.format {
        Format::Json => serde_json::to_string_pretty(&report)?,
        Format::Human => table(&report),
    };
    Ok(writeln!(std::io::stdout(), "{text}")?)
}

fn read(path: &Path) -> Result<String, Failure> {
    Ok(std::fs::read_to_string(path).map_err(|e| format!("{}: {e}", path.display()))?)
}

/// The frozen shaders, with these entry points.
fn parse(text: &str, [vertex, fragment]: [&str; 2]) -> Result<Parsed, Failure> {
    let options = Options {
        vertex: Some(vertex.to_owned()),
        fragment: Some(fragment.to_owned()),
        ..Options::default()
    };
    Ok(front::parse(&[Source::new("bounds.wgsl", text)], &options)?)
}

/// The scene: layers of noise over each other.
struct Stack {
    /// Quads along each side of a layer.
    grid: u32,
    layers: u32,
    order: &'static str,
    /// The order, as a number for the shader.
    number: u32,
}

/// Times each hand-written form against the generated one.
fn compare(
    gpu: &Gpu,
    scene: &Scene,
    (stack, facts): (&Stack, &Facts),
    forms: &[(&'static str, &'static str)],
    handwritten: impl Fn(&Plan, &str) -> Result<Plan, Failure>,
    timing: &TimingSettings,
) -> Result<Vec<BenchRow>, Failure> {
    let session = Session::new(gpu, scene, ShaderForm::Text)?;
    let forward = session.originals().first().ok_or("no plan")?;
    let mut rows = Vec::new();
    for (form, recipe) in forms {
        eprintln!(
            "{} instances of {} quads, {}: {form}",
            stack.layers,
            stack.grid * stack.grid,
            stack.order
        );
        let hand = handwritten(forward, form)?;
        let generated = Recipe::parse([recipe])?
            .apply(forward, facts)
            .map_err(|refusal| refusal.to_string())?;
        let prepare = |plan: &Plan| session.prepare(std::slice::from_ref(plan));
        let (original, hand, generated) =
            (prepare(forward)?, prepare(&hand)?, prepare(&generated)?);
        let error = measure::compare(&hand.render()?, &generated.render()?)?;
        let (_, times) = measure::time(gpu, &[&hand, &generated, &original], timing, |_| {})?;
        let [hand, generated, original] = &times[..] else {
            continue;
        };
        rows.push(BenchRow {
            grid: stack.grid,
            layers: stack.layers,
            order: stack.order,
            form,
            recipe,
            forward_ms: original.time.estimate,
            handwritten_ms: hand.time.estimate,
            generated_ms: generated.time.estimate,
            ratio: generated.speedup,
            changed_pixels: error.changed_pixels,
        });
    }
    Ok(rows)
}

fn table(report: &Yardstick) -> String {
    let mut lines = vec![
        format!(
            "{}x{} on {}\n",
            report.resolution[0], report.resolution[1], report.adapter.name
        ),
        format!(
            "{:>4}  {:>6}  {:<13}  {:<15}  {:>10}  {:>9}  {:>9}  {:>22}  {:>10}",
            "grid",
            "layers",
            "order",
            "form",
            "forward ms",
            "hand ms",
            "ours ms",
            "hand / ours",
            "changed px"
        ),
    ];
    lines.extend(report.rows.iter().map(|r| {
        format!(
            "{:>4}  {:>6}  {:<13}  {:<15}  {:>10.3}  {:>9.3}  {:>9.3}  {:>6.3} [{:>5.3}, {:>5.3}]  \
             {:>10}",
            r.grid,
            r.layers,
            r.order,
            r.form,
            r.forward_ms.median,
            r.handwritten_ms.median,
            r.generated_ms.median,
            r.ratio.median,
            r.ratio.low,
            r.ratio.high,
            r.changed_pixels
        )
    }));
    lines.join("\n")
}

/// The layers of noise as a scene: no vertex data, one instance a layer.
fn scene(text: &str, size: [u32; 2], stack: &Stack) -> Result<Scene, Failure> {
    let parsed = parse(text, ["vs", "fs"])?;
    let numbers = |n: f64| Value::Numbers(vec![n]);
    let values = BTreeMap::from([
        ("p.n".to_owned(), numbers(f64::from(stack.grid))),
        ("p.layers".to_owned(), numbers(f64::from(stack.layers))),
        ("p.w".to_owned(), numbers(f64::from(size[0]))),
        ("p.h".to_owned(), numbers(f64::from(size[1]))),
        ("p.inst".to_owned(), numbers(0.0)),
        ("p.freq".to_owned(), numbers(8.0)),
        ("p.order".to_owned(), numbers(f64::from(stack.number))),
        ("p.pad1".to_owned(), numbers(0.0)),
    ]);
    let mut state = MaterialState::default();
    state.primitive.cull = CullMode::None;
    let material = Material {
        values,
        ..handmade::material("bounds", parsed, state)
    };
    let mesh = Mesh {
        name: "layer".to_owned(),
        vertex_count: stack.grid * stack.grid * 6,
        streams: BTreeMap::new(),
        indices: None,
        bounds: Default::default(),
    };
    let draws = vec![handmade::draw("layers", stack.layers)];
    Ok(handmade::scene("handwritten", size, material, mesh, draws))
}

/// A hand-written form as a plan: the frozen entry points, and the state that goes with them.
fn handwritten(forward: &Plan, form: &str) -> Result<Plan, Failure> {
    let mut plan = forward.clone();
    let program = plan.programs.get("main").cloned().ok_or("no program")?;
    let main = plan.passes.first_mut().ok_or("no pass")?;
    let mut prepass = main.clone();
    prepass.role = Role::Prepass;
    prepass.phase = Phase::Depth;
    prepass.fragment = None;
    prepass.targets.clear();
    prepass.draws = Draws::Opaque;
    match form {
        "vertex hoist" => {
            main.vertex = "vs_hoist".to_owned();
            main.fragment = Some("fs_hoist".to_owned());
            reflect::fill(main, &program);
            return Ok(plan);
        }
        "pre-pass EQUAL" => {
            if let Some(depth) = &mut main.depth {
                depth.compare = CompareFunction::Equal;
                depth.write = false;
            }
        }
        "pre-pass biased" => {
            if let Some(depth) = &mut prepass.depth {
                depth.bias = DepthBias {
                    constant: 64,
                    slope_scale: 2.0,
                    clamp: 0.0,
                };
            }
        }
        _ => {
            main.fragment = Some(
                if form == "prologue" {
                    "fs_discard"
                } else {
                    "fs_vote"
                }
                .to_owned(),
            );
            let name = "prepass-depth".to_owned();
            let source = BindingSource::Attachment { name };
            let depth = BindingUse::new([0, 1], BindingKind::DepthTexture, source);
            main.bindings.push(depth);
            if let Some(depth) = &mut prepass.depth {
                depth.attachment = "prepass-depth".to_owned();
            }
            let scene = plan.attachments.first().cloned();
            plan.attachments.extend(scene.map(|a| Attachment {
                name: "prepass-depth".to_owned(),
                sampled: true,
                ..a
            }));
        }
    }
    reflect::fill(main, &program);
    reflect::fill(&mut prepass, &program);
    plan.passes.insert(0, prepass);
    Ok(plan)
}
