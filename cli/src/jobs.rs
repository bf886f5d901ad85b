//! `preshade jobs`: measurements as lines that any scheduler can share out.

use std::collections::BTreeMap;
use std::path::Path;

use preshade::unstable::jobs::{self, JOB_SCHEMA, Kind};
use preshade::unstable::measure;
use preshade::unstable::passes::pass::Facts;
use preshade::unstable::recipe::Recipe;
use preshade::unstable::scene::Variables;
use preshade::unstable::search::candidates;

use crate::many::{Chosen, Job};
use crate::verify::{self, TimeArg, VerifyArgs};
use crate::{Ending, Failure, input, output, promises};

/// Arguments of `jobs`.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  preshade jobs scenes/ --explore --time first-frames > jobs.jsonl
  preshade jobs lit.wgsl --variant depth-prepass --variant early-discard > jobs.jsonl
  preshade evaluate --jobs jobs.jsonl --out results/
  preshade merge results/ -o results.json

One line a variant of an input: pictures, and with --time times too, in a line of their own. The
flags are those of `verify`. A variant that every material refuses gets no line. A line has the
hashes of all files that it reads: the machine that runs it needs the same files at the same paths.")]
pub struct JobsArgs {
    /// The variants that `plan` and `explore` try. With --budget also those that change the picture.
    #[arg(long)]
    explore: bool,
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

/// Lists the jobs.
pub fn run(args: &JobsArgs, config: Option<&Path>) -> Result<Ending, Failure> {
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
    if verify.budget.is_some() && !args.explore {
        return Err(Failure(
            "error: --budget goes with --explore: variants that are named have budgets of their own"
                .to_owned(),
        ));
    }
    verify.check_many(true)?;
    let given = verify::recipes(&verify.variants.sweeps()?);
    let mut declared = match verify.every_pass {
        true => promises::every_pass()?,
        false => Vec::new(),
    };
    if args.explore {
        declared.extend(candidates::recipes(verify.budget)?);
    }
    if given.is_empty() && declared.is_empty() {
        declared = verify::recipes(&verify::by_default()?);
    }
    let config = config.map(|path| {
        std::fs::read_to_string(path)
            .map_err(|e| Failure(format!("error: {}: {e}", path.display())))
    });
    let config = config.transpose()?.filter(|text| !text.trim().is_empty());
    let list = List {
        args,
        given,
        declared,
        config,
        arguments: arguments(verify),
    };
    let inputs = verify.jobs()?.unwrap_or_else(|| {
        vec![Job {
            shader: verify.shader.clone(),
            folder: None,
            chosen: Chosen::Given,
        }]
    });
    let (mut all, mut failed) = (BTreeMap::new(), 0);
    for input in &inputs {
        match list.jobs(input, &mut all) {
            Ok(()) => {}
            Err(Failure(why)) if promises::is_left_out(input, &why) => {}
            Err(Failure(why)) => {
                failed += 1;
                output::message(&format!("{}: {why}", named(input).join(" ")));
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

/// The flags of `verify` that each job gets.
fn arguments(verify: &VerifyArgs) -> Vec<String> {
    let words = promises::flags(&verify.shader.files);
    // Before the subcommand are flags about colours and the like.
    let subcommand = words.iter().position(|word| word == "jobs");
    words
        .into_iter()
        .skip(subcommand.map_or(0, |i| i + 1))
        .collect()
}

fn named(input: &Job) -> Vec<String> {
    let files = input.shader.files.iter();
    files.map(|f| f.display().to_string()).collect()
}

struct List<'a> {
    args: &'a JobsArgs,
    given: Vec<Recipe>,
    /// Those whose parameters name what no material of an input has are left out.
    declared: Vec<Recipe>,
    config: Option<String>,
    arguments: Vec<String>,
}

impl List<'_> {
    /// Adds the jobs of one input, by key.
    fn jobs(&self, input: &Job, all: &mut BTreeMap<String, jobs::Job>) -> Result<(), Failure> {
        let verify = &self.args.verify;
        let scene = verify::scene(verify, &input.shader, &Variables::new())?;
        let originals = measure::originals(&scene);
        for recipe in &self.given {
            recipe.check_names(&originals)?;
        }
        let is_named = |recipe: &&Recipe| recipe.check_names(&originals).is_ok();
        let recipes = self.given.iter();
        let recipes = recipes.chain(self.declared.iter().filter(is_named));
        let mut files = BTreeMap::new();
        for path in input.shader.reads() {
            let bytes = std::fs::read(&path)
                .map_err(|e| Failure(format!("error: {}: {e}", path.display())))?;
            files.insert(
                input::from_here(&path).display().to_string(),
                jobs::hash(&bytes),
            );
        }
        let cameras = scene.cameras.iter();
        let frames: usize = cameras.map(|c| c.frames.len().min(verify.frames)).sum();
        let views = (frames * scene.orders.len().max(1)) as f64;
        let megapixels = f64::from(scene.size[0]) * f64::from(scene.size[1]) / 1e6;
        let pictures = SECONDS_TO_START + 2.0 * views * megapixels * SECONDS_A_MEGAPIXEL;
        let mut kinds = vec![(Kind::Picture, pictures)];
        if verify.time.is_some_and(|time| time != TimeArg::No) {
            kinds.push((Kind::Time, pictures + verify.seconds));
        }
        for recipe in recipes {
            // Facts of an adapter, which change few texts, are not known here.
            let variant = measure::variant(&originals, recipe, &Facts::default());
            let is_chosen_there = measure::leaves_a_choice(recipe);
            if variant.is_refused() && !is_chosen_there {
                continue;
            }
            let texts = promises::frame(&variant.plans).unwrap_or_default();
            for (kind, seconds) in &kinds {
                let mut arguments = self.arguments.clone();
                if let (Kind::Time, Some(time)) = (kind, verify.time) {
                    let word = clap::ValueEnum::to_possible_value(&time);
                    let word = word.map(|v| v.get_name().to_owned());
                    arguments.extend(["--time".to_owned()].into_iter().chain(word));
                }
                let mut job = jobs::Job {
                    schema: JOB_SCHEMA.to_owned(),
                    key: String::new(),
                    kind: *kind,
                    input: named(input),
                    variant: recipe.to_string(),
                    arguments,
                    config: self.config.clone(),
                    adapter: None,
                    files: files.clone(),
                    seconds: 0.0,
                };
                let line = serde_json::to_string(&job)?;
                job.key = jobs::key([jobs::VERSION, &line, &texts]);
                job.adapter = self.args.only_on.clone();
                job.seconds = (seconds * 10.0).round() / 10.0;
                all.insert(job.key.clone(), job);
            }
        }
        Ok(())
    }
}
