//! The refusals of `depth-prepass`.

use shader_text::refusals::refusals;

refusals! {
    BIAS_CONSTANT = "bias-constant":
        "The bias asked for is larger than the whole range of depth.",
        "Leave `bias-constant` out for the default.";
    BIAS_NEEDS_TRIANGLES = "bias-needs-triangles":
        "`depth-prepass` pushes its depths away by the rasteriser's depth bias, which WebGPU \
         applies to triangles only.",
        "Take `form=equal` for lines and points.";
    BIAS_SLOPE = "bias-slope":
        "`bias-slope` is a finite number of at least 0.",
        "Leave it out for 2.";
    DEPTH_BIAS_CLAMP = "depth-bias-clamp":
        "The material clamps its own depth bias. Both passes would be clamped to one bias, with \
         no margin between them.",
        "Take `form=equal`, or leave the clamp out.";
    DEPTH_NOT_INVARIANT = "depth-not-invariant":
        "The fragment stage writes `frag_depth`. No language can mark that invariant, so two \
         pipelines may round it apart and EQUAL would drop the pixel.",
        "Take `form=biased`.";
    NEAR_PLANE = "near-plane":
        "A surface lies on the near plane, at depth 0 of a float format, where a bias is nothing, \
         or clamped there after it was biased, or as a triangle of no area, which has no slope to \
         be biased by; the pre-pass would hide what it was drawn for.",
        "Take `form=equal`, or a unorm depth format and clipping, or draw it in a phase of its \
         own.";
    NO_BIAS = "no-bias":
        "A bias of 0 makes the pre-pass hide what it was drawn for.",
        "Give `bias-constant=1` or more.";
}
