// Two scenes: in `deep` much is hidden, and what hides it is drawn last; in `flat` nothing is, and there are many vertices. `?scene=deep`

import * as THREE from 'three';
import { Preshade } from 'preshade-three';
import { interval } from '/three/measure.js';

const query = new URLSearchParams(location.search);
const SIZE = Number(query.get('size') ?? 160);
const renderer = new THREE.WebGLRenderer({ preserveDrawingBuffer: true });
renderer.setSize(SIZE, SIZE);
document.body.append(renderer.domElement);
const gl = renderer.getContext();
const camera = new THREE.PerspectiveCamera(50, 1, 0.1, 50);
camera.position.z = 4;

const costly = (name) =>
    new THREE.ShaderMaterial({
        name,
        uniforms: { tint: { value: new THREE.Color('#88aacc') } },
        vertexShader:
            'varying vec3 vAt; void main() { vAt = position; gl_Position = projectionMatrix * modelViewMatrix * vec4(position, 1.0); }',
        fragmentShader: `uniform vec3 tint; varying vec3 vAt; void main() { float s = 0.0;
            for (int i = 0; i < 24; i++) s += sin(vAt.x * float(i + 3) + s) * cos(vAt.y * float(i + 5));
            gl_FragColor = vec4(tint * (0.6 + 0.02 * s), 1.0); }`,
    });

const scenes = {
    deep() {
        const scene = new THREE.Scene();
        const material = costly('layers');
        const geometry = new THREE.PlaneGeometry(5, 5);
        for (let i = 0; i < 8; i++) {
            const mesh = new THREE.Mesh(geometry, material);
            mesh.position.z = -2 + i * 0.3;
            // From the back to the front.
            mesh.renderOrder = i;
            scene.add(mesh);
        }
        return scene;
    },
    flat() {
        const scene = new THREE.Scene();
        const material = costly('carpet');
        scene.add(new THREE.Mesh(new THREE.PlaneGeometry(2, 2, 150, 150), material));
        return scene;
    },
};
const scene = scenes[query.get('scene') ?? 'deep']();
const preshade = await Preshade.of(renderer, { cache: false });
const prepass = preshade.prepass(scene, {
    measure: query.has('always')
        ? false
        : {
              frames: Number(query.get('frames') ?? 30),
              method: query.get('method'),
              // By default never: a look falls into the frames of a slow machine.
              again: Number(query.get('again') ?? Infinity),
          },
    remember: query.has('remember'),
    form: query.get('form') ?? 'equal',
});

const frame = () => new Promise((resolve) => requestAnimationFrame(resolve));

/** Draws as a page does until the choice is made; gives back the states before it. */
async function choose(limit = 1500) {
    const states = new Set();
    for (let i = 0; i < limit; i++) {
        renderer.render(scene, camera);
        await frame();
        const now = preshade.report().map(({ state }) => state);
        if (i > 5 && prepass.isSettled && now.every((state) => ['done', 'off', 'refused'].includes(state)))
            return { states: [...states] };
        for (const state of now) states.add(state);
    }
    throw new Error(JSON.stringify(preshade.report(), null, 1));
}

/** Draws as the choice has it. */
async function go(frames) {
    for (let i = 0; i < frames; i++) {
        renderer.render(scene, camera);
        await frame();
    }
}

/** Draws until fragments were counted; gives back how many there are for each pixel. */
async function counted() {
    for (let i = 0; i < 300; i++) {
        const [{ perPixel }] = preshade.report();
        if (perPixel > 0) return perPixel;
        await go(1);
    }
    throw new Error('nothing was counted');
}

/** Wall time of whole frames, in the order A B B A, of which B are with what the choice has: independent of what it measured. Each frame is read back. */
function table(blocks, forced = false) {
    const one = (enabled) => {
        prepass.enabled = enabled;
        prepass.forced = forced;
        const began = performance.now();
        renderer.render(scene, camera);
        gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(4));
        return performance.now() - began;
    };
    const ratios = [];
    const all = { without: [], with: [] };
    for (let i = -1; i < blocks; i++) {
        const [a1, b1, b2, a2] = [one(false), one(true), one(true), one(false)];
        if (i < 0) continue;
        ratios.push(Math.log((b1 + b2) / (a1 + a2)));
        all.without.push(a1, a2);
        all.with.push(b1, b2);
    }
    prepass.enabled = true;
    prepass.forced = false;
    const { middle, low, high } = interval(ratios);
    const median = (values) => values.sort((a, b) => a - b)[values.length >> 1];
    return {
        ratio: Math.exp(middle),
        low: Math.exp(low),
        high: Math.exp(high),
        without: median(all.without),
        with: median(all.with),
    };
}

Object.assign(globalThis, {
    THREE,
    renderer,
    scene,
    camera,
    prepass,
    preshade,
    choose,
    go,
    counted,
    table,
    report: () => preshade.report().map((row) => ({ ...row, measured: row.measured })),
});
globalThis.ready = true;
