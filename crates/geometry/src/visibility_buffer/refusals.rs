//! The refusals of `visibility-buffer`.

use shader_text::refusals::refusals;

refusals! {
    CIRCULAR_GRADIENT = "circular-gradient":
        "A derivative depends on itself. `visibility-buffer` computes derivatives from the values \
         of neighbouring pixels, which it does not have here.",
        "Sample with explicit gradients or an explicit level.";
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
        "A derivative is computed within a loop, and it may differ in each iteration.",
        "Sample with explicit gradients or an explicit level.";
    GRADIENT_OF_GRADIENT = "gradient-of-gradient":
        "A derivative, or an implicit level of detail, depends on another derivative.",
        "Sample with explicit gradients or an explicit level.";
    HALF_VARYING = "half-varying":
        "`visibility-buffer` does not interpolate varyings of half precision.",
        "Declare it `f32`.";
    HAS_OTHER_PASSES = "has-other-passes":
        "Another pass of the plan draws the same surface.",
        "Put `visibility-buffer` first, or alone, in the recipe.";
    INTERPOLATED = "interpolated":
        "The colours depend on interpolated values or on an implicit level of detail. The resolve \
         computes both itself, and no language defines the last bits that a rasteriser gives them. \
         Shading may multiply the difference: a texel's weight has steps of 1/256, a highlight is \
         steep, a comparison is a jump.",
        "Set the allowed difference with `budget=0.05`, for example, and let `verify` measure it.";
    MULTISAMPLED = "multisampled":
        "A multisampled pixel may show several triangles, and a visibility buffer would shade \
         only one.",
        "Draw with one sample per pixel.";
    NO_COLOR = "no-color":
        "The fragment stage writes no colour, so there is nothing to shade later.",
        "Leave the material as it is.";
    ARRAY_GRADIENT = "array-gradient":
        "An element of an array of textures is sampled at an implicit level of detail.",
        "Sample with explicit gradients or an explicit level, or use one texture with layers.";
    NO_GRADIENT_FORM = "no-gradient-form":
        "A texture is sampled at an implicit level of detail, and its type cannot be sampled with \
         gradients.",
        "Sample an explicit level.";
    SELECT = "select":
        "This `select` does not fit the `form`: only `form=fragment` has a depth test that tells \
         draws apart, and `form=binned` lists the pixels of each draw already.",
        "Leave it out. `form=compute` accepts `tiles` and `id`.";
    SUBDIVIDED = "subdivided":
        "`tessellate` divided the triangles, so their corners are not vertices of the mesh.",
        "Leave `tessellate` out of the recipe.";
    TARGET_FORMAT = "target-format":
        "WebGPU does not guarantee this colour format as a storage texture.",
        "Use `form=fragment`.";
    TOO_MANY_VARYINGS = "too-many-varyings":
        "The author's varyings and the id need more locations than the material requires of a \
         device.",
        "Mark the position `@invariant`, or set `vertex=sliced`. If your devices have the limit, \
         set `vertex=same`.";
    WRITE_MASK = "write-mask":
        "A colour target has a write mask, and a storage texture is written whole.",
        "Use `form=fragment`.";
}
