//! One material: read, rewritten by each pass, written in each target, and judged.

use std::collections::{BTreeSet, HashSet};
use std::path::{Path, PathBuf};

use preshade_compiler::emit;
use preshade_compiler::front::{self, Code, Options, Source};
use preshade_compiler::pipeline;
use preshade_compiler::recipe::Step;
use preshade_geometry::PASSES;
use preshade_plan::pass::Facts;
use preshade_plan::plan::{BindingSource, Plan};
use preshade_plan::plan_file::{PlanFile, Target};
use preshade_plan::state::MaterialState;
use shader_text::files::{self, File};

use crate::Arguments;
use crate::cases::is_vertex;
use crate::judges::{self, Author};
use crate::record::{Outcome, Record};
use crate::sayable;

const TARGETS: [Target; 5] = [
    Target::Wgsl,
    Target::Spirv,
    Target::Glsl450,
    Target::GlslVulkan,
    Target::GlslEs300,
];

/// A material under examination.
struct Look<'a> {
    arguments: &'a Arguments,
    /// Where files are written.
    dir: PathBuf,
    /// Of the vertex and of the fragment stage.
    authors: [Option<Author>; 2],
    /// Texts that have been judged.
    seen: HashSet<(Target, Vec<u8>)>,
    record: Record,
}

/// What becomes of the material of the arguments' files.
pub fn looked_at(arguments: &Arguments) -> Record {
    let own = std::env::temp_dir().join(format!("preshade-corpus-{}", std::process::id()));
    let dir = arguments.keep.clone().unwrap_or_else(|| own.clone());
    std::fs::create_dir_all(&dir).unwrap();
    let mut look = Look {
        arguments,
        dir,
        authors: [None, None],
        seen: HashSet::new(),
        record: Record::default(),
    };
    look.whole();
    std::fs::remove_dir_all(own).ok();
    look.record
}

/// The material's sources, with a vertex stage if a fragment shader is alone.
fn sources(paths: &[PathBuf], options: &Options) -> Result<Vec<Source>, front::Error> {
    let mut sources = crate::one::sources(paths);
    let extension = paths[0].extension().and_then(|e| e.to_str());
    if paths.len() == 1 && matches!(extension, Some("frag" | "fs")) {
        let text = front::vertex_stage_for(&sources[0], options)?;
        sources.insert(0, Source::new("generated.vert", text));
    }
    Ok(sources)
}

