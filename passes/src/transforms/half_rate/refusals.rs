//! The refusals of `half-rate`.

use shader_text::refusals::refusals;

refusals! {
    DEPTH_TEST = "depth-test":
        "The material tests or writes depth. At half the rate there is no depth to test against, so \
         covered values would mix with hidden ones.",
        "Draw it over everything, with `depth_compare = \"always\"` and `depth_write = false`, as \
         full-screen draws are.";
    HALF_RATE_SAMPLES = "half-rate-samples":
        "The material is drawn with several samples a pixel, and a half-rate texel stands for a whole \
         pixel.",
        "Draw it with one sample.";
    HALF_RATE_STENCIL = "half-rate-stencil":
        "The material tests or writes stencil, which the half-rate pass does not have.",
        "Mask by `discard`.";
    NO_GUIDE = "no-guide":
        "`guide` names a value that the carried ones are not computed from, or that is not loaded at \
         the pixel itself.",
        "Name values that are: the message lists them.";
    NOTHING_AT_HALF_RATE = "nothing-at-half-rate":
        "No value of the fragment stage costs so much that computing it for a quarter of the pixels, \
         and reading it back in all of them, saves `least` ops. `explain` lists the values that stay, \
         and why.",
        "Leave the material as it is, or give a smaller `least`.";
}
