//! Decides whether a material can be split.

use naga::valid::GlobalUse;
use naga::{AddressSpace, Binding, BuiltIn, Expression, GlobalVariable, Handle, Module};
use naga_edit::interface;

use super::differences::Reached;
use super::ids::Facing;
use super::{refusals, refuse};
use preshade_dataflow::slice::Slice;
use preshade_passes::analysis::opaque::Opaque;
use preshade_passes::analysis::refusals as shared;
use preshade_plan::pass::Refusal;
use preshade_plan::plan::{GpuPass, Plan};
use preshade_plan::state::{CullMode, DepthBias, Topology};
use shader_text::refusals::RefusalInfo;
use shader_text::source::SourceMap;

/// Checks the state of a pass.
pub(crate) fn state(plan: &Plan, pass: &GpuPass) -> Vec<Refusal> {
    let mut refusals = Vec::new();
    if pass.primitive.topology != Topology::TriangleList {
        refusals.push(refuse(
            &shared::TOPOLOGY,
            "only a triangle list has triangle ids here: strips are not supported",
            "draw a triangle list",
        ));
    }
    if pass.multisample.count > 1 {
        refusals.push(refuse(
            &refusals::MULTISAMPLED,
            "a multisampled pixel may show several triangles, and the resolve would shade only one",
            "draw it with one sample per pixel",
        ));
    }
    if !pass.geometry.is_as_given() {
        refusals.push(refuse(
            &refusals::SUBDIVIDED,
            "`tessellate` divided the triangles, so their corners are not vertices of the mesh",
            "leave tessellate out of the recipe",
        ));
    }
    if pass
        .targets
        .iter()
        .flatten()
        .any(|t| t.attachment.is_some())
        || plan.passes.len() > 1
    {
        refusals.push(refuse(
            &refusals::HAS_OTHER_PASSES,
            "another pass of the plan draws the same surface",
            "start from the original plan",
        ));
    }
    refusals
}

/// Refuses a rounding contract if colours depend on values that rasteriser and resolve round
/// differently.
pub(crate) fn rounding(reached: &Reached, sources: &SourceMap) -> Option<Refusal> {
    let reason = "the colours depend on interpolated values or on an implicit level of detail. \
                  No language defines the last bits of either, and shading may multiply them";
    let remedy = "set budget=0.05, for example, and let `verify` measure the difference";
    Some(refuse(&refusals::INTERPOLATED, reason, remedy).at(sources, reached.rounded?))
}

/// Checks that the vertex stage can run for three corners in one invocation.
pub(crate) fn vertex(opaque: &Opaque<'_>) -> Vec<Refusal> {
    let mut refusals = Vec::new();
    let module = opaque.program.module();
    let entry = &module.entry_points[opaque.vertex];
    refusals.extend(kept_state(
        opaque,
        opaque.vertex,
        &shared::VERTEX_STATE,
        "the vertex stage",
        "it would run three times in one invocation",
    ));
    for input in interface::inputs(module, &entry.function) {
        if let Some(Binding::BuiltIn(b)) = input.binding
            && !matches!(b, BuiltIn::VertexIndex | BuiltIn::InstanceIndex)
        {
            refusals.push(refuse(
                &shared::VERTEX_BUILTIN,
                format!("the vertex stage reads {b:?}, which a resolve pass does not have"),
                "leave it out",
            ));
        }
    }
    if let Some(attribute) = opaque.pass.attributes.iter().find(|a| a.ty.contains("f16")) {
        refusals.push(refuse(
            &shared::HALF_ATTRIBUTE,
            format!(
                "the attribute `{}` is f16, which preshade does not decode from a buffer",
                attribute.name
            ),
            "declare it f32; the vertex buffer may keep its format",
        ));
    }
    refusals
}

/// Depth ranges of the viewports of a material's draws.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum DepthRange {
    /// 0 to 1, or unknown.
    Whole,
    /// Some draw has another range.
    Narrow,
}

/// Checks that the fragment stage can run on reconstructed inputs. `colors` is the slice of its
/// colours, because a struct of inputs may have unneeded members.
pub(crate) fn fragment(opaque: &Opaque<'_>, colors: &Slice, depths: DepthRange) -> Vec<Refusal> {
    let mut refusals = Vec::new();
    let module = opaque.program.module();
    let fragment = colors.entry;
    let entry = &module.entry_points[fragment];
    let all = interface::inputs(module, &entry.function);
    let read = || colors.inputs.iter().filter_map(|i| all.get(*i)).cloned();
    for input in read() {
        let name = input.name.unwrap_or_default();
        let half = module.types[input.ty].inner.scalar() == Some(naga::Scalar::F16);
        match input.binding {
            Some(Binding::BuiltIn(
                BuiltIn::Position { .. } | BuiltIn::FrontFacing | BuiltIn::PrimitiveIndex,
            )) => {}
            Some(Binding::BuiltIn(b)) => refusals.push(refuse(
                &refusals::FRAGMENT_BUILTIN,
                format!("the fragment stage reads {b:?}, which the resolve does not reconstruct"),
                "leave it out",
            )),
            Some(Binding::Location { .. }) if half => refusals.push(refuse(
                &refusals::HALF_VARYING,
                format!("the varying `{name}` is f16, which the resolve does not interpolate"),
                "declare it f32",
            )),
            _ => {}
        }
    }
    let reads_position =
        read().any(|i| matches!(i.binding, Some(Binding::BuiltIn(BuiltIn::Position { .. }))));
    if reads_position && opaque.depth.bias != DepthBias::default() {
        refusals.push(refuse(
            &shared::BIASED_POSITION,
            "the fragment stage reads the position, whose depth includes the depth bias on some \
             graphics APIs and not on others",
            "remove the bias, or pass the part of the position that is needed as a varying",
        ));
    }
    if reads_position && depths == DepthRange::Narrow {
        refusals.push(refuse(
            &shared::DEPTH_RANGE,
            "the fragment stage reads the position, and a draw sets a depth range other than 0 to 1, \
             which the resolve does not know",
            "set the depth range 0 to 1, or pass the part of the position that is needed as a varying",
        ));
    }
    refusals.extend(kept_state(
        opaque,
        fragment,
        &refusals::FRAGMENT_STATE,
        "the fragment stage",
        "parts of it run for several pixels in one invocation",
    ));
    refusals
}

