//! `preshade fleet`: scripts that share a list of jobs out.

use std::path::{Path, PathBuf};

use crate::evaluate::EvaluateArgs;
use crate::{Ending, Failure, output};

#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  preshade fleet slurm --jobs jobs.jsonl --gpu 1 > fleet.sh && sh fleet.sh
  preshade fleet hq --jobs jobs.jsonl --gpu gpus/nvidia > fleet.sh && sh fleet.sh
  preshade fleet hyperqueue --jobs jobs.jsonl > fleet.py && python3 fleet.py
  preshade fleet parallel --jobs jobs.jsonl --shares 4 > fleet.sh && sh fleet.sh --jobs 2
  preshade fleet github --jobs jobs.jsonl -- --adapter llvmpipe > .github/workflows/preshade.yml

Each script is a few lines, to read and to change. It needs `preshade` and the input files wherever
a job runs. Timing jobs run apart from pictures, with a machine to themselves where the scheduler
can do that. HyperQueue and Slurm run again what was lost with a machine. With the others, and after
any other failure, run the script again: results that are there are not measured again.")]
pub struct FleetArgs {
    /// Who shares the jobs out.
    #[arg(value_enum, value_name = "SCHEDULER")]
    scheduler: Scheduler,
    /// List of `preshade jobs`, as a path for the script.
    #[arg(long, value_name = "FILE")]
    jobs: PathBuf,
    /// Folder for the results.
    #[arg(
        short,
        long,
        alias = "output",
        value_name = "DIR",
        default_value = "results"
    )]
    out: PathBuf,
    /// Number of shares; default: 16. In HyperQueue each job is a task instead.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..))]
    shares: Option<u16>,
    /// The scheduler's name of a GPU: a resource of HyperQueue, such as gpus/nvidia, or a value of
    /// Slurm's --gpus, such as 1 or a100:1.
    #[arg(long, value_name = "NAME", value_parser = parse_gpu)]
    gpu: Option<String>,
    /// Further flags of `evaluate`, after `--`.
    #[arg(last = true, value_name = "FLAGS")]
    flags: Vec<String>,
}

/// Who shares jobs out.
#[derive(Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum Scheduler {
    /// HyperQueue's command: a shell script.
    Hq,
    /// HyperQueue's Python package: a Python script.
    Hyperqueue,
    /// Slurm: a shell script that submits arrays.
    Slurm,
    /// GNU parallel: a shell script.
    Parallel,
    /// GitHub Actions: a workflow.
    Github,
}

/// It becomes a part of a comment that Slurm reads, which knows no quotes.
fn parse_gpu(text: &str) -> Result<String, String> {
    let is_plain = |c: char| c.is_ascii_alphanumeric() || "/:,._-".contains(c);
    match !text.is_empty() && text.chars().all(is_plain) {
        true => Ok(text.to_owned()),
        false => Err("expected letters, digits and `/`, `:`, `,`, `.`, `_`, `-`".to_owned()),
    }
}

/// Entries of a matrix of GitHub.
const MOST_ENTRIES: u16 = 256;

