precision highp float;

in vec3 position;
in vec3 normal;
in vec2 uv;

uniform mat4 modelMatrix;
uniform mat4 viewMatrix;
uniform mat4 projectionMatrix;
layout(std140) uniform Weather {
    float time;
    float wind;
};

out vec3 vWorld;
out vec3 vNormal;
out vec2 vUv;

void main() {
    vec4 world = modelMatrix * vec4(position, 1.0);
    float sway = uv.y * uv.y * wind;
    world.xz += sway * vec2(sin(time * 1.7 + world.x * 0.9), cos(time * 1.3 + world.z * 0.7));
    vWorld = world.xyz;
    vNormal = mat3(modelMatrix) * normal;
    vUv = uv;
    gl_Position = projectionMatrix * viewMatrix * world;
}
