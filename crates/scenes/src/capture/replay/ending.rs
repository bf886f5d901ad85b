//! Shaders of a replay whose loops end. The page's browser drew them to an end, but another driver's rounding may keep a
//! loop from it, and a loop without end hangs a GPU. Scenes made of the frame are drawn with a check that reports this
//! ([`preshade_draw::render`]); a replay leaves such a loop and says nothing.

use std::borrow::Cow;
use std::sync::Arc;

use naga::Module;
use preshade_passes::rebuild::bounded;
use preshade_plan::program::Program;
use shader_text::source::{Language, SourceMap};
use wgpu::ShaderSource;

/// The module, or a copy of it in which every loop ends.
pub(super) fn module(program: &Program) -> Module {
    // A loop around a barrier cannot be left by some of its invocations: it stays as it is.
    let cut = bounded::cut(program).ok().flatten();
    cut.as_ref().unwrap_or(program).module().clone()
}

/// The source as it is, unless a loop of it may not end.
pub(super) fn source(source: ShaderSource<'static>) -> ShaderSource<'static> {
    let read = match &source {
        ShaderSource::Wgsl(text) => naga::front::wgsl::parse_str(text).ok(),
        ShaderSource::SpirV(words) => {
            let options = naga::front::spv::Options {
                adjust_coordinate_space: false,
                ..Default::default()
            };
            naga::front::spv::Frontend::new(words.iter().copied(), &options)
                .parse()
                .ok()
        }
        _ => None,
    };
    let cut = read
        .and_then(|read| Program::new(read, Arc::new(SourceMap::new()), Language::Wgsl).ok())
        .and_then(|program| bounded::cut(&program).ok().flatten());
    match cut {
        Some(cut) => ShaderSource::Naga(Cow::Owned(cut.module().clone())),
        None => source,
    }
}
