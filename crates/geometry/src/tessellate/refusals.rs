//! The refusals of `tessellate`.

use shader_text::refusals::refusals;

refusals! {
    ADAPTIVE_FORM = "adaptive-form":
        "`tessellate` with `edge-pixels` follows the camera, and the vertices of `form=shared` or \
         `form=static` are made for all cameras.",
        "Use `form=pulled`.";
    CHANGES = "changes":
        "`tessellate:form=static` computes at load what does not change, and the scene shows that \
         one of its inputs does.",
        "Use `form=shared`.";
    EDGE_PIXELS = "edge-pixels":
        "A segment is 1 to 256 pixels long.",
        "Give a length in that range: `edge-pixels=8`, say.";
    FLAT_SHARED = "flat-shared":
        "`tessellate:form=shared` makes one vertex for all triangles around it, and a flat \
         varying differs between them.",
        "Use `form=pulled`.";
    HAS_PASSES = "has-passes":
        "Tessellation stages are written for a plan whose only pass is the main one: any other \
         would not divide the surface.",
        "Use `hoist` alone.";
    KNOWS_TRIANGLES = "knows-triangles":
        "The fragment stage reads a triangle index or barycentric coordinates, which dividing the \
         triangle changes.",
        "Pass them as varyings.";
    LEVEL = "level":
        "A tessellation level is 1 to 64.",
        "Give a level in that range.";
    MAY_CHANGE = "may-change":
        "`tessellate:form=static` computes at load. Without a scene we don't know whether its \
         inputs change.",
        "If they don't, list them in `fixed=`.";
    NO_ATTRIBUTES = "no-attributes":
        "`tessellate:form=static` follows vertex buffers, and this material's vertices are made \
         from their index.",
        "Use `form=shared`.";
    NOT_HOISTED = "not-hoisted":
        "`hoist` moved nothing to the vertices, so more vertices would only cost time.",
        "Put `hoist:budget=0.01` before `tessellate`.";
    NOT_LAST = "not-last":
        "Tessellation stages are made from the vertex stage that `hoist` built, and a later pass \
         replaced it.",
        "Put `hoist` last.";
    NOT_SPLIT = "not-split":
        "`tessellate` needs the vertex stage that `hoist` built, and this is another one.",
        "Apply `tessellate` directly after `hoist`.";
    NOTHING_BENDS = "nothing-bends":
        "Every hoisted value is linear over a triangle, so more vertices would only cost time.",
        "Give `hoist` a budget.";
    STORAGE_BUFFERS = "storage-buffers":
        "A stage would read more storage buffers than WebGPU guarantees.",
        "Pack attributes into fewer buffers.";
    UNKNOWN_FIXED = "unknown-fixed":
        "`fixed=` names a variable that the shader does not have.",
        "Name one of the shader's variables; the message lists them.";
    VARYING = "varying":
        "A varying cannot be computed at a new vertex.",
        "Declare it as a perspective-correct `f32`, or as flat.";
    VERTEX_STORES = "vertex-stores":
        "The vertex stage writes memory, and it would run more often than the material has \
         vertices.",
        "Move the writes to a pass of their own.";
}
