// The built-in metallic-roughness material of glTF 2.0. docs/reference/gltf.md describes it.
// The lines between `//#if WORD` and `//#end` are for the materials that have the word.

struct Camera {
    view_proj: mat4x4f,
    position: vec3f,
}

struct Object {
    model: mat4x4f,
    normal_matrix: mat4x4f,
}

struct Material {
    base_color_factor: vec4f,
    emissive_factor: vec3f,
    metallic_factor: f32,
    roughness_factor: f32,
    normal_scale: f32,
    occlusion_strength: f32,
    alpha_cutoff: f32,
//#if TRANSFORM
    base_color_transform: mat3x3f,
    metallic_roughness_transform: mat3x3f,
    normal_transform: mat3x3f,
    occlusion_transform: mat3x3f,
    emissive_transform: mat3x3f,
//#end
}

@group(0) @binding(0) var<uniform> camera: Camera;
@group(1) @binding(0) var<uniform> object: Object;
//#if SKIN
@group(1) @binding(1) var<storage, read> joint_matrices: array<mat4x4f>;
//#end
@group(2) @binding(0) var<uniform> material: Material;
//#if BASE_COLOR_TEXTURE
@group(2) @binding(1) var base_color_texture: texture_2d<f32>;
@group(2) @binding(2) var base_color_sampler: sampler;
//#end
//#if METALLIC_ROUGHNESS_TEXTURE
@group(2) @binding(3) var metallic_roughness_texture: texture_2d<f32>;
@group(2) @binding(4) var metallic_roughness_sampler: sampler;
//#end
//#if NORMAL_TEXTURE
@group(2) @binding(5) var normal_texture: texture_2d<f32>;
@group(2) @binding(6) var normal_sampler: sampler;
//#end
//#if OCCLUSION_TEXTURE
@group(2) @binding(7) var occlusion_texture: texture_2d<f32>;
@group(2) @binding(8) var occlusion_sampler: sampler;
//#end
//#if EMISSIVE_TEXTURE
@group(2) @binding(9) var emissive_texture: texture_2d<f32>;
@group(2) @binding(10) var emissive_sampler: sampler;
//#end
//#if LIT

struct Light {
    // Towards the light if `kind` is 0, else its place.
    position: vec3f,
    // 0 directional, 1 point, 2 spot.
    kind: f32,
    // Lux, or candela.
    color: vec3f,
    // Distance at which it ends; 0 is never.
    range: f32,
    // Where a spot light shines.
    direction: vec3f,
    // Cosines of a spot light's cones.
    inner: f32,
    outer: f32,
}

@group(0) @binding(1) var<uniform> lights: array<Light, LIGHTS>;
//#end

struct Vertex {
    @location(0) position: vec3f,
//#if LIT
    @location(1) normal: vec3f,
//#end
//#if NORMAL_TEXTURE
    @location(2) tangent: vec4f,
//#end
//#if UV
    @location(3) uv: vec2f,
//#end
//#if UV1
    @location(4) uv1: vec2f,
//#end
//#if COLOR
    @location(5) color: vec4f,
//#end
//#if SKIN
    @location(6) joints: vec4u,
    @location(7) weights: vec4f,
//#end
//#if INSTANCES
    @location(8) instance_matrix_0: vec4f,
    @location(9) instance_matrix_1: vec4f,
    @location(10) instance_matrix_2: vec4f,
    @location(11) instance_matrix_3: vec4f,
//#end
}

struct Varyings {
    @builtin(position) @invariant clip: vec4f,
    @location(0) world: vec3f,
//#if LIT
    @location(1) normal: vec3f,
//#end
//#if NORMAL_TEXTURE
    @location(2) tangent: vec4f,
//#end
//#if UV
    @location(3) uv: vec2f,
//#end
//#if UV1
    @location(4) uv1: vec2f,
//#end
//#if COLOR
    @location(5) color: vec4f,
//#end
}

