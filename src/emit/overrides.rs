//! Replaces overrides by their defaults for targets without overrides.

use std::collections::BTreeMap;

use naga::back::PipelineConstants;
use naga::back::pipeline_constants::{PipelineConstantError, process_overrides};
use naga::valid::ModuleInfo;
use naga::{Expression, Literal, Module, ShaderStage};
use preshade_passes::program::Program;

use super::{EmitError, Target};

/// A module without overrides.
pub(super) struct Settled {
    pub(super) module: Module,
    pub(super) info: ModuleInfo,
}

/// Replaces every override by its default; `None` if there is none.
pub(super) fn settle(
    program: &Program,
    stage: ShaderStage,
    entry: &str,
    file: &str,
    target: Target,
) -> Result<Option<Settled>, EmitError> {
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
        Err(PipelineConstantError::MissingValue(name)) => Err(EmitError::Inexpressible {
            file: file.to_owned(),
            target,
            what: format!("the override `{name}` has no default"),
            remedy:
                "give it one in the source: this target has no overrides and uses their defaults"
                    .to_owned(),
        }),
        Err(e) => Err(EmitError::Writer {
            file: file.to_owned(),
            target,
            message: e.to_string(),
        }),
    }
}

impl Settled {
    /// The defaults of the overrides that the stage reads, for
    /// [`StageFile::overrides`](super::StageFile::overrides).
    pub(super) fn values(&self, program: &Program) -> BTreeMap<String, f64> {
        let value = |name: &Option<String>| {
            let mut constants = self.module.constants.iter().map(|(_, c)| c);
            let constant = constants.find(|c| c.name.is_some() && c.name == *name)?;
            match self.module.global_expressions[constant.init] {
                Expression::Literal(literal) => number(literal),
                Expression::ZeroValue(_) => Some(0.0),
                _ => None,
            }
        };
        let overrides = program.module().overrides.iter().map(|(_, o)| o);
        overrides
            .filter_map(|o| {
                let key = match (o.id, &o.name) {
                    (Some(id), _) => id.to_string(),
                    (None, Some(name)) => name.clone(),
                    (None, None) => return None,
                };
                Some((key, value(&o.name)?))
            })
            .collect()
    }
}

fn number(literal: Literal) -> Option<f64> {
    match literal {
        Literal::F64(v) => Some(v),
        Literal::F32(v) => Some(f64::from(v)),
        Literal::F16(v) => Some(v.to_f64()),
        Literal::I32(v) => Some(f64::from(v)),
        Literal::U32(v) => Some(f64::from(v)),
        Literal::Bool(v) => Some(f64::from(u8::from(v))),
        _ => None,
    }
}
