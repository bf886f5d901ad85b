//! What every test of this crate needs: WGSL in, WGSL out.
#![allow(dead_code, clippy::unwrap_used, clippy::panic)]

pub mod decided;
pub mod random;
pub mod specialized;
pub mod stages;

use std::sync::Arc;

use naga::back::wgsl::WriterFlags;
use preshade_plan::program::Program;
use shader_text::source::{Language, SourceMap};

/// A validated program from WGSL.
pub fn program(source: &str) -> Program {
    match read(source) {
        Ok(program) => program,
        Err(why) => panic!("{why}"),
    }
}

/// A program from WGSL, or why it is none.
pub fn read(source: &str) -> Result<Program, String> {
    let module = naga::front::wgsl::parse_str(source).map_err(|e| e.emit_to_string(source))?;
    let mut sources = SourceMap::new();
    sources.add("test.wgsl", source);
    Program::new(module, Arc::new(sources), Language::Wgsl)
        .map_err(|e| format!("{e}: {:?}", e.labels))
}

/// The program with another module, which must validate.
pub fn validated(program: &Program, module: naga::Module) -> Program {
    match program.with_module(module.clone()) {
        Ok(program) => program,
        Err(e) => panic!("{e}: {:?}\n{module:#?}", e.labels),
    }
}

/// A program as WGSL, which must parse again.
pub fn wgsl(program: &Program) -> String {
    let text =
        naga::back::wgsl::write_string(program.module(), program.info(), WriterFlags::empty())
            .unwrap();
    if let Err(e) = naga::front::wgsl::parse_str(&text) {
        panic!("{}", e.emit_to_string(&text));
    }
    text
}

/// The pass and the parameters of a recipe of one step.
pub fn step(recipe: &'static str) -> (&'static str, serde_json::Value) {
    let (pass, params) = recipe.split_once(':').unwrap_or((recipe, ""));
    let params = params.split(',').filter_map(|p| p.split_once('='));
    let value = |text: &str| serde_json::from_str(text).unwrap_or_else(|_| text.into());
    let params = params.map(|(name, text)| (name.to_owned(), value(text)));
    (pass, serde_json::Value::Object(params.collect()))
}
