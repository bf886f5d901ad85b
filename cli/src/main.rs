//! `preshade` at the command line. One file a subcommand; data on stdout, messages on stderr.
//!
//! Exit status: 0 fine (a refusal is fine: the original stays), 1 a contract or relation broke, 2
//! bad usage or input, 3 `verify` or `agree` found nothing that a verdict could depend on.

use std::ffi::OsString;
use std::io::IsTerminal;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::OnceLock;

use clap::parser::ValueSource;
use clap::{ColorChoice, CommandFactory, FromArgMatches, Parser, Subcommand, ValueEnum};
use config::{Arguments, Config};
use preshade_draw::render::NOT_MEASURED;
use shader_text::limits::Limits;
use shader_text::nearest::unknown;
use shader_text::read_limited::ReadError;
use watch::Reads;

mod adapters;
mod agree;
mod agree_inputs;
mod agree_revisions;
mod agree_scene;
mod bounded;
#[cfg(feature = "capture")]
mod capture;
mod codes;
mod completions;
mod config;
mod depfile;
mod evaluate;
mod exhaustive;
mod explain;
mod explore;
mod file_names;
mod flags;
mod fleet;
mod graph;
mod guesses;
mod hints;
mod input;
mod jobs;
mod limits;
mod lock;
mod man;
mod materials;
mod merge;
mod output;
mod passes;
mod plan;
mod profile;
mod promises;
mod results;
mod rewrite;
mod rewritten;
mod saved_results;
mod scenes;
mod share;
mod state;
mod sweep_axis;
mod variants;
mod verify;
mod view;
mod watch;
mod worker;

/// Writes faster variants of a material's shaders, and verifies each by rendering and timing it.
#[derive(Parser)]
#[command(
    name = "preshade",
    version,
    propagate_version = true,
    max_term_width = 110,
    arg_required_else_help = true,
    after_help = "\
Examples:
  preshade explain lit.wgsl
  preshade --explain blended
  preshade rewrite lit.wgsl --pass depth-prepass --emit wgsl,glsl -o out/
  preshade agree lit.wgsl --with shadow.wgsl --as shadow
  preshade verify lit.wgsl
  preshade verify scene.toml --pass depth-prepass:form=equal --out report/

Data goes to stdout, messages to stderr. A flag overrides the environment (PRESHADE_ADAPTER for
--adapter; `;` separates several values), and the environment overrides preshade.toml
(adapter = \"llvmpipe\", or [verify] and then frames = 4). --FLAG=false resets a switch.
Exit status: 0 fine (also if a pass is refused: it is skipped), 1 a variant broke its contract, 2
bad usage or input, 3 (`verify`, `explore`) not measured: no verdict depends on what was drawn."
)]
struct Cli {
    #[command(subcommand)]
    command: Option<Command>,
    /// Explain a code of a message: `blended` for `note[depth-prepass/blended]`. Without a code,
    /// list all.
    #[arg(long, value_name = "CODE", num_args = 0..=1, default_missing_value = "")]
    explain: Option<String>,
    /// Colours of messages and tables. With auto, NO_COLOR is respected.
    #[arg(long, global = true, value_enum, value_name = "WHEN", default_value_t = Colors::Auto, help_heading = "All commands")]
    color: Colors,
    /// File with values for flags; default: `preshade.toml` in the current folder.
    #[arg(
        long,
        global = true,
        value_name = "FILE",
        help_heading = "All commands"
    )]
    config: Option<PathBuf>,
    /// Only print the value of each flag and its source.
    #[arg(long, global = true, help_heading = "All commands")]
    print_config: bool,
    /// Run again whenever an input file changes.
    #[arg(long, global = true, help_heading = "All commands")]
    watch: bool,
}

/// When to colour. Auto: on a terminal, unless NO_COLOR is set.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum Colors {
    Auto,
    Always,
    Never,
}

/// The value of `--color`, set before anything is printed.
static COLORS: OnceLock<Colors> = OnceLock::new();

