#!/usr/bin/env python3
"""Expands the shaders of public engines, so that `preshade agree` can read them.

    scripts/engine-passes.py ENGINE CHECKOUT OUT

ENGINE is rend3, fyrox, bloom or luanti; CHECKOUT is a folder with the engine's files. An engine puts
a shader together at run time: of a template, of a RON file, of Rust strings, of a preamble. This
script does the same with the engine's own text, and writes whole shaders to OUT. It changes no line
of a shader. docs/agree.md says what was found in them.
"""
import pathlib
import re
import sys


def rend3(root, out):
    """Handlebars of rend3: `include`, `if` and `vertex_fetch`, for its CPU-driven profile."""
    folders = {"rend3-routine": "rend3-routine/shaders/src", "rend3": "rend3/shaders"}
    # rend3's `VertexAttributeId` and `ShaderVertexBufferConfig::from_built_in`.
    attributes = ["position", "normal", "tangent", "texture_coords_0", "texture_coords_1", "color_0",
                  "joint_indices", "joint_weights"]
    types = {
        "position": ("vec3<f32>", "extract_attribute_vec3_f32", None),
        "normal": ("vec3<f32>", "extract_attribute_vec3_f32", None),
        "tangent": ("vec3<f32>", "extract_attribute_vec3_f32", None),
        "texture_coords_0": ("vec2<f32>", "extract_attribute_vec2_f32", None),
        "texture_coords_1": ("vec2<f32>", "extract_attribute_vec2_f32", None),
        "color_0": ("vec4<f32>", "extract_attribute_vec4_u8_unorm", "vec4<f32>(1.0)"),
    }

    def fetch(words):
        objects, batch, wanted = words[0], words[1], words[2:]
        struct = ["struct VertexInput {"]
        body = ["fn get_vertices(indices: Indices) -> VertexInput {", "    var verts: VertexInput;"]
        for name in wanted:
            ty, extract, default = types[name]
            struct.append(f"    {name}: {ty},")
            offset = f"{objects}[indices.object].vertex_attribute_start_offsets[{attributes.index(name)}]"
            body.append(f"    let {name}_offset = {offset};")
            read = f"verts.{name} = {extract}({name}_offset, indices.vertex);"
            if name == "position":
                body.append(f"    {read}")
                continue
            other = f" else {{ verts.{name} = {default}; }}" if default else ""
            body.append(f"    if ({name}_offset != 0xFFFFFFFFu) {{ {read} }}{other}")
        body += ["    return verts;", "}"]
        unpack = (
            "fn unpack_vertex_index(vertex_index: u32) -> Indices {\n"
            "    let batch_indices = unpack_batch_index(vertex_index);\n"
            f"    let object_id = {batch}.object_culling_information[batch_indices.local_object].object_id;\n"
            "    return Indices(object_id, batch_indices.vertex);\n}")
        parts = ['{{include "rend3/vertex_attributes.wgsl"}}', unpack, "\n".join(struct + ["}"]), "\n".join(body)]
        return "\n".join(parts)

    def render(text, data, seen):
        text = re.sub(r"\{\{\s*vertex_fetch\s+(.*?)\}\}", lambda m: fetch(m[1].split()), text, flags=re.S)

        def condition(words):
            equal = re.fullmatch(r'\(eq (\w+) "(\w+)"\)', words)
            return data.get(equal[1]) == equal[2] if equal else bool(data.get(words))

        # Innermost first.
        inner = re.compile(r"\{\{#if ([^}]*)\}\}((?:(?!\{\{#if|\{\{/if).)*)\{\{/if\}\}", re.S)
        while True:
            found = inner.search(text)
            if not found:
                break
            yes, _, no = found[2].partition("{{else}}")
            text = text[: found.start()] + (yes if condition(found[1].strip()) else no) + text[found.end():]

        def include(match):
            name = match[1]
            if name in seen:
                return ""
            seen.add(name)
            crate, _, path = name.partition("/")
            return render((root / folders[crate] / path).read_text(), data, seen)

        text = re.sub(r'\{\{include "([^"]+)"\}\}', include, text)
        return re.sub(r"\{\{(\w+)\}\}", lambda m: str(data[m[1]]), text)

    data = {"profile": "CpuDriven", "discard": True, "vertex_array_counts": len(attributes)}
    for name in ["depth", "opaque"]:
        text = (root / folders["rend3-routine"] / f"{name}.wgsl").read_text()
        (out / f"{name}.wgsl").write_text(render(text, data, set()))


FYROX = {
    "fyrox_instanceData": [("worldMatrix", "mat4x4f"), ("worldViewProjection", "mat4x4f"), ("blendShapesCount", "i32"),
                           ("useSkeletalAnimation", "u32"), ("blendShapesWeights", "array<vec4f, 32>")],
    "fyrox_boneMatrices": [("matrices", "array<mat4x4f, 255>")],
    "fyrox_graphicsSettings": [("usePOM", "u32")],
    "fyrox_cameraData": [("viewProjectionMatrix", "mat4x4f"), ("position", "vec3f"), ("upVector", "vec3f"),
                         ("sideVector", "vec3f"), ("zNear", "f32"), ("zFar", "f32"), ("zRange", "f32")],
    "fyrox_lightData": [("lightPosition", "vec3f"), ("ambientLightColor", "vec4f")],
}


