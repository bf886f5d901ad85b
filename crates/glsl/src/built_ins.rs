//! Built-ins that naga's IR has and its GLSL front end lacks. The rewritten text declares an input
//! or output with a location of its own for each; this makes it the built-in.

use naga::{Arena, Binding, BuiltIn, Expression, Handle, Module, ShaderStage, Type, TypeInner};

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

    /// The location that stands for it. No device has so many.
    pub(super) fn location(&self) -> u32 {
        let at = VARIABLES.iter().position(|v| v == self);
        i32::MAX as u32 - at.unwrap_or(0) as u32
    }
}

/// Replaces the locations by the built-ins that they stand for.
///
/// naga's front end makes an output of each element of an array. So the output of clip distances is
/// declared as a float, and this returns the array `clip_distances` instead.
pub(super) fn replace(module: &mut Module, clip_distances: Option<&str>) {
    let settle = |binding: &mut Option<Binding>| {
        let Some(Binding::Location { location, .. }) = binding else {
            return None;
        };
        let found = VARIABLES.iter().find(|v| v.location() == *location)?;
        *binding = Some(Binding::BuiltIn(found.built_in));
        Some(found.built_in)
    };
    let mut globals = module.global_variables.iter();
    let array =
        globals.find(|(_, g)| clip_distances.is_some() && g.name.as_deref() == clip_distances);
    let array = array.map(|(handle, g)| (handle, g.ty));
    let mut results = Vec::new();
    for entry in &mut module.entry_points {
        for argument in &mut entry.function.arguments {
            settle(&mut argument.binding);
        }
        let Some(result) = &mut entry.function.result else {
            continue;
        };
        settle(&mut result.binding);
        let mut ty = module.types[result.ty].clone();
        let TypeInner::Struct { members, .. } = &mut ty.inner else {
            continue;
        };
        let found: Vec<Option<BuiltIn>> =
            members.iter_mut().map(|m| settle(&mut m.binding)).collect();
        let clips = |b: &Option<BuiltIn>| *b == Some(BuiltIn::ClipDistances);
        if let (Some(at), Some((array, of))) = (found.iter().position(clips), array) {
            members[at].ty = of;
            return_array(&mut entry.function.expressions, at, array);
        }
        if found.iter().any(Option::is_some) {
            results.push((result.ty, ty));
        }
    }
    for (handle, mut ty) in results {
        lay_out(&mut ty, module);
        module.types.replace(handle, ty);
    }
}

/// Loads `array` as the result's member `at`.
fn return_array(
    expressions: &mut Arena<Expression>,
    at: usize,
    array: Handle<naga::GlobalVariable>,
) {
    let member = expressions.iter().find_map(|(_, e)| match e {
        Expression::Compose { components, .. } => components.get(at).copied(),
        _ => None,
    });
    if let Some(member) = member
        && let Expression::Load { pointer } = expressions[member]
    {
        expressions[pointer] = Expression::GlobalVariable(array);
    }
}

/// Sets the offsets of a struct of outputs, one member after another.
fn lay_out(ty: &mut Type, module: &Module) {
    let TypeInner::Struct { members, span } = &mut ty.inner else {
        return;
    };
    *span = 0;
    for member in members {
        member.offset = *span;
        *span += module.types[member.ty].inner.size(module.to_ctx());
    }
}