#[derive(Subcommand)]
enum Command {
    /// Lists the passes that apply to a shader, refusals with their reasons, rates and costs.
    Explain(explain::ExplainArgs),
    /// Prints the dataflow graph, as dot or JSON.
    Graph(graph::GraphArgs),
    /// Lists the passes and their parameters.
    Passes(passes::PassesArgs),
    /// Rewrites a shader by a recipe of passes.
    Rewrite(rewrite::RewriteArgs),
    /// Holds two programs against each other: a hand-written depth or shadow pass against its main
    /// pass, or shaders before and after an edit.
    Agree(agree::AgreeArgs),
    /// Draws a scene or a shader with the original and its variants: error, time, verdict.
    Verify(verify::VerifyArgs),
    /// Chooses the passes that pay for each material of a scene on this adapter, by measurement.
    Plan(plan::PlanArgs),
    /// Finds where the time of a frame goes, by leaving out one kind of work after the other.
    Profile(profile::ProfileArgs),
    /// Finds the best recipes by error and time: those that no other recipe beats in both.
    Explore(explore::ExploreArgs),
    /// Lists measurements as jobs, one a line, that any machine or scheduler can run.
    Jobs(jobs::JobsArgs),
    /// Prints a script that shares jobs out: Slurm, HyperQueue, GNU parallel, GitHub.
    Fleet(fleet::FleetArgs),
    /// Runs jobs, or a share of them, and keeps one file for each result.
    Evaluate(evaluate::EvaluateArgs),
    /// Merges results of any number of machines and adapters.
    Merge(merge::MergeArgs),
    /// Records frames of a page (WebGPU, WebGL) or of a wgpu app into a frame folder.
    #[cfg(feature = "capture")]
    Capture(capture::CaptureArgs),
    /// Lists the adapters of this machine.
    Adapters(adapters::AdaptersArgs),
    /// Prints a completion script for a shell.
    Completions(completions::CompletionsArgs),
    /// Prints the manual pages.
    Man(man::ManArgs),
}

impl Command {
    /// Runs the command. `config` is the configuration file.
    fn run(&self, config: Option<&Path>) -> Result<Ending, Failure> {
        match self {
            Self::Explain(a) => explain::run(a),
            Self::Graph(a) => graph::run(a),
            Self::Passes(a) => passes::run(a),
            Self::Rewrite(a) => rewrite::run(a, config),
            Self::Agree(a) => agree::run(a),
            Self::Verify(a) => {
                let sweeps = a.sweeps()?;
                match a.jobs()? {
                    Some(jobs) => promises::run(a, &jobs, &sweeps),
                    None => verify::run(a, &sweeps),
                }
            }
            Self::Plan(a) if a.exhaustive => exhaustive::run(a),
            Self::Plan(a) => plan::run(a),
            Self::Profile(a) => profile::run(a),
            Self::Explore(a) => explore::run(a),
            Self::Jobs(a) => jobs::run(a),
            Self::Fleet(a) => fleet::run(a),
            Self::Evaluate(a) => evaluate::run(a),
            Self::Merge(a) => merge::run(a),
            #[cfg(feature = "capture")]
            Self::Capture(a) => capture::run(a),
            Self::Adapters(a) => adapters::run(a),
            Self::Completions(a) => completions::run(a, Cli::command()),
            Self::Man(a) => man::run(a, Cli::command()),
        }
    }

    /// Keeps the flags in effect of commands that other processes continue.
    fn keep_flags(&mut self, matches: &clap::ArgMatches) {
        let flags = match self {
            Self::Verify(a) => &mut a.flags,
            Self::Jobs(a) => &mut a.verify.flags,
            Self::Plan(a) => &mut a.flags,
            Self::Explore(a) => &mut a.flags,
            _ => return,
        };
        let command = Cli::command();
        if let Some((name, of_it)) = matches.subcommand()
            && let Some(sub) = command.find_subcommand(name)
        {
            *flags = flags::words(sub, of_it);
        }
    }

    /// Limits on its input, if it reads any.
    fn limits(&self) -> Option<Limits> {
        let limits = match self {
            Self::Explain(a) => &a.shader.limits,
            Self::Graph(a) => &a.shader.limits,
            Self::Rewrite(a) => &a.shader.limits,
            Self::Agree(a) => &a.shader.limits,
            Self::Verify(a) => &a.shader.limits,
            Self::Profile(a) => &a.shader.limits,
            Self::Explore(a) => &a.shader.limits,
            Self::Jobs(a) => &a.verify.shader.limits,
            Self::Plan(a) => &a.limits,
            _ => return None,
        };
        Some(limits.limits())
    }

    /// Its input files. `None`: stdin, or nothing that could change.
    fn reads(&self) -> Option<Reads> {
        let shader = match self {
            Self::Explain(a) => &a.shader,
            Self::Graph(a) => &a.shader,
            Self::Rewrite(a) => return a.reads(),
            Self::Verify(a) => &a.shader,
            Self::Profile(a) => &a.shader,
            Self::Explore(a) => &a.shader,
            Self::Agree(a) => {
                return Some(Reads {
                    files: a.reads(),
                    includes: a.shader.glsl.include.clone(),
                    ..Reads::default()
                });
            }
            Self::Plan(a) => {
                return Some(Reads {
                    files: a.reads(),
                    trees: a.folders(),
                    ..Reads::default()
                });
            }
            _ => return None,
        };
        (!shader.reads_stdin()).then(|| Reads {
            files: shader.reads(),
            includes: shader.glsl.include.clone(),
            ..Reads::default()
        })
    }
}

