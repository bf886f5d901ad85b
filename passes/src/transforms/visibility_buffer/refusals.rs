//! The refusals of `visibility-buffer`.

use crate::core::refusals::refusals;

refusals! {
    ANISOTROPIC_SAMPLE = "anisotropic-sample":
        "The scene sets an anisotropy for a sampler that is read at interpolated coordinates or \
         at an implicit level. How many texels such a sampler takes, and along which line, jumps \
         with the last bits of the gradients, which a resolve rounds otherwise.",
        "Give a budget (`budget=0.02`) and let `verify` measure it, or set an anisotropy of 1.";
    BIASED_SAMPLE = "biased-sample":
        "A sample's level has a bias, which a resolve makes of scaled gradients, and levels round \
         differently.",
        "Give a budget (`budget=0.02`), or sample with gradients or a level of your own.";
    CIRCULAR_GRADIENT = "circular-gradient":
        "A derivative depends on itself. `visibility-buffer` computes derivatives from the values \
         of neighbouring pixels, which it does not have here.",
        "Sample with gradients or a level of your own.";
    CUBE_SAMPLE = "cube-sample":
        "A cube is sampled at an implicit level. Adapters make that of gradients of their own, \
         and not as of gradients that are given.",
        "Give a budget (`budget=0.02`), or sample with gradients or a level of your own.";
    DISCONTINUOUS = "discontinuous":
        "An interpolated value reaches an operation that jumps (a comparison, `floor`, a nearest \
         sample): its last bit may change the picture.",
        "Say what may differ with `budget=`, and let `verify` measure it.";
    FRAGMENT_BUILTIN = "fragment-builtin":
        "`visibility-buffer` shades pixels away from the rasteriser, and one of the builtins that \
         the fragment stage reads is not reconstructed there.",
        "Leave it out.";
    FRAGMENT_STATE = "fragment-state":
        "The fragment stage keeps state in a variable of the whole invocation, and parts of it \
         run for several pixels in one. In WGSL such a variable is a `var<private>`, in GLSL a \
         global variable, or an `out` that a function other than `main` writes.",
        "Pass each variable that the message names as a parameter (`inout`, or a pointer, if it \
         is written), or declare it in the entry point.";
    GRADIENT_IN_LOOP = "gradient-in-loop":
        "A derivative is taken within a loop, where each turn's would be another.",
        "Sample with gradients or a level of your own.";
    GRADIENT_OF_GRADIENT = "gradient-of-gradient":
        "A derivative, or an implicit level of detail, is taken of what rests on a derivative.",
        "Sample with gradients or a level of your own.";
    HALF_VARYING = "half-varying":
        "A varying of half precision is not interpolated by `visibility-buffer`.",
        "Make it `f32`.";
    HAS_OTHER_PASSES = "has-other-passes":
        "Another pass of the plan draws the same surface.",
        "Put `visibility-buffer` first, or alone, in the recipe.";
    MULTISAMPLED = "multisampled":
        "A pixel of several samples shows several triangles, and a visibility buffer would shade \
         it for one of them.",
        "Draw with one sample a pixel.";
    NEAREST_SAMPLE = "nearest-sample":
        "The scene sets `nearest` for a sampler that is read at interpolated coordinates or at an \
         implicit level: between two texels, or levels, it jumps with the last bits of a \
         coordinate, which a resolve rounds otherwise.",
        "Give a budget (`budget=0.02`) and let `verify` measure it, set `linear`, or read whole \
         texels (`textureLoad`) by a flat value.";
    NO_COLOR = "no-color":
        "The fragment stage gives no colour, so there is nothing to shade later.",
        "Leave the material as it is.";
    NO_GRADIENT_FORM = "no-gradient-form":
        "A sample takes its level of detail from its neighbours, and its kind of texture has no \
         sampling with gradients.",
        "Sample with a level of your own.";
    SELECT = "select":
        "Draws are told apart by a depth test in `form=fragment` alone; `form=binned` has a list \
         of each draw's own pixels, and `form=compute` no depth test, so there this `select` \
         means nothing.",
        "Leave it out; `form=compute` takes `tiles` and `id`.";
    STEEP = "steep":
        "An interpolated value reaches an operation whose slope has no bound: the root of a \
         difference that may be 0 (the rim of a ray-traced sphere, a normal's z from its x and \
         y), or `acos` and `asin` at 1 and -1. Last bits come out of it as steps.",
        "Say what may differ with `budget=`, and let `verify` measure it, or keep the operand \
         away from there (`max(.., 0.001)`).";
    SUBDIVIDED = "subdivided":
        "The triangles are divided ones, whose corners are not the author's vertices.",
        "Leave `tessellate` out of the recipe.";
    TARGET_FORMAT = "target-format":
        "WebGPU does not promise this colour format as a storage texture.",
        "Take `form=fragment`.";
    TOO_MANY_VARYINGS = "too-many-varyings":
        "The author's varyings and the id need more locations than the material asks of a device.",
        "Mark the position `@invariant`, or take `vertex=sliced`. If your devices have the limit, \
         take `vertex=same`.";
    WRITE_MASK = "write-mask":
        "A colour target is written in part, and a storage texture is written whole.",
        "Take `form=fragment`.";
}
