//! Makes every loop in a replay's shaders end.
//!
//! The loops ended in the page's browser, but another driver's rounding may keep one running, and
//! an endless loop hangs the GPU. Scenes have a check that reports this
//! ([`preshade_draw::render`]). A replay leaves the loop without a report.

use std::borrow::Cow;
use std::sync::Arc;

use naga::Module;
use preshade_passes::rebuild::bounded;
use preshade_plan::program::Program;
use shader_text::source::{Language, SourceMap};
use wgpu::ShaderSource;

/// The module, or a copy with bounded loops.
pub(super) fn module(program: &Program) -> Module {
    // A loop around a barrier stays unbounded, because some invocations cannot leave it alone.
    let cut = bounded::cut(program).ok().flatten();
    cut.as_ref().unwrap_or(program).module().clone()
}

/// The source, or its module with bounded loops if one may not end.
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
