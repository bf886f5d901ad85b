// three.js: 3D and array textures, integer and float textures, two targets with samples, stencil and clipping
// Drawn with WebGL.

import { loaded, loop } from './common.js';
import { THREE, base, camera, ground, knot, sun, webgl } from './three-common.js';

const renderer = webgl({ stencil: true });
renderer.localClippingEnabled = true;
const scene = base(0x304050);
const eye = camera();
sun(scene);
ground(scene);

const size = 24;
const density = new Uint8Array(size ** 3).map((_, i) => {
    const [x, y, z] = [i % size, Math.floor(i / size) % size, Math.floor(i / size ** 2)].map((n) => (n / size) * 2 - 1);
    return Math.max(0, 1 - Math.hypot(x, y, z)) * 255;
});
const volume = new THREE.Data3DTexture(density, size, size, size);
Object.assign(volume, { format: THREE.RedFormat, minFilter: THREE.LinearFilter, magFilter: THREE.LinearFilter, needsUpdate: true });
const layers = new THREE.DataArrayTexture(
    new Uint8Array(8 * 8 * 4 * 4).map((_, i) => ((i >> 2) * 37 * (1 + (i >> 8))) & 255),
    8,
    8,
    4,
);
layers.needsUpdate = true;
const table = new THREE.DataTexture(new Uint32Array(16).map((_, i) => i * 16), 16, 1, THREE.RedIntegerFormat, THREE.UnsignedIntType);
table.internalFormat = 'R32UI';
table.needsUpdate = true;
const heights = new THREE.DataTexture(new Float32Array(64).map((_, i) => Math.sin(i)), 8, 8, THREE.RedFormat, THREE.FloatType);
heights.needsUpdate = true;
const cloud = new THREE.Mesh(
    new THREE.BoxGeometry(1.6, 1.6, 1.6),
    new THREE.RawShaderMaterial({
        glslVersion: THREE.GLSL3,
        transparent: true,
        uniforms: {
            volume: { value: volume },
            layers: { value: layers },
            table: { value: table },
            heights: { value: heights },
            layer: { value: 0 },
        },
        vertexShader: `
uniform mat4 modelViewMatrix, projectionMatrix;
in vec3 position; in vec2 uv;
out vec3 at; out vec2 where;
void main() { at = position; where = uv; gl_Position = projectionMatrix * modelViewMatrix * vec4(position, 1.0); }`,
        fragmentShader: `
precision highp float; precision highp int; precision highp sampler3D; precision highp sampler2DArray; precision highp usampler2D;
uniform sampler3D volume; uniform sampler2DArray layers; uniform usampler2D table; uniform sampler2D heights; uniform int layer;
in vec3 at; in vec2 where; out vec4 color;
void main() {
    float density = 0.0;
    for (int i = 0; i < 8; i++) density += texture(volume, at / 1.6 + 0.5 - at * float(i) / 16.0).r;
    uint entry = texelFetch(table, ivec2(int(where.x * 16.0), 0), 0).r;
    float height = texelFetch(heights, ivec2(where * 8.0), 0).r;
    vec4 tint = texture(layers, vec3(where, float(layer)));
    color = vec4(tint.rgb + vec3(float(entry) / 512.0, height * 0.2, 0.0), clamp(density / 3.0, 0.2, 1.0));
}`,
    }),
);
cloud.position.set(-1.6, 1, 0);
scene.add(cloud);
const cut = knot(
    scene,
    new THREE.MeshStandardMaterial({
        color: 0xcc8844,
        side: THREE.DoubleSide,
        clippingPlanes: [new THREE.Plane(new THREE.Vector3(0, -1, 0), 1.6)],
    }),
);
cut.position.x = 1;
const mark = (material) => Object.assign(material, { stencilWrite: true, stencilRef: 1 });
const disk = new THREE.Mesh(
    new THREE.CircleGeometry(0.8, 32),
    mark(new THREE.MeshBasicMaterial({ color: 0x113311, stencilZPass: THREE.ReplaceStencilOp })),
);
disk.position.set(0.2, 1, 2.4);
disk.renderOrder = 1;
const inside = new THREE.Mesh(
    new THREE.PlaneGeometry(3, 0.5),
    mark(new THREE.MeshBasicMaterial({ color: 0xffdd33, stencilFunc: THREE.EqualStencilFunc, depthTest: false })),
);
inside.position.copy(disk.position);
inside.renderOrder = 2;
scene.add(disk, inside);

const targets = new THREE.WebGLRenderTarget(128, 96, { count: 2, samples: 4 });
const apart = base(0x000000);
apart.add(
    new THREE.Mesh(
        new THREE.TorusGeometry(1, 0.4, 12, 32),
        new THREE.RawShaderMaterial({
            glslVersion: THREE.GLSL3,
            vertexShader: `
uniform mat4 modelViewMatrix, projectionMatrix; uniform mat3 normalMatrix;
in vec3 position, normal; out vec3 facing;
void main() { facing = normalMatrix * normal; gl_Position = projectionMatrix * modelViewMatrix * vec4(position, 1.0); }`,
            fragmentShader: `
precision highp float; in vec3 facing;
layout(location = 0) out vec4 color; layout(location = 1) out vec4 normals;
void main() { color = vec4(0.9, 0.5, 0.2, 1.0); normals = vec4(normalize(facing) * 0.5 + 0.5, 1.0); }`,
        }),
    ),
);
targets.textures.forEach((map, i) => {
    const screen = new THREE.Mesh(new THREE.PlaneGeometry(1.2, 0.9), new THREE.MeshBasicMaterial({ map }));
    screen.position.set(i * 1.4 - 0.6, 2.6, 0);
    scene.add(screen);
});
loaded();
loop((step) => {
    cut.rotation.y = step * 0.05;
    cloud.material.uniforms.layer.value = Math.floor(step / 5) % 4;
    apart.children[0].rotation.x = step * 0.1;
    renderer.setRenderTarget(targets);
    renderer.render(apart, eye);
    renderer.setRenderTarget(null);
    renderer.render(scene, eye);
});
