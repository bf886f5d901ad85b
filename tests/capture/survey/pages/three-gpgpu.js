// three.js: `GPUComputationRenderer`, particles whose positions a shader computes in float textures
// Drawn with WebGL.

import { GPUComputationRenderer } from 'three/addons/misc/GPUComputationRenderer.js';
import { loaded, loop, random } from './common.js';
import { THREE, base, camera, webgl } from './three-common.js';

const SIZE = 32;
const renderer = webgl();
const scene = base(0x101018);
const eye = camera([0, 0, 5], [0, 0, 0]);
const next = random(3);
const compute = new GPUComputationRenderer(SIZE, SIZE, renderer);
const fill = (data, scale) => {
    for (let i = 0; i < data.length; i++) data[i] = (next() - 0.5) * scale;
    return data;
};
const [positions, velocities] = [compute.createTexture(), compute.createTexture()];
fill(positions.image.data, 3);
fill(velocities.image.data, 0.02);
const velocity = compute.addVariable(
    'velocity',
    `void main() {
        vec2 at = gl_FragCoord.xy / resolution.xy;
        vec4 v = texture2D(velocity, at), p = texture2D(position, at);
        gl_FragColor = vec4(v.xyz * 0.995 - normalize(p.xyz + 1e-4) * 0.002 + cross(p.xyz, vec3(0.0, 0.001, 0.0)), 1.0);
    }`,
    velocities,
);
const position = compute.addVariable(
    'position',
    `void main() {
        vec2 at = gl_FragCoord.xy / resolution.xy;
        gl_FragColor = vec4(texture2D(position, at).xyz + texture2D(velocity, at).xyz, 1.0);
    }`,
    positions,
);
for (const variable of [velocity, position]) compute.setVariableDependencies(variable, [velocity, position]);
const failed = compute.init();
if (failed) throw new Error(failed);
const geometry = new THREE.BufferGeometry();
const where = Float32Array.from({ length: SIZE * SIZE * 3 }, (_, i) => {
    const point = Math.floor(i / 3);
    return [(point % SIZE) / SIZE, Math.floor(point / SIZE) / SIZE, 0][i % 3];
});
geometry.setAttribute('position', new THREE.BufferAttribute(where, 3));
const material = new THREE.ShaderMaterial({
    uniforms: { positions: { value: null } },
    vertexShader: `uniform sampler2D positions; varying vec3 tint;
void main() {
    vec3 p = texture2D(positions, position.xy).xyz;
    tint = p * 0.4 + 0.5;
    gl_Position = projectionMatrix * modelViewMatrix * vec4(p, 1.0);
    gl_PointSize = 6.0 / gl_Position.w * 3.0;
}`,
    fragmentShader: `varying vec3 tint;
void main() { if (length(gl_PointCoord - 0.5) > 0.5) discard; gl_FragColor = vec4(tint, 1.0); }`,
});
const points = new THREE.Points(geometry, material);
points.frustumCulled = false;
scene.add(points);
loaded();
loop(() => {
    compute.compute();
    material.uniforms.positions.value = compute.getCurrentRenderTarget(position).texture;
    renderer.render(scene, eye);
});
