#version 450

layout(set = 0, binding = 1, std140) uniform Camera {
    layout(offset = 32) mat4 projection;
    layout(offset = 128, row_major) mat4 view;
    layout(row_major) mat3x2 atlas;
    layout(row_major) mat2x4 tilts[2];
} camera;
layout(push_constant) uniform Place {
    layout(offset = 16) vec4 shift;
    float lean;
    int tilt;
} place;

layout(location = 0) in vec3 position;
layout(location = 3) in vec2 uv;

layout(location = 0) out vec2 v_uv;
layout(location = 2) out float v_height;

void main() {
    vec3 at = position * place.shift.w;
    at.x += at.y * place.lean;
    v_uv = camera.atlas * vec3(uv, 1.0);
    v_height = position.y;
    at.z += dot(camera.tilts[place.tilt][1], vec4(at, 1.0)) + camera.tilts[1][place.tilt].y;
    at += camera.view[place.tilt].zyx * 0.1;
    gl_Position = camera.projection * (camera.view * vec4(at + place.shift.xyz, 1.0));
}
