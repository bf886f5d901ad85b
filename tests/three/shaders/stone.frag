#define LAYERS 2
#define OCTAVES 3

uniform sampler2D stoneMap;
uniform sampler2D reliefMap;
uniform sampler2D mossMap;
uniform float stoneScale;
uniform float mossScale;
uniform float mossAmount;
uniform float azimuth;
uniform float elevation;
uniform float turbidity;
uniform vec3 skyColor;
uniform vec3 groundColor;
uniform vec3 fogColor;
uniform float fogDensity;

varying vec3 vWorld;
varying vec3 vNormal;

#include <hex>

// The same for the whole draw, and yet written where a shader's author needs it: in the fragment stage.
vec3 sunDirection() {
    return vec3(cos(elevation) * sin(azimuth), sin(elevation), cos(elevation) * cos(azimuth));
}

vec3 sunLight() {
    float air = 1.0 / (sin(elevation) + 0.15 * pow(elevation * 57.29578 + 3.885, -1.253));
    vec3 scattered = vec3(0.05, 0.11, 0.24) * turbidity;
    return 3.6 * exp(-scattered * air);
}

float lattice(vec3 cell) {
    uvec3 h = uvec3(ivec3(cell)) * uvec3(1597334673u, 3812015801u, 2798796415u);
    uint n = (h.x ^ h.y ^ h.z) * 2654435769u;
    n ^= n >> 15u;
    n *= 2246822519u;
    return float(n >> 8u) / 16777216.0;
}

float noise(vec3 p) {
    vec3 cell = floor(p);
    vec3 t = fract(p);
    t = t * t * t * (t * (t * 6.0 - 15.0) + 10.0);
    vec2 o = vec2(0.0, 1.0);
    vec4 low = vec4(lattice(cell), lattice(cell + o.yxx), lattice(cell + o.xyx), lattice(cell + o.yyx));
    vec4 high = vec4(lattice(cell + o.xxy), lattice(cell + o.yxy), lattice(cell + o.xyy), lattice(cell + o.yyy));
    vec4 z = mix(low, high, t.z);
    vec2 y = mix(z.xy, z.zw, t.y);
    return mix(y.x, y.y, t.x);
}

float weather(vec3 p) {
    float sum = 0.0;
    float amplitude = 0.5;
    for (int i = 0; i < OCTAVES; i++) {
        sum += amplitude * noise(p);
        p = p * 2.03 + 17.0;
        amplitude *= 0.5;
    }
    return sum;
}

// A texture on each of the three planes that the surface faces, by how much it does.
vec4 onPlanes(sampler2D map, vec3 p, vec3 dx, vec3 dy, vec3 facing, float sharpness) {
    vec4 sum = vec4(0.0);
    if (facing.x > 0.0) sum += hexTile(map, p.zy, dx.zy, dy.zy, sharpness) * facing.x;
    if (facing.y > 0.0) sum += hexTile(map, p.xz, dx.xz, dy.xz, sharpness) * facing.y;
    if (facing.z > 0.0) sum += hexTile(map, p.xy, dx.xy, dy.xy, sharpness) * facing.z;
    return sum;
}

void main() {
    vec3 dx = dFdx(vWorld);
    vec3 dy = dFdy(vWorld);
    vec3 normal = normalize(vNormal);
    vec3 facing = max(pow(abs(normal), vec3(6.0)) - 0.03, 0.0);
    facing /= facing.x + facing.y + facing.z;

    vec3 p = vWorld * stoneScale;
    vec4 stone = onPlanes(stoneMap, p, dx * stoneScale, dy * stoneScale, facing, 6.0);
    vec2 relief = onPlanes(reliefMap, p, dx * stoneScale, dy * stoneScale, facing, 6.0).xy * 2.0 - 1.0;
    float worn = weather(vWorld * 0.13);
    vec3 color = stone.rgb * (0.65 + 0.8 * worn);

#if LAYERS > 1
    vec3 moss = onPlanes(mossMap, vWorld * mossScale, dx * mossScale, dy * mossScale, facing, 4.0).rgb;
    float grown = smoothstep(0.42, 0.62, worn + 0.32 * normal.y - 0.5 * stone.g + mossAmount);
    color = mix(color, moss, grown);
    relief *= 1.0 - 0.7 * grown;
#endif

    vec3 side = normalize(cross(normal, abs(normal.y) < 0.9 ? vec3(0.0, 1.0, 0.0) : vec3(1.0, 0.0, 0.0)));
    vec3 bent = normalize(normal + 0.9 * (side * relief.x + cross(side, normal) * relief.y));

    vec3 sun = sunDirection();
    vec3 light = sunLight();
    vec3 view = normalize(cameraPosition - vWorld);
    vec3 half_ = normalize(sun + view);
    float diffuse = max(dot(bent, sun), 0.0);
    float gloss = pow(max(dot(bent, half_), 0.0), 24.0) * 0.18 * stone.g;
    vec3 ambient = mix(groundColor, skyColor, 0.5 + 0.5 * bent.y);
    vec3 lit = color * (ambient + light * diffuse * 0.32) + light * gloss * diffuse;

    float away = distance(cameraPosition, vWorld);
    float fog = 1.0 - exp(-fogDensity * fogDensity * away * away);
    gl_FragColor = vec4(mix(lit, fogColor, fog), 1.0);
}
