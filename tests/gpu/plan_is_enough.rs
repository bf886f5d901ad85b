//! Every field of `plan.json` matters. One mutation each: the field is changed in the JSON, and our
//! renderer, which knows nothing else of a variant, either refuses it in words or draws another
//! picture. The fields are those of the schema, so that a new one without a mutation fails here.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use glam::{Mat4, Vec3};
use preshade_compiler::emit;
use preshade_compiler::recipe::Recipe;
use preshade_draw::render::{self, FrameSettings, Prepared, Rendered, SceneInputs};
use preshade_draw::scene::{DrawOrder, Scene, Stream, Value};
use preshade_plan::pass::Facts;
use preshade_plan::plan::Plan;
use preshade_plan::plan_file::{PlanFile, Target};
use preshade_plan::state::{
    Blend, ColorTarget, CompareFunction, CullMode, DepthBias, DepthFormat, StencilFace,
    StencilOperation, StencilState,
};
use serde_json::{Value as Json, json};
use shader_text::files::File;

use crate::render_support::*;

/// What a mutation must lead to.
enum Then {
    /// An error that contains this.
    Refused(&'static str),
    /// Another picture or depth.
    Redrawn,
}
use Then::{Redrawn, Refused};

/// Where a plan is from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Case {
    /// One opaque material with a texture and a bias.
    Lit,
    /// The same with four samples, half transparent.
    Sampled,
    /// The blended material of [`stencilled`].
    Glass,
    /// The opaque material of [`stencilled`] that writes the stencil.
    Mask,
    /// The same without the wall, so that it has its render pass for itself.
    Alone,
    /// A pre-pass that draws to attachments of its own, which the main pass reads.
    Packed,
    /// A pre-pass whose depth the main pass reads as a depth texture.
    Read,
    /// Subdivided triangles, pulled by the vertex stage.
    Pulled,
    /// Subdivided triangles, whose edges are divided by their length on the screen.
    Adaptive,
    /// Subdivided triangles, whose vertices a compute pass computes.
    Shared,
    /// With values that a compute pass makes once a draw.
    Once,
    /// With values for one pixel of each 2x2.
    Halved,
    /// Shaded from ids, in two draws told apart by a depth test.
    Ids,
    /// The same with ids of unindexed vertices.
    Unindexed,
    /// Shaded from ids in a compute pass.
    Computed,
    /// Shaded from ids in tiles.
    Tiled,
    /// Shaded from ids in a compute pass, sorted by instance.
    Binned,
}

