//! What is fuzzed, apart from what drives it: `fuzz/` under libFuzzer, `tests/it/fuzz_corpus.rs` on
//! what was found.
//!
//! A target takes any bytes. It panics where preshade is wrong: a panic of ours, an invalid module,
//! a text that does not read back. An error or a refusal is an answer.
#![allow(dead_code, clippy::unwrap_used, clippy::panic)]

pub mod ir;
pub mod recipes;
#[cfg(feature = "verify")]
pub mod scenes;

use std::path::{Path, PathBuf};
use std::sync::Arc;

use preshade_compiler::emit;
use preshade_compiler::front::{self, Source};
use preshade_compiler::recipe::Recipe;
use preshade_plan::pass::Facts;
use preshade_plan::plan::Plan;
use preshade_plan::plan_file::Target;
use preshade_plan::program::Program;
use preshade_plan::state::MaterialState;
use shader_text::options::Options;
use shader_text::source::Language;

/// Bytes as choices: every choice has an answer, and equal bytes give equal ones.
pub struct Bytes<'a>(pub &'a [u8]);

impl Bytes<'_> {
    pub fn byte(&mut self) -> u8 {
        match self.0 {
            [first, rest @ ..] => {
                let first = *first;
                self.0 = rest;
                first
            }
            [] => 0,
        }
    }

    /// Below `n`, which is above 0.
    pub fn below(&mut self, n: usize) -> usize {
        let wide = usize::from(self.byte());
        match n {
            0 | 1 => 0,
            2..=256 => wide % n,
            _ => (wide | usize::from(self.byte()) << 8) % n,
        }
    }

    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }
}

/// The root of the checkout; where that is on another machine than it was built on, the folder that
/// the fuzzer runs in.
pub fn root() -> PathBuf {
    let here = Path::new(env!("CARGO_MANIFEST_DIR"));
    let all = [Some(here), here.parent(), Some(Path::new("."))];
    let mut all = all.into_iter().flatten();
    let found = all.find(|folder| folder.join("fixtures").is_dir());
    found.unwrap_or(here).to_owned()
}

/// Parses, and emits what parses.
fn parsed(sources: &[Source]) {
    match front::parse(sources, &Options::default()) {
        Ok(parsed) => {
            let fragment = parsed.fragment.as_deref();
            // One that the writers have to write: a program that no transform has touched ships as
            // its author's text.
            let module = parsed.program.module().clone();
            let program = parsed.program.with_module(module).unwrap();
            let state = MaterialState::default();
            emitted(&Plan::original(
                "m",
                program,
                &parsed.vertex,
                fragment,
                &state,
            ));
        }
        Err(error) => {
            let told = error.render(shader_text::error::Color::Never);
            let by_naga = told.contains("/naga-30") || told.contains("/pp-rs");
            assert!(
                error.code() != shader_text::error::Code::Panic || by_naga,
                "{told}"
            );
        }
    }
}

/// Emits a plan for every target: each text reads back, or the target cannot say it.
pub fn emitted(plan: &Plan) {
    for target in Target::GENERAL {
        match emit::emit(plan, &[target], &emit::Options::default()) {
            Ok(_) | Err(emit::EmitError::Inexpressible { .. }) => {}
            // A panic or a refusal of naga's writers is told and nothing is shipped; the fuzzer is
            // after what is ours.
            Err(emit::EmitError::Writer { .. }) => {}
            Err(e) => panic!("{e}"),
        }
    }
}

/// One WGSL file.
pub fn wgsl(data: &[u8]) {
    if let Ok(text) = std::str::from_utf8(data) {
        parsed(&[Source::new("m.wgsl", text)]);
    }
}

/// A GLSL vertex and a fragment file, between them a byte of 0.
pub fn glsl(data: &[u8]) {
    let Ok(text) = std::str::from_utf8(data) else {
        return;
    };
    let (vertex, fragment) = text.split_once('\0').unwrap_or((VERTEX, text));
    parsed(&[
        Source::new("m.vert", vertex),
        Source::new("m.frag", fragment),
    ]);
}

const VERTEX: &str =
    "#version 450\nlayout(location = 0) in vec4 p;\nvoid main() { gl_Position = p; }\n";

/// A module of both stages, or of one, through passes and writers.
pub fn whole(module: naga::Module) {
    let Ok(program) = Program::new(module, Arc::default(), Language::Wgsl) else {
        return;
    };
    let named = |stage| {
        let entries = &program.module().entry_points;
        let found = entries.iter().find(|e| e.stage == stage);
        found.map(|e| e.name.clone())
    };
    let Some(vertex) = named(naga::ShaderStage::Vertex) else {
        return;
    };
    let fragment = named(naga::ShaderStage::Fragment);
    let state = MaterialState::default();
    let plan = Plan::original("m", program, &vertex, fragment.as_deref(), &state);
    for recipe in [
        "depth-prepass",
        "early-discard",
        "hoist",
        "visibility-buffer:budget=1",
    ] {
        let recipe = Recipe::parse_list(recipe).unwrap();
        if let Ok(plan) = recipe.apply(&plan, &Facts::without_ties()) {
            emitted(&plan);
        }
    }
}
