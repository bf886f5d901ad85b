precision highp float;

in vec3 vWorld;
in vec3 vNormal;
in vec2 vUv;

uniform sampler2D leafMap;
uniform sampler2D veinMap;
uniform vec3 cameraPosition;
uniform float azimuth;
uniform float elevation;
uniform float cutoff;
uniform vec3 skyColor;
uniform vec3 groundColor;
layout(std140) uniform Air {
    vec3 fogColor;
    float fogDensity;
};

out vec4 color;

#include <hex>

void main() {
    vec2 dx = dFdx(vUv);
    vec2 dy = dFdy(vUv);
    vec4 leaf = textureGrad(leafMap, vUv, dx, dy);
    vec3 vein = hexTile(veinMap, vUv * 3.1, dx * 3.1, dy * 3.1, 5.0).rgb;
    if (leaf.a < cutoff) discard;

    vec3 sun = vec3(cos(elevation) * sin(azimuth), sin(elevation), cos(elevation) * cos(azimuth));
    vec3 normal = normalize(gl_FrontFacing ? vNormal : -vNormal);
    float front = max(dot(normal, sun), 0.0);
    float through = max(dot(-normal, sun), 0.0);
    vec3 albedo = leaf.rgb * (0.55 + 0.9 * vein);
    vec3 lit = albedo * (mix(groundColor, skyColor, 0.5 + 0.5 * normal.y) + 1.1 * front);
    lit += albedo * albedo * vec3(1.5, 1.7, 0.4) * through;

    float away = distance(cameraPosition, vWorld);
    float fog = 1.0 - exp(-fogDensity * fogDensity * away * away);
    color = vec4(mix(lit, fogColor, fog), 1.0);
}
