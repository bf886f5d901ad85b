//! How preshade's own cost grows with the shader: reading, the graph, each pass and writing, of
//! made shaders of 100 to 100,000 expressions, in one function and in many.
//!
//! `cargo bench -p preshade --bench growth` prints milliseconds, and how much each step grew where
//! the expressions grew tenfold: 12 is the limit for all but naga's own parser, which is quadratic
//! within one function and stands apart. Then 1,000 materials in one process, and the largest
//! memory of each. `-- --only STEP SHAPE EXPRESSIONS`, `--only graph one 10000` say, runs one step
//! once: `scripts/callgrind.sh` counts its instructions. `-- --most N` ends at N expressions.

use std::hint::black_box;
use std::time::Instant;

use preshade_compiler::emit::{self, Options};
use preshade_compiler::front::{self, Source};
use preshade_compiler::recipe::Recipe;
use preshade_dataflow::graph::Graph;
use preshade_geometry::examples;
use preshade_plan::pass::{Facts, Use};
use preshade_plan::plan::Plan;
use preshade_plan::plan_file::Target;
use preshade_plan::program::Program;
use preshade_plan::state::MaterialState;
use shader_text::error::Color;
use shader_text::{files, options};

type Result<T> = std::result::Result<T, Box<dyn std::error::Error>>;

/// The recipes that are timed.
fn recipes() -> impl Iterator<Item = &'static str> {
    let timed = examples().filter(|(_, used)| **used == Use::Growth);
    timed.map(|(recipe, _)| recipe)
}

/// How the expressions of a made shader are spread.
#[derive(Clone, Copy)]
enum Shape {
    /// In the fragment entry point.
    One,
    /// In functions of about a hundred expressions.
    Many,
}

impl Shape {
    fn name(self) -> &'static str {
        match self {
            Self::One => "one",
            Self::Many => "many",
        }
    }
}

/// The largest growth for ten times the expressions that is not told as too much.
const LIMIT: f64 = 12.0;

fn main() -> Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let after = |flag: &str| -> &[String] {
        let at = arguments.iter().position(|a| a == flag);
        at.map_or(&[], |at| &arguments[at + 1..])
    };
    if let [step, shape, expressions, ..] = after("--only") {
        let shape = match shape.as_str() {
            "one" => Shape::One,
            _ => Shape::Many,
        };
        return only(step, shape, expressions.parse()?);
    }
    if arguments.iter().any(|a| a == "--whole") {
        return whole();
    }
    let most: usize = after("--most").first().map_or(Ok(100_000), |n| n.parse())?;
    let steps: Vec<&str> = ["naga", "read", "graph"]
        .into_iter()
        .chain(recipes())
        .chain(["wgsl"])
        .collect();
    print!("{:<6} {:>7}", "shape", "exprs");
    for step in &steps {
        print!(" {step:>17}");
    }
    println!(" {:>8}", "MiB");
    for shape in [Shape::One, Shape::Many] {
        let mut before: Option<Vec<f64>> = None;
        for expressions in [100, 1_000, 10_000, 100_000]
            .into_iter()
            .filter(|n| *n <= most)
        {
            forget_peak();
            let made = Made::new(shape, expressions)?;
            let times = steps
                .iter()
                .map(|step| best(step, &made))
                .collect::<Result<Vec<f64>>>()?;
            print!("{:<6} {:>7}", shape.name(), count(&made.program));
            for (i, time) in times.iter().enumerate() {
                let growth = before.as_ref().map(|before| time / before[i]);
                let growth = growth.map_or(String::new(), |g| {
                    let mark = if g > LIMIT { "!" } else { " " };
                    format!(" x{g:.1}{mark}")
                });
                print!(" {:>17}", format!("{time:.2}{growth:>7}"));
            }
            println!(" {:>8}", peak());
            before = Some(times);
        }
    }
    whole()?;
    thousand()
}

