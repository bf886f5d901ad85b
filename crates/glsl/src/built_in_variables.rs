//! GLSL's built-in variables.

use naga::{BuiltIn, ShaderStage};

use super::ty::Component::Float;
use super::ty::Ty;

#[derive(Debug)]
pub(super) struct Variable {
    /// Names in GLSL, separated by spaces.
    names: &'static str,
    stage: Option<ShaderStage>,
    pub is_output: bool,
    /// Type in the IR. For an array, the type of its elements.
    pub ty: Ty,
    pub built_in: BuiltIn,
}

const fn of(
    names: &'static str,
    stage: Option<ShaderStage>,
    is_output: bool,
    ty: Ty,
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
const VEC3: Ty = Ty::Vector(Float, 3);
const VEC4: Ty = Ty::Vector(Float, 4);
const POSITION: BuiltIn = BuiltIn::Position { invariant: false };

/// Built-ins that become a global on first use.
#[rustfmt::skip]
static PLAIN: &[Variable] = &[
    of("gl_Position", VERTEX, true, VEC4, POSITION),
    of("gl_FragCoord", FRAGMENT, false, VEC4, POSITION),
    of("gl_FrontFacing", FRAGMENT, false, Ty::BOOL, BuiltIn::FrontFacing),
    of("gl_FragDepth gl_FragDepthEXT", FRAGMENT, true, Ty::FLOAT, BuiltIn::FragDepth),
    of("gl_VertexIndex gl_VertexID", VERTEX, false, Ty::UINT, BuiltIn::VertexIndex),
    of("gl_InstanceIndex gl_InstanceID gl_InstanceIDARB", VERTEX, false, Ty::UINT, BuiltIn::InstanceIndex),
    of("gl_SampleID", FRAGMENT, false, Ty::UINT, BuiltIn::SampleIndex),
    of("gl_PrimitiveID", FRAGMENT, false, Ty::UINT, BuiltIn::PrimitiveIndex),
    of("gl_BaseVertex gl_BaseVertexARB", VERTEX, false, Ty::UINT, BuiltIn::BaseVertex),
    of("gl_BaseInstance gl_BaseInstanceARB", VERTEX, false, Ty::UINT, BuiltIn::BaseInstance),
    of("gl_DrawID gl_DrawIDARB", VERTEX, false, Ty::UINT, BuiltIn::DrawIndex),
];

/// Built-ins for which `resolve` declares an input or output.
#[rustfmt::skip]
static DECLARED: &[Variable] = &[
    of("gl_SampleMaskIn", FRAGMENT, false, Ty::UINT, BuiltIn::SampleMask),
    of("gl_SampleMask", FRAGMENT, true, Ty::UINT, BuiltIn::SampleMask),
    of("gl_ClipDistance", VERTEX, true, Ty::FLOAT, BuiltIn::ClipDistances),
    of("gl_BaryCoordEXT gl_BaryCoordNV", FRAGMENT, false, VEC3, BuiltIn::Barycentric { perspective: true }),
    of("gl_BaryCoordNoPerspEXT gl_BaryCoordNoPerspNV", FRAGMENT, false, VEC3, BuiltIn::Barycentric { perspective: false }),
    of("gl_ViewIndex gl_ViewID_OVR", None, false, Ty::UINT, BuiltIn::ViewIndex),
    of("gl_SubgroupSize", None, false, Ty::UINT, BuiltIn::SubgroupSize),
    of("gl_SubgroupInvocationID", None, false, Ty::UINT, BuiltIn::SubgroupInvocationId),
];

fn named(all: &'static [Variable], name: &str, stage: ShaderStage) -> Option<&'static Variable> {
    let mut all = all.iter();
    all.find(|v| v.names.split(' ').any(|n| n == name) && v.stage.is_none_or(|s| s == stage))
}

/// The value of a built-in constant: what OpenGL ES 3.0 or OpenGL 4.5 guarantees, within WebGPU's
/// limits.
pub(super) fn limit(name: &str) -> Option<i32> {
    Some(match name {
        "gl_MaxVertexUniformVectors" | "gl_MaxFragmentUniformVectors" => 256,
        "gl_MaxVertexUniformComponents" | "gl_MaxFragmentUniformComponents" => 1024,
        "gl_MaxCombinedTextureImageUnits" => 32,
        "gl_MaxVertexAttribs" | "gl_MaxVaryingVectors" | "gl_MaxVertexOutputVectors" => 16,
        "gl_MaxTextureImageUnits" | "gl_MaxVertexTextureImageUnits" => 16,
        "gl_MaxFragmentInputVectors" => 15,
        "gl_MaxDrawBuffers" | "gl_MaxClipDistances" => 8,
        "gl_MinProgramTexelOffset" => -8,
        "gl_MaxProgramTexelOffset" => 7,
        _ => return None,
    })
}

/// The built-in of this name that becomes a global on first use.
pub(super) fn plain(name: &str, stage: ShaderStage) -> Option<&'static Variable> {
    named(PLAIN, name, stage)
}

/// The built-in of this name for which `resolve` declares an input or output.
pub(super) fn declared(name: &str, stage: ShaderStage) -> Option<&'static Variable> {
    named(DECLARED, name, stage)
}

impl Variable {
    pub(super) fn first_name(&self) -> &'static str {
        self.names.split(' ').next().unwrap_or(self.names)
    }
}