impl Look<'_> {
    fn whole(&mut self) {
        let paths = &self.arguments.paths;
        let include = &self.arguments.include;
        if self.arguments.judge {
            for path in paths {
                let author = judges::author(path, &self.dir, include);
                let stage = usize::from(!is_vertex(path));
                let unsayable = author.spirv.as_ref().and_then(|spirv| {
                    let bytes = std::fs::read(spirv).ok()?;
                    sayable::unsayable(&bytes)
                });
                self.record.unsayable = self.record.unsayable.take().or(unsayable);
                let legal = self.record.legal.unwrap_or(true) && author.is_legal;
                self.record.legal = Some(legal);
                self.authors[stage] = Some(author);
            }
            let words = |stage: &Option<Author>| stage.as_ref().and_then(|a| a.spirv.clone());
            let pair = words(&self.authors[0]).zip(words(&self.authors[1]));
            if pair.is_some_and(|(v, f)| judges::are_apart(&v, &f)) {
                self.record.legal = Some(false);
            }
        }
        let is_lone_fragment =
            paths.len() == 1 && paths[0].to_string_lossy().ends_with(".frag.spv");
        if is_lone_fragment {
            let half = || "material without its vertex stage".to_owned();
            self.record.unsayable.get_or_insert_with(half);
        }
        let options = Options {
            include: include.clone(),
            ..Options::default()
        };
        let read = sources(paths, &options).and_then(|s| front::parse(&s, &options));
        let original = match read {
            Ok(parsed) => parsed.plan("material", &MaterialState::default()),
            Err(error) => {
                let said = match error.code() {
                    Code::Panic => error.notes().join("; "),
                    _ => error.message().to_owned(),
                };
                if error.code() == Code::Panic {
                    self.record.panics.push(said.clone());
                }
                self.record.read = self.refused("reading", error.code().name(), said);
                return;
            }
        };
        self.record.read = Outcome::Done;
        self.written("original", &original);
        if self.arguments.no_passes {
            return;
        }
        for pass in PASSES.iter() {
            let name = pass.info().name;
            let step = Step {
                pass: name.to_owned(),
                params: serde_json::Map::new(),
                site: None,
            };
            let outcome = match pipeline::run(&step, &original, &[], &Facts::default()) {
                Ok(outcome) => {
                    self.written(name, &outcome.plan);
                    Outcome::Done
                }
                Err(refused) => {
                    let refusal = refused.first();
                    self.refused(name, &refusal.code, refusal.reason)
                }
            };
            self.record.passes.insert(name.to_owned(), outcome);
        }
    }

    /// Takes down a refusal, and a bug if it is told as one.
    fn refused(&mut self, what: &str, code: &str, message: String) -> Outcome {
        let line = || format!("{what}: {message}");
        if message.contains("panicked") {
            self.record.panics.push(line());
        } else if message.contains("is a bug") || code == "writer" {
            self.record.bugs.push(line());
        }
        Outcome::Refused {
            code: code.to_owned(),
            message,
        }
    }

    /// Writes a plan in each target, and has it judged.
    fn written(&mut self, pass: &str, plan: &Plan) {
        let judge = self.arguments.judge;
        for target in TARGETS {
            let outcome = match emit::emit(plan, &[target], &emit::Options::default()) {
                Ok(files) => {
                    let dir = self.dir.join(pass).join(target.name());
                    if judge || self.arguments.keep.is_some() {
                        files::write(&dir, &files).unwrap();
                    }
                    if judge {
                        self.judged(pass, plan, target, &files, &dir);
                    }
                    Outcome::Done
                }
                Err(error) => {
                    let what = format!("{pass} in {target}");
                    self.refused(&what, error.code(), error.to_string())
                }
            };
            let targets = self.record.targets.entry(pass.to_owned()).or_default();
            targets.insert(target.name().to_owned(), outcome);
        }
    }

    fn judged(&mut self, pass: &str, plan: &Plan, target: Target, files: &[File], dir: &Path) {
        let features = plan.passes.iter().flat_map(|p| &p.features);
        let features = features.chain(plan.compute.iter().flat_map(|p| &p.features));
        let is_nagas = |f: &String| f.starts_with("wgpu-") || f == "immediates";
        let is_beyond_tint = target == Target::Wgsl && features.clone().any(is_nagas);
        for file in files.iter().filter(|f| !f.name.ends_with(".json")) {
            // The name tells the stage.
            let extension = file.name.rsplit('.').next().unwrap_or_default();
            let text = [extension.as_bytes(), &file.bytes].concat();
            if !self.seen.insert((target, text)) {
                continue;
            }
            let refused = judges::of_written(&dir.join(&file.name), target);
            match refused {
                Some(_) if is_beyond_tint => self.record.beyond_tint += 1,
                Some(said) => {
                    let line = format!("{pass} in {target}: {}: {said}", file.name);
                    self.record.invalid.push(line);
                }
                None => {}
            }
            self.record.judged += 1;
        }
        if matches!(target, Target::Spirv | Target::GlslVulkan)
            && let Err(error) = self.reflected(pass, plan, target, files, dir)
        {
            let line = format!("{pass} in {target}: {error}");
            self.record.reflection.push(line);
        }
    }

    /// Compares the interface of each stage with that of the author's words. The original's is the
    /// same; a variant's has nothing else but what its plan says that it adds.
    fn reflected(
        &mut self,
        pass: &str,
        plan: &Plan,
        target: Target,
        files: &[File],
        dir: &Path,
    ) -> Result<(), String> {
        let of_plan = files.iter().find(|f| f.name.ends_with(".plan.json"));
        let plan_file: PlanFile = of_plan
            .and_then(|f| serde_json::from_slice(&f.bytes).ok())
            .ok_or("there is no plan.json")?;
        for (of_pass, files) in plan.passes.iter().zip(&plan_file.files) {
            let stages = [files.vertex.get(&target), files.fragment.get(&target)];
            for (stage, file) in stages.into_iter().enumerate() {
                let author = self.authors[stage].as_ref().and_then(|a| a.spirv.clone());
                let (Some(file), Some(author)) = (file, author) else {
                    continue;
                };
                let is_vertex = stage == 0;
                let is_named = target == Target::Spirv;
                let wanted = judges::interface(&author, is_vertex, is_named)?;
                let mut allowed = wanted.clone();
                // A pass may move work, with the resources that it reads, to the other stage.
                let other = self.authors[1 - stage].as_ref();
                let other = match other.and_then(|a| a.spirv.as_ref()) {
                    Some(other) => judges::interface(other, false, is_named)?,
                    None => BTreeSet::new(),
                };
                let words = judges::words(&dir.join(&file.file))?;
                let found = judges::interface(&words, is_vertex, is_named)?;
                // If the author's stages declare one block with different members or names, the IR
                // has the longer one, and the first one's name.
                let place = |line: &str| {
                    let head = line.split(" { ").next()?;
                    // The two stages may call the block differently.
                    head.rsplit_once(' ').map(|(place, _)| place.to_owned())
                };
                let longer = |line: &String| {
                    other.contains(line) && wanted.iter().any(|l| place(l) == place(line))
                };
                let longer: BTreeSet<String> = found
                    .difference(&wanted)
                    .filter(|l| longer(l))
                    .cloned()
                    .collect();
                let is_shorter = |line: &String| longer.iter().any(|l| place(l) == place(line));
                allowed.extend(longer.clone());
                if pass != "original" {
                    allowed.extend(other.clone());
                }
                let own = |source: &BindingSource| matches!(source, BindingSource::Author);
                let added: Vec<String> = of_pass
                    .bindings
                    .iter()
                    .filter(|b| !own(&b.source))
                    .map(|b| format!("set {} binding {}:", b.group, b.binding))
                    .collect();
                let is_added = |line: &&String| added.iter().any(|a| line.starts_with(a));
                let strange = found.difference(&allowed).filter(|l| !is_added(l));
                let strange: Vec<_> = strange.map(|l| format!("has {l}")).collect();
                let lost: BTreeSet<_> = match pass {
                    "original" => {
                        let lost = wanted.difference(&found).cloned();
                        lost.filter(|l| !is_shorter(l)).collect()
                    }
                    _ => BTreeSet::new(),
                };
                let used = match lost.is_empty() {
                    true => BTreeSet::new(),
                    false => judges::used_interface(&author, is_vertex, is_named)?,
                };
                let (lost, unused): (Vec<_>, Vec<_>) =
                    lost.into_iter().partition(|l| used.contains(l));
                // The plan says whose default is final.
                let notes = &plan_file.plan.notes;
                let is_final = |line: &String| {
                    let id = line
                        .strip_prefix("constant ")
                        .and_then(|l| l.split_once(' '));
                    let start = id.map(|(id, _)| format!("the specialisation constant {id}, "));
                    start.is_some_and(|s| notes.iter().any(|n| n.starts_with(&s)))
                };
                let (settled, lost): (Vec<_>, Vec<_>) = lost.into_iter().partition(is_final);
                self.record.settled.extend(settled);
                let lost = lost.into_iter().map(|l| format!("lacks {l}"));
                let differences: Vec<String> = strange.into_iter().chain(lost).collect();
                if !differences.is_empty() {
                    let all = differences.join("; ");
                    let line = format!("{pass} in {target}: {}: {all}", file.file);
                    self.record.reflection.push(line);
                }
                self.record.unused.extend(unused);
                self.record.longer.extend(longer);
                self.record.reflected += 1;
            }
        }
        Ok(())
    }
}
