#version 450

layout(constant_id = 7) const bool CUT = false;
layout(constant_id = 9) const uint STEPS = 1u;
layout(constant_id = 3) const int SHADE = 0;
const uint LAST = STEPS - 1u;
layout(constant_id = 5) const int BANDS = 2;

layout(set = 1, binding = 3) uniform sampler2DShadow shadows;
layout(set = 1, binding = 0, std430) readonly buffer Ramp {
    float bias;
    vec3 steps[];
} ramp;

layout(set = 1, binding = 1) uniform Banding {
    vec4 last;
    vec4 bands[BANDS];
} banding;

layout(location = 0) in vec4 v_hue;
layout(location = 1) in vec3 v_light;
layout(location = 2) in vec3 v_position;

layout(location = 0) out vec4 color;

void main() {
    vec3 near = abs(v_position);
    if (CUT && length(near - 0.5) > 0.75) {
        discard;
    }
    vec3 sum = vec3(0.0);
    for (uint i = 0u; i <= LAST; i++) {
        sum += ramp.steps[i] / float(STEPS);
    }
    float lit = 0.4 + 0.6 * texture(shadows, v_light - vec3(0.0, 0.0, ramp.bias));
    vec3 shaded = SHADE == 2 ? v_hue.rgb * (0.4 + near) : v_hue.rgb;
    vec3 banded = banding.last.rgb;
    for (int i = 0; i < BANDS; i++) {
        banded += banding.bands[i].rgb * step(banding.bands[i].w, near.y);
    }
    color = vec4(shaded * sum * lit * banded, v_hue.a);
}
