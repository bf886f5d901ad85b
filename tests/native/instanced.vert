#version 450

layout(constant_id = 3) const float SPREAD = 1.0;
layout(constant_id = 4) const uint AXIS = 0u;

struct Body {
    mat4 model;
    vec4 hue;
};

layout(set = 0, binding = 5, std430) readonly buffer Crowd {
    vec4 shift;
    Body bodies[];
} crowd;
layout(set = 0, binding = 2) uniform Frame {
    mat4 projection;
    mat4 light;
} frame;

layout(location = 1) in vec3 position;

layout(location = 0) out vec4 v_hue;
layout(location = 1) out vec3 v_light;
layout(location = 2) out vec3 v_position;

void main() {
    Body body = crowd.bodies[gl_InstanceIndex];
    vec4 world = body.model * vec4(position, 1.0);
    if (AXIS == 1u) {
        world.y *= SPREAD;
    }
    world += crowd.shift;
    vec4 light = frame.light * world;
    v_hue = body.hue;
    v_light = light.xyz / light.w;
    v_position = position;
    gl_Position = frame.projection * world;
}
