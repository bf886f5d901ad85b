#version 450
layout(location = 0) in vec3 position;
layout(location = 1) in vec2 texcoord;
layout(location = 0) out vec2 uv;
layout(location = 1) flat out int kind;
layout(set = 0, binding = 0) uniform Camera { mat4 view_proj; vec4 tint; } camera;
void main() {
    uv = texcoord;
    kind = 3;
    gl_Position = camera.view_proj * vec4(position, 1.0);
}