/// Fields that a renderer does not act on, each with what stands for it instead.
const INFORMATIVE: &[(&str, &str)] = &[
    (
        "passes[].program",
        "a name: `files` says which file each stage is in",
    ),
    (
        "passes[].bindings[].name",
        "a name for readers: group and binding say which it is",
    ),
    (
        "passes[].attributes[].name",
        "a name for readers: the location says which it is",
    ),
    (
        "passes[].bindings[].visibility.compute",
        "no stage of a render pass: mutated in compute passes",
    ),
    (
        "passes[].bindings[].source.of",
        "the previous frame's copies: `outputs.rs` compares velocities with the positions of two frames",
    ),
    ("passes[].bindings[].source.group", "of the same copies"),
    ("passes[].bindings[].source.binding", "of the same copies"),
    (
        "passes[].bindings[].source.part.attribute.previous_of",
        "of the same copies",
    ),
    ("passes[].attributes[].previous_of", "of the same copies"),
    (
        "passes[].bindings[].source.value",
        "what a host computes: `outputs.rs` compares ids and distances",
    ),
    (
        "passes[].left_out",
        "what `view=drop` leaves out, for readers",
    ),
    (
        "passes[].view_dependent",
        "uniforms of a light's view: `measure_shadow.rs` shows that a list that forgets one is \
         broken",
    ),
    (
        "passes[].bindings[].layout.storage-texture",
        "no scene gives a storage texture: a plan that asks for one is refused, below",
    ),
    (
        "passes[].bindings[].source.location",
        "the scene's colour as a compute pass writes it: mutated there",
    ),
    (
        "passes[].bindings[].source.part.draw.formats",
        "what a host must store: the renderer refuses other formats, of which a scene has none",
    ),
    (
        "passes[].geometry.denominator",
        "what packed weights sum to, for readers: the text divides by it",
    ),
    (
        "passes[].bindings[].source.part.attribute.name",
        "a name for readers: the location says which it is",
    ),
    (
        "passes[].bindings[].source.part.attribute.type",
        "what the text decodes to, for readers",
    ),
    (
        "files[].tessellation",
        "files of stages that WebGPU does not have: `native_tessellation.rs` draws them by OpenGL",
    ),
    (
        "compute[].program",
        "a name: `compute_files` says which file each stage is in",
    ),
    (
        "compute[].when",
        "one frame is drawn here, which is the one at load: `tessellate_static.rs` draws several",
    ),
    (
        "compute[].bindings",
        "of the type of a pass's bindings, and filled by the same function",
    ),
    (
        "compute[].geometry.form",
        "the same as the pass's: another is another mesh, which nobody draws",
    ),
    (
        "compute[].geometry.given",
        "the same as the pass's: another is another mesh, which nobody draws",
    ),
    (
        "compute[].geometry.edge_pixels",
        "of the pulled form, which has no compute pass",
    ),
    (
        "compute[].geometry.denominator",
        "what packed weights sum to, for readers: the text divides by it",
    ),
    (
        "compute[].geometry.vertices",
        "of the pulled form, which has no compute pass",
    ),
    (
        "compute[].geometry.indices",
        "of the pulled form, which has no compute pass",
    ),
    (
        "compute[].geometry.batch",
        "of the pulled form, which has no compute pass",
    ),
    (
        "compute_files[].{}.constants",
        "of SPIR-V, which the renderer does not draw: `emit.rs` holds them to the text",
    ),
    (
        "compute_files[].{}.overrides",
        "of SPIR-V and GLSL, which the renderer does not draw: `emit.rs` holds them to the text",
    ),
    (
        "compute_files[].{}.textures",
        "of GLSL, which the renderer does not draw",
    ),
    (
        "compute_files[].{}.uniforms",
        "of GLSL, which the renderer does not draw: `glsl_names.rs` holds them to the text",
    ),
    (
        "compute_files[].{}.attributes",
        "of GLSL, which the renderer does not draw: `glsl_names.rs` holds them to the text",
    ),
    (
        "compute_files[].{}.blocks",
        "of GLSL, which the renderer does not draw",
    ),
    (
        "files[].vertex.{}.extensions",
        "of GLSL, which the renderer does not draw: `lacks.rs` compiles the texts",
    ),
    (
        "files[].fragment.{}.extensions",
        "of GLSL, which the renderer does not draw: `lacks.rs` compiles the texts",
    ),
    (
        "compute_files[].{}.extensions",
        "of GLSL, which the renderer does not draw: `lacks.rs` compiles the texts",
    ),
    ("steps", "how the plan was made"),
    ("contract", "a promise: `verify` measures it"),
    (
        "self_test",
        "what a host runs at load, apart from its frames",
    ),
    ("fallback", "what to draw in place of the plan, below"),
    (
        "guard",
        "what a host checks before it draws the plan: `specialize.rs`",
    ),
    ("notes", "words"),
    ("forms", "a promise"),
    (
        "original",
        "a plan in place of the plan, of the same types: drawn below",
    ),
    (
        "files[].vertex.{}.constants",
        "of SPIR-V, which the renderer does not draw: `emit.rs` holds them to the text",
    ),
    (
        "files[].vertex.{}.overrides",
        "of SPIR-V and GLSL, which the renderer does not draw: `emit.rs` holds them to the text",
    ),
    (
        "files[].vertex.{}.textures",
        "of GLSL, which the renderer does not draw",
    ),
    (
        "files[].vertex.{}.uniforms",
        "of GLSL, which the renderer does not draw: `glsl_names.rs` holds them to the text",
    ),
    (
        "files[].vertex.{}.attributes",
        "of GLSL, which the renderer does not draw: `glsl_names.rs` holds them to the text",
    ),
    (
        "files[].vertex.{}.blocks",
        "of GLSL, which the renderer does not draw",
    ),
    (
        "files[].fragment.{}.constants",
        "of SPIR-V, which the renderer does not draw: `emit.rs` holds them to the text",
    ),
    (
        "files[].fragment.{}.overrides",
        "of SPIR-V and GLSL, which the renderer does not draw: `emit.rs` holds them to the text",
    ),
    (
        "files[].fragment.{}.textures",
        "of GLSL, which the renderer does not draw",
    ),
    (
        "files[].fragment.{}.uniforms",
        "of GLSL, which the renderer does not draw: `glsl_names.rs` holds them to the text",
    ),
    (
        "files[].fragment.{}.attributes",
        "of GLSL, which the renderer does not draw: `glsl_names.rs` holds them to the text",
    ),
    (
        "files[].fragment.{}.blocks",
        "of GLSL, which the renderer does not draw",
    ),
];

