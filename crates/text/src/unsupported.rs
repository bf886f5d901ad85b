//! What GLSL for Vulkan and OpenGL has and preshade does not read, by name.
//!
//! The lexer asks for types and qualifiers, which would end in a syntax error. The resolver asks
//! for functions, variables and layouts. The reader of SPIR-V asks by GLSL's words.

use std::collections::HashMap;
use std::sync::LazyLock;

use naga::Span;

use super::error::{Code, Error};

/// Where the grammar has a name.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Word {
    /// In place of a type.
    Type,
    /// Before a declaration, where glsl-lang's grammar has no such word.
    Qualifier,
    /// In a layout, where it changes how the text is parsed.
    Layout,
    /// Anything else: a function, a variable, another layout.
    Name,
}

/// Names that are not read for one reason.
#[derive(Debug)]
pub struct Absent {
    word: Word,
    /// Separated by spaces. `*` stands for any ending.
    names: &'static str,
    /// Why, after "NAME is not supported: ".
    why: &'static str,
    remedy: &'static str,
}

const fn of(word: Word, names: &'static str, why: &'static str, remedy: &'static str) -> Absent {
    Absent {
        word,
        names,
        why,
        remedy,
    }
}

const RAYS: &str = "WebGPU has no ray tracing";
const RAYS_REMEDY: &str = "bake the result into a texture, or compute it in a pass of its own";
const SUBPASSES: &str = "WebGPU has no subpasses";
const SUBPASSES_REMEDY: &str = "end the render pass, bind the attachment as a `texture2D`, and read \
                                it by `texelFetch(t, ivec2(gl_FragCoord.xy), 0)`";
const SMALL: &str = "WebGPU has no integers of 8 or 16 bits";
const LARGE: &str = "WebGPU has no 64-bit integers";
const LARGE_REMEDY: &str = "use a `uvec2` of the low and the high half";
const POINTERS: &str = "WebGPU has no pointers to buffers";
const POINTERS_REMEDY: &str = "bind the buffer as a storage block, and pass an index";
const MATRICES: &str = "WebGPU has no cooperative matrices or tensors";
const INTERLOCK: &str = "WebGPU cannot order the fragments of a pixel";
const INTERLOCK_REMEDY: &str = "blend, or draw the layers in passes of their own";
const COMPUTE: &str = "it belongs to compute shaders";
const FIXED: &str = "it depends on OpenGL's fixed functions";
const RATES: &str = "WebGPU has no variable shading rate";
const PARAMETERS: &str = "preshade does not read it";

