//! `preshade rewrite`: applies a recipe, and writes the shaders and the plan.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use std::time::Instant;

use preshade_compiler::command::material::assumed;
use preshade_compiler::command::refusal;
use preshade_compiler::command::rewrite::{self, OnAdapter, Report, Rewritten};
use preshade_compiler::emit;
use preshade_compiler::pipeline::{self, Applied, Frame, Skipped};
use preshade_compiler::recipe::{Recipe, Step};
use preshade_draw::render::{AdapterChoice, Gpu};
use preshade_geometry::{PASSES, pass_named};
use preshade_lab::measure::{self, validate_on};
use preshade_plan::pass::Refusal;
use preshade_plan::plan::{Plan, Role};
use preshade_plan::plan_file::Target;
use preshade_validate::{By, Effort, validate_by};
use rayon::prelude::*;
use shader_text::files::File;

use crate::input::{Materials, ShaderArgs};
use crate::materials::{self, Chosen, Job, Sum};
use crate::rewritten::{RewriteResult, Times};
use crate::watch::Reads;
use crate::{Ending, Failure, Format, depfile, output};
use shader_text::nearest::unknown;

#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  preshade rewrite lit.wgsl --pass depth-prepass                       to stdout
  preshade rewrite lit.wgsl --pass depth-prepass:form=equal --emit wgsl,spirv -o out/
  preshade rewrite lit.vert lit.frag --pass early-discard --emit glsl-es -o out/
  preshade rewrite scene.toml --pass depth-prepass -o out/             every material of a scene
  preshade rewrite shaders/ --pass depth-prepass --out-dir out/        every shader below a folder
  preshade rewrite - --lang wgsl --pass depth-prepass < lit.wgsl

A refused pass is skipped, and reported on stderr with its reason. `preshade passes` lists the
passes. A target that cannot express a material is reported too; the other targets are written, and
the exit status is 2. The files of a material are written all or none. Files that the plan.json of
an earlier run names, and the new one does not, are removed.")]
pub struct RewriteArgs {
    /// A pass of the recipe, in order: `depth-prepass`, `early-discard:quad=lane,budget=0.02` and
    /// so on.
    #[arg(long = "pass", value_name = "NAME[:k=v,..]")]
    passes: Vec<String>,
    /// Targets to write, separated by commas, beside `plan.json`. Default: wgsl, and of a captured frame of
    /// WebGL the GLSL ES that the page has.
    #[arg(long, value_enum, value_delimiter = ',')]
    emit: Vec<EmitTarget>,
    /// Folder to write to, created if necessary. Without it, shaders and plan go to stdout.
    #[arg(short, long, alias = "output", value_name = "DIR")]
    out: Option<PathBuf>,
    /// Rewrite each FILE as a material of its own, and every shader below a folder. Writes below
    /// this folder, in the same tree; several input folders get a folder each.
    #[arg(long, value_name = "DIR", conflicts_with = "out")]
    out_dir: Option<PathBuf>,
    /// Write the dependencies of the written files, as a Makefile rule.
    #[arg(long, value_name = "FILE")]
    depfile: Option<PathBuf>,
    /// Print the WGSL after this pass to stderr, or after each pass: `all`.
    #[arg(long, value_name = "PASS", value_parser = parse_pass)]
    print_after: Vec<String>,
    /// Print the time of reading, of each pass and of writing to stderr.
    #[arg(long)]
    time_passes: bool,
    /// Check each variant against the original before it is written: by proof, or on random and
    /// adversarial inputs, with an interpreter and on an adapter if there is one. A variant that
    /// breaks its contract is not written, and the exit status is 1.
    #[arg(long)]
    validate: bool,
    /// A refused pass is an error (exit status 2). Without this, it is skipped and reported.
    #[arg(long)]
    require: bool,
    /// Output form.
    #[arg(long, value_enum, default_value_t = Format::Human)]
    format: Format,
    // Last: its help heading applies to the flags after it.
    #[command(flatten)]
    pub shader: ShaderArgs,
}