/// One mutation a field: the case, a JSON pointer into its `plan.json`, the value to put there, and
/// what must come of it.
#[rustfmt::skip] // One row a field.
fn mutations() -> Vec<(Case, &'static str, Json, Then)> {
    use Case::{Adaptive, Alone, Binned, Computed, Glass, Halved, Ids, Lit, Mask, Once, Packed, Pulled, Read, Sampled, Shared, Tiled, Unindexed};
    vec![
        (Lit, "/schema", json!("preshade.plan.v0"), Refused("its schema is `preshade.plan.v0`")),
        (Lit, "/material", json!("someone else's"), Redrawn),
        (Lit, "/attachments/0/name", json!("elsewhere"), Refused("it has no attachment \
            `scene-depth`")),
        (Lit, "/attachments/0/format", json!("depth16unorm"), Redrawn),
        (Lit, "/attachments/0/samples", json!(4), Refused("draws 1 samples a pixel, and \
            `scene-depth` has 4")),
        (Read, "/attachments/1/sampled", json!(false), Refused("does not mark as sampled")),
        (Lit, "/attachments/0/clear", json!(0.9), Redrawn),
        (Packed, "/attachments/2/clear", json!(0.5), Refused("cannot be cleared to")),
        (Lit, "/passes/0/role", json!("prepass"), Refused("not those of its passes")),
        (Glass, "/passes/0/phase", json!("opaque"), Redrawn),
        (Lit, "/passes/0/vertex", json!("elsewhere"), Refused("other entry points")),
        (Lit, "/passes/0/fragment", json!("elsewhere"), Refused("other entry points")),
        (Mask, "/passes/0/primitive/topology", json!("line-list"), Redrawn),
        (Lit, "/passes/0/primitive/cull", json!("front"), Redrawn),
        (Lit, "/passes/0/primitive/front_face", json!("cw"), Redrawn),
        (Lit, "/passes/0/primitive/unclipped_depth", json!(true), Redrawn),
        (Lit, "/passes/0/depth/attachment", json!("elsewhere"), Refused("it has no attachment \
            `elsewhere`")),
        (Lit, "/passes/0/depth/compare", json!("greater"), Redrawn),
        (Lit, "/passes/0/depth/write", json!(false), Redrawn),
        (Lit, "/passes/0/depth/bias/constant", json!(0), Redrawn),
        (Lit, "/passes/0/depth/bias/slope_scale", json!(2.0), Redrawn),
        (Lit, "/passes/0/depth/bias/clamp", json!(0.001), Redrawn),
        (Lit, "/passes/0/depth/read_only", json!(true), Refused("writes `scene-depth`, which it \
            binds read-only")),
        (Lit, "/passes/0/depth/ops/load", json!("load"), Refused("nothing is in it yet")),
        (Lit, "/passes/0/depth/ops/store", json!("discard"), Redrawn),
        (Mask, "/passes/0/depth/stencil_ops/load", json!("load"), Refused("loads the stencil of \
            `scene-depth`")),
        (Alone, "/passes/0/depth/stencil_ops/store", json!("discard"), Refused("discards the \
            stencil of `scene-depth`")),
        (Mask, "/passes/0/stencil/front/compare", json!("never"), Redrawn),
        (Mask, "/passes/0/stencil/front/fail", json!("keep"), Redrawn),
        (Mask, "/passes/0/stencil/front/depth_fail", json!("keep"), Redrawn),
        (Mask, "/passes/0/stencil/front/pass", json!("keep"), Redrawn),
        (Mask, "/passes/0/stencil/back/compare", json!("never"), Redrawn),
        (Mask, "/passes/0/stencil/back/fail", json!("keep"), Redrawn),
        (Mask, "/passes/0/stencil/back/depth_fail", json!("keep"), Redrawn),
        (Mask, "/passes/0/stencil/back/pass", json!("keep"), Redrawn),
        (Mask, "/passes/0/stencil/read_mask", json!(0), Redrawn),
        (Mask, "/passes/0/stencil/write_mask", json!(0), Redrawn),
        (Mask, "/passes/0/stencil/reference", json!(3), Redrawn),
        (Lit, "/passes/0/multisample/count", json!(4), Refused("draws 4 samples a pixel, and \
            `scene-depth` has 1")),
        (Lit, "/passes/0/multisample/mask", json!(0), Redrawn),
        (Sampled, "/passes/0/multisample/alpha_to_coverage", json!(true), Redrawn),
        (Lit, "/passes/0/targets/0/format", json!("rgba16float"), Redrawn),
        (Packed, "/passes/0/targets/0/attachment", json!("elsewhere"), Refused("it has no \
            attachment `elsewhere`")),
        (Glass, "/passes/0/targets/0/blend/color/src", json!("one"), Redrawn),
        (Glass, "/passes/0/targets/0/blend/color/dst", json!("one"), Redrawn),
        (Glass, "/passes/0/targets/0/blend/color/operation", json!("subtract"), Redrawn),
        (Glass, "/passes/0/targets/0/blend/alpha/src", json!("zero"), Redrawn),
        (Glass, "/passes/0/targets/0/blend/alpha/dst", json!("zero"), Redrawn),
        (Glass, "/passes/0/targets/0/blend/alpha/operation", json!("subtract"), Redrawn),
        (Lit, "/passes/0/targets/0/write_mask", json!(14), Redrawn),
        (Packed, "/passes/0/targets/0/ops/load", json!("load"), Refused("nothing is in it yet")),
        (Packed, "/passes/0/targets/0/ops/store", json!("discard"), Refused("discards \
            `prepass-depth-packed`")),
        (Lit, "/passes/0/targets/0/ops/store", json!("discard"), Redrawn),
        (Lit, "/passes/0/bindings/0/group", json!(3), Refused("is not a binding the author's \
            program uses")),
        (Lit, "/passes/0/bindings/0/binding", json!(3), Refused("is not a binding the author's \
            program uses")),
        (Lit, "/passes/0/bindings/0/kind", json!("storage-read"), Refused("is a StorageRead in the plan")),
        (Lit, "/passes/0/bindings/0/visibility/vertex", json!(false), Refused("the pipeline of pass `main`")),
        (Lit, "/passes/0/bindings/2/visibility/fragment", json!(false), Refused("the pipeline of pass `main`")),
        (Read, "/passes/1/bindings/2/source/from", json!("author"), Refused("is not a binding the \
            author's program uses")),
        (Read, "/passes/1/bindings/2/source/name", json!("elsewhere"), Refused("reads `elsewhere`, \
            which is no attachment")),
        (Lit, "/passes/0/bindings/0/layout", json!(null), Refused("has no layout")),
        (Lit, "/passes/0/bindings/0/layout/buffer/type", json!("storage"), Refused("laid out as a storage buffer")),
        (Lit, "/passes/0/bindings/0/layout/buffer/min_binding_size", json!(4096), Refused("of 4096 bytes in the plan")),
        (Lit, "/passes/0/bindings/3/layout/sampler/type", json!("comparison"), Refused("a comparison sampler")),
        (Lit, "/passes/0/bindings/2/layout/texture/sample_type", json!("uint"), Refused("unsigned integers")),
        (Lit, "/passes/0/bindings/2/layout/texture/view_dimension", json!("cube"), Refused("a Cube texture")),
        (Lit, "/passes/0/bindings/2/layout/texture/multisampled", json!(true), Refused("a multisampled D2 texture")),
        (Lit, "/passes/0/attributes/0/location", json!(9), Refused("location 9")),
        (Lit, "/passes/0/attributes/0/type", json!("vec3<u32>"), Refused("does not feed")),
        (Lit, "/passes/0/features", json!(["time-travel"]), Refused("needs time-travel")),
        (Lit, "/passes/0/limits", json!({"maxBindGroups": 1_000_000}), Refused("needs \
            maxBindGroups of 1000000")),
        (Glass, "/passes/0/draws", json!("opaque"), Redrawn),
        (Pulled, "/passes/0/geometry/kind", json!("as-given"), Refused("does not say how its \
            geometry is subdivided")),
        (Shared, "/passes/0/geometry/pattern", json!("uniform"), Redrawn),
        (Shared, "/passes/0/geometry/level", json!(3), Redrawn),
        (Pulled, "/passes/0/geometry/form", json!("shared"), Redrawn),
        (Pulled, "/passes/0/geometry/vertices/1", json!(0), Redrawn),
        (Pulled, "/passes/0/geometry/indices/0", json!(5), Redrawn),
        (Pulled, "/passes/0/geometry/batch", json!(1), Redrawn),
        (Pulled, "/passes/0/geometry/given", json!("triangle-strip"), Redrawn),
        (Adaptive, "/passes/0/geometry/edge_pixels", json!(null), Refused("bytes in the plan")),
        (Pulled, "/passes/0/bindings/5/source/part/attribute/location", json!(9), Refused("at location 9")),
        (Pulled, "/passes/0/bindings/2/source/part/constants/streams/0", json!(9), Refused("at location 9")),
        (Shared, "/passes/0/bindings/2/source/part/vertices/buffer", json!("elsewhere"), Refused("has no buffer `elsewhere`")),
        (Shared, "/vertex_buffers/0/name", json!("elsewhere"), Refused("has no buffer `vertices`")),
        (Shared, "/vertex_buffers/0/stride", json!(4), Redrawn),
        (Shared, "/compute/0/entry_point", json!("elsewhere"), Refused("other entry points")),
        (Shared, "/compute/0/workgroup", json!(1_000_000), Redrawn),
        (Shared, "/compute/0/geometry/kind", json!("as-given"), Refused("computes no geometry")),
        (Shared, "/compute/0/geometry/pattern", json!("uniform"), Redrawn),
        (Shared, "/compute/0/geometry/level", json!(3), Redrawn),
        (Shared, "/compute/0/features", json!(["time-travel"]), Refused("needs time-travel")),
        (Shared, "/compute/0/limits", json!({"maxComputeWorkgroupSizeX": 1_000_000}), Refused("needs \
            maxComputeWorkgroupSizeX of 1000000")),
        (Shared, "/compute_files/0/wgsl/file", json!("elsewhere.wgsl"), Refused("there is no file \
            `elsewhere.wgsl`")),
        (Shared, "/compute_files/0/wgsl/entry_point", json!("elsewhere"), Refused("other entry points")),
        (Once, "/draw_buffers/0/name", json!("elsewhere"), Refused("has no buffer `preamble`")),
        (Once, "/draw_buffers/0/size", json!(4), Refused("bytes in the plan")),
        (Once, "/passes/0/bindings/2/source/part/values/buffer", json!("elsewhere"), Refused("has no buffer `elsewhere`")),
        (Halved, "/attachments/1/divisor", json!(1), Redrawn),
        (Halved, "/attachments/1/divisor", json!(3), Redrawn),
        (Halved, "/passes/0/phase", json!("blended"), Redrawn),
        (Ids, "/passes/0/phase", json!("opaque"), Redrawn),
        (Ids, "/passes/1/bindings/1/source/part", json!("indices"), Redrawn),
        (Ids, "/passes/2/depth/compare", json!("always"), Redrawn),
        (Ids, "/passes/2/bindings/4/source/part/draw/streams/0", json!(9), Refused("at location 9")),
        (Ids, "/passes/2/bindings/5/source/name", json!("elsewhere"), Refused("reads `elsewhere`, \
            which is no attachment")),
        (Computed, "/passes/1/phase", json!("opaque"), Redrawn),
        (Computed, "/compute/0/when/phase", json!("depth"), Redrawn),
        (Computed, "/compute/0/workgroup", json!(16), Redrawn),
        (Computed, "/compute/0/bindings/0/visibility/compute", json!(false), Refused("the compute \
            pass of material `lit` was refused")),
        (Computed, "/compute/0/bindings/9/source/location", json!(1), Refused("which no pass draws to")),
        (Tiled, "/frame_buffers/0/name", json!("elsewhere"), Refused("has no buffer \
            `visibility-quads`")),
        (Tiled, "/frame_buffers/0/holds", json!("pixels"), Refused("and no arguments")),
        (Tiled, "/passes/1/geometry/buffer", json!("visibility-quad-tiles"), Refused("and no arguments")),
        (Tiled, "/passes/1/geometry/kind", json!("full-screen"), Redrawn),
        (Tiled, "/passes/1/bindings/9/source/part/frame/buffer", json!("elsewhere"), Refused("has no buffer `elsewhere`")),
        (Binned, "/compute/1/draws", json!("once"), Redrawn),
        (Binned, "/compute/3/geometry/buffer", json!("elsewhere"), Refused("has no buffer `elsewhere`")),
        (Unindexed, "/passes/0/geometry/kind", json!("as-given"), Redrawn),
        (Lit, "/files/0/role", json!("prepass"), Refused("not those of its passes")),
        (Lit, "/files/0/vertex/wgsl/file", json!("elsewhere.wgsl"), Refused("there is no file \
            `elsewhere.wgsl`")),
        (Lit, "/files/0/vertex/wgsl/entry_point", json!("elsewhere"), Refused("other entry points")),
        (Lit, "/files/0/fragment/wgsl/file", json!("elsewhere.wgsl"), Refused("there is no file \
            `elsewhere.wgsl`")),
        (Lit, "/files/0/fragment/wgsl/entry_point", json!("elsewhere"), Refused("other entry points")),
    ]
}