#[rustfmt::skip]
const ABSENT: &[Absent] = &[
    of(Word::Type, "accelerationStructureEXT accelerationStructureNV rayQueryEXT hitObjectNV hitObjectEXT", RAYS, RAYS_REMEDY),
    of(Word::Qualifier, "rayPayload* hitAttribute* callableData*", RAYS, RAYS_REMEDY),
    of(Word::Name, "rayQuery* traceRay* traceNV reportIntersection* executeCallable* ignoreIntersection* terminateRay* shaderRecord* gl_RayFlags* gl_RayQuery*", RAYS, RAYS_REMEDY),
    of(Word::Type, "subpassInput* isubpassInput* usubpassInput* f16subpassInput* attachmentEXT iattachmentEXT uattachmentEXT", SUBPASSES, SUBPASSES_REMEDY),
    of(Word::Name, "subpassLoad input_attachment_index colorAttachmentReadEXT depthAttachmentReadEXT stencilAttachmentReadEXT", SUBPASSES, SUBPASSES_REMEDY),
    of(Word::Type, "int8_t uint8_t i8vec* u8vec* int16_t uint16_t i16vec* u16vec*", SMALL, "use `int` or `uint`, and take the bits by `bitfieldExtract`"),
    of(Word::Type, "int64_t uint64_t i64vec* u64vec*", LARGE, LARGE_REMEDY),
    of(Word::Type, "i64image* u64image*", "WebGPU has no images of 64-bit integers", "use two images of `r32ui`"),
    of(Word::Type, "f16sampler* f16texture* f16image*", "WebGPU's textures have 32 bits in shaders", "use `sampler2D` and its like, and convert the result"),
    of(Word::Type, "textureBuffer itextureBuffer utextureBuffer imageBuffer iimageBuffer uimageBuffer", "WebGPU has no buffer textures", "use a storage block with an array"),
    of(Word::Name, "packUint2x32 unpackUint2x32 packInt2x32 unpackInt2x32 pack64 unpack32 doubleBitsTo* int64BitsTo* uint64BitsTo*", LARGE, LARGE_REMEDY),
    of(Word::Qualifier, "coopmat fcoopmatNV icoopmatNV ucoopmatNV coopvecNV tensorARM tensorLayoutNV tensorViewNV", MATRICES, "use `mat4`, or arrays of vectors"),
    of(Word::Name, "coopMat* coopVec* tensor*", MATRICES, "use `mat4`, or arrays of vectors"),
    of(Word::Type, "bfloat16_t bf16vec* floate5m2_t floate4m3_t", "WebGPU has no such floats", "use `float`, or `float16_t`"),
    of(Word::Layout, "buffer_reference buffer_reference_align", POINTERS, POINTERS_REMEDY),
    of(Word::Qualifier, "pervertexEXT pervertexNV __explicitInterpAMD", "a fragment reads no values of single vertices in WebGPU", "write `flat` outputs of the vertex stage, or read a storage block by `gl_VertexIndex` there"),
    of(Word::Qualifier, "perprimitiveEXT perprimitiveNV taskPayloadSharedEXT taskNV perviewNV", "it belongs to mesh shaders, which WebGPU lacks", "write a `flat` output of the vertex stage"),
    of(Word::Qualifier, "spirv_instruction spirv_execution_mode spirv_execution_mode_id spirv_decorate spirv_decorate_id spirv_decorate_string spirv_type spirv_storage_class spirv_by_reference spirv_literal", "no other language has inline SPIR-V", "use GLSL's functions"),
    of(Word::Name, "sparseTexture* sparseTexelFetch* sparseTexelsResidentARB sparseImageLoad* textureClampARB textureOffsetClampARB textureGradClampARB textureGradOffsetClampARB", "WebGPU has no sparse textures", "use the function without `sparse`, and a residency texture of your own"),
    of(Word::Name, "atomicCompSwap atomicLoad atomicStore", PARAMETERS, "use `atomicAdd`, `atomicExchange` and their like, or write the material in WGSL"),
    of(Word::Name, "imageAtomic*", "naga's image atomics return nothing, and none exchanges", "use `imageAtomicAdd` and its like as a statement, or `atomicAdd` and its like on a storage block"),
    of(Word::Name, "atomic_uint atomicCounter*", "WebGPU has no atomic counters", "write the material in WGSL, with an atomic in a storage buffer"),
    of(Word::Name, "subgroup*", "naga has no such operation", "use `subgroupAdd` and its like, `subgroupBallot`, or a shuffle"),
    of(Word::Name, "gl_SubGroup* ballotARB readInvocationARB readFirstInvocationARB anyInvocation* allInvocations*", "it is of an older extension", "use `subgroupBallot` and its like, of GL_KHR_shader_subgroup"),
    of(Word::Name, "clockARB clock2x32ARB clockRealtimeEXT clockRealtime2x32EXT", "WebGPU has no shader clock", "measure with timestamp queries"),
    of(Word::Name, "beginInvocationInterlock* endInvocationInterlock* beginFragmentShaderOrdering* pixel_interlock_* sample_interlock_* shading_rate_interlock_*", INTERLOCK, INTERLOCK_REMEDY),
    of(Word::Name, "blend_support_*", "WebGPU has no advanced blend equations", "read the target as a texture and blend in the shader"),
    of(Word::Name, "post_depth_coverage override_coverage inner_coverage", "WebGPU has no such coverage", "use `gl_SampleMaskIn` as it is"),
    of(Word::Name, "gl_DeviceIndex", "WebGPU draws on one device", "draw on each device, with its number in a uniform"),
    of(Word::Name, "gl_PositionPerViewNV gl_SecondaryPositionNV gl_SecondaryViewportMaskNV", "a vertex has one position in WebGPU", "compute it from `gl_ViewIndex`"),
    of(Word::Name, "gl_Layer gl_ViewportIndex gl_ViewportMask*", "WebGPU draws to one layer and one viewport", "draw each layer in a pass of its own"),
    of(Word::Name, "gl_BaseVertex* gl_BaseInstance* gl_DrawID*", "WebGPU has no such built-in", "pass it in a uniform, or as a push constant"),
    of(Word::Name, "gl_ShadingRateEXT gl_ShadingRateFlag* gl_PrimitiveShadingRateEXT gl_FragSizeEXT gl_FragInvocationCountEXT gl_FragmentSizeNV gl_InvocationsPerPixelNV", RATES, "leave it out: every pixel is shaded"),
    of(Word::Name, "gl_FullyCoveredEXT gl_FragFullyCoveredNV", "WebGPU has no conservative rasterisation", "leave it out"),
    of(Word::Name, "gl_SamplePosition gl_NumSamples", "WebGPU does not tell the positions of samples", "qualify an input with `sample`"),
    of(Word::Name, "gl_HelperInvocation helperInvocationEXT", "WebGPU does not tell helper invocations", "leave the test out: their results are dropped"),
    of(Word::Name, "gl_PointCoord", "WebGPU's points are one pixel large", "draw quads with a coordinate instead"),
    of(Word::Name, "gl_CullDistance", "WebGPU has no such built-in", "write the distances to `gl_ClipDistance`"),
    of(Word::Name, "gl_Vertex", FIXED, "it is a legacy built-in: declare `in vec4 position`, or before GLSL 1.30 `attribute vec4 position`"),
    of(Word::Name, "gl_Normal gl_Color gl_SecondaryColor gl_MultiTexCoord* gl_FogCoord", FIXED, "it is a legacy built-in: declare an attribute of your own, as `in vec3 normal`"),
    of(Word::Name, "ftransform gl_ModelView* gl_Projection*", FIXED, "it is a legacy built-in: declare `in vec4 position` and `uniform mat4 mvp`, and write `mvp * position`"),
    of(Word::Name, "gl_TexCoord gl_FrontColor gl_BackColor gl_FrontSecondaryColor gl_BackSecondaryColor gl_FogFragCoord gl_ClipVertex gl_NormalMatrix gl_TextureMatrix* gl_LightSource gl_FrontMaterial gl_BackMaterial gl_LightModel gl_Fog gl_NormalScale gl_ClipPlane gl_Point", FIXED, "it is a legacy built-in: declare a varying or a uniform of your own"),
    of(Word::Name, "component", "WebGPU cannot pack two variables into one location", "give each variable a location of its own, or pack them into one vector"),
    of(Word::Name, "barrier memoryBarrier* groupMemoryBarrier controlBarrier", COMPUTE, "leave it out"),
    of(Word::Name, "interpolateAtCentroid interpolateAtSample interpolateAtOffset interpolateAtVertexAMD", "in WebGPU each input has one interpolation", "qualify the input itself with `centroid` or `sample`"),
    of(Word::Name, "textureQueryLod textureQueryLOD", "WebGPU has no such query", "compute the level from the coordinates' derivatives"),
    of(Word::Name, "textureGatherOffsets", "WebGPU only gathers a square", "fetch the four texels"),
    of(Word::Name, "subroutine", "WebGPU has no pointers to functions", "select the function by a `uniform int` and a `switch`"),
    of(Word::Name, "textureSamples imageSamples", "WebGPU does not tell the number of samples", "pass it in a uniform"),
    of(Word::Name, "textureBlockMatch* textureWeightedQCOM textureBoxFilterQCOM fragmentMaskFetchAMD fragmentFetchAMD cubeFaceIndexAMD cubeFaceCoordAMD min3 max3 mid3 swizzleInvocation* writeInvocationAMD mbcntAMD timeAMD gl_Warp* gl_SM* gl_Core*", "it belongs to one vendor", "write it yourself"),
];