/// A whole compile of each fixture against naga's own parsing, validating and writing of the source
/// and of every module that came of it.
fn whole() -> Result<()> {
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/shaders");
    let Ok(entries) = std::fs::read_dir(folder) else {
        return Ok(());
    };
    let recipe = Recipe::parse(["depth-prepass"])?;
    let mut ratios = Vec::new();
    for entry in entries {
        let path = entry?.path();
        let Ok(text) = std::fs::read_to_string(&path) else {
            continue;
        };
        let source = Source::new(path.display().to_string(), text);
        let compile = || -> Result<Vec<files::File>> {
            let (_, plan) = program(&source)?;
            // A refusal is a normal outcome, and keeps the original.
            let plan = recipe.apply(&plan, &Facts::default()).unwrap_or(plan);
            Ok(emit::emit(&plan, &[Target::Wgsl], &Options::default())?)
        };
        let files = compile()?;
        let modules = files.iter().filter(|f| f.name.ends_with(".wgsl"));
        let texts = modules.map(|f| String::from_utf8_lossy(&f.bytes).into_owned());
        let texts: Vec<String> = [source.text.clone()].into_iter().chain(texts).collect();
        // In turns, so that what else the machine does falls on both alike.
        let (mut ours, mut nagas) = (f64::INFINITY, f64::INFINITY);
        for _ in 0..15 {
            ours = ours.min(milliseconds(|| compile().map(drop))?);
            nagas = nagas.min(milliseconds(|| {
                texts.iter().try_for_each(|t| naga_alone(t))
            })?);
        }
        ratios.push((ours / nagas, path));
    }
    ratios.sort_by(|a, b| a.0.total_cmp(&b.0));
    if let (Some((most, path)), Some((median, _))) = (ratios.last(), ratios.get(ratios.len() / 2)) {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        println!(
            "a whole compile takes {median:.2} times what naga does by itself to its texts, median \
             of {} fixtures; {most:.2} of {name}",
            ratios.len()
        );
    }
    Ok(())
}

/// How long something takes.
fn milliseconds(work: impl Fn() -> Result<()>) -> Result<f64> {
    let clock = Instant::now();
    work()?;
    Ok(clock.elapsed().as_secs_f64() * 1e3)
}

/// Parses, validates and writes a text.
fn naga_alone(text: &str) -> Result<()> {
    use naga::{back, front, valid};
    let module = front::wgsl::parse_str(text)?;
    let info = valid::Validator::new(valid::ValidationFlags::all(), valid::Capabilities::all())
        .validate(&module)?;
    black_box(back::wgsl::write_string(
        &module,
        &info,
        back::wgsl::WriterFlags::empty(),
    ))?;
    Ok(())
}

/// Runs one step once.
fn only(step: &str, shape: Shape, expressions: usize) -> Result<()> {
    let ms = time(step, &Made::new(shape, expressions)?)?;
    println!("{ms:.2} ms");
    Ok(())
}

/// A made shader, and what it is read as.
struct Made {
    source: Source,
    program: Program,
    plan: Plan,
}

impl Made {
    fn new(shape: Shape, expressions: usize) -> Result<Self> {
        let source = made(shape, expressions);
        let (program, plan) = program(&source)?;
        Ok(Self {
            source,
            program,
            plan,
        })
    }
}

/// The least of a few runs, in milliseconds: what others do to the machine only adds. As many runs
/// of each size, the first of which asks the system for memory and the others find it, or growth
/// would be one of first runs over later ones; only what takes seconds (naga's quadratic reading)
/// runs once.
fn best(step: &str, made: &Made) -> Result<f64> {
    let first = time(step, made)?;
    let again = if first < 4_000.0 { 4 } else { 0 };
    (0..again).try_fold(first, |least, _| Ok(f64::min(least, time(step, made)?)))
}

/// The time of one step, in milliseconds.
fn time(step: &str, made: &Made) -> Result<f64> {
    let recipe = |pass: &str| Recipe::parse([pass]);
    let none = Facts::default();
    match step {
        "naga" => milliseconds(|| {
            let module = naga::front::wgsl::parse_str(&made.source.text)?;
            black_box(Program::new(
                module,
                Default::default(),
                shader_text::source::Language::Wgsl,
            ))?;
            Ok(())
        }),
        "read" => milliseconds(|| program(&made.source).map(|read| drop(black_box(read)))),
        "graph" => milliseconds(|| {
            black_box(Graph::build(&made.program));
            Ok(())
        }),
        "wgsl" => {
            // Of a text of its own: an original ships as it was written.
            let apply = recipe("depth-prepass")?.apply(&made.plan, &none);
            let plan = apply.map_err(|r| r.reason)?;
            milliseconds(|| {
                black_box(emit::emit(&plan, &[Target::Wgsl], &Options::default()))?;
                Ok(())
            })
        }
        pass => {
            let recipe = recipe(pass)?;
            // A refusal takes its time too.
            milliseconds(|| {
                let _ = black_box(recipe.apply(&made.plan, &none));
                Ok(())
            })
        }
    }
}