/// A texture times a uniform, on positions that a uniform transforms.
const LIT: &str = "
struct Camera { view_proj: mat4x4<f32> }
struct Object { model: mat4x4<f32>, tint: vec4<f32> }
@group(0) @binding(0) var<uniform> camera: Camera;
@group(1) @binding(0) var<uniform> object: Object;
@group(1) @binding(1) var albedo: texture_2d<f32>;
@group(1) @binding(2) var smooth_sampler: sampler;
struct Out { @builtin(position) @invariant at: vec4<f32>, @location(0) uv: vec2<f32> }
@vertex fn vs(@location(0) position: vec3<f32>, @location(1) uv: vec2<f32>) -> Out {
    return Out(camera.view_proj * object.model * vec4(position, 1.0), uv);
}
@fragment fn fs(in: Out) -> @location(0) vec4<f32> {
    return object.tint * textureSample(albedo, smooth_sampler, in.uv);
}
";

/// Waves on the same positions, to be hoisted.
const WAVES: &str = "
struct Camera { view_proj: mat4x4<f32> }
struct Object { model: mat4x4<f32>, tint: vec4<f32> }
@group(0) @binding(0) var<uniform> camera: Camera;
@group(1) @binding(0) var<uniform> object: Object;
struct Out { @builtin(position) at: vec4<f32>, @location(0) world: vec3<f32> }
@vertex fn vs(@location(0) position: vec3<f32>) -> Out {
    let world = object.model * vec4(position, 1.0);
    return Out(camera.view_proj * world, world.xyz);
}
@fragment fn fs(in: Out) -> @location(0) vec4<f32> {
    let waves = sin(in.world.x * 5.0) * cos(in.world.y * 4.0) * sin(exp(in.world.z)) * \
        exp(sin(in.world.x));
    return vec4(object.tint.rgb * (0.5 + 0.4 * waves), 1.0);
}
";

