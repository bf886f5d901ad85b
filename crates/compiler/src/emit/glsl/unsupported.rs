//! Features that a GLSL target lacks: one table, and naga's own.
//!
//! naga writes most of these anyway, and the text then does not compile. Our front end does not
//! notice, because it takes such names in every version.

use naga::back::glsl;
use naga::valid::{FunctionInfo, ModuleInfo};
use naga::{
    AddressSpace, Binding, BuiltIn, EarlyDepthTest, EntryPoint, Expression, Function, ImageClass,
    Module, TypeInner,
};
use naga_edit::interface;

use crate::emit::EmitError;
use preshade_plan::plan_file::Target;
use shader_text::tokens as text;
use shader_text::tokens::TokenKind;

/// A construct of a stage that a version of GLSL may lack.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Construct {
    /// A builtin input or output.
    Builtin(BuiltIn),
    StorageBuffer,
    Immediates,
    BindingArray,
    /// A texel fetch from a depth texture.
    DepthLoad,
    /// A depth texture sampled without a comparison.
    DepthSample,
    /// A choice between vectors of integers, which naga writes as `mix`.
    IntegerMix,
    /// `@early_depth_test(force)`.
    ForcedTest,
    /// Any of these words in naga's text.
    Words(&'static [&'static str]),
}

use Construct::{Builtin, Words};

const EVERY: &[Target] = &[
    Target::Glsl450,
    Target::GlslEs300,
    Target::GlslEs100,
    Target::GlslTess,
    Target::GlslVulkan,
    Target::GlslVulkanTess,
];
const ES: &[Target] = &[Target::GlslEs300, Target::GlslEs100];
const TESS: &[Target] = &[Target::GlslTess];
const ES_AND_TESS: &[Target] = &[Target::GlslEs300, Target::GlslEs100, Target::GlslTess];
const VULKAN_TESS: &[Target] = &[Target::GlslVulkanTess];

const NOT_ES: &str = "emit GLSL 4.50, WGSL or SPIR-V";
const NOT_GLSL: &str = "emit WGSL or SPIR-V";
const NOT_VULKAN: &str = "emit glsl-tess, or pass it as an attribute or in a uniform buffer";

/// A construct, the targets that lack it, a name for it, and a remedy. `{}` in the name is the word
/// or variable.
#[rustfmt::skip]
const LACKS: &[(Construct, &[Target], &str, &str)] = &[
    // GLSL ES 3.20, or OES_sample_variables.
    (Builtin(BuiltIn::SampleIndex), ES, "sample_index", NOT_ES),
    // GLSL has arrays, which naga writes as scalars.
    (Builtin(BuiltIn::SampleMask), EVERY, "sample_mask", NOT_GLSL),
    // GLSL ES 3.20.
    (Builtin(BuiltIn::PrimitiveIndex), ES, "primitive_index", NOT_ES),
    // The extension is of GLSL 4.50.
    (Builtin(BuiltIn::Barycentric { perspective: true }), ES_AND_TESS, "barycentric", NOT_ES),
    (Builtin(BuiltIn::Barycentric { perspective: false }), ES_AND_TESS,
        "barycentric_no_perspective", NOT_ES),
    // WebGL has WEBGL_clip_cull_distance, under another name than the one that naga requires.
    (Builtin(BuiltIn::ClipDistances), ES, "clip_distances", NOT_ES),
    // GLSL 4.60.
    (Builtin(BuiltIn::DrawIndex), EVERY, "draw_index", NOT_GLSL),
    (Builtin(BuiltIn::BaseVertex), EVERY, "base_vertex", NOT_GLSL),
    (Builtin(BuiltIn::BaseInstance), EVERY, "base_instance", NOT_GLSL),
    // Vulkan's GLSL has it; OpenGL's extension has another name.
    (Builtin(BuiltIn::ViewIndex), EVERY, "view_index", NOT_GLSL),
    // naga requires the extension for subgroup operations only.
    (Builtin(BuiltIn::SubgroupSize), EVERY, "subgroup_size", NOT_GLSL),
    (Builtin(BuiltIn::SubgroupInvocationId), EVERY, "subgroup_invocation_id", NOT_GLSL),
    (Builtin(BuiltIn::SubgroupId), EVERY, "subgroup_id", NOT_GLSL),
    (Builtin(BuiltIn::NumSubgroups), EVERY, "num_subgroups", NOT_GLSL),
    (Builtin(BuiltIn::VertexIndex), VULKAN_TESS, "the vertex index", NOT_VULKAN),
    (Builtin(BuiltIn::InstanceIndex), VULKAN_TESS, "the instance index", NOT_VULKAN),
    (Construct::Immediates, VULKAN_TESS, "immediate data", NOT_VULKAN),
    (Construct::StorageBuffer, TESS, "a storage buffer (OpenGL has them since 4.3)",
        "emit glsl-vulkan-tess, or read a uniform buffer or a texture"),
    (Construct::BindingArray, EVERY, "the binding array `{}`", NOT_GLSL),
    // naga declares every depth texture as a sampler that compares. One that is only loaded from is
    // a texture of floats by now.
    (Construct::DepthLoad, EVERY,
        "textureLoad of the depth texture `{}`, which is sampled too or passed to a function",
        "bind the depth as texture_2d<f32> too, and load from that"),
    (Construct::DepthSample, EVERY, "the depth texture `{}` sampled without a comparison",
        "bind the depth as texture_2d<f32>"),
    // GLSL ES 3.10.
    (Construct::IntegerMix, ES, "a choice between vectors of integers", NOT_ES),
    // GLSL ES 3.10.
    (Construct::ForcedTest, ES, "a forced early depth test", NOT_ES),
    // GLSL ES 3.10.
    (Words(&["sampler2DMS", "isampler2DMS", "usampler2DMS"]), ES, "multisampled textures", NOT_ES),
    // GLSL ES 3.10.
    (Words(&["textureGather", "textureGatherOffset", "textureGatherOffsets"]), ES, "textureGather",
        NOT_ES),
    (Words(&["bitCount", "bitfieldExtract", "bitfieldInsert", "bitfieldReverse", "findLSB",
        "findMSB", "frexp", "imulExtended", "ldexp", "packSnorm4x8", "packUnorm4x8",
        "umulExtended", "unpackSnorm4x8", "unpackUnorm4x8"]), ES, "the function {}", NOT_ES),
    (Words(&["double"]), ES, "64-bit floats", NOT_ES),
    // For levels and biases of shadow textures that are cubes or arrays.
    (Words(&["GL_EXT_texture_shadow_lod"]), EVERY, "a comparison at a level of this texture",
        NOT_GLSL),
];

