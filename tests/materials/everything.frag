#version 450
layout(location = 0) in vec2 uv;
layout(location = 1) flat in int kind;
layout(location = 0) out vec4 color;
layout(location = 1) out vec4 normal;
layout(set = 1, binding = 0) uniform texture2D albedo;
layout(set = 1, binding = 1) uniform sampler filtering;
float shared_state = 0.5;
float own_state = 2.0;
float helper(float x) { shared_state += x; return shared_state; }
void main() {
    normal = vec4(0.0);
    vec4 texel = texture(sampler2D(albedo, filtering), uv);
    if (texel.a < 0.5) discard;
    if (kind == 1) {
        color = vec4(1.0);
        return;
    }
    own_state *= helper(uv.x);
    for (int i = 0; i < 4; i++) {
        if (texel.r > float(i)) { color = vec4(own_state); return; }
    }
    color = texel * gl_FragCoord.z;
}
