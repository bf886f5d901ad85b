//! `preshade jobs`: measurements as lines that any scheduler can share out.

use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;

use clap::CommandFactory;
use preshade_compiler::recipe::Recipe;
use preshade_draw::scene::Scene;
use preshade_lab::jobs::{self, EVERY, JOB_SCHEMA, Kind};
use preshade_lab::measure;
use preshade_lab::search::candidates;
use preshade_passes::transforms::specialize::Specialize;
use preshade_plan::budget::Budget;
use preshade_plan::pass::{Facts, Pass};
use preshade_plan::plan::Plan;
use preshade_scenes::Variables;

use crate::file_names::from_here;
use crate::input::ShaderArgs;
use crate::materials::{Chosen, Job};
use crate::verify::{self, TimeArg, VerifyArgs};
use crate::{Cli, Ending, Failure, flags, output, plan, promises};

#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  preshade jobs scenes/ --explore --time first-frames > jobs.jsonl
  preshade jobs lit.wgsl --variant depth-prepass --variant early-discard > jobs.jsonl
  preshade jobs scenes/ --exhaustive > jobs.jsonl
  preshade evaluate --jobs jobs.jsonl --out results/
  preshade merge results/ -o results.json

One line a variant of an input: pictures, and with --time times too, in a line of their own. The
flags are those of `verify`. A variant that every material refuses gets no line, and of variants that
draw the same text, one does. A line has the hashes of all files that it reads: the machine that
runs it needs the same files at the same paths.")]
pub struct JobsArgs {
    /// The variants that `plan` and `explore` try. With --budget also those that change the picture.
    #[arg(long)]
    explore: bool,
    /// A job for each scene, which times every candidate in every view, as `plan --exhaustive` does.
    #[arg(long, conflicts_with_all = ["explore", "every_pass", "passes", "variants", "time"])]
    exhaustive: bool,
    /// Only adapters with this text in their name, driver or backend may run the jobs.
    #[arg(long, value_name = "TEXT")]
    only_on: Option<String>,
    #[command(flatten)]
    pub verify: VerifyArgs,
}

/// A picture of 1 megapixel is drawn, read back and compared in about this many seconds on a GPU.
const SECONDS_A_MEGAPIXEL: f64 = 0.05;

/// Opening an adapter and compiling shaders.
const SECONDS_TO_START: f64 = 1.5;

pub fn run(args: &JobsArgs) -> Result<Ending, Failure> {
    let verify = &args.verify;
    if verify.adapter.is_some() {
        return Err(Failure(
            "error: jobs are for any adapter: `evaluate` takes --adapter, and --only-on says here \
             which ones may run them"
                .to_owned(),
        ));
    }
    if verify.shader.reads_stdin() {
        return Err(Failure(
            "error: jobs name files, which each machine reads: stdin is not one".to_owned(),
        ));
    }
    if verify.budget.is_some() && !args.explore && !args.exhaustive {
        return Err(Failure(
            "error: --budget goes with --explore and --exhaustive: variants that are named have \
             budgets of their own"
                .to_owned(),
        ));
    }
    verify.check_many(true)?;
    let list = List::new(args)?;
    let inputs = verify.jobs()?.unwrap_or_else(|| {
        vec![Job {
            shader: verify.shader.clone(),
            folder: None,
            chosen: Chosen::Given,
        }]
    });
    let (mut all, mut failed) = (BTreeMap::new(), 0);
    for input in &inputs {
        match list.jobs(input) {
            Ok(jobs) => all.extend(jobs.into_iter().map(|job| (job.key.clone(), job))),
            Err(Failure(why)) if promises::is_left_out(input, &why) => {}
            Err(Failure(why)) => {
                failed += 1;
                output::message(&format!("{}: {why}", named(&input.shader).join(" ")));
            }
        }
    }
    for job in all.values() {
        output::data(&serde_json::to_string(job)?)?;
    }
    match failed {
        0 => Ok(Ending::Fine),
        n => Err(Failure(format!(
            "error: {} could not be read; the jobs of the others are listed",
            output::count(n, "input")
        ))),
    }
}

