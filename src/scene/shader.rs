//! Shader files into programs: the scene's call of the front end.

use std::sync::Arc;

use naga::ShaderStage;
use preshade_passes::program::{Language, Program, SourceMap};

use super::Error;

/// A linked program and the entry points a material draws with.
pub(super) struct Parsed {
    pub program: Program,
    pub vertex: String,
    pub fragment: Option<String>,
}

/// One file of shader text.
pub(super) struct Text {
    pub name: String,
    pub text: String,
}

/// Parses one file that holds both stages. Entry points not named are the only ones of their stage.
pub(super) fn parse(
    files: &[Text],
    vertex: Option<&str>,
    fragment: Option<&str>,
) -> Result<Parsed, Error> {
    let [file] = files else {
        return Err(Error::new("two-file shaders need the front end"));
    };
    let mut sources = SourceMap::new();
    sources.add(&file.name, &file.text);
    let module = naga::front::wgsl::parse_str(&file.text).map_err(|e| {
        Error::new(format!("`{}` does not parse: {e}", file.name))
            .detail(e.emit_to_string_with_path(&file.text, &file.name))
    })?;
    let program = Program::new(module, Arc::new(sources), Language::Wgsl)
        .map_err(|e| Error::new(format!("`{}` is not valid: {e}", file.name)))?;
    let entry = |stage: ShaderStage, wanted: Option<&str>| {
        let names: Vec<&str> = program
            .module()
            .entry_points
            .iter()
            .filter(|e| e.stage == stage)
            .map(|e| e.name.as_str())
            .collect();
        match (wanted, names.as_slice()) {
            (Some(w), names) if names.contains(&w) => Ok(Some(w.to_owned())),
            (Some(w), names) => Err(
                Error::new(format!("no entry point `{w}` in `{}`", file.name))
                    .suggest(w, names.iter().copied()),
            ),
            (None, []) => Ok(None),
            (None, [one]) => Ok(Some((*one).to_owned())),
            (None, many) => Err(Error::new(format!(
                "`{}` has several entry points of one stage: {}",
                file.name,
                many.join(", ")
            ))
            .help("name one with `entry`")),
        }
    };
    let vertex = entry(ShaderStage::Vertex, vertex)?
        .ok_or_else(|| Error::new(format!("`{}` has no vertex entry point", file.name)))?;
    let fragment = entry(ShaderStage::Fragment, fragment)?;
    Ok(Parsed {
        program,
        vertex,
        fragment,
    })
}
