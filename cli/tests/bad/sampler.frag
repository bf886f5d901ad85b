#version 450
layout(binding = 0) uniform sampler2D albedo;
layout(location = 0) out vec4 color;
void main() { color = texture(albedo, vec2(0.5)); }