/// A colour of exponentials, to be computed once a draw.
const GLOW: &str = "
struct Camera { view_proj: mat4x4<f32> }
struct Object { model: mat4x4<f32>, tint: vec4<f32> }
@group(0) @binding(0) var<uniform> camera: Camera;
@group(1) @binding(0) var<uniform> object: Object;
struct Out { @builtin(position) at: vec4<f32>, @location(0) world: vec3<f32> }
@vertex fn vs(@location(0) position: vec3<f32>) -> Out {
    let world = object.model * vec4(position, 1.0);
    return Out(camera.view_proj * world, world.xyz);
}
@fragment fn fs(in: Out) -> @location(0) vec4<f32> {
    let glow = exp2(sin(object.tint.rgb) - 1.0);
    return vec4(glow * abs(in.world), 1.0);
}
";

/// A tilted square that pierces the near plane, in front of nothing.
fn lit() -> Scene {
    let tilted = Mat4::from_translation(Vec3::new(0.0, 0.0, 0.3))
        * Mat4::from_rotation_y(0.5)
        * Mat4::from_scale(Vec3::splat(0.8));
    let mut lit = material("lit", LIT);
    lit.state.depth_bias = DepthBias {
        constant: 1 << 18,
        ..DepthBias::default()
    };
    let mut scene = scene(
        [64, 64],
        vec![lit],
        vec![draw("tilted", tilted, [0.9, 0.8, 0.7, 1.0])],
    );
    let uv = vec![0.0, 0.0, 1.0, 0.0, 1.0, 1.0, 0.0, 1.0];
    scene.meshes[0].streams.insert(
        "uv".to_owned(),
        Stream::Float {
            components: 2,
            data: uv,
        },
    );
    scene
}

