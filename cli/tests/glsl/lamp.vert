#version 300 es
in vec3 position;
uniform mat4 transform;
out vec2 at;
void main() {
    at = position.xy;
    gl_Position = transform * vec4(position, 1.0);
}
