//! Refusals that several passes share.

use shader_text::refusals::refusals;

refusals! {
    ALPHA_TO_COVERAGE = "alpha-to-coverage":
        "Coverage comes from the alpha of a colour target. A depth-only pass without that target \
         (a shadow map), or a material whose alpha cannot be computed apart, has nothing to take \
         it from.",
        "Test alpha by `discard`.";
    BIASED_POSITION = "biased-position":
        "The shader decides by the z of `@builtin(position)` whether a fragment is kept. On \
         Vulkan and OpenGL a depth bias is part of that z, so a biased pass would keep others.",
        "Take `form=equal`, or `early-discard`; or pass the depth along as a varying of its own.";
    BLENDED = "blended":
        "What lies behind a blended material shows through it, so its depth must not hide \
         anything.",
        "Draw it opaque, or leave it as it is: blended draws come last.";
    COLOR_MASK = "color-mask":
        "A material that writes depth but not all colour channels hides what lies behind it, and \
         another material writes the channels it leaves. Which of them shows there depends on the \
         order of draws, and drawing depth first changes it.",
        "Write all channels, or draw the material in a pass of its own after the frame.";
    COMPARE = "compare":
        "A pass can only draw ahead of a material whose comparison lets the nearest fragment win.",
        "Use `less`, `less-equal`, `greater` or `greater-equal`.";
    COMPARE_DIRECTION = "compare-direction":
        "The depth is cleared to the end of the range against which the comparison lets nothing \
         pass.",
        "Say which way depth grows (`--reversed-z`, `depth_direction`).";
    DEPTH_RANGE = "depth-range":
        "A draw of the frame sets a viewport whose depth range is not 0 to 1, and the variant would \
         compute a depth without it.",
        "Set the depth range 0 to 1, or leave the material as it is.";
    DEPTH_TIES = "depth-ties":
        "Several surfaces were measured to share the nearest depth, as do a decal in the plane of \
         its wall, or a mesh that is drawn twice. Under EQUAL all of them pass and the last one \
         wins, where the first did.",
        "Take `form=biased`.";
    DEPTH_WRITE_OFF = "depth-write-off":
        "The material writes no depth, so nothing of it hides anything.",
        "Turn depth writes on if it is opaque.";
    FORCED_EARLY_TEST = "forced-early-test":
        "With `@early_depth_test(force)` a fragment that discards still writes depth, which no \
         slice reproduces.",
        "Remove the attribute.";
    FRAGMENT_STORE = "fragment-store":
        "The fragment stage writes memory. Fragments that end up hidden write too, and would no \
         longer.",
        "Move the store to a pass of its own.";
    FRAGMENT_STORES = "fragment-stores":
        "The fragment stage writes memory, and a pass that moves values out of it does not follow \
         what it writes.",
        "Move the writes to a pass of their own.";
    FUSED_DISCARD = "fused-discard":
        "A discard or a depth is computed from a sum, and other code of the stage reads one of its \
         terms too. A compiler may fuse a term into a sum where nothing else reads it. The slice \
         has fewer readers, so it may decide by other bits than the whole stage: on an NVIDIA \
         H200, 13 of 57,600 depths differed, on llvmpipe 340 of 230,400.",
        "Compute what decides from values that the colours do not read, or pass it as a varying.";
    HALF_ATTRIBUTE = "half-attribute":
        "A vertex attribute of half precision is not decoded where it is pulled from a storage \
         buffer.",
        "Declare it `f32`: the vertex buffer's format may stay.";
    HAS_PREPASS = "has-prepass":
        "The plan already draws this material's depth ahead of it.",
        "Use one of the two passes. Put `hoist` and `tessellate` before a pre-pass, not after it.";
    NEIGHBOUR_COUNTS_FRAGMENTS = "neighbour-counts-fragments":
        "Another material of the frame writes stencil or memory, hidden fragments of it too: \
         which of them run depends on who drew depth before.",
        "Draw that material before the pre-pass or after the frame.";
    NEIGHBOUR_MOVES_DEPTH = "neighbour-moves-depth":
        "Another material of the frame writes depth without comparing it.",
        "Take `depth-prepass:form=biased`, or draw that material in a phase of its own.";
    NEIGHBOUR_WITHOUT_DEPTH = "neighbour-without-depth":
        "Another opaque material of the frame writes no depth (a sky drawn first, say), and would \
         be drawn after what is shaded from ids.",
        "Let it write depth, or draw it in a phase of its own.";
    NO_BUDGET = "no-budget":
        "The pass changes the picture, and needs to know by how much it may.",
        "Give `budget=0.01` (of `flip_mean`, or of `metric=max_abs`). `skip-taps:threshold=0` \
         needs none if no tap is sampled at an implicit level.";
    NO_DEPTH = "no-depth":
        "The material binds no depth attachment.",
        "Give it a depth state.";
    NO_FRAGMENT_STAGE = "no-fragment-stage":
        "The material has no fragment stage, so the pass has nothing to do.",
        "Leave the material as it is.";
    NO_MAIN_PASS = "no-main-pass":
        "The plan has no main pass.",
        "Start from the original plan.";
    NO_VERTEX_STAGE = "no-vertex-stage":
        "The main pass names no vertex entry point of its program.",
        "Name one.";
    NOT_FIRST = "not-first":
        "Another pass of the plan draws the same surface, with stages made of those that would \
         change.",
        "Put `specialize` and `early-alpha` first in the recipe, then `preamble`. Divide a surface \
         once: `tessellate` after `tessellate` has no vertex stage of the author's left. Derive \
         `shadow` and `outputs` from a plan without `preamble`.";
    NOT_SEPARABLE = "not-separable":
        "The values that would move cannot be separated from the rest of the stage.",
        "Compute them ahead of the branch or return that encloses them.";
    NOTHING_PAYS = "nothing-pays":
        "No value that may move saves a fragment more than it costs to read it: from a varying \
         (`hoist`), or from a buffer of the draw (`preamble`).",
        "The message names the one thing that would help. `hoist`: a budget, a measurement, \
         `finite=assumed`, `jumps=carried` or a larger error. `preamble`: `allow=rounding`, or a \
         smaller `least`. `preshade explain` lists the values that were not moved, and why.";
    SAMPLE_MASK = "sample-mask":
        "The fragment stage writes the sample mask, so coverage is decided there, sample by \
         sample.",
        "Decide coverage by `discard`.";
    SAMPLE_RATE = "sample-rate":
        "With several samples a stage that reads an input by sample (`sample_index`, or a varying \
         interpolated by sample) runs once for each sample. A slice, or a specialised stage, that \
         does not read that input would run once for each pixel.",
        "Interpolate at the centre, or draw with one sample.";
    STENCIL_TEST = "stencil-test":
        "The material is masked by stencil, whose contents at the time of a pre-pass are not \
         known.",
        "Mask by `discard`, or leave it as it is.";
    STENCIL_WRITE = "stencil-write":
        "The material writes stencil, which drawing it twice would do twice.",
        "Move the write to a pass of its own.";
    SUBGROUP = "subgroup":
        "The shader has subgroup operations. Their results depend on which other fragments run, \
         and the pass changes that.",
        "Compute the value without them, or leave the material as it is.";
    SUBNORMAL = "subnormal":
        "A number of the draw, or one computed from it, is subnormal: below 2^-126, and not 0. Some \
         stages of a driver take such a number for 0, and others keep it. So a stage of another kind \
         may compute something else from it.",
        "Set the number to 0, or leave the material as it is.";
    SURVIVING_SAMPLES = "surviving-samples":
        "With several samples the fragment stage reads the sample mask, or a varying at the \
         centroid of the covered samples. A driver may leave out samples that fail the early depth \
         test, and depth drawn ahead changes which do.",
        "Interpolate at the centre, or take `early-discard`, whose main pass keeps its own depth.";
    TOO_LARGE = "too-large":
        "The shader has more values than the pass examines in reasonable time.",
        "Split the shader, or leave it as it is.";
    TOPOLOGY = "topology":
        "The pass works on triangles.",
        "Draw triangles.";
    UNDEFINED_DERIVATIVE = "undefined-derivative":
        "The fragment stage takes a derivative, or samples at an implicit level, in a branch or a \
         loop that not all lanes of a quad may run, and after a discard. The languages leave the \
         value undefined. On SwiftShader it changes with the lanes that leave early, and sometimes \
         from draw to draw.",
        "Take it before the branch, give the level explicitly, or use `depth-prepass`, which leaves \
         the stage as it is.";
    UNKNOWN_FUNCTION = "unknown-function":
        "`of=` names a function that the fragment stage does not call.",
        "Name functions that it calls; the message lists them.";
    VERTEX_BUILTIN = "vertex-builtin":
        "The vertex stage reads a builtin that a new or a pulled vertex does not have.",
        "Leave it out.";
    VERTEX_STATE = "vertex-state":
        "The vertex stage keeps state in a variable of the whole invocation, and it would run \
         several times in one.",
        "Pass the variable to functions as a parameter: see `fragment-state`.";
    VERTEX_STORE = "vertex-store":
        "The vertex stage writes memory, which drawing it twice would do twice.",
        "Move the store to a compute pass.";
    VOTE_NEEDS_TRIANGLES = "vote-needs-triangles":
        "Lines and points have no quads to vote in.",
        "Take `quad=lane`.";
}
