//! The refusals of `outputs`.

use shader_text::refusals::refusals;

refusals! {
    ALPHA_DECIDES = "alpha-decides":
        "Alpha to coverage or blending decides how much of a pixel a material covers. A picture of \
         depths, velocities or ids has one value for each pixel.",
        "Say which alpha covers: `cutoff=0.5`.";
    AMBIGUOUS_NAME = "ambiguous-name":
        "Several values of the material have the name that you gave.",
        "Write `NAME@FUNCTION`, `NAME@FUNCTION:LINE`, or the whole path of a member: `surface.normal`.";
    HAS_OUTPUTS = "has-outputs":
        "The plan already has a pass of outputs.",
        "Name all outputs in one step: `outputs:write=normal+velocity`.";
    JITTER_MATRIX = "jitter-matrix":
        "Jitter counts as 0, and a position that is multiplied by a matrix of zeros is none.",
        "Name the offset: a member of its own, or the numbers of the matrix that hold it, as in \
         `jitter=camera.proj[2].xy`.";
    MIXED_VIEWS = "mixed-views":
        "A shadow map and distances are drawn from a light's view, depth and velocity from the camera's.",
        "Write them by two recipes, or take `shadow` for the map.";
    NO_NORMAL = "no-normal":
        "No vector of the fragment stage plays the role of a normal: to be of length 1, to come from the vertices, and \
         to meet a light's vector in a dot product.",
        "Name it: `normal=NAME`; or take the triangle's: `faces=right-handed`.";
    NO_POSITION = "no-position":
        "A distance or the triangle's normal is computed from a position in the world, and the vertex stage has none \
         in sight, or several.",
        "Name a value of the fragment stage: `position=in.world`.";
    NO_PREVIOUS = "no-previous":
        "The position of the previous frame cannot be computed: it depends on what a host cannot \
         keep.",
        "Read it from a buffer that shaders do not write.";
    NO_SUCH_NAME = "no-such-name":
        "The material has no value, buffer or attribute of that name.",
        "Take one of those listed.";
    NOT_A_DIRECTION = "not-a-direction":
        "A normal is a vector of three floats, and the value that you named is not.",
        "Name another, or write it as a value: `write=NAME`.";
    NOT_A_POSITION = "not-a-position":
        "A position is a vector of three or four floats, and for `faces` an interpolated input of the fragment stage. \
         The value that you named is not.",
        "Name another.";
    OTHER_VIEW = "other-view":
        "The other view's resources do not fit the mapping.",
        "Give their declarations: `layout=view.wgsl`.";
    OTHER_VIEW_LACKS = "other-view-lacks":
        "The slice reads something of the author's view that the other view does not have.",
        "Map it to something of the other view: `map=light.position=camera.position`.";
    OUTPUT_TYPE = "output-type":
        "No colour target holds values of that type.",
        "Name a scalar or a vector, of truth values or of numbers of 16 or 32 bits.";
    TOO_MANY = "too-many":
        "The pass needs more attributes, varyings or targets than every device has.",
        "Write fewer outputs in one pass, or copy fewer attributes.";
    UNREAD_JITTER = "unread-jitter":
        "The position does not read the jitter that you name.",
        "Name what the vertex stage adds to the position, or leave `jitter` out.";
    SEVERAL_NORMALS = "several-normals":
        "More than one vector of the fragment stage plays the role of a normal.",
        "Name the one that you mean: `normal=NAME`.";
    SEVERAL_CALLS = "several-calls":
        "The function that computes the value is called more than once, and a picture shows one value.",
        "Give the result of the call that you mean a name, and write that name.";
    VIEWER_DECIDES = "viewer-decides":
        "What is drawn depends on the viewer, and no rule says what it is without.",
        "Keep it: `view=keep`. It then follows the light. If a name misleads, say so: \
         `viewer=-material.eye_open`.";
}

/// The remedy in the middle of a message.
pub(super) fn remedy(code: &shader_text::refusals::RefusalInfo) -> String {
    let text = code.remedy.trim_end_matches('.');
    let (first, rest) = text.split_at(1);
    first.to_lowercase() + rest
}
