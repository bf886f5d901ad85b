//! Auxiliary passes of WebGL's materials: their plain uniforms stay plain.

use preshade_compiler::emit;
use preshade_compiler::front::{self, Source};
use preshade_compiler::recipe::Recipe;
use preshade_plan::pass::Facts;
use preshade_plan::plan::Plan;
use preshade_plan::plan_file::Target;
use preshade_plan::state::MaterialState;
use shader_text::options::{ClipSpace, Options};

const VERTEX: &str = "precision highp float;
attribute vec3 position; attribute vec2 uv; attribute vec4 joints;
uniform mat4 modelMatrix, viewMatrix, projectionMatrix;
uniform mat4 bones[4];
uniform vec2 shift;
uniform float time;
varying vec2 vUv; varying float vGlow;
void main() {
    vec4 p = bones[int(joints.x)] * vec4(position, 1.0);
    p.y += sin(time + p.x) * 0.1;
    vUv = uv; vGlow = time;
    gl_Position = projectionMatrix * (viewMatrix * (modelMatrix * p));
    gl_Position.xy += shift * gl_Position.w;
}";
const FRAGMENT: &str = "precision highp float;
varying vec2 vUv; varying float vGlow;
uniform sampler2D map; uniform float dissolve; uniform vec3 tint;
void main() {
    vec4 c = texture2D(map, vUv);
    if (c.a < dissolve) discard;
    gl_FragColor = vec4(c.rgb * tint + vGlow, 1.0);
}";

fn made(texts: [(&str, &str); 2], recipe: &str) -> Result<Plan, String> {
    let sources = texts.map(|(name, text)| Source::new(name, text));
    let options = Options {
        clip_space: texts[0].1.contains("450").then_some(ClipSpace::AsWritten),
        ..Options::default()
    };
    let parsed = front::parse(&sources, &options).map_err(|e| e.to_string())?;
    let [vertex, fragment] = [0, 1].map(|i| parsed.program.module().entry_points[i].name.clone());
    let state = MaterialState::default();
    let plan = Plan::original("a", parsed.program, &vertex, Some(&fragment), &state);
    let recipe = Recipe::parse([recipe]).map_err(|e| e.to_string())?;
    let made = recipe.apply(&plan, &Facts::default());
    made.map_err(|why| why.to_string())
}

fn webgl(recipe: &str) -> Result<Plan, String> {
    made([("a.vert", VERTEX), ("a.frag", FRAGMENT)], recipe)
}

/// Text of the files of the new pass, and the plan file.
fn written(plan: &Plan, target: Target) -> Result<[String; 2], String> {
    let files =
        emit::emit(plan, &[target], &emit::Options::default()).map_err(|e| e.to_string())?;
    let text = |is: &dyn Fn(&str) -> bool| -> String {
        let of = files.iter().filter(|f| is(&f.name));
        of.map(|f| String::from_utf8_lossy(&f.bytes).into_owned())
            .collect()
    };
    Ok([
        text(&|name| name.contains(".outputs.")),
        text(&|name| name.ends_with("plan.json")),
    ])
}

#[test]
fn plain_uniforms_of_the_previous_frame_are_plain() {
    for (target, matrix) in [(Target::GlslEs300, "mat4x4"), (Target::GlslEs100, "mat4")] {
        let recipe = "outputs:write=velocity,static=modelMatrix,jitter=shift";
        let plan = webgl(recipe).unwrap();
        let [text, json] = written(&plan, target).unwrap();
        for name in ["viewMatrix", "projectionMatrix"] {
            assert!(
                text.contains(&format!("uniform {matrix} {name}_previous;")),
                "{text}"
            );
            assert!(
                json.contains(&format!("\"previous_of\": \"{name}\"")),
                "{json}"
            );
        }
        assert!(text.contains("bones_previous[4];"), "{text}");
        assert!(text.contains("uniform float time_previous;"), "{text}");
        // Neither what stands still, nor what the position does not read, nor the jitter.
        for name in [
            "modelMatrix_previous",
            "dissolve_previous",
            "shift_previous",
            "std140",
        ] {
            assert!(!text.contains(name), "{name}: {text}");
        }
    }
    let [text, _] = written(&webgl("outputs:write=velocity").unwrap(), Target::GlslEs100).unwrap();
    assert!(
        text.contains("gl_FragColor = vec4((") && text.contains(", 0., 1.);"),
        "{text}"
    );
    // WebGL 1 has no integer targets.
    let refused = written(&webgl("outputs:write=id").unwrap(), Target::GlslEs100).unwrap_err();
    assert!(refused.contains("emit GLSL ES 3.00"), "{refused}");
}