pub fn run(args: &FleetArgs) -> Result<Ending, Failure> {
    let scheduler = args.scheduler;
    let is_queue = matches!(scheduler, Scheduler::Hq | Scheduler::Hyperqueue);
    let shares = args.shares.unwrap_or(16);
    let wrong = match scheduler {
        _ if is_queue && args.shares.is_some() => "each job is a task of HyperQueue: no --shares",
        Scheduler::Parallel | Scheduler::Github if args.gpu.is_some() => {
            "--gpu goes with hq, hyperqueue and slurm"
        }
        Scheduler::Github if shares > MOST_ENTRIES => "a matrix of GitHub has at most 256 entries",
        _ => "",
    };
    if !wrong.is_empty() {
        return Err(Failure(format!("error: {wrong}")));
    }
    let (jobs, out) = (word(&args.jobs)?, word(&args.out)?);
    for flag in &args.flags {
        word(Path::new(flag))?;
    }
    let evaluate = |jobs: &str| -> Vec<String> {
        let words = ["preshade", "evaluate", "--jobs", jobs, "--out", out];
        let words = words.map(str::to_owned).into_iter();
        words.chain(args.flags.iter().cloned()).collect()
    };
    // A mistake is found here and not by each task. The script gives the two others itself.
    let mut words = evaluate(jobs);
    words.extend(["--partition", "hash:1/1", "--kind", "time"].map(str::to_owned));
    <EvaluateArgs as clap::Args>::augment_args(clap::Command::new("evaluate"))
        .try_get_matches_from(&words[1..])
        .map_err(|e| Failure(e.to_string().trim_end().to_owned()))?;

    let line = shell_words::join(evaluate(jobs));
    let lines = |kind: &str| -> String {
        (1..=shares)
            .map(|share| format!("{line} --partition hash:{share}/{shares} --kind {kind}\n"))
            .collect()
    };
    let numbers: Vec<String> = (1..=shares).map(|share| share.to_string()).collect();
    // Without a name of a GPU, a timing job gets all cores of a worker.
    let gpu = args.gpu.as_deref();
    let (template, request) = match scheduler {
        Scheduler::Hq => (
            include_str!("fleet/hq.sh"),
            gpu.map_or("--cpus all".to_owned(), |g| format!("--resource {g}=1")),
        ),
        Scheduler::Hyperqueue => (
            include_str!("fleet/hyperqueue.py"),
            gpu.map_or("cpus=\"all\"".to_owned(), |g| {
                format!("resources={{\"{g}\": 1}}")
            }),
        ),
        Scheduler::Slurm => (
            include_str!("fleet/slurm.sh"),
            gpu.map_or(String::new(), |g| format!("#SBATCH --gpus={g}\n")),
        ),
        Scheduler::Parallel => (include_str!("fleet/parallel.sh"), String::new()),
        Scheduler::Github => (include_str!("fleet/github.yml"), String::new()),
    };
    let piped = evaluate("-");
    let (jobs, piped) = match scheduler {
        // Texts and lists of JSON are texts and lists of Python.
        Scheduler::Hyperqueue => (serde_json::to_string(jobs)?, serde_json::to_string(&piped)?),
        _ => (
            shell_words::quote(jobs).into_owned(),
            shell_words::join(piped),
        ),
    };
    // GitHub replaces expressions in texts.
    let plain = |text: String| match scheduler {
        Scheduler::Github => text.replace("${{", "${{ '${{' }}"),
        _ => text,
    };
    let line = plain(line.clone());
    output::data(&filled(
        template,
        &[
            ("jobs", &jobs),
            ("out", &shell_words::quote(out)),
            ("folder", &plain(serde_json::to_string(out)?)),
            ("evaluate", &line),
            ("piped", &piped),
            ("request", &request),
            ("shares", &shares.to_string()),
            ("numbers", &numbers.join(", ")),
            ("pictures", &lines("picture")),
            ("times", &lines("time")),
        ],
    ))?;
    Ok(Ending::Fine)
}

/// A path or word for one line of a script.
///
/// # Errors
/// It is stdin, has control characters, or is not UTF-8.
fn word(path: &Path) -> Result<&str, Failure> {
    let why = match path.to_str() {
        Some("-") => "stdin cannot be named in a script",
        Some(text) if text.chars().any(char::is_control) => "control characters cannot be written",
        Some(text) => return Ok(text),
        None => "it is not UTF-8",
    };
    Err(Failure(format!("error: `{}`: {why}", path.display())))
}

/// A template with values for its `@{name}`.
fn filled(template: &str, values: &[(&str, &str)]) -> String {
    let (mut text, mut rest) = (String::new(), template);
    while let Some((before, after)) = rest.split_once("@{") {
        let (name, after) = after.split_once('}').unwrap_or((after, ""));
        let value = values.iter().find(|(known, _)| *known == name);
        text.push_str(before);
        text.push_str(value.map_or("", |(_, value)| value));
        rest = after;
    }
    text + rest
}