impl Absent {
    pub fn word(&self) -> Word {
        self.word
    }

    /// The error about `name`, which this is.
    pub fn refuse(&self, name: &str, place: Option<Span>) -> Error {
        let message = format!("`{name}` is not supported: {}", self.why);
        Error::new(Code::Unsupported, message)
            .label_if(place)
            .note(self.remedy)
    }
}

/// The table by name. Each entry has its number, since the first of several counts.
struct Index {
    names: HashMap<&'static str, (usize, &'static Absent)>,
    /// The names before a `*`.
    starts: Vec<(&'static str, (usize, &'static Absent))>,
}

static INDEX: LazyLock<Index> = LazyLock::new(|| {
    let mut index = Index {
        names: HashMap::new(),
        starts: Vec::new(),
    };
    for (n, absent) in ABSENT.iter().enumerate() {
        for name in absent.names.split(' ') {
            match name.strip_suffix('*') {
                Some(start) => index.starts.push((start, (n, absent))),
                None => {
                    index.names.entry(name).or_insert((n, absent));
                }
            }
        }
    }
    index
});

/// The entry of a name.
pub fn absent(name: &str) -> Option<&'static Absent> {
    let whole = INDEX.names.get(name);
    let starts = INDEX
        .starts
        .iter()
        .find(|(start, _)| name.starts_with(start));
    let found = whole.into_iter().chain(starts.map(|(_, found)| found));
    found.min_by_key(|(n, _)| *n).map(|(_, absent)| *absent)
}

/// An error, if the name is not supported.
pub fn refuse(name: &str, place: Option<Span>) -> Result<(), Error> {
    match absent(name) {
        Some(absent) => Err(absent.refuse(name, place)),
        None => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_name_is_in_the_table_once() {
        let all: Vec<&str> = ABSENT.iter().flat_map(|a| a.names.split(' ')).collect();
        for (i, name) in all.iter().enumerate() {
            assert!(!name.is_empty() && !all[..i].contains(name), "{name}");
        }
        for absent in ABSENT {
            assert!(!absent.why.is_empty() && !absent.remedy.is_empty());
        }
    }
}
