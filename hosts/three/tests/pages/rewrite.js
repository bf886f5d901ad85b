// The world drawn by recipes: one part for each, all on the same scene, one of which is enabled.

import * as THREE from 'three';
import { Preshade } from 'preshade-three';
import { world } from './world.js';

const query = new URLSearchParams(location.search);
const SIZE = 192;
const renderer = new THREE.WebGLRenderer({
    preserveDrawingBuffer: true,
    antialias: query.has('antialias'),
    reversedDepthBuffer: query.has('reversed'),
});
renderer.setSize(SIZE, SIZE);
renderer.shadowMap.enabled = true;
renderer.toneMapping = THREE.ACESFilmicToneMapping;
document.body.append(renderer.domElement);
const { scene, camera, materials, set } = world();
/** Work for a vertex shader to take over from the fragments of a plane. */
materials.waves.fragmentShader = `uniform vec3 tint; uniform float time; varying vec3 vAt;
    void main() {
        float turn = 0.0;
        for (int i = 0; i < 24; i++) turn += sin(time * float(i + 2)) * cos(time + float(i));
        gl_FragColor = vec4(tint * (0.6 + 0.1 * sin(vAt.x * 5.0 + turn) * cos(vAt.y * 7.0)), 1.0);
    }`;
const preshade = await Preshade.of(renderer, { cache: false });
const gl = renderer.getContext();
const parts = new Map();

function part(name, options) {
    const made = preshade.rewrite(scene, options);
    made.enabled = false;
    parts.set(name, made);
}

function bytes() {
    const read = new Uint8Array(SIZE * SIZE * 4);
    gl.readPixels(0, 0, SIZE, SIZE, gl.RGBA, gl.UNSIGNED_BYTE, read);
    return read;
}

/** The picture as this part draws it, or three.js alone, and the draws of the frame. */
function drawn(name) {
    for (const [each, of] of parts) of.enabled = each === name;
    renderer.render(scene, camera);
    return { picture: bytes(), draws: renderer.info.render.calls };
}

const differing = (a, b) => {
    let count = 0;
    for (let i = 0; i < a.length; i += 4) if ([0, 1, 2, 3].some((c) => a[i + c] !== b[i + c])) count++;
    return count;
};

/** Pixels that differ from three.js' own picture, at this moment. */
function compare(name) {
    const plain = drawn(null);
    const ours = drawn(name);
    const again = drawn(null);
    return {
        off: differing(plain.picture, ours.picture),
        unstable: differing(plain.picture, again.picture),
        more: ours.draws - plain.draws,
    };
}

/** Pixels off in a frame by the part that comes before one of three.js alone. */
function first(name) {
    const ours = drawn(name);
    return differing(drawn(null).picture, ours.picture);
}

/** Draws until nothing is made or tested any more. Resolves to how many pixels were off in any frame until then. */
async function settle(name) {
    let off = 0;
    for (let i = 0; i < 1000; i++) {
        off += compare(name).off;
        await new Promise((resolve) => requestAnimationFrame(resolve));
        await preshade.settled();
        if (i > 3 && parts.get(name).isSettled) return { frames: i, off };
    }
    throw new Error(`${name}: ${JSON.stringify(rows(name))}`);
}

/** The rows of a part as if it were on. */
function rows(name) {
    const of = parts.get(name);
    const { enabled } = of;
    of.enabled = true;
    const all = of.report();
    of.enabled = enabled;
    return all.map((row) => ({ ...row, skipped: row.skipped, passes: row.plan?.passes.map(({ role }) => role) }));
}

Object.assign(globalThis, {
    THREE,
    renderer,
    scene,
    camera,
    materials,
    set,
    preshade,
    part,
    parts,
    compare,
    first,
    settle,
    rows,
});
globalThis.ready = true;