#[test]
fn plain_uniforms_are_mapped_one_by_one() {
    let all = "outputs:write=shadow,map=lightProj=projectionMatrix+lightView=viewMatrix";
    let [text, _] = written(&webgl(all).unwrap(), Target::GlslEs100).unwrap();
    for name in [
        "lightProj;",
        "lightView;",
        "modelMatrix;",
        "float dissolve;",
    ] {
        assert!(text.contains(name), "{name}: {text}");
    }
    assert!(
        !text.contains("viewMatrix") && !text.contains("std140"),
        "{text}"
    );
    let refused = webgl("outputs:write=shadow,map=lightProj=projectionMatrix").unwrap_err();
    assert!(
        refused.contains("reads `viewMatrix`, which follows the viewer"),
        "{refused}"
    );
    let taken = "outputs:write=shadow,map=time=projectionMatrix+lightView=viewMatrix";
    let refused = webgl(taken).unwrap_err();
    assert!(refused.contains("`time` of the author's"), "{refused}");
}

const INSTANCED: &str = "#version 450
layout(location = 0) in vec3 position;
layout(location = 1) in mat4 instanceMatrix;
layout(set = 0, binding = 0) uniform Camera { mat4 view_proj; };
void main() { gl_Position = view_proj * instanceMatrix * vec4(position, 1.0); }";
const PLAIN: &str = "#version 450
layout(location = 0) out vec4 color;
void main() { color = vec4(1.0); }";

/// In the picture y points down, as in Vulkan's clip space.
#[test]
fn a_matrix_attribute_is_one_name_and_an_unnamed_block_has_its_own() {
    let texts = [("a.vert", INSTANCED), ("a.frag", PLAIN)];
    let plan = made(texts, "outputs:write=velocity,moving=instanceMatrix").unwrap();
    let [text, json] = written(&plan, Target::GlslVulkan).unwrap();
    for column in 0..4 {
        let name = format!("instanceMatrix_{column}_previous");
        assert!(text.contains(&name), "{text}");
        assert!(json.contains(&format!("\"{name}\"")), "{json}");
    }
    assert!(json.contains("\"of\": \"Camera\""), "{json}");
    assert!(text.contains("vec2(0.5, 0.5)"), "{text}");
    let plan = webgl("outputs:write=velocity").unwrap();
    let [text, _] = written(&plan, Target::GlslEs300).unwrap();
    assert!(text.contains("vec2(0.5, -0.5)"), "{text}");
}

/// The range of depths says nothing about y: OpenGL has both ranges (`glClipControl`).
#[test]
fn y_follows_from_the_language_and_not_from_the_range_of_depths() {
    let vertex = VERTEX.replace("precision highp float;", "#version 450 core");
    let vertex = vertex.replace("attribute", "in").replace("varying", "out");
    let fragment = "#version 450 core
        out vec4 color; void main() { color = vec4(1.0); }";
    let texts = [("a.vert", vertex.as_str()), ("a.frag", fragment)];
    for (recipe, y) in [
        ("outputs:write=velocity", "vec2(0.5, -0.5)"),
        ("outputs:write=velocity,y=down", "vec2(0.5, 0.5)"),
    ] {
        let plan = made(texts, recipe).unwrap();
        let [text, _] = written(&plan, Target::GlslEs300).unwrap();
        assert!(text.contains(y), "{recipe}: {text}");
    }
}

#[test]
fn a_point_light_beside_plain_uniforms_is_plain() {
    let plan = webgl("outputs:write=distance").unwrap();
    for target in [Target::GlslEs100, Target::GlslEs300] {
        let [text, json] = written(&plan, target).unwrap();
        assert!(text.contains("point_light;"), "{text}");
        assert!(!text.contains("point_light_"), "{text}");
        assert!(json.contains("\"name\": \"point_light\""), "{json}");
    }
}

#[test]
fn plain_uniforms_are_named_without_our_block_and_unnamed_blocks_by_their_names() {
    let refused = webgl("outputs:write=velocity,static=modelMatrx").unwrap_err();
    assert!(refused.contains("`modelMatrix`"), "{refused}");
    assert!(!refused.contains(".modelMatrix"), "{refused}");
    let fragment = FRAGMENT
        .replace("uniform vec3 tint;", "uniform vec3 tint, cameraPosition;")
        .replace(
            "c.a < dissolve",
            "c.a < dissolve || cameraPosition.y > 2.0 * dissolve",
        );
    let texts = [("a.vert", VERTEX), ("a.frag", fragment.as_str())];
    let plan = made(texts, "outputs:write=shadow,view=drop").unwrap();
    let own = plan.passes.iter().find(|pass| !pass.left_out.is_empty());
    let left_out = &own.unwrap().left_out;
    assert!(left_out[0].contains("dissolve"), "{left_out:?}");
    assert!(!left_out[0].contains("uniforms."), "{left_out:?}");
    let texts = [("a.vert", INSTANCED), ("a.frag", PLAIN)];
    made(
        texts,
        "outputs:write=velocity,jitter=Camera.view_proj[2].xy",
    )
    .unwrap();
    let refused = made(texts, "outputs:write=velocity,jitter=Camera.view_proj").unwrap_err();
    assert!(refused.contains("jitter-matrix"), "{refused}");
}
