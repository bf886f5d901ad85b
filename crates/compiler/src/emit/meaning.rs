//! Compares the meaning of a written text with its program. The text is read as a program, and the
//! two are [compared](agree) as by `preshade agree --as same`.
//!
//! A text without a comparison does not count as the same: the caller gets a sentence with the
//! reason. `plan.json` has none, since a host that only writes has the same bytes.

use std::borrow::Cow;

use naga::ShaderStage;
use naga_edit::declared::Depth;
use preshade_plan::plan::{GpuPass, Plan};
use preshade_plan::program::Program;
use preshade_plan::state::MaterialState;
use preshade_validate::Effort;
use preshade_validate::agree::{self, Class, Outcome, Relation};
use shader_text::source::Language;

use super::{ClipSpace, EmitError, Emitted, Options, written_key};
use crate::front;
use preshade_plan::plan_file::Target;
use shader_text::{options, panics};

/// How much of each text's meaning is compared.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Meaning {
    /// Inputs, and steps of the interpreter for each.
    pub effort: Effort,
    /// Bytes of a pair of stages. Longer ones are not compared.
    pub most_bytes: usize,
}

impl Meaning {
    /// A few milliseconds of an ordinary shader. The bounds are counts, so that a result does not
    /// depend on the machine.
    pub const QUICK: Self = Self {
        effort: Effort {
            inputs: 6,
            seed: 0,
            steps: 2_000,
            paths: 2,
        },
        most_bytes: 24 * 1024,
    };
}

/// The files of one program in a target, and its passes.
pub(super) struct Texts<'a> {
    pub(super) plan: &'a Plan,
    /// The program's key in the plan.
    pub(super) key: &'a str,
    pub(super) program: &'a Program,
    pub(super) target: Target,
    pub(super) emitted: &'a [Emitted],
}