@vertex
fn vertex_main(in: Vertex) -> Varyings {
    var out: Varyings;
    var place = vec4f(in.position, 1.0);
//#if LIT
    var normal = in.normal;
//#end
//#if NORMAL_TEXTURE
    var tangent = in.tangent.xyz;
//#end
//#if SKIN
    let skin = in.weights.x * joint_matrices[in.joints.x] + in.weights.y * joint_matrices[in.joints.y]
        + in.weights.z * joint_matrices[in.joints.z] + in.weights.w * joint_matrices[in.joints.w];
    place = skin * place;
//#if LIT
    normal = (skin * vec4f(normal, 0.0)).xyz;
//#end
//#if NORMAL_TEXTURE
    tangent = (skin * vec4f(tangent, 0.0)).xyz;
//#end
//#end
//#if INSTANCES
    let instance = mat4x4f(in.instance_matrix_0, in.instance_matrix_1, in.instance_matrix_2,
        in.instance_matrix_3);
    place = instance * place;
//#if LIT
    // The inverse transpose of a rotation with scales.
    let scales = vec3f(dot(instance[0].xyz, instance[0].xyz), dot(instance[1].xyz, instance[1].xyz),
        dot(instance[2].xyz, instance[2].xyz));
    normal = (instance * vec4f(normal / scales, 0.0)).xyz;
//#end
//#if NORMAL_TEXTURE
    tangent = (instance * vec4f(tangent, 0.0)).xyz;
//#end
//#end
    let world = object.model * place;
    out.world = world.xyz;
    out.clip = camera.view_proj * world;
//#if LIT
    out.normal = (object.normal_matrix * vec4f(normal, 0.0)).xyz;
//#end
//#if NORMAL_TEXTURE
    out.tangent = vec4f((object.model * vec4f(tangent, 0.0)).xyz, in.tangent.w);
//#end
//#if UV
    out.uv = in.uv;
//#end
//#if UV1
    out.uv1 = in.uv1;
//#end
//#if COLOR
    out.color = in.color;
//#end
    return out;
}

//#if LIT

const PI = 3.14159265;

// The light of the surroundings: of the sky from above, of the ground from below.
const SKY = vec3f(0.5, 0.55, 0.6);
const GROUND = vec3f(0.2, 0.19, 0.18);

// The mean of the surroundings over a lobe around a direction, `width` times as steep as they are.
fn surroundings(direction: vec3f, width: f32) -> vec3f {
    return mix(GROUND, SKY, 0.5 + 0.5 * width * direction.y);
}

struct Surface {
    normal: vec3f,
    view: vec3f,
    base: vec3f,
    metallic: f32,
    roughness: f32,
    // What a specular layer reflects of light from all around: the part of its reflectance along the
    // normal, and the rest.
    layer: vec2f,
}

// Reflectance along the normal of what is no metal.
const DIELECTRIC = vec3f(0.04);

fn fresnel(along: vec3f, cosine: f32) -> vec3f {
    return along + (1.0 - along) * pow(1.0 - cosine, 5.0);
}

// Karis' fit (2014) of GGX over all directions.
fn layer(roughness: f32, view: f32) -> vec2f {
    let r = roughness * vec4f(-1.0, -0.0275, -0.572, 0.022) + vec4f(1.0, 0.0425, 1.04, -0.04);
    let a = min(r.x * r.x, exp2(-9.28 * view)) * r.x + r.y;
    return vec2f(-1.04, 1.04) * a + r.zw;
}

// Light that a surface reflects to the viewer, for each unit of irradiance: Lambert below a
// specular layer of GGX with its height-correlated visibility (glTF 2.0, appendix B).
fn reflected(surface: Surface, to_light: vec3f) -> vec3f {
    let halfway = normalize(to_light + surface.view);
    let light = saturate(dot(surface.normal, to_light));
    let view = saturate(dot(surface.normal, surface.view));
    let peak = saturate(dot(surface.normal, halfway));
    let across = saturate(dot(surface.view, halfway));
    let alpha = surface.roughness * surface.roughness;
    let alpha2 = alpha * alpha;
    let spread = peak * peak * (alpha2 - 1.0) + 1.0;
    let distribution = alpha2 / (PI * spread * spread);
    let shadowed = light * sqrt(alpha2 + (1.0 - alpha2) * view * view)
        + view * sqrt(alpha2 + (1.0 - alpha2) * light * light);
    let along = mix(DIELECTRIC, surface.base, surface.metallic);
    // What bounces between the facets is not lost.
    let several = 1.0 + along * (1.0 / (surface.layer.x + surface.layer.y) - 1.0);
    let mirror = fresnel(along, across) * several * (distribution * 0.5 / max(shadowed, 1e-6));
    let diffuse = surface.base * (1.0 - surface.metallic) * (1.0 - fresnel(DIELECTRIC, across));
    return (diffuse / PI + mirror) * light;
}

// Direction to a light, and its irradiance on a surface across that direction.
fn arriving(light: Light, world: vec3f) -> array<vec3f, 2> {
    if light.kind == 0.0 {
        return array(light.position, light.color);
    }
    let way = light.position - world;
    let distance = length(way);
    let to_light = way / distance;
    var strength = 1.0 / max(distance * distance, 0.01);
    if light.range > 0.0 {
        let end = saturate(1.0 - pow(distance / light.range, 4.0));
        strength *= end * end;
    }
    if light.kind == 2.0 {
        strength *= smoothstep(light.outer, light.inner, dot(-to_light, light.direction));
    }
    return array(to_light, light.color * strength);
}

