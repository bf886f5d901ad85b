//! The refusals of `early-discard`.

use shader_text::refusals::refusals;

refusals! {
    BINDING_TAKEN = "binding-taken":
        "The group and binding that a pass was to add is one of the shader's own.",
        "Give another `group` and `binding`, or leave them out.";
    DEPTH_BIAS = "depth-bias":
        "The material has a depth bias, which its fragment stage does not see on every API: \
         comparing its depth in the shader, it could take itself for hidden.",
        "Take `depth-prepass`.";
    DEPTH_LOOP = "depth-loop":
        "The depth that the material writes depends on a loop that may not end. The prologue \
         would run it a second time, ahead of the discards that may be all that leaves it.",
        "Count its turns by\n\
constants, or take `depth-prepass`, which keeps the discards.\n\
\n\x20   for (var i = 0; i < 32; i++) { if (hit) { break; } .. }    // ends";
    GROUP_LIMIT = "group-limit":
        "WebGPU promises four bind groups.",
        "Give a `group` of at most 3, or leave it out.";
    LANE_DECIDES_COVERAGE = "lane-decides-coverage":
        "Under `quad=lane` a sample decides what a fragment covers, and with gradients taken \
         first it would round otherwise than in the pre-pass.",
        "Take `quad=vote`.";
    LANE_NEEDS_BUDGET = "lane-needs-budget":
        "Under `quad=lane` gradients are taken ahead of the discard, and the level of detail they \
         choose rounds otherwise than the implicit one.",
        "Take `quad=vote`, which is exact, or say what may differ: `budget=0.02`.";
    LANE_SPOILS_DERIVATIVES = "lane-spoils-derivatives":
        "The fragment stage takes a derivative of something that cannot be computed ahead of the \
         discard: a lane that left would spoil it for its neighbours.",
        "Take `quad=vote`.";
    PACKED_MSAA = "packed-msaa":
        "Under multisampling a fragment stage packs one depth for all samples of a pixel.",
        "Take `texture=depth` or `texture=float`.";
    PACKED_READONLY = "packed-readonly":
        "A packed depth is a colour, which cannot be attached as depth.",
        "Take `attachment=own`, or `texture=float`.";
    READONLY_DEPTH_WRITER = "readonly-depth-writer":
        "The material writes depth, which a read-only attachment cannot take.",
        "Take `attachment=own`.";
    READONLY_INVERT = "readonly-invert":
        "Under a read-only attachment the hardware rejects what `mode=invert` would show.",
        "Take `attachment=own`.";
    TOLERANCE = "tolerance":
        "The tolerance is a finite number of at least 0.",
        "Leave it out to have it derived from the depth format.";
}
