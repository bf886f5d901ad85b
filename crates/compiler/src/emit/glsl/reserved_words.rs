//! Words that an author's name must not be in GLSL ES 3.00 or 4.50: keywords, reserved words (3.7
//! of both) and built-in functions (chapter 8).

/// Keywords and reserved words, except for type names that [`is_type`] recognises.
const KEYWORDS: &str = "active asm atomic_uint attribute bool break buffer case cast centroid \
                        class coherent common const continue default demote discard do double else \
                        enum extern external false filter fixed flat float for goto half highp \
                        hvec2 hvec3 hvec4 if inline inout input in int interface invariant layout \
                        long lowp mediump \
                        namespace noinline noperspective out output packed partition patch precise \
                        precision public readonly resource restrict return sample sampler \
                        samplerShadow \
                        shared short sizeof smooth static struct subroutine superp switch template \
                        this true typedef uint uniform union \
                        unsigned using varying void volatile while writeonly main";

/// Names of GLSL's functions.
const FUNCTIONS: &str = "abs acos acosh all any asin asinh atan atanh atomicAdd atomicAnd \
                         atomicCompSwap atomicCounter atomicExchange atomicMax atomicMin atomicOr \
                         atomicXor barrier bitCount bitfieldExtract bitfieldInsert bitfieldReverse \
                         ceil clamp cos cosh cross dFdx dFdxCoarse dFdxFine dFdy dFdyCoarse \
                         dFdyFine degrees \
                         determinant distance dot equal exp exp2 faceforward findLSB findMSB \
                         floatBitsToInt floatBitsToUint floor fma fract frexp fwidth fwidthCoarse \
                         fwidthFine \
                         greaterThan greaterThanEqual groupMemoryBarrier imageAtomicAdd imageLoad \
                         imageSize imageStore imulExtended intBitsToFloat interpolateAtCentroid \
                         interpolateAtOffset interpolateAtSample inverse inversesqrt isinf isnan \
                         ldexp length lessThan lessThanEqual log log2 matrixCompMult max \
                         memoryBarrier \
                         memoryBarrierBuffer memoryBarrierImage memoryBarrierShared min mix mod \
                         modf noise1 noise2 noise3 noise4 normalize not notEqual outerProduct \
                         packDouble2x32 \
                         packHalf2x16 packSnorm2x16 packSnorm4x8 packUnorm2x16 packUnorm4x8 pow \
                         radians reflect refract round roundEven sign sin sinh smoothstep sqrt \
                         step tan tanh \
                         texelFetch texelFetchOffset texture textureGather textureGatherOffset \
                         textureGatherOffsets textureGrad textureGradOffset textureLod \
                         textureLodOffset \
                         textureOffset textureProj textureProjGrad textureProjGradOffset \
                         textureProjLod textureProjLodOffset textureProjOffset textureQueryLevels \
                         textureQueryLod \
                         textureSamples textureSize transpose trunc uaddCarry uintBitsToFloat \
                         umulExtended unpackDouble2x32 unpackHalf2x16 unpackSnorm2x16 \
                         unpackSnorm4x8 \
                         unpackUnorm2x16 unpackUnorm4x8 usubBorrow shadow1D shadow2D texture1D \
                         texture2D texture3D textureCube texture2DLod texture2DProj textureCubeLod";

/// Whether a variable of that name would hide a function or keyword.
pub(super) fn is_reserved(word: &str) -> bool {
    is_keyword(word) || FUNCTIONS.split_whitespace().any(|w| w == word)
}

/// Whether nothing may have the name, including struct members.
pub(super) fn is_keyword(word: &str) -> bool {
    word.starts_with("gl_") || KEYWORDS.split_whitespace().any(|w| w == word) || is_type(word)
}

/// Whether the word has the form of a vector, matrix, sampler, image or texture type. Textures are
/// types in Vulkan's GLSL alone, which our front end reads.
fn is_type(word: &str) -> bool {
    let digits =
        |rest: &str| !rest.is_empty() && rest.bytes().all(|b| b.is_ascii_digit() || b == b'x');
    let opaque = |rest: &str| {
        let shapes = ["1D", "2D", "3D", "Cube", "Buffer", "ExternalOES"];
        let endings = [
            "",
            "Array",
            "Rect",
            "MS",
            "MSArray",
            "Shadow",
            "ArrayShadow",
            "RectShadow",
        ];
        let ending = shapes.iter().find_map(|s| rest.strip_prefix(s));
        ending.is_some_and(|e| endings.contains(&e))
    };
    let is_plain = |plain: &str| {
        let after = |stem: &str| plain.strip_prefix(stem);
        ["vec", "mat"].iter().any(|s| after(s).is_some_and(digits))
            || ["sampler", "image", "texture"]
                .iter()
                .any(|s| after(s).is_some_and(opaque))
    };
    // With an optional prefix letter.
    is_plain(word)
        || word
            .strip_prefix(['b', 'i', 'u', 'd'])
            .is_some_and(is_plain)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn types_and_words_are_no_names() {
        for word in [
            "dmat3x2",
            "ivec4",
            "usampler2DArray",
            "iimage3D",
            "texture",
            "sample",
            "gl_Position",
            "main",
        ] {
            assert!(is_reserved(word), "{word}");
        }
        for word in [
            "vector",
            "material",
            "samplerOf",
            "imageOf",
            "map",
            "uv2",
            "bmp",
            "samplerCubeMap",
            "samplerCubeMap_1",
            "sampler2DWeight",
            "image2DX",
        ] {
            assert!(!is_reserved(word), "{word}");
        }
    }
}