/// A wall, a mask, and glass that is drawn where the stencil is 1. The mask replaces 0 by 1 where
/// it is in sight and where it is behind the wall, and makes it 2 where it is drawn once more. It
/// is seen from the front above and from behind below.
fn stencilled() -> Scene {
    let face = |fail, depth_fail, pass| StencilFace {
        compare: CompareFunction::NotEqual,
        fail,
        depth_fail,
        pass,
    };
    let (fail, depth_fail, pass) = (
        StencilOperation::IncrementClamp,
        StencilOperation::Replace,
        StencilOperation::Replace,
    );
    let with_depth = |name: &str| {
        let mut m = material(name, FLAT);
        m.state.depth_format = DepthFormat::Depth24plusStencil8;
        m.state.targets = vec![Some(ColorTarget::opaque("rgba8unorm"))];
        m
    };
    let wall = with_depth("wall");
    let mut mask = with_depth("mask");
    mask.state.primitive.cull = CullMode::None;
    mask.state.stencil = Some(StencilState {
        front: face(fail, depth_fail, pass),
        back: face(fail, depth_fail, pass),
        read_mask: 255,
        write_mask: 255,
        reference: 1,
    });
    mask.state.depth_write = false;
    let mut glass = with_depth("glass");
    glass.state.depth_write = false;
    let shown = StencilFace {
        compare: CompareFunction::Equal,
        fail: StencilOperation::Keep,
        depth_fail: StencilOperation::Keep,
        pass: StencilOperation::Keep,
    };
    glass.state.stencil = Some(StencilState {
        front: shown,
        back: shown,
        read_mask: 255,
        write_mask: 0,
        reference: 1,
    });
    glass.state.targets = vec![Some(ColorTarget {
        blend: Some(Blend::ALPHA),
        ..ColorTarget::opaque("rgba8unorm")
    })];
    // A rectangle in clip space; `turned`: seen from behind.
    let at = |x: f32, y: f32, w: f32, h: f32, z: f32, turned: bool| {
        let mirror = if turned { -1.0 } else { 1.0 };
        Mat4::from_translation(Vec3::new(x, y, z)) * Mat4::from_scale(Vec3::new(w * mirror, h, 1.0))
    };
    let mut draws = Vec::new();
    let mut add = |material: usize, transform: Mat4, tint: [f64; 4]| {
        let mut d = draw(&format!("draw {}", draws.len()), transform, tint);
        d.material = material;
        draws.push(d);
    };
    // Glass first: only its phase puts it last.
    add(2, at(0.0, 0.0, 1.0, 1.0, 0.1, false), [0.2, 0.4, 0.9, 0.5]);
    add(0, at(0.0, 0.0, 1.0, 1.0, 0.5, false), [0.5, 0.3, 0.1, 1.0]);
    for (y, turned) in [(0.5, false), (-0.5, true)] {
        let grey = [0.3, 0.3, 0.3, 1.0];
        // Left: passes, and in its upper part then fails. Right: behind the wall.
        add(1, at(-0.6, y, 0.3, 0.4, 0.4, turned), grey);
        add(1, at(-0.6, y + 0.1, 0.3, 0.2, 0.4, turned), grey);
        add(1, at(0.5, y, 0.3, 0.4, 0.8, turned), grey);
    }
    let mut scene = scene([64, 64], vec![wall, mask, glass], draws);
    scene.depth_format = DepthFormat::Depth24plusStencil8;
    scene
}

/// [`stencilled`] without its wall.
fn unwalled() -> Scene {
    let mut scene = stencilled();
    scene.materials.remove(0);
    scene.draws.retain(|d| d.material != 0);
    for draw in &mut scene.draws {
        draw.material -= 1;
    }
    scene
}

fn scene_of(case: Case) -> Scene {
    match case {
        Case::Lit => lit(),
        Case::Sampled => {
            let mut scene = with_samples(lit(), 4);
            let half = Value::Numbers(vec![0.9, 0.8, 0.7, 0.5]);
            scene.draws[0].values.insert("object.tint".to_owned(), half);
            scene
        }
        Case::Ids | Case::Unindexed | Case::Computed | Case::Tiled | Case::Binned => {
            let mut scene = lit();
            let mut smaller = scene.draws[0].clone();
            smaller.name = "smaller".to_owned();
            smaller.transform *= Mat4::from_translation(Vec3::new(0.3, 0.4, -0.2))
                * Mat4::from_scale(Vec3::splat(0.4));
            let blue = Value::Numbers(vec![0.2, 0.3, 0.9, 1.0]);
            smaller.values.insert("object.tint".to_owned(), blue);
            scene.draws.push(smaller);
            scene
        }
        Case::Alone => unwalled(),
        Case::Glass | Case::Mask => stencilled(),
        Case::Packed | Case::Read => planes([64, 64], 3),
        Case::Pulled | Case::Adaptive | Case::Shared => {
            let mut scene = lit();
            scene.materials = vec![material("lit", WAVES)];
            scene
        }
        Case::Once => {
            let mut scene = lit();
            scene.materials = vec![material("lit", GLOW)];
            scene
        }
        Case::Halved => {
            let path = concat!(
                env!("CARGO_MANIFEST_DIR"),
                "/fixtures/adversarial/thin-lines.toml"
            );
            let scene = preshade_scenes::load(Path::new(path)).unwrap();
            scene.resized([64, 64])
        }
    }
}