def fyrox(root, out):
    """RON of Fyrox: the resources as declarations, and each pass's two stages."""
    kinds = {"Vector2": "vec2f", "Vector3": "vec3f", "Vector4": "vec4f", "Float": "f32", "UInt": "u32", "Int": "i32",
             "Bool": "u32", "Color": "vec4f"}
    shared = (root / "fyrox-graphics-wgpu/src/shaders/shared.wgsl").read_text()
    for path in sorted((root / "fyrox-material/src/shader/standard/wgpu").glob("*.shader")):
        text = path.read_text()
        head = text[: text.index("passes:")]
        declarations = []
        for match in re.finditer(r'name:\s*"(\w+)",\s*kind:\s*(Texture|PropertyGroup)\((.*?)binding:\s*(\d+)', head, re.S):
            name, kind, inner, binding = match[1], match[2], match[3], int(match[4])
            if kind == "Texture":
                texture = {"Sampler2D": "texture_2d<f32>", "Sampler3D": "texture_3d<f32>",
                           "SamplerCube": "texture_cube<f32>"}[re.search(r"Sampler\w+", inner)[0]]
                declarations.append(f"@group(0) @binding({binding}) var {name}_tex: {texture};")
                declarations.append(f"@group(0) @binding({binding + 100}) var {name}_samp: sampler;")
                continue
            fields = FYROX.get(name) or [(f[1], kinds[f[2]]) for f in
                                         re.finditer(r'name:\s*"(\w+)",\s*kind:\s*(\w+)\(', inner)]
            if fields:
                members = "".join(f"    {field}: {ty},\n" for field, ty in fields)
                declarations.append(f"struct T{name} {{\n{members}}}")
                declarations.append(f"@group(0) @binding({binding + 200}) var<uniform> {name}: T{name};")
        declared = "\n".join(declarations) + "\n"
        passes = text[text.index("passes:"):]
        stages = r'name:\s*"(\w+)".*?vertex_shader:\s*r#"(.*?)"#.*?fragment_shader:\s*r#"(.*?)"#'
        for found in re.finditer(stages, passes, re.S):
            for stage, code in [("vert", found[2]), ("frag", found[3])]:
                name = f"{path.stem}.{found[1]}.{stage}.wgsl"
                (out / name).write_text(declared + shared + code)


def bloom(root, out):
    """Rust strings of Bloom: the scene shader, which has a pre-pass too, and the cut-out shadow."""
    def string(path, name):
        file = root / path
        body = file.read_text().split(f"const {name}: &str = concat!(", 1)[1].split('"#);', 1)[0]
        parts = []
        for part in re.finditer(r'include_str!\("([^"]+)"\)|r#"(.*)', body, re.S):
            parts.append((file.parent / part[1]).read_text() if part[1] else part[2])
        return "\n".join(parts)

    scene = string("native/shared/src/renderer/shaders/core.rs", "SCENE_SHADER")
    (out / "scene.wgsl").write_text(scene)
    (out / "shadow-cutout.wgsl").write_text(string("native/shared/src/shadows.rs", "SHADOW_SHADER_CUTOUT"))


def luanti(root, out):
    """Luanti's preamble, with the constants of one material: leaves that wave."""
    constants = """
#define MATERIAL_TYPE TILE_MATERIAL_WAVING_LEAVES
#define TILE_MATERIAL_BASIC 0
#define TILE_MATERIAL_ALPHA 1
#define TILE_MATERIAL_WAVING_LEAVES 5
#define TILE_MATERIAL_WAVING_PLANTS 6
#define MATERIAL_WAVING_LIQUID 0
#define MATERIAL_WATER_REFLECTIONS 0
#define ENABLE_WAVING_LEAVES 1
#define ENABLE_WAVING_PLANTS 1
#define ENABLE_WAVING_WATER 0
#define USE_DISCARD_REF 1
#define SHADOW_FILTER 0
#define SOFTSHADOWRADIUS 1.0
#define ENABLE_TONE_MAPPING 0
"""
    plain = "#version 330\n#define lowp\n#define mediump\n#define highp\n#define CENTROID_ centroid\n"
    vertex = plain + """#define VARYING_ out
layout(location = 0) in vec4 inVertexPosition;
layout(location = 1) in vec3 inVertexNormal;
layout(location = 2) in vec4 inVertexColor_raw;
layout(location = 4) in vec2 inTexCoord0;
#define inVertexColor (inVertexColor_raw.bgra)
uniform mat4 mWorldView;
uniform mat4 mWorldViewProj;
uniform mat4 mTexture;
"""
    fragment = plain + "#define VARYING_ in\n#define texture2D texture\nout vec4 outFragColor;\n#define gl_FragColor outFragColor\n"
    for name, folder in [("nodes", "nodes_shader"), ("shadow", "shadow/pass1")]:
        for stage, head, ending in [("vertex", vertex, "vert"), ("fragment", fragment, "frag")]:
            text = (root / f"client/shaders/{folder}/opengl_{stage}.glsl").read_text()
            (out / f"{name}.{ending}").write_text(head + constants + text)


if __name__ == "__main__":
    engines = {"rend3": rend3, "fyrox": fyrox, "bloom": bloom, "luanti": luanti}
    if len(sys.argv) != 4 or sys.argv[1] not in engines:
        sys.exit(__doc__)
    target = pathlib.Path(sys.argv[3])
    target.mkdir(parents=True, exist_ok=True)
    engines[sys.argv[1]](pathlib.Path(sys.argv[2]), target)