// What a layer reflects of light from all around: at once, and after several bounces (Fdez-Aguera
// 2019).
fn scattered(along: vec3f, layer: vec2f) -> array<vec3f, 2> {
    let once = along * layer.x + layer.y;
    let rest = 1.0 - (layer.x + layer.y);
    let mean = along + (1.0 - along) / 21.0;
    return array(once, once * mean / (1.0 - rest * mean) * rest);
}

// Light of the surroundings that a surface reflects.
fn ambient(surface: Surface, occlusion: f32) -> vec3f {
    let below = scattered(DIELECTRIC, surface.layer);
    let metal = scattered(surface.base, surface.layer);
    let once = mix(below[0], metal[0], surface.metallic);
    let several = mix(below[1], metal[1], surface.metallic);
    let diffuse = surface.base * (1.0 - surface.metallic) * (1.0 - below[0] - below[1]);
    let lobe = pow(surface.roughness, 4.0);
    let mirrored = normalize(mix(reflect(-surface.view, surface.normal), surface.normal, lobe));
    let from_all = surroundings(surface.normal, 2.0 / 3.0);
    let specular = surroundings(mirrored, 1.0 - lobe / 3.0) * once + from_all * several;
    return (diffuse * from_all + specular) * occlusion;
}
//#end
//#if TRANSFORM

fn at(uv: vec2f, transform: mat3x3f) -> vec2f {
    return (transform * vec3f(uv, 1.0)).xy;
}
//#end

@fragment
fn fragment_main(
    in: Varyings,
//#if TWO_SIDED
    @builtin(front_facing) is_front: bool,
//#end
) -> @location(0) vec4f {
    var base = material.base_color_factor;
//#if COLOR
    base *= in.color;
//#end
//#if BASE_COLOR_TEXTURE
    base *= textureSample(base_color_texture, base_color_sampler, BASE_COLOR_AT);
//#end
//#if LIT
    var normal = normalize(in.normal);
    // A surface that bends within a pixel is rougher than its texels.
    let bends = max(abs(dpdx(normal)), abs(dpdy(normal)));
    let bent = max(max(bends.x, bends.y), bends.z);
//#if TWO_SIDED
    let side = select(-1.0, 1.0, is_front);
    normal *= side;
//#end
//#if NORMAL_TEXTURE
    let relief = textureSample(normal_texture, normal_sampler, NORMAL_AT).xyz * 2.0 - 1.0;
    var along_u = normalize(in.tangent.xyz);
    var along_v = cross(normalize(in.normal), along_u) * in.tangent.w;
//#if TWO_SIDED
    along_u *= side;
    along_v *= side;
//#end
    let slopes = relief.xy * material.normal_scale;
    normal = normalize(slopes.x * along_u + slopes.y * along_v + relief.z * normal);
//#end
    var metallic = material.metallic_factor;
    var roughness = material.roughness_factor;
//#if METALLIC_ROUGHNESS_TEXTURE
    let shine = textureSample(metallic_roughness_texture, metallic_roughness_sampler, METALLIC_ROUGHNESS_AT);
    roughness *= shine.g;
    metallic *= shine.b;
//#end
    var occlusion = 1.0;
//#if OCCLUSION_TEXTURE
    let open = textureSample(occlusion_texture, occlusion_sampler, OCCLUSION_AT).r;
    occlusion = 1.0 + material.occlusion_strength * (open - 1.0);
//#end
    var glow = material.emissive_factor;
//#if EMISSIVE_TEXTURE
    glow *= textureSample(emissive_texture, emissive_sampler, EMISSIVE_AT).rgb;
//#end
//#end
//#if MASK
    if base.a < material.alpha_cutoff {
        discard;
    }
//#end
    var color = base.rgb;
//#if LIT
    let view = normalize(camera.position - in.world);
    roughness = min(max(roughness, 0.045) + bent, 1.0);
    let spread = layer(roughness, saturate(dot(normal, view)));
    let surface = Surface(normal, view, base.rgb, metallic, roughness, spread);
    color = glow + ambient(surface, occlusion);
    for (var i = 0; i < LIGHTS; i++) {
        let light = arriving(lights[i], in.world);
        color += light[1] * reflected(surface, light[0]);
    }
//#end
//#if ENCODE
    // The target stores sRGB, and does not encode it.
    let encoded = pow(max(color, vec3f(0.0031308)), vec3f(1.0 / 2.4)) * 1.055 - 0.055;
    color = select(encoded, color * 12.92, color <= vec3f(0.0031308));
//#end
//#if BLEND
    return vec4f(color, base.a);
//#else
    return vec4f(color, 1.0);
//#end
}
