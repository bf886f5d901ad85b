//! Times parsing and emitting one material in every target: `cargo run --release --features glsl,spirv --example emit_speed [FILE.wgsl]`.
//! Without a file it makes a material of about 1,500 expressions.

use std::time::Instant;

use preshade::emit::{self, Options, Target};
use preshade::front::{self, Color, Source};
use preshade::passes::plan::Plan;
use preshade::passes::state::MaterialState;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let source = match std::env::args().nth(1) {
        Some(path) => Source::new(&path, std::fs::read_to_string(&path)?),
        None => Source::new("made.wgsl", made()),
    };
    let mut times: Vec<[f64; 2]> = Vec::new();
    let mut expressions = 0;
    for _ in 0..20 {
        let start = Instant::now();
        let parsed = front::parse(std::slice::from_ref(&source), &front::Options::default())
            .map_err(|e| e.render(Color::Never))?;
        let read = start.elapsed().as_secs_f64() * 1e3;
        let module = parsed.program.module();
        expressions = module
            .functions
            .iter()
            .map(|(_, f)| f)
            .chain(module.entry_points.iter().map(|e| &e.function))
            .map(|f| f.expressions.len())
            .sum();
        let plan = Plan::original(
            "m",
            parsed.program,
            &parsed.vertex,
            parsed.fragment.as_deref(),
            &MaterialState::default(),
        );
        let start = Instant::now();
        emit::emit(&plan, &Target::ALL, &Options::default())?;
        times.push([read, start.elapsed().as_secs_f64() * 1e3]);
    }
    for (i, what) in ["parse", "emit, all targets"].iter().enumerate() {
        let mut column: Vec<f64> = times.iter().map(|t| t[i]).collect();
        column.sort_by(f64::total_cmp);
        println!(
            "{what}: median {:.2} ms, most {:.2} ms ({expressions} expressions)",
            column[column.len() / 2],
            column[column.len() - 1]
        );
    }
    Ok(())
}

/// A fragment stage of many small steps.
fn made() -> String {
    let mut functions = String::new();
    let mut calls = String::new();
    for f in 0..8 {
        functions.push_str(&format!(
            "fn layer_{f}(p: vec2<f32>) -> f32 {{\n    var sum = 0.0;\n    var q = p;\n"
        ));
        for i in 0..12 {
            functions.push_str(&format!(
                "    sum += sin(q.x * {i}.5 + u.time) * cos(q.y - {f}.25);\n    q = q.yx * 1.5 + vec2<f32>(sum, {i}.0);\n"
            ));
        }
        functions.push_str("    return sum;\n}\n");
        calls.push_str(&format!("    color += vec3<f32>(layer_{f}(in.uv), {f}.0, 1.0) * textureSample(t, s, in.uv).rgb;\n"));
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