fn named(shader: &ShaderArgs) -> Vec<String> {
    let files = shader.files.iter();
    files.map(|f| f.display().to_string()).collect()
}

/// The part that all jobs of one input share.
pub struct Input<'a> {
    shader: &'a ShaderArgs,
    /// BLAKE3 of the files, by path.
    files: BTreeMap<String, String>,
}

impl<'a> Input<'a> {
    /// Hashes the files of a shader or scene.
    pub fn new(shader: &'a ShaderArgs) -> Result<Self, Failure> {
        let hashed = |path: PathBuf| {
            let bytes = std::fs::read(&path)
                .map_err(|e| Failure(format!("error: {}: {e}", path.display())))?;
            let name = from_here(&path).display().to_string();
            Ok((name, jobs::hash(&bytes)))
        };
        Ok(Self {
            shader,
            files: shader
                .reads()
                .into_iter()
                .map(hashed)
                .collect::<Result<_, Failure>>()?,
        })
    }

    /// A job. `plans` are those that it draws.
    pub fn job(
        &self,
        (kind, seconds): (Kind, f64),
        variant: &str,
        arguments: Vec<String>,
        plans: &[Plan],
    ) -> Result<jobs::Job, Failure> {
        let mut job = jobs::Job {
            schema: JOB_SCHEMA.to_owned(),
            key: String::new(),
            kind,
            input: named(self.shader),
            variant: variant.to_owned(),
            arguments,
            adapter: None,
            files: self.files.clone(),
            seconds: 0.0,
        };
        let texts = promises::frame(plans).unwrap_or_default();
        job.key = jobs::key([jobs::VERSION, &serde_json::to_string(&job)?, &texts]);
        job.seconds = (seconds * 10.0).round() / 10.0;
        Ok(job)
    }
}

/// Estimated seconds for pictures of a scene's views on a fast GPU, and the number of views.
fn estimate(scene: &Scene, frames_per_camera: usize) -> (f64, f64) {
    let cameras = scene.cameras.iter();
    let frames: usize = cameras.map(|c| c.frames.len().min(frames_per_camera)).sum();
    let views = (frames * scene.orders.len().max(1)) as f64;
    let megapixels = f64::from(scene.size[0]) * f64::from(scene.size[1]) / 1e6;
    let pictures = SECONDS_TO_START + 2.0 * views * megapixels * SECONDS_A_MEGAPIXEL;
    (pictures, views)
}

/// Checks that `plan` has these flags of `verify`.
fn check_flags(words: &[String]) -> Result<(), Failure> {
    let command = Cli::command();
    let plan = command.find_subcommand("plan");
    let known: Vec<&str> = plan
        .into_iter()
        .flat_map(clap::Command::get_arguments)
        .filter_map(clap::Arg::get_long)
        .collect();
    match flags::without(words, &known).first() {
        None => Ok(()),
        Some(word) => Err(Failure(format!(
            "error: {word} does not go with --exhaustive: `plan` has no such flag"
        ))),
    }
}

/// The job of every candidate of a scene.
pub fn exhaustive(
    input: &Input<'_>,
    scene: &Scene,
    budget: Option<Budget>,
    arguments: Vec<String>,
) -> Result<jobs::Job, Failure> {
    let originals = measure::originals(scene);
    let mut plans = Vec::new();
    let recipes = candidates::recipes(budget)?;
    for recipe in &recipes {
        plans.extend(measure::variant(&originals, recipe, &Facts::default()).plans);
    }
    let given = |flag: &str| {
        let flag = format!("--{flag}=");
        arguments
            .iter()
            .find_map(|word| word.strip_prefix(flag.as_str()))
    };
    let frames = given("frames").and_then(|n| n.parse().ok());
    let (pictures, views) = estimate(scene, frames.unwrap_or(plan::FRAMES));
    let seconds = given("seconds").and_then(|n| n.parse().ok());
    let seconds = pictures * recipes.len() as f64 + views * seconds.unwrap_or(plan::SECONDS);
    input.job((Kind::Time, seconds), EVERY, arguments, &plans)
}

