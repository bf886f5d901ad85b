//! Built-in variables for which `resolve` declares an input or output.

use naga::{BuiltIn, ShaderStage};

/// A built-in variable.
#[derive(Debug, PartialEq)]
pub(super) struct Variable {
    /// Names in GLSL, separated by spaces.
    names: &'static str,
    pub stage: Option<ShaderStage>,
    pub is_output: bool,
    /// The declared type, without the array's length.
    pub ty: &'static str,
    pub built_in: BuiltIn,
}

const fn of(
    names: &'static str,
    stage: Option<ShaderStage>,
    is_output: bool,
    ty: &'static str,
    built_in: BuiltIn,
) -> Variable {
    Variable {
        names,
        stage,
        is_output,
        ty,
        built_in,
    }
}

const FRAGMENT: Option<ShaderStage> = Some(ShaderStage::Fragment);
const VERTEX: Option<ShaderStage> = Some(ShaderStage::Vertex);

#[rustfmt::skip]
const VARIABLES: &[Variable] = &[
    of("gl_SampleMaskIn", FRAGMENT, false, "uint", BuiltIn::SampleMask),
    of("gl_SampleMask", FRAGMENT, true, "uint", BuiltIn::SampleMask),
    of("gl_ClipDistance", VERTEX, true, "float", BuiltIn::ClipDistances),
    of("gl_BaryCoordEXT gl_BaryCoordNV", FRAGMENT, false, "vec3", BuiltIn::Barycentric { perspective: true }),
    of("gl_BaryCoordNoPerspEXT gl_BaryCoordNoPerspNV", FRAGMENT, false, "vec3", BuiltIn::Barycentric { perspective: false }),
    of("gl_ViewIndex gl_ViewID_OVR", None, false, "uint", BuiltIn::ViewIndex),
    of("gl_SubgroupSize", None, false, "uint", BuiltIn::SubgroupSize),
    of("gl_SubgroupInvocationID", None, false, "uint", BuiltIn::SubgroupInvocationId),
];

/// The built-in of that name in a stage.
pub(super) fn variable(name: &str, stage: ShaderStage) -> Option<&'static Variable> {
    let mut all = VARIABLES.iter();
    all.find(|v| v.names.split(' ').any(|n| n == name) && v.stage.is_none_or(|s| s == stage))
}

impl Variable {
    pub(super) fn first_name(&self) -> &'static str {
        self.names.split(' ').next().unwrap_or(self.names)
    }
}
