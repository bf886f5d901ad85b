#version 450

layout(set = 0, binding = 3) uniform sampler2D base;
layout(set = 2, binding = 3) uniform sampler2D layers[3];
layout(set = 2, binding = 0) uniform Paint {
    vec4 low;
    layout(offset = 48, row_major) mat3 hues;
    layout(offset = 112) float strength;
} paint;
layout(push_constant) uniform Look {
    layout(offset = 48) vec4 tint;
    float cutoff;
    int layer;
} look;

layout(location = 0) in vec2 v_uv;
layout(location = 2) in float v_height;

layout(location = 0) out vec4 color;

void main() {
    vec4 texel = texture(base, v_uv);
    if (texel.a < look.cutoff) {
        discard;
    }
    vec3 layer = texture(layers[2], v_uv * 3.0).rgb;
    if (look.layer < 2) {
        layer *= look.layer == 1 ? texture(layers[1], v_uv).rgb : texture(layers[0], v_uv.yx).rgb;
    }
    vec3 painted = paint.hues * mix(texel.rgb, layer, paint.strength);
    color = vec4(mix(paint.low.rgb, painted, 0.5 + 0.5 * v_height), 1.0) * look.tint;
}