/// The files of every material of a case, and which of them is mutated.
fn files_of(case: Case, scene: &Scene) -> (Vec<Vec<File>>, usize) {
    let recipe = match case {
        Case::Packed => Some("early-discard:texture=packed"),
        Case::Read => Some("early-discard"),
        Case::Pulled => Some("hoist:budget=1,finite=assumed,jumps=carried,tessellate:level=4"),
        Case::Adaptive => {
            Some("hoist:budget=1,finite=assumed,jumps=carried,tessellate:level=8,edge-pixels=5")
        }
        Case::Shared => {
            Some("hoist:budget=1,finite=assumed,jumps=carried,tessellate:level=8,form=shared")
        }
        Case::Once => Some("preamble"),
        Case::Halved => Some("half-rate:budget=1"),
        Case::Ids => Some("visibility-buffer:budget=1"),
        Case::Unindexed => Some("visibility-buffer:ids=unindexed,select=id,budget=1"),
        Case::Computed => Some("visibility-buffer:form=compute,budget=1"),
        Case::Tiled => Some("visibility-buffer:select=tiles,budget=1"),
        Case::Binned => Some("visibility-buffer:form=binned,budget=1"),
        Case::Lit | Case::Sampled | Case::Glass | Case::Mask | Case::Alone => None,
    };
    let plans: Vec<Plan> = originals(scene)
        .into_iter()
        .map(|plan| match recipe {
            None => plan,
            Some(recipe) => Recipe::parse_list(recipe)
                .unwrap()
                .apply(&plan, &Facts::default())
                .unwrap(),
        })
        .collect();
    let files = plans
        .iter()
        .map(|p| emit::emit(p, &[Target::Wgsl], &emit::Options::default()).unwrap())
        .collect();
    let mutated = match case {
        Case::Glass => 2,
        Case::Mask => 1,
        _ => 0,
    };
    (files, mutated)
}

fn draw_files(scene: &Scene, files: &[Vec<File>]) -> Result<Rendered, render::Error> {
    let inputs = SceneInputs::new(gpu(), scene)?;
    let variant = preshade_scenes::from_files(files)?;
    let mut prepared = Prepared::new(&inputs, &variant, &FrameSettings::of(scene))?;
    let frame = &scene.cameras[0].frames[0];
    prepared.aim(frame, DrawOrder::AsGiven);
    prepared.render()
}

fn plan_json(files: &mut [File]) -> &mut File {
    let json = files.iter_mut().find(|f| f.name.ends_with(".plan.json"));
    json.unwrap()
}

/// A case as it is emitted, and its picture.
struct Unmutated {
    scene: Scene,
    files: Vec<Vec<File>>,
    /// Index of the material to change.
    mutated: usize,
    picture: Rendered,
}

impl Unmutated {
    fn of(case: Case) -> Self {
        let scene = scene_of(case);
        let (files, mutated) = files_of(case, &scene);
        let picture = draw_files(&scene, &files).unwrap();
        Self {
            scene,
            files,
            mutated,
            picture,
        }
    }
}