/// Refuses a module of one stage that uses a feature that the target lacks, before naga writes it.
/// naga would panic, or write text that does not compile.
pub(super) fn refuse_module(
    module: &Module,
    info: &ModuleInfo,
    name: &str,
    target: Target,
) -> Result<(), EmitError> {
    let lacking = |(construct, lacking, ..): &&(Construct, &[Target], &str, &str)| {
        lacking
            .contains(&target)
            .then(|| found(module, info, *construct))
            .flatten()
    };
    for row in LACKS {
        if let Some(detail) = lacking(&row) {
            return Err(refusal(row.2, &detail, row.3, name, target));
        }
    }
    Ok(())
}

/// The module without a conservative early depth test, if the target has none: GLSL has them since
/// 4.20, and in extensions that not every compiler knows. It is a hint: the picture stays the same.
pub(super) fn without_conservative_test(module: &Module, target: Target) -> Option<Module> {
    let is_conservative =
        |e: &EntryPoint| matches!(e.early_depth_test, Some(EarlyDepthTest::Allow { .. }));
    let is_lacking = ES_AND_TESS.contains(&target);
    if !is_lacking || !module.entry_points.iter().any(is_conservative) {
        return None;
    }
    let mut module = module.clone();
    for entry in &mut module.entry_points {
        entry.early_depth_test = None;
    }
    Some(module)
}

/// Refuses naga's text of a stage that uses a function that the target lacks.
pub(super) fn refuse_words(written: &str, name: &str, target: Target) -> Result<(), EmitError> {
    for (construct, lacking, what, remedy) in LACKS {
        let Words(words) = construct else { continue };
        let mut used = text::tokens(written).map(|(_, range)| &written[range]);
        if lacking.contains(&target)
            && let Some(word) = used.find(|w| words.contains(w))
        {
            return Err(refusal(what, word, remedy, name, target));
        }
    }
    Ok(())
}