/// How a command ended, unless it failed.
pub enum Ending {
    Fine,
    /// A variant broke its contract.
    ContractBroken,
    /// Every variant is `not measured`, or the pictures left something untested.
    NotMeasured,
}

impl Ending {
    pub fn of(is_broken: bool, is_unmeasured: bool) -> Self {
        match is_broken {
            true => Self::ContractBroken,
            false if is_unmeasured => Self::NotMeasured,
            false => Self::Fine,
        }
    }
}

/// Bad usage or input, as a message to print.
#[derive(Debug)]
pub struct Failure(pub String);

impl Failure {
    /// A file that cannot be read.
    pub fn unread(path: &Path, error: &ReadError) -> Self {
        let remedy = match error {
            ReadError::TooLarge(exceeded) => format!("\n = {}", exceeded.remedy()),
            _ => String::new(),
        };
        Self(format!("error: {}: {error}{remedy}", path.display()))
    }

    /// Some of `count` inputs failed.
    pub fn of_inputs(failed: &[String], count: usize) -> Self {
        Self(format!(
            "error: {} of {count} inputs failed: {}",
            failed.len(),
            failed.join(", ")
        ))
    }

    /// There is no `what` of that name. Suggests the nearest name, and lists all.
    pub fn unknown(what: &str, name: &str, known: &[&str]) -> Self {
        Self(format!("error: {}", unknown(what, name, known)))
    }
}

impl<E: std::error::Error + 'static> From<E> for Failure {
    fn from(error: E) -> Self {
        let code = codes::of(&error).map_or(String::new(), |code| format!("[{code}]"));
        let mut message = format!("error{code}: {error}");
        let mut source = error.source();
        while let Some(s) = source {
            message.push_str(&format!("\n  because: {s}"));
            source = s.source();
        }
        Self(message)
    }
}

/// Output form of commands that print data.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Format {
    /// For people.
    Human,
    /// For programs.
    Json,
}

/// Output form of commands whose data is a table.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Table {
    /// For people.
    Human,
    /// For programs.
    Json,
    /// For spreadsheets.
    Csv,
}

/// Whether messages on stderr are coloured.
pub fn color_on_stderr() -> bool {
    color_on(&std::io::stderr())
}

/// Whether text on `stream` is coloured.
pub fn color_on(stream: &impl IsTerminal) -> bool {
    match COLORS.get() {
        Some(Colors::Always) => true,
        Some(Colors::Never) => false,
        Some(Colors::Auto) | None => {
            std::env::var_os("NO_COLOR").is_none_or(|v| v.is_empty()) && stream.is_terminal()
        }
    }
}

/// Keeps Mesa's device-select layer from looking for a Wayland display, which prints errors if
/// there is none. Nothing is shown on a screen, and preshade sorts adapters itself.
fn keep_drivers_quiet() {
    const ABOUT_DISPLAYS: [&str; 4] = [
        "XDG_RUNTIME_DIR",
        "WAYLAND_DISPLAY",
        "MESA_VK_DEVICE_SELECT",
        "NODEVICE_SELECT",
    ];
    if cfg!(target_os = "linux") && ABOUT_DISPLAYS.iter().all(|v| std::env::var_os(v).is_none()) {
        // SAFETY: called first in `main`, while this is the only thread.
        #[allow(unsafe_code)]
        unsafe {
            std::env::set_var("NODEVICE_SELECT", "1");
        }
    }
}

fn main() -> ExitCode {
    keep_drivers_quiet();
    match run(&std::env::args_os().collect::<Vec<_>>()) {
        Ok(Ending::Fine) => ExitCode::SUCCESS,
        Ok(Ending::ContractBroken) => ExitCode::from(1),
        Ok(Ending::NotMeasured) => ExitCode::from(3),
        Err(Failure(message)) => {
            let mut parts = message.split(": ");
            let is_unmeasured = parts.any(|part| part == NOT_MEASURED.trim_end_matches(": "));
            output::message(
                message
                    .strip_prefix("error: ")
                    .filter(|_| is_unmeasured)
                    .unwrap_or(&message),
            );
            ExitCode::from(if is_unmeasured { 3 } else { 2 })
        }
    }
}

/// A message in the requested colours.
fn command_line() -> clap::Command {
    Cli::command().color(match COLORS.get() {
        Some(Colors::Always) => ColorChoice::Always,
        Some(Colors::Never) => ColorChoice::Never,
        Some(Colors::Auto) | None => ColorChoice::Auto,
    })
}