#[test]
fn every_field_is_needed() {
    let mut unmutated: BTreeMap<Case, Unmutated> = BTreeMap::new();
    let mut wrong = Vec::new();
    for (case, pointer, value, then) in mutations() {
        let of = unmutated.entry(case).or_insert_with(|| Unmutated::of(case));
        let mut files = of.files.clone();
        let file = plan_json(&mut files[of.mutated]);
        let mut plan: Json = serde_json::from_slice(&file.bytes).unwrap();
        put(&mut plan, pointer, value);
        file.bytes = serde_json::to_vec(&plan).unwrap();
        let told = match (draw_files(&of.scene, &files), then) {
            (Err(e), Refused(text)) if e.to_string().contains(text) && !text.is_empty() => continue,
            (Ok(drawn), Redrawn) if drawn != of.picture => continue,
            // An adapter without the feature says so.
            (Err(render::Error::Unsupported { .. }), Redrawn) => continue,
            (Err(e), _) => format!("refused: {e}"),
            (Ok(drawn), _) if drawn == of.picture => "drawn alike".to_owned(),
            (Ok(_), _) => "drawn otherwise".to_owned(),
        };
        wrong.push(format!("{case:?} {pointer}: {told}"));
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

/// Puts `value` at `pointer`, whose last key may be one that the JSON leaves out.
fn put(json: &mut Json, pointer: &str, value: Json) {
    let (parent, key) = pointer.rsplit_once('/').unwrap();
    let parent = json
        .pointer_mut(parent)
        .unwrap_or_else(|| panic!("there is no {parent}"));
    match parent {
        Json::Array(items) => items[key.parse::<usize>().unwrap()] = value,
        Json::Object(members) => {
            assert_ne!(members.get(key), Some(&value), "{pointer} is so already");
            members.insert(key.to_owned(), value);
        }
        other => panic!("{pointer}: {other} has no members"),
    }
}

/// The fields of a schema that hold no others, as paths: `[]` is any element, `{}` any key.
fn leaves(root: &Json, at: &Json, path: &str, out: &mut BTreeSet<String>) {
    if let Some(name) = at["$ref"].as_str() {
        let definition = root.pointer(name.trim_start_matches('#')).unwrap();
        return leaves(root, definition, path, out);
    }
    let before = out.len();
    for choices in ["anyOf", "oneOf", "allOf"] {
        for choice in at[choices].as_array().into_iter().flatten() {
            if choice["type"] != "null" {
                leaves(root, choice, path, out);
            }
        }
    }
    for (name, inner) in at["properties"].as_object().into_iter().flatten() {
        let path = if path.is_empty() {
            name.clone()
        } else {
            format!("{path}.{name}")
        };
        leaves(root, inner, &path, out);
    }
    if at["items"].is_object() {
        leaves(root, &at["items"], &format!("{path}[]"), out);
    }
    let of_maps = ["additionalProperties", "patternProperties"];
    for inner in of_maps.iter().map(|k| &at[*k]).filter(|i| i.is_object()) {
        leaves(root, inner, &format!("{path}.{{}}"), out);
    }
    // Types with members of their own are not leaves, though a variant of theirs without any may
    // be.
    let nested = out
        .range(format!("{path}.")..)
        .next()
        .is_some_and(|p| p.starts_with(&format!("{path}.")) || p.starts_with(&format!("{path}[")));
    if out.len() == before && !nested && !path.is_empty() {
        out.insert(path.to_owned());
    }
}

fn covers(pointer: &str, leaf: &str) -> bool {
    let segments = leaf.replace("[]", ".[]");
    let wanted: Vec<&str> = segments.split('.').collect();
    let given: Vec<&str> = pointer.trim_start_matches('/').split('/').collect();
    let rest = wanted.get(given.len()..).unwrap_or_default();
    given.len() <= wanted.len()
        && rest.iter().all(|s| ["[]", "{}"].contains(s))
        && given.iter().zip(&wanted).all(|(g, w)| match *w {
            "[]" => g.parse::<usize>().is_ok(),
            "{}" => true,
            name => *g == name,
        })
}

#[test]
fn every_field_of_the_schema_has_a_mutation_or_a_reason() {
    let schema = schemars::schema_for!(PlanFile).to_value();
    let mut fields = BTreeSet::new();
    leaves(&schema, &schema, "", &mut fields);
    assert!(
        fields.contains("passes[].depth.bias.constant"),
        "{fields:#?}"
    );
    let mutated = mutations();
    let is_informative = |field: &str, prefix: &str| {
        let rest = field.strip_prefix(prefix);
        rest.is_some_and(|r| r.is_empty() || r.starts_with(['.', '[']))
    };
    let missing: Vec<&String> = fields
        .iter()
        .filter(|f| {
            !INFORMATIVE
                .iter()
                .any(|(prefix, _)| is_informative(f, prefix))
        })
        .filter(|f| !mutated.iter().any(|(_, pointer, ..)| covers(pointer, f)))
        .collect();
    assert!(
        missing.is_empty(),
        "without a mutation or a reason: {missing:#?}"
    );
    for (prefix, reason) in INFORMATIVE {
        assert!(
            fields.iter().any(|f| is_informative(f, prefix)),
            "`{prefix}` ({reason}) is no field"
        );
    }
    for (_, pointer, ..) in &mutated {
        let known = fields.iter().any(|f| covers(pointer, f));
        assert!(
            known || pointer.ends_with("/layout") || pointer.ends_with("/part"),
            "{pointer} is no field"
        );
    }
}

#[test]
fn the_fallback_is_the_original() {
    let scene = planes([64, 64], 3);
    let (files, _) = files_of(Case::Read, &scene);
    let names: Vec<&str> = files[0].iter().map(|f| f.name.as_str()).collect();
    assert_eq!(
        names,
        [
            "flat.main.wgsl",
            "flat.prepass.wgsl",
            "flat.original.wgsl",
            "flat.plan.json"
        ]
    );
    let mut files = files;
    let file = plan_json(&mut files[0]);
    let plan: PlanFile = serde_json::from_slice(&file.bytes).unwrap();
    let fallback = plan.fallback().unwrap();
    file.bytes = serde_json::to_vec(&fallback).unwrap();
    let drawn = draw_files(&scene, &files).unwrap();
    let original = originals(&scene)[0].clone();
    assert_eq!(fallback.plan.passes[0].depth, original.passes[0].depth);
    let written = [Target::Wgsl];
    let untouched = emit::emit(&original, &written, &emit::Options::default()).unwrap();
    assert_eq!(drawn, draw_files(&scene, &[untouched]).unwrap());
}

#[test]
fn an_untouched_main_program_is_its_own_fallback() {
    let scene = planes([64, 64], 3);
    let plan = Recipe::parse(["depth-prepass"])
        .unwrap()
        .apply(&originals(&scene)[0], &Facts::default())
        .unwrap();
    let files = emit::emit(&plan, &[Target::Wgsl], &emit::Options::default()).unwrap();
    let names: Vec<&str> = files.iter().map(|f| f.name.as_str()).collect();
    assert_eq!(
        names,
        ["flat.main.wgsl", "flat.prepass.wgsl", "flat.plan.json"]
    );
    let plan: PlanFile = serde_json::from_slice(&files[2].bytes).unwrap();
    let fallback = plan.fallback().unwrap();
    assert_eq!(
        fallback.files[0].vertex[&Target::Wgsl].file,
        "flat.main.wgsl"
    );
    assert_eq!(fallback.plan.passes.len(), 1);
}

#[test]
fn a_storage_texture_that_the_scene_does_not_have_is_told() {
    let scene = lit();
    let (mut files, which) = files_of(Case::Lit, &scene);
    let file = plan_json(&mut files[which]);
    let mut plan: Json = serde_json::from_slice(&file.bytes).unwrap();
    let layout = json!({"storage-texture": {
        "access": "write-only",
        "format": "rgba8unorm",
        "view_dimension": "2d",
    }});
    put(
        &mut plan,
        "/passes/0/bindings/2/kind",
        json!("storage-texture"),
    );
    put(&mut plan, "/passes/0/bindings/2/layout", layout);
    file.bytes = serde_json::to_vec(&plan).unwrap();
    let error = draw_files(&scene, &files).unwrap_err().to_string();
    assert_eq!(
        error,
        "the plan of material `lit` cannot be drawn: `albedo` (group 1, binding 1) is a storage \
         texture of Rgba8Unorm in the plan; \
         what there is to bind is a D2 texture of floats"
    );
}
