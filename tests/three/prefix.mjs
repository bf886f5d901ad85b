// What `preshade/three-prefix` declares for a ShaderMaterial, beside the whole text that three.js makes of it: the same depth pass is derived from both.

import assert from 'node:assert/strict';
import { rewrite } from 'preshade';
import { withThree } from 'preshade/three-prefix';

/** By flag of the material, texts that read what three.js declares for it. */
const MATERIALS = [
    {
        settings: {},
        vertex: `
uniform float time;
varying vec2 at;
void main() {
    at = uv;
    vec3 moved = position + normal * sin(time + position.x * 4.0) * 0.1;
    gl_Position = projectionMatrix * modelViewMatrix * vec4(moved, 1.0);
}`,
        fragment: `
uniform sampler2D map;
varying vec2 at;
void main() {
    vec4 texel = texture2D(map, at);
    if (texel.a < 0.5) discard;
    gl_FragColor = texel;
}`,
    },
    {
        settings: { vertexColors: true, glslVersion: '300 es' },
        define: ['USE_COLOR'],
        vertex: `
varying vec4 tint;
void main() {
    vec4 seen = viewMatrix * modelMatrix * vec4(position, 1.0);
    tint = vec4(color, length(normalMatrix * normal) + cameraPosition.x);
    gl_Position = projectionMatrix * seen;
}`,
        fragment: `
varying vec4 tint;
layout(location = 0) out vec4 shown;
void main() {
    if (tint.a + float(isOrthographic) + viewMatrix[0].x < 0.5) discard;
    shown = tint;
}`,
    },
];

/** In the page: the texts that three.js compiles. */
async function compiled({ settings, vertex, fragment }) {
    const { Mesh, PlaneGeometry, ShaderMaterial } = await import('three');
    const { renderer, scene, camera } = window.page;
    const uniforms = { time: { value: 0 }, map: { value: null } };
    const material = new ShaderMaterial({ ...settings, uniforms, vertexShader: vertex, fragmentShader: fragment });
    const gl = renderer.getContext();
    const mesh = new Mesh(new PlaneGeometry(), material);
    scene.add(mesh);
    renderer.compile(mesh, camera, scene);
    const program = renderer.info.programs.at(-1);
    const texts = [program.vertexShader, program.fragmentShader].map((shader) => gl.getShaderSource(shader));
    scene.remove(mesh);
    material.dispose();
    return { vertex: texts[0], fragment: texts[1] };
}

export async function prefix(page) {
    for (const { settings, define = [], ...stages } of MATERIALS) {
        const real = await page.evaluate(compiled, { settings, ...stages });
        const options = { name: 'own', pass: 'depth-prepass', emit: 'glsl-es' };
        assert.ok(real.vertex.includes(stages.vertex) && real.fragment.includes(stages.fragment), real.vertex);
        const [theirs, ours] = [await rewrite(real, options), await rewrite(withThree(stages), { ...options, define })];
        const passes = ({ files }) => files.filter(({ name }) => name.includes('prepass'));
        assert.match(ours.recipe, /^depth-prepass/);
        assert.equal(passes(ours).length, 2);
        // Each unit in the order of its names: that of the declarations is three.js's, or ours.
        const lines = (of) => passes(of).map(({ text }) => text.split('\n').sort());
        assert.deepEqual(lines(ours), lines(theirs));
    }
}
