//! Overrides for targets that have none: each takes its default.

use naga::back::PipelineConstants;
use naga::back::pipeline_constants::{PipelineConstantError, process_overrides};
use naga::valid::ModuleInfo;
use naga::{Module, ShaderStage};
use preshade_passes::program::Program;

use super::{Error, Target};

/// A module ready for a writer that knows no overrides.
pub(super) struct Settled {
    pub(super) module: Module,
    pub(super) info: ModuleInfo,
}

/// The program with every override replaced by its default; `None` where it has no override and can be written as it is.
pub(super) fn settle(
    program: &Program,
    stage: ShaderStage,
    entry: &str,
    file: &str,
    target: Target,
) -> Result<Option<Settled>, Error> {
    let module = program.module();
    if module.overrides.is_empty() {
        return Ok(None);
    }
    let none = PipelineConstants::default();
    match process_overrides(module, program.info(), Some((stage, entry)), &none) {
        Ok((module, info)) => Ok(Some(Settled {
            module: module.into_owned(),
            info: info.into_owned(),
        })),
        Err(PipelineConstantError::MissingValue(name)) => Err(Error::Inexpressible {
            file: file.to_owned(),
            target,
            what: format!("the override `{name}` has no default"),
            remedy: "give it one in the source: this target has no overrides, defaults are written in their place".to_owned(),
        }),
        Err(e) => Err(Error::Writer {
            file: file.to_owned(),
            target,
            message: e.to_string(),
        }),
    }
}