fn program(source: &Source) -> Result<(Program, Plan)> {
    let parsed = front::parse(std::slice::from_ref(source), &options::Options::default())
        .map_err(|e| e.render(Color::Never))?;
    let (program, fragment) = (parsed.program, parsed.fragment.as_deref());
    let plan = Plan::original(
        "m",
        program.clone(),
        &parsed.vertex,
        fragment,
        &MaterialState::default(),
    );
    Ok((program, plan))
}

fn count(program: &Program) -> usize {
    let module = program.module();
    let entries = module.entry_points.iter().map(|e| &e.function);
    let functions = module.functions.iter().map(|(_, f)| f);
    functions.chain(entries).map(|f| f.expressions.len()).sum()
}

/// A material of about so many expressions: a cut-out whose colour is a chain of small steps, with
/// an affine and a slowly changing part.
fn made(shape: Shape, expressions: usize) -> Source {
    // A step is about 16 expressions.
    let steps = (expressions / 16).max(1);
    let step = |i: usize| {
        format!(
            "    sum += sin(q.x * {}.5 + u.time) * cos(q.y - 0.25);\n    q = q.yx * 1.5 + \
             vec2<f32>(sum, {}.0);\n",
            i % 97,
            i % 31
        )
    };
    let body = |steps: std::ops::Range<usize>| steps.map(step).collect::<String>();
    let (functions, calls) = match shape {
        Shape::One => (
            String::new(),
            format!(
                "    var sum = 0.0;\n    var q = in.uv;\n{}    color += vec3<f32>(sum, q);\n",
                body(0..steps)
            ),
        ),
        Shape::Many => {
            let layers = steps.div_ceil(6);
            let function = |f: usize| {
                format!(
                    "fn layer_{f}(p: vec2<f32>) -> f32 {{\n    var sum = 0.0;\n    var q = p;\n\
                     {}    return sum;\n}}\n",
                    body(f * 6..(f * 6 + 6).min(steps))
                )
            };
            let call =
                |f: usize| format!("    color += vec3<f32>(layer_{f}(in.uv), {f}.0, 1.0);\n");
            (
                (0..layers).map(function).collect(),
                (0..layers).map(call).collect(),
            )
        }
    };
    let text = format!(
        "struct Uniforms {{ view_proj: mat4x4<f32>, time: f32 }}
@group(0) @binding(0) var<uniform> u: Uniforms;
@group(0) @binding(1) var t: texture_2d<f32>;
@group(0) @binding(2) var s: sampler;
struct Varyings {{ @builtin(position) clip: vec4<f32>, @location(0) uv: vec2<f32> }}
{functions}
@vertex fn vs(@location(0) p: vec3<f32>) -> Varyings {{
    return Varyings(u.view_proj * vec4<f32>(p, 1.0), p.xy);
}}
@fragment fn fs(in: Varyings) -> @location(0) vec4<f32> {{
    let texel = textureSample(t, s, in.uv);
    if texel.a < 0.5 {{ discard; }}
    var color = texel.rgb;
{calls}    return vec4<f32>(color, 1.0);
}}
"
    );
    Source::new("made.wgsl", text)
}

/// A thousand materials of about 300 expressions, no two alike, each read, rewritten and written,
/// one after the other.
fn thousand() -> Result<()> {
    forget_peak();
    let clock = Instant::now();
    let recipe = Recipe::parse(["depth-prepass"])?;
    let mut bytes = 0;
    for i in 0..1_000 {
        let source = made(Shape::Many, 250 + i % 100);
        let (_, plan) = program(&source)?;
        let plan = recipe
            .apply(&plan, &Facts::default())
            .map_err(|r| r.reason)?;
        let files = emit::emit(&plan, &[Target::Wgsl], &Options::default())?;
        bytes += files.iter().map(|f| f.bytes.len()).sum::<usize>();
    }
    println!(
        "1,000 materials on one core: {:.2} s, {} MiB, {bytes} bytes written",
        clock.elapsed().as_secs_f64(),
        peak()
    );
    Ok(())
}

/// The largest memory of this process since [`forget_peak`], in MiB; 0 elsewhere than on Linux.
fn peak() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find(|l| l.starts_with("VmHWM:"));
    let kib = line.and_then(|l| l.split_whitespace().nth(1)?.parse::<u64>().ok());
    kib.unwrap_or(0) / 1024
}

/// Starts to watch memory anew (proc(5), `clear_refs`).
fn forget_peak() {
    let _ = std::fs::write("/proc/self/clear_refs", "5");
}