/// Refuses a vertex stage with an array as an attribute, which GLSL ES has not (3.00, section 4.3.4).
pub(in crate::emit) fn refuse_attribute_arrays(
    written: &str,
    name: &str,
    target: Target,
) -> Result<(), EmitError> {
    let is_array = |line: &&str| {
        let mut words = text::tokens(line).map(|(_, range)| &line[range]);
        words.any(|w| w == "in" || w == "attribute") && line.ends_with("];")
    };
    let is_lacking = ES.contains(&target) && name.ends_with(".vert");
    let globals = written.lines().filter(|l| !l.starts_with(' '));
    match globals.filter(|_| is_lacking).find(is_array) {
        None => Ok(()),
        Some(_) => Err(refusal(
            "an array as an attribute",
            "",
            NOT_ES,
            name,
            target,
        )),
    }
}

/// Refuses a text with an identifier that is too long for its version (GLSL 4.50, GLSL ES 3.00 and
/// 1.00, section 3.7 or 3.8; WebGL 1, section 6.25).
pub(in crate::emit) fn refuse_long_names(
    written: &str,
    name: &str,
    target: Target,
) -> Result<(), EmitError> {
    let most = match target {
        Target::GlslEs100 => 256,
        _ => 1024,
    };
    let mut tokens = text::tokens(written);
    match tokens.find(|(kind, range)| *kind == TokenKind::Word && range.len() > most) {
        None => Ok(()),
        Some((_, range)) => {
            let start: String = written[range].chars().take(24).collect();
            let what = format!("a name of over {most} characters, `{start}..`");
            Err(refusal(&what, "", "shorten the name", name, target))
        }
    }
}

fn refusal(what: &str, detail: &str, remedy: &str, name: &str, target: Target) -> EmitError {
    EmitError::Inexpressible {
        file: name.to_owned(),
        target,
        what: what.replace("{}", detail),
        remedy: remedy.to_owned(),
    }
}

/// The name of the variable or builtin if the module has the construct.
fn found(module: &Module, info: &ModuleInfo, construct: Construct) -> Option<String> {
    let entry = module.entry_points.first()?;
    let global = |wanted: &dyn Fn(AddressSpace, &TypeInner) -> bool| {
        let mut all = module.global_variables.iter().map(|(_, g)| g);
        let found = all.find(|g| wanted(g.space, &module.types[g.ty].inner))?;
        Some(found.name.clone().unwrap_or_default())
    };
    match construct {
        Builtin(wanted) => {
            let inputs = interface::inputs(module, &entry.function).into_iter();
            let mut all = inputs.chain(interface::outputs(module, &entry.function));
            let found = all.any(|io| io.binding == Some(Binding::BuiltIn(wanted)));
            found.then(String::new)
        }
        Construct::StorageBuffer => {
            global(&|space, _| matches!(space, AddressSpace::Storage { .. }))
        }
        Construct::Immediates => global(&|space, _| space == AddressSpace::Immediate),
        Construct::BindingArray => global(&|_, ty| matches!(ty, TypeInner::BindingArray { .. })),
        Construct::ForcedTest => {
            let is_forced = entry.early_depth_test == Some(EarlyDepthTest::Force);
            is_forced.then(String::new)
        }
        Construct::DepthLoad | Construct::DepthSample | Construct::IntegerMix => {
            let functions = module.functions.iter().map(|(h, f)| (f, &info[h]));
            let mut functions = functions.chain([(&entry.function, info.get_entry_point(0))]);
            functions.find_map(|(f, info)| match construct {
                Construct::IntegerMix => integer_mix(module, f, info),
                _ => depth_read(module, f, info, construct),
            })
        }
        Words(_) => None,
    }
}

/// Whether a function chooses between vectors of integers or of bools.
fn integer_mix(module: &Module, function: &Function, info: &FunctionInfo) -> Option<String> {
    let is_mix = |(_, e): (_, &Expression)| {
        let Expression::Select {
            condition, accept, ..
        } = e
        else {
            return false;
        };
        let inner = |e: naga::Handle<Expression>| info[e].ty.inner_with(&module.types);
        let is_vector = matches!(inner(*condition), TypeInner::Vector { .. });
        is_vector && inner(*accept).scalar_kind() != Some(naga::ScalarKind::Float)
    };
    function.expressions.iter().any(is_mix).then(String::new)
}

