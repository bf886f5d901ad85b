//! Writes a module as readable WGSL that naga and Tint accept, and checks the text by parsing it
//! again.

pub(crate) mod constants;
pub(crate) mod deep_expressions;
pub(crate) mod fingerprint;
mod initialisers;
mod loops;
mod repair;
pub(crate) mod subgroups;
pub(crate) mod tidy;
pub(crate) mod varying;

use naga::Module;
use naga::back::wgsl::{Writer, WriterFlags};
use preshade_plan::program::Program;

/// The program cannot be written as WGSL.
#[derive(Debug)]
pub(crate) enum WgslError {
    /// WGSL cannot express it.
    Inexpressible(String),
    /// naga's writer failed, with its message.
    Writer(String),
    /// The text differs from the program when read back.
    Differs(String),
}

/// Writes a program. `name` is the file's, for errors, and `header` its first lines.
pub(crate) fn write(program: &Program, name: &str, header: &str) -> Result<String, WgslError> {
    let (prepared, repaired) = written(program)?;
    let tidied = tidy::tidy(prepared.module(), &repaired);
    check(program, &format!("{header}{tidied}"), name)?;
    let sources = program.sources().files().iter();
    let enable = subgroups::restored(&tidied, sources.map(|f| f.text.as_str()));
    Ok(format!("{header}{enable}{tidied}"))
}

/// The program and naga's repaired text for it.
pub(crate) fn written(program: &Program) -> Result<(Program, String), WgslError> {
    let with = |module: Module| {
        program.with_module(module).map_err(|invalid| {
            WgslError::Writer(format!("the prepared module is invalid: {invalid}"))
        })
    };
    let mut prepared = program.clone();
    if let Some(module) = constants::hide(&prepared) {
        prepared = with(module)?;
    }
    if let Some(module) = deep_expressions::name_deep_expressions(&prepared) {
        prepared = with(module)?;
    }
    let raw = |program: &Program| {
        let mut writer = Writer::new(String::new(), WriterFlags::empty());
        let written = writer.write(program.module(), program.info());
        written.map_err(|e| WgslError::Writer(e.to_string()))?;
        Ok(writer.finish())
    };
    let written = match initialisers::set_apart(prepared.module()) {
        None => raw(&prepared)?,
        Some(apart) => apart.put_back(&raw(&with(apart.module.clone())?)?),
    };
    let written = shader_text::tokens::exact_floats(&written, shader_text::tokens::Spelling::Wgsl);
    let repaired = repair::repair(prepared.module(), &written).map_err(WgslError::Inexpressible)?;
    Ok((prepared, repaired))
}

/// Parses `text` and compares it with the program.
fn check(program: &Program, text: &str, name: &str) -> Result<(), WgslError> {
    let module = naga::front::wgsl::parse_str(text).map_err(|e| {
        let message = e.emit_to_string_with_path(text, name);
        WgslError::Differs(format!("it does not parse: {message}"))
    })?;
    let wanted = fingerprint::of(program.module());
    let found = fingerprint::of(&module);
    if let Some(difference) = fingerprint::difference(&wanted, &found) {
        return Err(WgslError::Differs(difference));
    }
    program
        .with_module(module)
        .map_err(|invalid| WgslError::Differs(format!("it is not valid: {invalid}")))?;
    Ok(())
}