impl RewriteArgs {
    /// Its input files. `None`: stdin.
    pub fn reads(&self) -> Option<Reads> {
        if self.shader.reads_stdin() {
            return None;
        }
        let jobs = self.jobs().unwrap_or_default();
        let folders = self.shader.files.iter().filter(|f| f.is_dir());
        Some(Reads {
            files: jobs.iter().flat_map(|j| j.shader.reads()).collect(),
            trees: folders.cloned().collect(),
            includes: self.shader.glsl.include.clone(),
            out: self.out_dir.clone().or_else(|| self.out.clone()),
        })
    }

    fn jobs(&self) -> Result<Vec<Job>, Failure> {
        match &self.out_dir {
            Some(out) => materials::jobs(&self.shader, out),
            None => Ok(vec![Job {
                shader: self.shader.clone(),
                folder: self.out.clone(),
                chosen: Chosen::Given,
            }]),
        }
    }
}

/// The word for every pass.
const ALL: &str = "all";

fn parse_pass(name: &str) -> Result<String, String> {
    let names = PASSES.iter().map(|p| p.info().name).chain([ALL]);
    match name == ALL || pass_named(name).is_some() {
        true => Ok(name.to_owned()),
        false => Err(unknown("pass", name, &names.collect::<Vec<_>>())),
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum EmitTarget {
    /// WGSL, one file a program.
    Wgsl,
    /// SPIR-V binaries.
    Spirv,
    /// GLSL 4.50 for OpenGL.
    Glsl,
    /// GLSL 4.50 for Vulkan.
    GlslVulkan,
    /// GLSL ES 3.00 for WebGL 2.
    GlslEs,
    /// GLSL ES 1.00 for WebGL 1, as far as it can express a material.
    #[value(name = "glsl-es-100")]
    GlslEs100,
    /// GLSL 4.00 for OpenGL, with hoisted work in a tessellation stage.
    GlslTess,
    /// GLSL 4.50 for Vulkan, likewise.
    GlslVulkanTess,
}

impl From<EmitTarget> for Target {
    fn from(target: EmitTarget) -> Self {
        match target {
            EmitTarget::Wgsl => Self::Wgsl,
            EmitTarget::Spirv => Self::Spirv,
            EmitTarget::Glsl => Self::Glsl450,
            EmitTarget::GlslVulkan => Self::GlslVulkan,
            EmitTarget::GlslEs => Self::GlslEs300,
            EmitTarget::GlslEs100 => Self::GlslEs100,
            EmitTarget::GlslTess => Self::GlslTess,
            EmitTarget::GlslVulkanTess => Self::GlslVulkanTess,
        }
    }
}

/// Rewrites a material, every material of a scene, or many with `--out-dir`. `config` is the
/// configuration file.
pub fn run(args: &RewriteArgs, config: Option<&Path>) -> Result<Ending, Failure> {
    let mut recipe = Recipe::parse(&args.passes)?;
    let read = |file: &str| fs::read_to_string(file).map_err(|e| e.to_string());
    rewrite::read_layouts(&mut recipe, &read).map_err(|e| Failure(format!("error: {e}")))?;
    let mut targets: Vec<Target> = args.emit.iter().map(|t| Target::from(*t)).collect();
    if targets.is_empty() {
        targets.push(args.shader.target());
    }
    let nowhere = args.out.is_none() && args.out_dir.is_none();
    if nowhere && targets.contains(&Target::Spirv) {
        return Err(Failure(
            "error: SPIR-V is binary: say with -o DIR where to write it".to_owned(),
        ));
    }
    if nowhere && args.depfile.is_some() {
        return Err(Failure(
            "error: --depfile lists what files depend on: give their folder with -o DIR".to_owned(),
        ));
    }
    for pass in &args.print_after {
        if pass != ALL && recipe.steps.iter().all(|s| s.pass != *pass) {
            output::message(&format!(
                "warning: --print-after {pass}: no --pass is {pass}, so there is nothing to print"
            ));
        }
    }
    let jobs = args.jobs()?;
    let made: Vec<Result<RewriteResult, Failure>> = jobs
        .par_iter()
        .map(|job| make(job, args, &recipe, &targets))
        .collect();
    let mut run = Run {
        args,
        config,
        jobs: jobs.len(),
        report: Vec::new(),
        rules: Vec::new(),
        times: Vec::new(),
        errors: Vec::new(),
        sum: Sum::default(),
        assumed: Vec::new(),
        taken: BTreeMap::new(),
    };
    for (job, made) in jobs.iter().zip(made) {
        run.add(job, made)?;
    }
    run.end()
}

/// A run over all jobs.
struct Run<'a> {
    args: &'a RewriteArgs,
    config: Option<&'a Path>,
    jobs: usize,
    report: Vec<Rewritten>,
    rules: Vec<depfile::Rule>,
    times: Vec<Times>,
    errors: Vec<String>,
    sum: Sum,
    /// Notes about assumed pipeline state.
    assumed: Vec<String>,
    /// Written files, each with the first file of its job.
    taken: BTreeMap<PathBuf, &'a Path>,
}

impl<'a> Run<'a> {
    /// Adds a job, and writes its files.
    fn add(&mut self, job: &'a Job, made: Result<RewriteResult, Failure>) -> Result<(), Failure> {
        if made.is_err() && job.chosen == Chosen::Found && job.shader.is_no_material() {
            self.sum.no_material += 1;
            output::message(&materials::of_files(
                "note: no material: there is no entry point of a stage that one needs",
                job,
            ));
            return Ok(());
        }
        let mut made = made.unwrap_or_else(|Failure(error)| RewriteResult {
            errors: vec![error],
            ..RewriteResult::default()
        });
        for message in &made.messages {
            output::message(&self.named(message, job));
        }
        self.assumed.append(&mut made.assumed);
        if self.args.require {
            let refused = made.materials.iter().flat_map(|(material, _)| {
                let of = &material.material;
                let told = move |r: &Refusal| {
                    format!(
                        "error: `{of}` refuses {} ({}), and --require is given",
                        r.pass, r.code
                    )
                };
                material.refusals.iter().map(told)
            });
            made.errors.extend(refused.collect::<Vec<_>>());
        }
        self.sum.failed += usize::from(!made.errors.is_empty());
        for error in &made.errors {
            let error = self.named(error, job);
            if !self.errors.contains(&error) {
                self.errors.push(error);
            }
        }
        self.times.push(std::mem::take(&mut made.times));
        let files = made.materials.iter().flat_map(|(_, files)| files);
        let mut files: Vec<File> = files.cloned().collect();
        if !files.is_empty() {
            files.append(&mut made.versions);
        }
        if let Some(folder) = job.folder.as_ref().filter(|_| !files.is_empty()) {
            // The files of a job are written all or none. Other jobs are unaffected.
            if let Err(Failure(why)) = self.write(job, folder, files, &mut made) {
                self.errors.push(why);
                return Ok(());
            }
        } else if self.args.format == Format::Human {
            for file in files {
                let text = String::from_utf8_lossy(&file.bytes);
                output::data(&format!("// {}\n{text}", file.name))?;
            }
        }
        for (material, _) in made.materials.iter().filter(|(_, files)| !files.is_empty()) {
            self.sum
                .add(!material.recipe.is_empty(), &material.refusals);
        }
        made.hints.iter().for_each(|m| output::message(m));
        let materials = made.materials.into_iter();
        self.report
            .extend(materials.map(|(rewritten, _)| rewritten));
        Ok(())
    }

    /// A message with the files of its job, if there are several jobs.
    fn named(&self, message: &str, job: &Job) -> String {
        match self.jobs {
            1 => message.to_owned(),
            _ => materials::of_files(message, job),
        }
    }

    /// Writes the files of a job.
    fn write(
        &mut self,
        job: &'a Job,
        folder: &Path,
        files: Vec<File>,
        made: &mut RewriteResult,
    ) -> Result<(), Failure> {
        let from = job.shader.files.first();
        let from = from.map_or(Path::new("-"), PathBuf::as_path);
        let paths: Vec<PathBuf> = files.iter().map(|f| folder.join(&f.name)).collect();
        let twice = paths.iter().find_map(|p| Some((p, self.taken.get(p)?)));
        if let Some((path, first)) = twice {
            return Err(Failure(format!(
                "error: {} is already written of {}: rename {}",
                path.display(),
                first.display(),
                from.display()
            )));
        }
        self.taken.extend(paths.iter().map(|p| (p.clone(), from)));
        let all = files.len();
        let is_source = |path: &PathBuf| {
            let whole = path.canonicalize().ok();
            made.read
                .iter()
                .any(|read| read.canonicalize().ok() == whole)
        };
        let mut stale = emit::stale(folder, &files);
        stale.ours.retain(|path| !is_source(path));
        stale.others.retain(|path| !is_source(path));
        let written =
            write(folder, files, self.args.format, self.jobs).map_err(|Failure(why)| {
                self.sum.failed += usize::from(made.errors.is_empty());
                Failure(self.named(&why, job))
            })?;
        for path in stale.others {
            output::message(&format!(
                "warning: no plan names {} any more. Somebody has changed it, so it stays",
                path.display()
            ));
        }
        for path in stale.ours {
            emit::remove(&path)?;
            output::message(&format!(
                "removed {}: no plan names it any more",
                path.display()
            ));
        }
        self.sum.written += written;
        self.sum.up_to_date += all - written;
        let read = std::mem::take(&mut made.read).into_iter();
        let read = read.chain(self.config.map(Path::to_path_buf));
        self.rules.push((paths, read.collect()));
        Ok(())
    }

    /// Prints the report and the summary.
    fn end(mut self) -> Result<Ending, Failure> {
        if let Some(path) = &self.args.depfile {
            let written = depfile::write(path, &self.rules);
            self.errors
                .extend(written.err().map(|Failure(error)| error));
        }
        if self.sum.no_material == self.jobs {
            let none = "error: no shader in the folders given is a material";
            self.errors.push(none.to_owned());
        }
        let is_broken = self.report.iter().any(Rewritten::is_broken);
        if self.args.format == Format::Json {
            output::json(&Report::new(self.report, self.errors.clone()))?;
        }
        let nowhere = self.args.out.is_none() && self.args.out_dir.is_none();
        let is_written = self.sum.written > 0 || (nowhere && self.errors.is_empty());
        // For several jobs, the sum is printed.
        if self.jobs == 1 && is_written && self.args.format == Format::Human {
            self.assumed.iter().for_each(|note| output::message(note));
        }
        if self.args.time_passes {
            output::message(&Times::table(self.times.iter()));
        }
        // The summary comes last, where it is visible.
        let is_told = self.jobs > 1 && self.args.format == Format::Human;
        let line = is_told.then(|| self.sum.line());
        if !self.errors.is_empty() {
            self.errors.extend(line);
            return Err(Failure(self.errors.join("\n")));
        }
        line.iter().for_each(|line| output::message(line));
        match is_broken {
            true => Ok(Ending::ContractBroken),
            false => Ok(Ending::Fine),
        }
    }
}

/// Writes the files of one job, reports the changed ones, and returns their number.
fn write(folder: &Path, files: Vec<File>, format: Format, jobs: usize) -> Result<usize, Failure> {
    let changed = shader_text::files::write(folder, &files)?;
    if format == Format::Human {
        for path in &changed {
            output::message(&format!("wrote {}", path.display()));
        }
        if changed.is_empty() && jobs == 1 {
            output::message(&format!("{} is up to date", folder.display()));
        }
    }
    Ok(changed.len())
}

/// Reads, rewrites and emits the materials of one job.
fn make(
    job: &Job,
    args: &RewriteArgs,
    recipe: &Recipe,
    targets: &[Target],
) -> Result<RewriteResult, Failure> {
    let mut made = RewriteResult::default();
    made.messages.extend(materials::between(&job.shader.files));
    let materials = made
        .times
        .took(0, "parse", || job.shader.plans_by_draws(recipe))?;
    for original in &materials.asked {
        check_name(&original.material)?;
    }
    // The parts that a captured frame is drawn without.
    let notes = materials.scene.iter().flat_map(|scene| &scene.notes);
    made.messages
        .extend(notes.map(|note| format!("note: {note}")));
    let is_given = job.shader.state.state.is_some() || job.shader.is_scene();
    if !is_given && !recipe.steps.is_empty() {
        made.assumed
            .extend(materials.asked.iter().filter_map(assumed));
    }
    let applied = apply(&materials, recipe, args, &mut made.times);
    made.read = materials.files;
    let removed = applied
        .iter()
        .filter_map(|(plan, ..)| rewrite::removed_discard(plan));
    made.messages.extend(removed);
    let versions = materials.scene.iter().flat_map(|scene| {
        let plans: Vec<&Plan> = applied.iter().map(|(plan, ..)| plan).collect();
        measure::versions(scene, &plans)
    });
    made.versions = versions.map(|v| emit::versions(&v)).collect();
    for (original, (plan, messages, refusals)) in materials.asked.iter().zip(applied) {
        made.messages.extend(rewrite::draws_depth_alone(original));
        made.messages.extend(messages);
        made.messages
            .extend(rewrite::messages(&plan, materials.asked.len() == 1));
        let bar = args.validate.then(output::spinner);
        let told = |role: Role, promise: &str| {
            if let Some(bar) = &bar {
                bar.set_message(format!(
                    "validating `{}`, {} pass, {promise}",
                    plan.material,
                    role.name()
                ));
            }
        };
        let validation = args.validate.then(|| {
            made.times.took(u8::MAX - 1, "validate", || {
                let by = By {
                    effort: &Effort::default(),
                    runner: None,
                    told: &told,
                };
                validate_by(original, &plan, by)
            })
        });
        let checks = validation.iter().flatten();
        made.messages
            .extend(rewrite::check_messages(&plan.material, "", checks));
        let validation_on = validation.as_ref().and_then(|_| {
            let gpu = adapter().as_ref()?;
            Some(OnAdapter {
                adapter: gpu.adapter().name.clone(),
                checks: made.times.took(u8::MAX - 1, "validate on the adapter", || {
                    validate_on(gpu, original, &plan, &Effort::default(), &told)
                }),
            })
        });
        if let Some(bar) = &bar {
            bar.finish_and_clear();
        }
        match &validation_on {
            Some(OnAdapter { adapter, checks }) => {
                let place = format!(" on {adapter}");
                made.messages
                    .extend(rewrite::check_messages(&plan.material, &place, checks));
            }
            None if args.validate => made.messages.push(format!(
                "note: `{}` is not run on an adapter: none is at hand",
                plan.material
            )),
            None => {}
        }
        let elsewhere = validation_on.iter().flat_map(|v| &v.checks);
        let mut all = validation.iter().flatten().chain(elsewhere);
        let is_broken = all.any(|c| c.verdict.is_broken());
        let (files, uncompared, errors) = match is_broken {
            true => (Vec::new(), Vec::new(), Vec::new()),
            false => made
                .times
                .took(u8::MAX, "emit", || pipeline::emit_compared(&plan, targets)),
        };
        made.errors
            .extend(errors.iter().map(|e| format!("error: {e}")));
        made.messages
            .extend(uncompared.iter().map(|what| format!("note: {what}")));
        made.messages.extend(rewrite::added(&plan, &files));
        if recipe.steps.is_empty() && errors.is_empty() && args.out_dir.is_none() {
            made.hints.push(rewrite::nothing_asked_for(original));
        }
        let rewritten = Rewritten {
            validation,
            validation_on,
            ..Rewritten::new(&plan, refusals, &files, job.folder.as_deref())
        };
        made.materials.push((rewritten, files));
    }
    Ok(made)
}

/// The adapter for validation, if there is one. It is opened once.
fn adapter() -> &'static Option<Gpu> {
    static ADAPTER: OnceLock<Option<Gpu>> = OnceLock::new();
    ADAPTER.get_or_init(|| Gpu::new(&AdapterChoice::Best).ok())
}