/// The name of a depth texture that a function reads in this way.
fn depth_read(
    module: &Module,
    function: &Function,
    info: &FunctionInfo,
    construct: Construct,
) -> Option<String> {
    function.expressions.iter().find_map(|(_, e)| {
        let image = match (e, construct) {
            (Expression::ImageLoad { image, .. }, Construct::DepthLoad)
            | (
                Expression::ImageSample {
                    image,
                    depth_ref: None,
                    ..
                },
                Construct::DepthSample,
            ) => image,
            _ => return None,
        };
        let TypeInner::Image {
            class: ImageClass::Depth { .. },
            ..
        } = info[*image].ty.inner_with(&module.types)
        else {
            return None;
        };
        let name = match &function.expressions[*image] {
            Expression::GlobalVariable(g) => module.global_variables[*g].name.clone(),
            Expression::FunctionArgument(i) => function.arguments[*i as usize].name.clone(),
            _ => None,
        };
        Some(name.unwrap_or_else(|| "(unnamed)".to_owned()))
    })
}

/// naga's refusal in our words.
pub(super) fn inexpressible(error: &glsl::Error, name: &str, target: Target) -> EmitError {
    let remedy = match target {
        Target::GlslEs300 | Target::GlslEs100 => NOT_ES,
        _ => NOT_GLSL,
    };
    let (what, remedy) = match error {
        glsl::Error::MissingFeatures(features) => (in_words(*features), remedy),
        glsl::Error::UnsupportedScalar(scalar) => (
            format!("{}-bit numbers", 8 * u32::from(scalar.width)),
            NOT_GLSL,
        ),
        glsl::Error::ImageMultipleSamplers => (
            "one texture is sampled with two samplers, but GLSL combines a texture with one"
                .to_owned(),
            "declare the texture twice",
        ),
        glsl::Error::UnsupportedExternal(function)
            if matches!(target, Target::GlslEs300 | Target::GlslEs100) =>
        {
            (format!("the function {function}"), NOT_ES)
        }
        glsl::Error::FirstSamplingNotSupported => (
            "explicit flat interpolation from the first vertex".to_owned(),
            "write @interpolate(flat, either)",
        ),
        other => {
            return EmitError::Writer {
                file: name.to_owned(),
                target,
                message: other.to_string(),
            };
        }
    };
    refusal(&what, "", remedy, name, target)
}

/// Names missing features for messages.
fn in_words(features: glsl::Features) -> String {
    use glsl::Features as F;
    let words = [
        (F::BUFFER_STORAGE, "storage buffers"),
        (F::ARRAY_OF_ARRAYS, "arrays of arrays"),
        (F::DOUBLE_TYPE, "64-bit floats"),
        (F::FULL_IMAGE_FORMATS, "storage textures of this format"),
        (F::MULTISAMPLED_TEXTURES, "multisampled textures"),
        (
            F::MULTISAMPLED_TEXTURE_ARRAYS,
            "arrays of multisampled textures",
        ),
        (F::CUBE_TEXTURES_ARRAY, "arrays of cube textures"),
        (F::COMPUTE_SHADER, "compute shaders"),
        (
            F::IMAGE_LOAD_STORE,
            "storage textures, or a forced early depth test",
        ),
        (F::CONSERVATIVE_DEPTH, "a conservative early depth test"),
        (
            F::NOPERSPECTIVE_QUALIFIER,
            "interpolation without perspective (`linear`)",
        ),
        (F::SAMPLE_QUALIFIER, "interpolation at each sample"),
        (F::CLIP_DISTANCE, "clip distances"),
        (F::CULL_DISTANCE, "cull distances"),
        (F::SAMPLE_VARIABLES, "sample_index or sample_mask"),
        (F::DYNAMIC_ARRAY_SIZE, "arrays of dynamic length"),
        (F::MULTI_VIEW, "several views"),
        (F::TEXTURE_SAMPLES, "the number of samples of a texture"),
        (F::TEXTURE_LEVELS, "the number of levels of a texture"),
        (F::IMAGE_SIZE, "the size of a storage texture"),
        (F::DUAL_SOURCE_BLENDING, "dual source blending"),
        (
            F::TEXTURE_SHADOW_LOD,
            "levels of detail of shadow textures of cubes and arrays",
        ),
        (F::SUBGROUP_OPERATIONS, "subgroup operations"),
        (F::TEXTURE_ATOMICS, "atomics on textures"),
        (F::SHADER_BARYCENTRICS, "barycentric coordinates"),
        (F::PRIMITIVE_INDEX, "primitive_index"),
    ];
    let named: Vec<&str> = words
        .iter()
        .filter(|(feature, _)| features.contains(*feature))
        .map(|(_, word)| *word)
        .collect();
    match named[..] {
        [] => "a feature of a later version".to_owned(),
        _ => named.join(", "),
    }
}