impl Texts<'_> {
    /// Compares the text of each pass with its program. Returns a sentence on each that was not
    /// compared.
    pub(super) fn compare(
        &self,
        options: &Options,
        meaning: Meaning,
    ) -> Result<Vec<String>, EmitError> {
        // Its author's own text, or one that no front end of ours reads.
        let is_authors = self.target == Target::Wgsl
            && self.program.language() == Language::Wgsl
            && self
                .plan
                .programs
                .get(self.key)
                .is_some_and(Program::is_as_written);
        if is_authors || matches!(self.target, Target::GlslTess | Target::GlslVulkanTess) {
            return Ok(Vec::new());
        }
        let mut uncompared = Vec::new();
        let mut compared: Vec<(&str, Option<&str>)> = Vec::new();
        let (plan, key) = (self.plan, self.key);
        for pass in plan.passes.iter().filter(|p| p.program == key) {
            let entries = (pass.vertex.as_str(), pass.fragment.as_deref());
            if compared.contains(&entries) {
                continue;
            }
            compared.push(entries);
            let Some(files) = self.files(pass) else {
                continue;
            };
            uncompared.extend(self.compare_pass(pass, &files, meaning, options)?);
        }
        Ok(uncompared)
    }

    /// The files of a pass. `None` if one is listed as not read.
    fn files(&self, pass: &GpuPass) -> Option<Vec<usize>> {
        let at = |(stage, name): (ShaderStage, &str)| {
            let key = written_key(stage, name);
            let mut all = self.emitted.iter();
            all.position(|(_, stages)| stages.iter().any(|(k, _)| *k == key))
        };
        let mut files: Vec<usize> = pass.stages().into_iter().filter_map(at).collect();
        files.dedup();
        let is_unread = |i: &usize| self.emitted[*i].1.iter().any(|(_, s)| s.unread.is_some());
        (!files.iter().any(is_unread)).then_some(files)
    }

    /// Returns the reason if they were not compared.
    fn compare_pass(
        &self,
        pass: &GpuPass,
        files: &[usize],
        meaning: Meaning,
        options: &Options,
    ) -> Result<Option<String>, EmitError> {
        let texts = files.iter().map(|i| &self.emitted[*i].0);
        let texts = texts.map(|file| (file.name.as_str(), file.bytes.as_slice()));
        let texts: Vec<(&str, &[u8])> = texts.collect();
        let name = texts.last().map_or("", |(name, _)| *name);
        let is_turned = options.glsl_clip_space == ClipSpace::OpenGl
            && !matches!(self.target, Target::Wgsl | Target::Spirv);
        let stages = files.iter().flat_map(|i| &self.emitted[*i].1);
        let mut textures = stages.flat_map(|(_, stage)| &stage.textures);
        let has_fetches = textures.any(|t| t.size.is_some());
        let held = || panics::run(|| self.held(pass, &texts, meaning));
        let found = match (is_turned, has_fetches) {
            (true, _) => Err(Failed::Uncompared("its positions are OpenGL's".into())),
            // Both are made-up values, of different functions.
            (_, true) => Err(Failed::Uncompared(
                "it samples what the program loads".into(),
            )),
            _ => held().unwrap_or_else(|_| Err(Failed::Uncompared("it panicked".into()))),
        };
        match found {
            Ok(()) => Ok(None),
            Err(Failed::Uncompared(why)) => Ok(Some(format!(
                "`{name}`: what it means was not compared with the program: {why}"
            ))),
            Err(Failed::Differs(difference)) => Err(EmitError::Differs {
                file: name.to_owned(),
                target: self.target,
                difference,
            }),
        }
    }

    fn held(
        &self,
        pass: &GpuPass,
        texts: &[(&str, &[u8])],
        meaning: Meaning,
    ) -> Result<(), Failed> {
        let bytes: usize = texts.iter().map(|(_, bytes)| bytes.len()).sum();
        if bytes > meaning.most_bytes {
            let why = format!(
                "{bytes} bytes are over the {} to compare",
                meaning.most_bytes
            );
            return Err(Failed::Uncompared(why.into()));
        }
        let fragment = pass.fragment.as_deref();
        let state = MaterialState::default();
        let original = |program: Program| {
            Plan::original(&self.plan.material, program, &pass.vertex, fragment, &state)
        };
        let ours = original(self.program.clone());
        let mut theirs = self.read(pass, texts)?.plan(&self.plan.material, &state);
        // The text may have the fragment stage of another pass.
        if fragment.is_none() {
            theirs
                .passes
                .iter_mut()
                .for_each(|pass| pass.fragment = None);
        }
        let effort = &meaning.effort;
        let held = agree::agree(&ours, &theirs, Relation::Same.into(), effort);
        let agreement = held.map_err(|e| Failed::Uncompared(e.to_string().into()))?;
        let means = |class: Class| {
            matches!(
                class,
                Class::Position
                    | Class::KeepsHidden
                    | Class::Loses
                    | Class::Depth
                    | Class::DepthBias
                    | Class::Color
            )
        };
        let mut findings = agreement.findings.iter();
        if let Some(finding) = findings.find(|f| means(f.class)) {
            let difference = format!("{}: {}", finding.class.name(), finding.words);
            return Err(Failed::Differs(difference));
        }
        let mut outcomes = agreement.promises.iter().map(|held| &held.outcome);
        let why = outcomes.find_map(|outcome| match outcome {
            Outcome::NotEvaluated { why } => Some(why),
            _ => None,
        });
        match why {
            None => Ok(()),
            Some(why) => Err(Failed::Uncompared(why.clone().into())),
        }
    }

    fn read(&self, pass: &GpuPass, texts: &[(&str, &[u8])]) -> Result<front::Parsed, Failed> {
        let sources = texts.iter().map(|(name, bytes)| {
            front::Source::from_bytes(*name, bytes.to_vec())
                .map_err(|e| Failed::Uncompared(e.to_string().into()))
        });
        let sources = sources.collect::<Result<Vec<_>, _>>()?;
        // OpenGL's GLSL keeps its author's clip space.
        let is_open_gl = self.program.declared().depth == Depth::OpenGl;
        let clip_space = match is_open_gl && self.target != Target::GlslVulkan {
            true => options::ClipSpace::OpenGl,
            false => options::ClipSpace::AsWritten,
        };
        let is_wgsl = self.target == Target::Wgsl;
        let options = options::Options {
            vertex: is_wgsl.then(|| pass.vertex.clone()),
            fragment: pass.fragment.clone().filter(|_| is_wgsl),
            clip_space: Some(clip_space),
            ..shader_text::options::Options::default()
        };
        front::parse(&sources, &options).map_err(|e| {
            let told = e.render(shader_text::error::Color::Never);
            let line = told.lines().next().unwrap_or_default();
            Failed::Uncompared(format!("it is not read with its other stage: {line}").into())
        })
    }
}

/// Why a text may mean something else than its program.
enum Failed {
    Uncompared(Cow<'static, str>),
    Differs(String),
}