struct List<'a> {
    args: &'a JobsArgs,
    given: Vec<Recipe>,
    /// Leaves out recipes whose parameters name something that no material of an input has.
    declared: Vec<Recipe>,
    arguments: Vec<String>,
}

impl<'a> List<'a> {
    fn new(args: &'a JobsArgs) -> Result<Self, Failure> {
        let verify = &args.verify;
        let given = verify::recipes(&verify.variants.sweeps()?);
        let mut declared = match verify.every_pass {
            true => candidates::every_pass()?,
            false => Vec::new(),
        };
        if args.explore {
            declared.extend(candidates::recipes(verify.budget)?);
        }
        if given.is_empty() && declared.is_empty() {
            declared = verify::recipes(&candidates::by_default()?);
        }
        let mut arguments = flags::without(&verify.flags, &["explore", "exhaustive", "only-on"]);
        if args.exhaustive {
            check_flags(&arguments)?;
        } else {
            arguments = flags::without(&arguments, &promises::OF_SEVERAL);
        }
        Ok(Self {
            args,
            given,
            declared,
            arguments,
        })
    }

    /// The jobs of one input. Of declared variants that draw one text, the shortest gets one.
    fn jobs(&self, job: &Job) -> Result<Vec<jobs::Job>, Failure> {
        let verify = &self.args.verify;
        let input = Input::new(&job.shader)?;
        let scene = verify::scene(verify, &job.shader, &Variables::new())?;
        let mut found = match self.args.exhaustive {
            true => vec![exhaustive(
                &input,
                &scene,
                verify.budget,
                self.arguments.clone(),
            )?],
            false => self.of_variants(&input, &scene)?,
        };
        for job in &mut found {
            job.adapter.clone_from(&self.args.only_on);
        }
        Ok(found)
    }

    fn of_variants(&self, input: &Input<'_>, scene: &Scene) -> Result<Vec<jobs::Job>, Failure> {
        let verify = &self.args.verify;
        let originals = measure::originals(scene);
        for recipe in &self.given {
            recipe.check_names(&originals)?;
        }
        let is_named = |recipe: &&Recipe| recipe.check_names(&originals).is_ok();
        let mut declared: Vec<&Recipe> = self.declared.iter().filter(is_named).collect();
        declared.sort_by_key(|recipe| recipe.steps.len());
        let given = self.given.iter().map(|recipe| (recipe, true));
        let recipes = given.chain(declared.into_iter().map(|recipe| (recipe, false)));
        let mut texts = BTreeSet::new();
        let (pictures, _) = estimate(scene, verify.frames);
        let mut kinds = vec![(Kind::Picture, pictures)];
        if verify.time.is_some_and(|time| time != TimeArg::No) {
            kinds.push((Kind::Time, pictures + verify.seconds));
        }
        let mut found = Vec::new();
        for (recipe, is_given) in recipes {
            // Facts of an adapter, which change few texts, are not known here.
            let variant = measure::variant(&originals, recipe, &measure::known_for(scene, recipe));
            // Nor are the groups of draws that `specialize` makes versions for. A made-up scene has none.
            let specialises = recipe.steps.iter().any(|s| s.pass == Specialize::INFO.name);
            let is_chosen_there =
                measure::leaves_a_choice(recipe) || specialises && !scene.is_made_up;
            if variant.is_refused() && !is_chosen_there {
                continue;
            }
            let text = match is_chosen_there {
                true => None,
                false => promises::frame(&variant.plans),
            };
            let is_new = text.is_none_or(|text| texts.insert(text));
            if !is_new && !is_given {
                continue;
            }
            for kind in &kinds {
                let mut arguments = self.arguments.clone();
                if let (Kind::Time, Some(time)) = (kind.0, verify.time)
                    && let Some(word) = clap::ValueEnum::to_possible_value(&time)
                {
                    arguments.push(format!("--time={}", word.get_name()));
                }
                found.push(input.job(*kind, &recipe.to_string(), arguments, &variant.plans)?);
            }
        }
        Ok(found)
    }
}
