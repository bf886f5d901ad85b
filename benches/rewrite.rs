//! What `preshade rewrite` costs in process: parse, graph and `depth-prepass`, and each target's
//! emission, apart and in all.
//!
//! `cargo bench -p preshade --features glsl,spirv --bench rewrite [-- FILE.wgsl..]`. Without files
//! it takes the WGSL fixtures of one file and a made material of about 1,500 expressions. Median of
//! 20 runs, in milliseconds; the limit set for `rewrite` in all is 10 ms.
//!
//! Without files, then also what `hoist` costs of stages that grow: twice as many statements, or
//! calls, should cost about twice as much.

use std::path::{Path, PathBuf};
use std::time::Instant;

use preshade_compiler::emit::{self, Options};
use preshade_compiler::front::{self, Source};
use preshade_compiler::recipe::Recipe;
use preshade_dataflow::graph::Graph;
use preshade_passes::transforms::hoist::movable::Finite;
use preshade_passes::transforms::hoist::{self, Candidates, Hoist, HoistStages};
use preshade_plan::pass::{Facts, Pass, Refusal};
use preshade_plan::plan::Plan;
use preshade_plan::plan_file::Target;
use preshade_plan::state::MaterialState;
use shader_text::error::Color;
use shader_text::options;

const RUNS: usize = 20;

/// What is timed, in the order of the columns.
const STEPS: [&str; 8] = [
    "parse", "graph", "pass", "wgsl", "spirv", "glsl", "glsl-es", "rewrite",
];

fn main() -> Result<(), Box<dyn std::error::Error>> {
    // cargo passes `--bench`.
    let given: Vec<PathBuf> = std::env::args()
        .skip(1)
        .filter(|a| !a.starts_with("--"))
        .map(PathBuf::from)
        .collect();
    let mut sources = vec![
        Source::new("made-8-functions.wgsl", made(8, 7)),
        Source::new("made-1-function.wgsl", made(1, 56)),
    ];
    let grows = given.is_empty();
    for file in if grows { fixtures()? } else { given } {
        let name = file.display().to_string();
        sources.push(Source::new(&name, std::fs::read_to_string(&file)?));
    }
    print!("{:<40} {:>6}", "material", "exprs");
    for step in STEPS {
        print!(" {step:>8}");
    }
    println!();
    for source in &sources {
        let (expressions, times) = measure(source)?;
        let name = Path::new(&source.name).file_name().unwrap_or_default();
        print!("{:<40} {expressions:>6}", name.to_string_lossy());
        for median in times {
            // A target that cannot say what the material does is left out, of the whole as well.
            match median {
                Some(median) => print!(" {median:>8.2}"),
                None => print!(" {:>8}", "-"),
            }
        }
        println!();
    }
    if grows {
        hoist_grows()?;
    }
    Ok(())
}

/// Prints what the steps of a hoist cost of straight-line stages, and of trees of calls.
fn hoist_grows() -> Result<(), Box<dyn std::error::Error>> {
    print!("\n{:<40}", "stage");
    for step in ["exact", "budget", "candidates", "each"] {
        print!(" {step:>10}");
    }
    println!();
    let lines = [50, 100, 200, 400, 800].map(|n| (format!("{n} statements"), straight_line(n)));
    let trees = [4, 6, 8, 10].map(|n| (format!("{} calls", 2 << n), tree(n)));
    for (name, text) in lines.into_iter().chain(trees) {
        let source = Source::new("made.wgsl", text);
        let parsed = front::parse(&[source], &options::Options::default())
            .map_err(|e| e.render(Color::Never))?;
        let fragment = parsed.fragment.as_deref();
        let state = MaterialState::default();
        let plan = Plan::original("m", parsed.program, &parsed.vertex, fragment, &state);
        let facts = Facts::default();
        let exact = hoist::HoistParams::default();
        let budget = hoist::HoistParams {
            budget: Some(0.01),
            finite: Finite::Assumed,
            ..exact.clone()
        };
        print!("{name:<40}");
        for params in [exact, budget] {
            let clock = Instant::now();
            let _ = std::hint::black_box(Hoist::run(&plan, &facts, &params));
            print!(" {:>10.2}", ms(clock));
        }
        let refused = |r: Box<Refusal>| r.reason;
        let clock = Instant::now();
        let stages = HoistStages::of(&plan).map_err(refused)?;
        let graph = stages.graph();
        let candidates = Candidates::new(&stages, &graph, &facts).map_err(refused)?;
        print!(" {:>10.2}", ms(clock));
        let clock = Instant::now();
        for candidate in candidates.list() {
            std::hint::black_box(candidates.alone(&candidate.id)).map_err(refused)?;
        }
        println!(" {:>10.2}", ms(clock) / candidates.list().len() as f64);
    }
    Ok(())
}

/// A fragment stage of `statements` statements, each of which rests on the one before.
fn straight_line(statements: usize) -> String {
    let lines: String = (0..statements)
        .map(|i| format!("    x = x * u.scale + sin(x + {i}.0);\n"))
        .collect();
    stage("", &format!("var x = in.uv.x;\n{lines}"))
}

/// A fragment stage of two calls, each of which makes two calls, and so on `depth` times; the last
/// have a loop.
fn tree(depth: usize) -> String {
    let mut functions = "fn t0(x: f32) -> f32 {
    var a = x;
    for (var k = 0; k < 3; k++) { a = a + sin(a * u.scale); }
    return a;
}\n"
    .to_owned();
    for i in 1..=depth {
        let below = i - 1;
        functions.push_str(&format!(
            "fn t{i}(x: f32) -> f32 {{ return t{below}(x * 1.5) + t{below}(x + u.scale); }}\n"
        ));
    }
    let x = format!("let x = t{depth}(in.uv.x) + fwidth(t{depth}(in.uv.y));");
    stage(&functions, &x)
}

