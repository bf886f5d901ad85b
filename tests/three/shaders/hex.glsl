// Hex tiling: a texture without visible repetition, blended of three copies that are shifted at random, one for each hexagon that a point is near (Heitz and Neyret 2018).

vec2 cellShift(ivec2 cell) {
    uvec2 h = uvec2(cell) * uvec2(1664525u, 22695477u) + uvec2(1013904223u, 12345u);
    h ^= h.yx >> 15u;
    h *= uvec2(2246822519u, 3266489917u);
    h ^= h.yx >> 13u;
    return vec2(h >> 8u) / 16777216.0;
}

// Of the three hexagons around `uv`: which they are, and how near each is.
void hexCells(vec2 uv, out ivec2 a, out ivec2 b, out ivec2 c, out vec3 near) {
    vec2 skewed = mat2(1.0, 0.0, -0.57735027, 1.15470054) * uv * 3.4641016;
    ivec2 cell = ivec2(floor(skewed));
    vec2 part = skewed - vec2(cell);
    float rest = 1.0 - part.x - part.y;
    ivec2 corner = rest > 0.0 ? ivec2(0) : ivec2(1);
    a = cell + corner;
    b = cell + ivec2(corner.x, 1 - corner.y);
    c = cell + ivec2(1 - corner.x, corner.y);
    near = rest > 0.0 ? vec3(rest, part.y, part.x) : vec3(-rest, 1.0 - part.y, 1.0 - part.x);
}

// `dx` and `dy` are the gradients of `uv`.
vec4 hexTile(sampler2D map, vec2 uv, vec2 dx, vec2 dy, float sharpness) {
    ivec2 a;
    ivec2 b;
    ivec2 c;
    vec3 near;
    hexCells(uv, a, b, c, near);
    vec4 first = textureGrad(map, uv + cellShift(a), dx, dy);
    vec4 second = textureGrad(map, uv + cellShift(b), dx, dy);
    vec4 third = textureGrad(map, uv + cellShift(c), dx, dy);
    // What is brighter stands out, as a stone does of its joint.
    vec3 bright = vec3(first.g, second.g, third.g) + 0.2;
    vec3 weight = pow(near, vec3(sharpness)) * bright;
    weight /= weight.x + weight.y + weight.z;
    return first * weight.x + second * weight.y + third * weight.z;
}