/// Refuses a stage that writes private variables. These include GLSL inputs and outputs that
/// functions other than `main` use.
fn kept_state(
    opaque: &Opaque<'_>,
    entry: usize,
    code: &RefusalInfo,
    stage: &str,
    why: &str,
) -> Option<Refusal> {
    let module = opaque.program.module();
    let info = opaque.program.info().get_entry_point(entry);
    let kept: Vec<(Handle<GlobalVariable>, &GlobalVariable)> = module
        .global_variables
        .iter()
        .filter(|(_, global)| global.space == AddressSpace::Private)
        .filter(|(handle, _)| info[*handle].contains(GlobalUse::WRITE))
        .collect();
    let (first, _) = *kept.first()?;
    let function = &module.entry_points[entry].function;
    let inputs = interface::inputs(module, function);
    let outputs = interface::outputs(module, function);
    let is_of = |all: &[interface::Io], name| all.iter().any(|io| io.name.as_deref() == Some(name));
    let told = kept.iter().map(|(handle, global)| {
        let name = global.name.as_deref().unwrap_or_default();
        let what = match (is_of(&inputs, name), is_of(&outputs, name)) {
            (true, _) => "the input",
            (false, true) => "the output",
            (false, false) => "the private variable",
        };
        match user(module, *handle) {
            Some(user) => format!("{what} `{name}`, which `{user}` uses"),
            None => format!("{what} `{name}`"),
        }
    });
    let told: Vec<String> = told.collect();
    let remedy = match kept
        .iter()
        .any(|(handle, _)| user(module, *handle).is_some())
    {
        true => {
            "hand it to the functions that use it: as a parameter where they read it, as the \
             result (or an `inout` parameter, or a pointer) where they write it"
        }
        false => "declare it in the entry point's own body",
    };
    let refusal = refuse(
        code,
        format!(
            "{stage} keeps state in {}, and {why}",
            told.join(", and in ")
        ),
        remedy,
    );
    Some(refusal.at(
        opaque.program.sources(),
        module.global_variables.get_span(first),
    ))
}

/// Name of the first function, except entry points, that uses a variable.
fn user(module: &Module, variable: Handle<GlobalVariable>) -> Option<&str> {
    let uses = |e: &Expression| matches!(e, Expression::GlobalVariable(g) if *g == variable);
    let mut functions = module.functions.iter().map(|(_, function)| function);
    functions
        .find(|f| f.expressions.iter().any(|(_, e)| uses(e)))
        .and_then(|f| f.name.as_deref())
}

/// How the resolve determines the facing of a pixel.
pub(crate) fn facing(opaque: &Opaque<'_>, colors: &Slice) -> Facing {
    let module = opaque.program.module();
    let all = interface::inputs(module, &module.entry_points[colors.entry].function);
    let asks = colors
        .inputs
        .iter()
        .filter_map(|i| all.get(*i))
        .any(|i| matches!(i.binding, Some(Binding::BuiltIn(BuiltIn::FrontFacing))));
    match opaque.pass.primitive.cull {
        CullMode::None if asks => Facing::Written,
        CullMode::Front => Facing::Back,
        CullMode::None | CullMode::Back => Facing::Front,
    }
}

/// A colour that a compute stage writes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Stored {
    pub location: u32,
    /// Storage texture format in WGSL.
    pub format: &'static str,
    pub encoding: Encoding,
}

impl Stored {
    /// Whether stored values are in 0..1.
    pub fn is_normalized(&self) -> bool {
        self.format == "rgba8unorm"
    }
}

/// Encoding before a storage write.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Encoding {
    Linear,
    /// sRGB: a render target would encode it, a storage texture does not.
    Srgb,
}

/// The colours that a compute stage would write.
pub(crate) fn stored(pass: &GpuPass) -> Result<Vec<Stored>, Box<Refusal>> {
    const FORMATS: [(&str, &str, Encoding); 4] = [
        ("rgba8unorm", "rgba8unorm", Encoding::Linear),
        ("rgba8unorm-srgb", "rgba8unorm", Encoding::Srgb),
        ("rgba16float", "rgba16float", Encoding::Linear),
        ("rgba32float", "rgba32float", Encoding::Linear),
    ];
    let targets = (0..).zip(&pass.targets);
    targets
        .filter_map(|(location, target)| Some((location, target.as_ref()?)))
        .map(|(location, target)| {
            let found = FORMATS.iter().find(|(drawn, ..)| *drawn == target.format);
            let Some((_, format, encoding)) = found else {
                return Err(Box::new(refuse(
                    &refusals::TARGET_FORMAT,
                    format!(
                        "colour target {location} is {}, which WebGPU does not guarantee as a \
                         storage texture",
                        target.format
                    ),
                    "use form=fragment",
                )));
            };
            if target.write_mask != 0b1111 {
                return Err(Box::new(refuse(
                    &refusals::WRITE_MASK,
                    format!(
                        "colour target {location} has a write mask, and a storage texture is \
                         written whole"
                    ),
                    "use form=fragment",
                )));
            }
            Ok(Stored {
                location,
                format,
                encoding: *encoding,
            })
        })
        .collect()
}