/// A material whose fragment stage gives `x`.
fn stage(functions: &str, body: &str) -> String {
    format!(
        "struct Uniforms {{ view_proj: mat4x4<f32>, scale: f32 }}
@group(0) @binding(0) var<uniform> u: Uniforms;
struct Varyings {{ @builtin(position) clip: vec4<f32>, @location(0) uv: vec2<f32> }}
{functions}
@vertex fn vs(@location(0) p: vec3<f32>) -> Varyings {{
    return Varyings(u.view_proj * vec4<f32>(p, 1.0), p.xy);
}}
@fragment fn fs(in: Varyings) -> @location(0) vec4<f32> {{
    {body}
    return vec4<f32>(x, 0.0, 0.0, 1.0);
}}
"
    )
}

fn fixtures() -> std::io::Result<Vec<PathBuf>> {
    let dir = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/shaders");
    let mut files: Vec<PathBuf> = std::fs::read_dir(dir)?
        .map(|entry| Ok(entry?.path()))
        .collect::<std::io::Result<_>>()?;
    files.retain(|f| f.extension().is_some_and(|e| e == "wgsl"));
    files.sort();
    Ok(files)
}

/// Milliseconds of each step; `None` where a target cannot say what the material does.
type Medians = [Option<f64>; STEPS.len()];

/// The number of expressions of a material, and the median of each step in milliseconds.
fn measure(source: &Source) -> Result<(usize, Medians), Box<dyn std::error::Error>> {
    let recipe = Recipe::parse(["depth-prepass"])?;
    let mut runs: Vec<[f64; STEPS.len()]> = Vec::new();
    let mut expressions = 0;
    for _ in 0..RUNS {
        let mut run = [0.0; STEPS.len()];
        let clock = Instant::now();
        let parsed = front::parse(std::slice::from_ref(source), &options::Options::default())
            .map_err(|e| e.render(Color::Never))?;
        let program = parsed.program.clone();
        run[0] = ms(clock);
        let module = program.module();
        let entries = module.entry_points.iter().map(|e| &e.function);
        let functions = module.functions.iter().map(|(_, f)| f);
        expressions = functions.chain(entries).map(|f| f.expressions.len()).sum();

        // The pass builds its own graph: this column is a part of the next one.
        let clock = Instant::now();
        std::hint::black_box(Graph::build(&program));
        run[1] = ms(clock);

        let clock = Instant::now();
        let original = Plan::original(
            "m",
            parsed.program,
            &parsed.vertex,
            parsed.fragment.as_deref(),
            &MaterialState::default(),
        );
        // A refusal is a normal outcome, and keeps the original.
        let plan = recipe
            .apply(&original, &Facts::default())
            .unwrap_or(original);
        run[2] = ms(clock);

        let mut targets = Vec::new();
        for (column, target) in run[3..].iter_mut().zip(Target::ALL) {
            let clock = Instant::now();
            match std::hint::black_box(emit::emit(&plan, &[target], &Options::default())) {
                Ok(_) => targets.push(target),
                Err(emit::EmitError::Inexpressible { .. }) => continue,
                Err(error) => return Err(error.into()),
            }
            *column = ms(clock);
        }
        let clock = Instant::now();
        std::hint::black_box(emit::emit(&plan, &targets, &Options::default())?);
        run[7] = run[0] + run[2] + ms(clock);
        runs.push(run);
    }
    Ok((
        expressions,
        std::array::from_fn(|step| {
            let mut column: Vec<f64> = runs.iter().map(|run| run[step]).collect();
            column.sort_by(f64::total_cmp);
            Some(column[RUNS / 2]).filter(|median| *median > 0.0)
        }),
    ))
}

fn ms(clock: Instant) -> f64 {
    clock.elapsed().as_secs_f64() * 1e3
}

/// A fragment stage of `layers` functions of `steps` small steps each: 8 x 7, or 1 x 56, is about
/// 1,500 expressions.
fn made(layers: usize, steps: usize) -> String {
    let mut functions = String::new();
    let mut calls = String::new();
    for f in 0..layers {
        functions.push_str(&format!(
            "fn layer_{f}(p: vec2<f32>) -> f32 {{\n    var sum = 0.0;\n    var q = p;\n"
        ));
        for i in 0..steps {
            functions.push_str(&format!(
                "    sum += sin(q.x * {i}.5 + u.time) * cos(q.y - {f}.25);\n    q = q.yx * 1.5 + \
                 vec2<f32>(sum, {i}.0);\n"
            ));
        }
        functions.push_str("    return sum;\n}\n");
        calls.push_str(&format!(
            "    color += vec3<f32>(layer_{f}(in.uv), {f}.0, 1.0) * textureSample(t, s, \
             in.uv).rgb;\n"
        ));
    }
    format!(
        "struct Uniforms {{ view_proj: mat4x4<f32>, time: f32 }}
@group(0) @binding(0) var<uniform> u: Uniforms;
@group(0) @binding(1) var t: texture_2d<f32>;
@group(0) @binding(2) var s: sampler;
struct Varyings {{ @builtin(position) @invariant clip: vec4<f32>, @location(0) uv: vec2<f32> }}
{functions}
@vertex fn vs(@location(0) p: vec3<f32>) -> Varyings {{
    return Varyings(u.view_proj * vec4<f32>(p, 1.0), p.xy);
}}
@fragment fn fs(in: Varyings) -> @location(0) vec4<f32> {{
    var color = vec3<f32>(0.0);
{calls}    if color.x < 0.1 {{ discard; }}
    return vec4<f32>(color, 1.0);
}}
"
    )
}
