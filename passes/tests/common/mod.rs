//! What every test of this crate needs: WGSL in, WGSL out.
#![allow(dead_code, clippy::unwrap_used, clippy::panic)]

pub mod random;
pub mod specialized;
pub mod stages;

use std::sync::Arc;

use naga::back::wgsl::WriterFlags;
use preshade_passes::program::{Language, Program, SourceMap};

/// A validated program from WGSL.
pub fn program(source: &str) -> Program {
    let module = match naga::front::wgsl::parse_str(source) {
        Ok(module) => module,
        Err(e) => panic!("{}", e.emit_to_string(source)),
    };
    let mut sources = SourceMap::new();
    sources.add("test.wgsl", source);
    match Program::new(module, Arc::new(sources), Language::Wgsl) {
        Ok(program) => program,
        Err(e) => panic!("{e}: {:?}", e.labels),
    }
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