/// Applies the recipe to the materials of a job. Returns the plans, and each material's messages
/// and refusals.
fn apply(
    materials: &Materials,
    recipe: &Recipe,
    args: &RewriteArgs,
    times: &mut Times,
) -> Vec<(Plan, Vec<String>, Vec<Refusal>)> {
    let frame = Frame {
        materials: &materials.asked,
        neighbours: &materials.frame,
    };
    let mut messages: BTreeMap<String, Vec<String>> = BTreeMap::new();
    let mut remedies: BTreeMap<(String, usize), String> = BTreeMap::new();
    let mut began = Instant::now();
    let mut inspect = |step: &Step, plan: &Plan, result: &Applied| {
        let is_it = |s: &Step| std::ptr::eq(s, step);
        let order = recipe.steps.iter().position(is_it).unwrap_or(0);
        let is_other = |(i, s): (usize, &Step)| i != order && s.pass == step.pass;
        let name = match recipe.steps.iter().enumerate().any(is_other) {
            true => format!("{} (step {})", step.pass, order + 1),
            false => step.pass.clone(),
        };
        times.add(1 + order as u8, &name, began.elapsed());
        let messages = messages.entry(plan.material.clone()).or_default();
        if let Err(refusal) = result {
            let is_it = |original: &&Plan| original.material == plan.material;
            let original = materials.asked.iter().find(is_it);
            let earlier = original.and_then(|o| {
                pipeline::earlier(o, frame.neighbours, recipe, order, &materials.known)
            });
            let mut refusal = refusal.clone();
            if let Some(before) = earlier {
                refusal.remedy =
                    format!("put `{}` before `{}`", step.pass, recipe.steps[before].pass);
                remedies.insert((plan.material.clone(), order), refusal.remedy.clone());
            }
            messages.push(refusal::rendered(&refusal, plan));
        }
        if args.print_after.iter().any(|p| *p == step.pass || p == ALL) {
            let now = result.as_ref().unwrap_or(plan);
            messages.push(format!("// after {step}\n{}", texts(now)));
        }
        began = Instant::now();
        true
    };
    let (plans, skipped) = pipeline::apply_in(frame, recipe, &materials.known, &mut inspect);
    plans
        .into_iter()
        .map(|plan| {
            let own = skipped.iter().filter(|s| s.material == plan.material);
            let refusals = own.map(|s| refused(s, recipe, &remedies)).collect();
            let messages = messages.remove(&plan.material).unwrap_or_default();
            (plan, messages, refusals)
        })
        .collect()
}

