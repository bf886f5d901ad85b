// Pictures with and without pre-passes.

import * as THREE from 'three/webgpu';
import { emissive, mrt, output } from 'three/tsl';
import { Preshade } from 'preshade-three';
import {
    MATERIALS,
    OBJECTS,
    SIZE,
    differ,
    frame,
    litOf,
    renderer as make,
    scene as sceneOf,
    settle,
    shownBy,
} from './kit.js';

const asked = new URLSearchParams(location.search);
// A driver that computes other positions as soon as the fragment stage is another.
if (asked.has('perturb')) perturb();
const renderer = await make();
const targets = new Map();

function target(kind) {
    if (kind === 'canvas') return null;
    const options = { samples: asked.has('samples') ? 4 : 0, count: kind === 'mrt' ? 2 : 1 };
    if (!targets.has(kind)) targets.set(kind, new THREE.RenderTarget(SIZE, SIZE, options));
    const of = targets.get(kind);
    if (kind === 'mrt') [of.textures[0].name, of.textures[1].name] = ['output', 'emissive'];
    return of;
}

async function picture({ scene, camera }, kind) {
    const of = target(kind);
    renderer.setRenderTarget(of);
    if (kind === 'mrt') renderer.setMRT(mrt({ output, emissive }));
    renderer.render(scene, camera);
    renderer.setRenderTarget(null);
    renderer.setMRT(null);
    if (of) return new Uint8Array(await renderer.readRenderTargetPixelsAsync(of, 0, 0, SIZE, SIZE));
    return shownBy(renderer);
}

/** Draw calls of a render. */
async function calls(of, kind) {
    renderer.info.autoReset = false;
    renderer.info.reset();
    await picture(of, kind);
    renderer.info.autoReset = true;
    return renderer.info.render.drawCalls;
}

/** Pixels that differ, and what was done. Three objects of one material stand behind each other. */
globalThis.compare = async ({ target: kind = 'texture', count = 3, form, ...options }) => {
    const of = sceneOf(options);
    of.sun.castShadow = false;
    for (let i = 1; i < count; i++) {
        const other = OBJECTS[options.object ?? 'mesh'](of.material);
        other.position.set(0.3 * i, 0.1, -0.8 * i);
        of.scene.add(other);
    }
    const before = await picture(of, kind);
    const drawn = await calls(of, kind);
    const preshade = await Preshade.of(renderer, { cache: false });
    preshade.prepass(of.scene, { form });
    await settle(preshade, () => picture(of, kind), 8);
    const after = await picture(of, kind);
    const more = (await calls(of, kind)) - drawn;
    const rows = preshade.report().filter(({ uuid }) => uuid === of.material.uuid);
    preshade.dispose();
    const again = await picture(of, kind);
    const less = (await calls(of, kind)) - drawn;
    return { differ: differ(before, after, 4), lit: litOf(before), more, again: differ(before, again, 4), less, rows };
};

/** What is chosen where each draw of a pre-pass has a frame take `part` of the time that it takes without. */
globalThis.measured = async (part) => {
    const of = sceneOf({ material: 'plain' });
    of.sun.castShadow = false;
    const fewest = await calls(of, 'texture');
    const timer = {
        watch() {},
        dispose() {},
        take: (done) => queueMicrotask(() => done(10 * part ** (renderer.info.render.drawCalls - fewest))),
    };
    const preshade = await Preshade.of(renderer, { cache: false, timer });
    const prepass = preshade.prepass(of.scene, { measure: true });
    const isWaiting = ({ state }) => ['pending', 'waiting', 'measuring'].includes(state);
    let frames = 0;
    do {
        await calls(of, 'texture');
        await preshade.settled();
        await frame();
    } while (++frames < 400 && (preshade.report().some(isWaiting) || frames < 20));
    const rows = preshade.report();
    const more = (await calls(of, 'texture')) - fewest;
    prepass.forced = true;
    const forced = (await calls(of, 'texture')) - fewest;
    prepass.forced = false;
    // Much more is drawn: what was measured says little about it.
    for (let i = 0; i < 4; i++) of.scene.add(of.mesh.clone());
    let later = 0;
    while (++later < 400 && !preshade.report().some(isWaiting)) {
        await calls(of, 'texture');
        if (later % 20 === 0) await frame();
    }
    preshade.dispose();
    return { frames, more, forced, rows, later };
};

/** The real clock, and what is left of it. */
globalThis.timed = async () => {
    const of = sceneOf({ material: 'plain' });
    const preshade = await Preshade.of(renderer, { cache: false });
    const prepass = preshade.prepass(of.scene, { measure: true });
    const isWaiting = ({ state }) => ['pending', 'waiting', 'measuring'].includes(state);
    const before = await picture(of, 'texture');
    let [frames, worst] = [0, 0];
    do {
        worst = Math.max(worst, differ(before, await picture(of, 'texture'), 4));
        await preshade.settled();
    } while (++frames < 400 && (!prepass.isSettled || frames < 20));
    const rows = preshade.report();
    preshade.dispose();
    const names = ['beginRender', 'finishRender', 'initTimestampQuery', 'draw', 'copyFramebufferToTexture'];
    return { frames, worst, rows, left: names.filter((name) => Object.hasOwn(renderer.backend, name)) };
};

/** What options say that there are not. */
globalThis.refused = async () => {
    const { scene } = sceneOf({ material: 'plain' });
    const preshade = await Preshade.of(renderer, { cache: false });
    const told = (ask) => {
        try {
            ask();
        } catch (error) {
            return error.message;
        }
    };
    const found = [
        told(() => preshade.prepass(scene, { form: 'both' })),
        told(() => preshade.prepass(scene, { remember: true })),
        told(() => preshade.prepass(scene, { measure: { method: 'clock' } })),
        told(() => preshade.velocity(scene, { units: 'pixels' })),
        told(() => preshade.shadows(scene, { view: 'light' })),
    ];
    preshade.dispose();
    return found;
};

function perturb() {
    const codes = new WeakMap();
    const { prototype } = GPUDevice;
    const { createShaderModule, createRenderPipelineAsync } = prototype;
    prototype.createShaderModule = function (descriptor) {
        const module = createShaderModule.call(this, descriptor);
        codes.set(module, descriptor.code);
        return module;
    };
    prototype.createRenderPipelineAsync = function (descriptor) {
        const { vertex, fragment } = descriptor;
        const isAuthors = vertex.module.label !== 'preshade';
        if (isAuthors && fragment.module.label === 'preshade') {
            const position = /(varyings\.builtinClipSpace = [^;]+;)/;
            const code = codes.get(vertex.module).replace(position, '$1 varyings.builtinClipSpace.z += 1e-5;');
            const module = createShaderModule.call(this, { code });
            return createRenderPipelineAsync.call(this, { ...descriptor, vertex: { ...vertex, module } });
        }
        return createRenderPipelineAsync.call(this, descriptor);
    };
}

globalThis.materials = Object.keys(MATERIALS);
globalThis.ready = true;