/// Reads the command line, the environment and the configuration, and runs the command.
fn run(arguments: &[OsString]) -> Result<Ending, Failure> {
    if worker::mine().is_none() {
        let names = std::env::vars_os().map(|(name, _)| name);
        for warning in config::unknown_variables(&Cli::command(), names) {
            output::message(&warning);
        }
    }
    if worker::has_parent() {
        worker::end_with_parent();
    }
    let arguments = Arguments::of(arguments, &Cli::command());
    let color = config::color(&arguments);
    if let Some(color) = color.and_then(|c| Colors::from_str(c.to_str()?, true).ok()) {
        COLORS.get_or_init(|| color);
    }
    let CommandLine {
        cli,
        command,
        matches,
        config,
    } = read(&arguments)?;
    COLORS.get_or_init(|| cli.color);
    if let Some(code) = &cli.explain {
        output::data(&codes::explain(code)?)?;
        return Ok(Ending::Fine);
    }
    if cli.print_config {
        output::data(&config.print(&command, &matches))?;
        return Ok(Ending::Fine);
    }
    let Some(wanted) = &cli.command else {
        return Err(no_command());
    };
    let is_bounded = !cli.watch && worker::mine().is_none();
    if let Some(limits) = wanted.limits().filter(|_| is_bounded) {
        let tell: fn(&str) = match wants_json(&matches) {
            false => output::message,
            true => |why| {
                output::message(why);
                output::failed(why);
            },
        };
        bounded::start(&limits, tell);
    }
    let is_asked = matches.value_source("watch") == Some(ValueSource::CommandLine);
    // `--watch` parses the command line again in each round.
    let watched = cli.watch.then(|| wanted.reads());
    match watched {
        Some(Some(_)) => watch::run(|| round(&arguments)),
        Some(None) if is_asked => Err(Failure(
            "error: --watch needs files to watch: stdin is read once".to_owned(),
        )),
        _ => wanted.run(config.path()).inspect_err(|Failure(message)| {
            if worker::mine().is_none() && wants_json(&matches) {
                output::failed(message);
            }
        }),
    }
}

/// Whether the requested output form is JSON.
fn wants_json(matches: &clap::ArgMatches) -> bool {
    let Some((_, of_it)) = matches.subcommand() else {
        return false;
    };
    let format = of_it.try_get_raw("format").ok().flatten();
    format.is_some_and(|mut words| words.any(|word| word == "json"))
}

fn no_command() -> Failure {
    Failure("error: no command is given; see `preshade --help`".to_owned())
}

/// The command line with the values of the environment and the file.
struct CommandLine {
    cli: Cli,
    command: clap::Command,
    matches: clap::ArgMatches,
    config: Config,
}

/// Parses the command line. Help and version are printed here, and end the process.
fn read(arguments: &Arguments) -> Result<CommandLine, Failure> {
    // These must work whatever the file contains.
    let plain = command_line().try_get_matches_from(&arguments.words);
    let needs_no_file = match &plain {
        Err(error) if !error.use_stderr() => error.exit(),
        Err(_) => false,
        Ok(matches) => {
            matches.value_source("explain").is_some()
                || matches!(matches.subcommand_name(), Some(name) if config::OF_ITSELF.contains(&name))
        }
    };
    let config = match Config::read(arguments, &Cli::command()) {
        Ok(config) => config,
        Err(Failure(message)) if needs_no_file => {
            output::message(&message.replacen("error", "warning", 1));
            Config::of_flags(arguments)
        }
        Err(failure) => return Err(failure),
    };
    let mut command = config.apply(command_line());
    let usage = |error: clap::Error| {
        let (error, hint) = hints::of(error);
        let text = match color_on_stderr() {
            true => error.render().ansi().to_string(),
            false => error.render().to_string(),
        };
        let from = config.explained(&error, arguments);
        let from = from.map_or(String::new(), |from| format!("\n = {from} says so"));
        Failure(format!("{}{hint}{from}", text.trim_end()))
    };
    let matches = command
        .try_get_matches_from_mut(&arguments.words)
        .map_err(usage)?;
    let mut cli = Cli::from_arg_matches(&matches).map_err(|e| usage(e.format(&mut command)))?;
    if let Some(wanted) = &mut cli.command {
        wanted.keep_flags(&matches);
    }
    Ok(CommandLine {
        cli,
        command,
        matches,
        config,
    })
}

/// A round of `--watch`: the input files with the configuration file, and the command.
fn round(
    arguments: &Arguments,
) -> Result<(Reads, impl FnOnce() -> Result<Ending, Failure> + use<>), Failure> {
    let CommandLine { cli, config, .. } = read(arguments)?;
    let wanted = cli.command.ok_or_else(no_command)?;
    let mut reads = wanted.reads().unwrap_or_default();
    let file = config.path().map(Path::to_path_buf);
    reads
        .files
        .push(file.unwrap_or_else(|| PathBuf::from(config::FILE)));
    Ok((reads, move || wanted.run(config.path())))
}