/// The refusal of a step, with the order that would lift it.
fn refused(
    skipped: &Skipped,
    recipe: &Recipe,
    remedies: &BTreeMap<(String, usize), String>,
) -> Refusal {
    let mut refusal = (*skipped.refusal).clone();
    let order = recipe.steps.iter().position(|s| *s == skipped.step);
    let key = order.map(|order| (skipped.material.clone(), order));
    if let Some(remedy) = key.and_then(|key| remedies.get(&key)) {
        refusal.remedy.clone_from(remedy);
    }
    refusal
}

/// The WGSL of a plan.
fn texts(plan: &Plan) -> String {
    let emitted = match emit::emit(plan, &[Target::Wgsl], &emit::Options::default()) {
        Ok(files) => files,
        Err(error) => return format!("// {error}"),
    };
    let shaders = emitted.iter().filter(|f| f.name.ends_with(".wgsl"));
    let texts = shaders.map(|f| format!("// {}\n{}", f.name, String::from_utf8_lossy(&f.bytes)));
    texts.collect::<Vec<_>>().join("\n")
}

/// Checks that a material's name is valid in file names, and does not lead out of the folder.
pub fn check_name(material: &str) -> Result<(), Failure> {
    // A build script could not use a lock with such a name.
    if !shader_text::files::is_material_name(material) {
        return Err(Failure(format!(
            "error: `{material}` cannot begin a file name: give another with --name"
        )));
    }
    Ok(())
}
