//! `preshade profile`: finds where the time of a frame goes.

use std::time::Duration;

use preshade_lab::measure::{TimingSettings, parse_seconds, profile};
use preshade_lab::report;

use crate::input::ShaderArgs;
use crate::verify::command;
use crate::view::ViewArgs;
use crate::{Ending, Failure, Table, guesses, output, worker};

#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  preshade profile frame/
  preshade profile scene.toml --camera nave --format csv

Leaves out one kind of work after the other, and times the frame beside the original: vertices, and
for each material its textures, its arithmetic, the writing of its colours, and what decides its
discards. What runs side by side on the adapter overlaps, so the parts need not add up to 100 %. Where the pass and its draw calls are most of it, no
shader makes the frame faster.")]
pub struct ProfileArgs {
    #[command(flatten)]
    view: ViewArgs,
    /// Seconds to spend on each group of times.
    #[arg(long, value_name = "SECONDS", default_value_t = 2.0, value_parser = parse_seconds)]
    seconds: f64,
    /// Part of an adapter's name, driver or backend.
    #[arg(long, value_name = "TEXT")]
    adapter: Option<String>,
    /// Output form.
    #[arg(long, value_enum, default_value_t = Table::Human)]
    format: Table,
    // Last, because its help heading applies to all following arguments.
    #[command(flatten)]
    pub shader: ShaderArgs,
}

/// Profiles a scene, a captured frame, or a bare shader.
pub fn run(args: &ProfileArgs) -> Result<Ending, Failure> {
    let shader = args.shader.on(args.adapter.as_deref());
    let scene = args.view.of(shader.scene()?)?;
    guesses::tell(&scene);
    let gpu = worker::open(args.adapter.as_deref(), &args.shader.limits.limits())?;
    let timing = TimingSettings {
        budget: Duration::from_secs_f64(args.seconds),
        ..TimingSettings::default()
    };
    let profiled = || profile::profile(&gpu, &scene, &timing, &command());
    let found = output::working(format!("profiling {}", scene.name), profiled)?;
    let forms = output::Answer {
        table: report::profile::render(&found),
        json: serde_json::to_string_pretty(&found)?,
        csv: report::profile::csv(&found),
    };
    forms.print(args.format)?;
    Ok(Ending::Fine)
}
