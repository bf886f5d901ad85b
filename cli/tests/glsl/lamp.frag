#version 300 es
precision mediump float;
#include "falloff.glsl"
uniform vec3 tint;
uniform sampler2D glow;
in vec2 at;
out vec4 color;
void main() {
    float light = falloff(length(at) * float(REACH));
#ifdef MASKED
    if (light < 0.1) discard;
#endif
    color = vec4(tint * light, 1.0) * texture(glow, at);
}
