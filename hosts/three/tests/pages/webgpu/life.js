// How long things live: recompiled and disposed materials, preshade come and gone, a lost device; and what frames cost.

import * as THREE from 'three/webgpu';
import { float, fract, uv, vec4 } from 'three/tsl';
import { Preshade } from 'preshade-three';
import { SIZE, differ, frame, renderer as make, scene as sceneOf, settle } from './kit.js';

/** GPU buffers, textures and query sets that are made and not destroyed. */
const alive = new Set();
for (const name of ['createBuffer', 'createTexture', 'createQuerySet']) {
    const made = GPUDevice.prototype[name];
    GPUDevice.prototype[name] = function (descriptor) {
        const of = made.call(this, descriptor);
        if (!/^preshade/.test(descriptor.label ?? '')) return of;
        alive.add(of);
        const { destroy } = of;
        of.destroy = () => {
            alive.delete(of);
            destroy.call(of);
        };
        return of;
    };
}

const renderer = await make();
const target = new THREE.RenderTarget(SIZE, SIZE);
const counts = () => ({
    renderObjects: renderer._objects._renderObjects.size,
    pipelines: renderer._pipelines.caches.size,
    programs: renderer._pipelines.programs.vertex.size + renderer._pipelines.programs.fragment.size,
    states: renderer._nodes.nodeBuilderCache.size,
    alive: alive.size,
    heap: (globalThis.gc?.(), performance.memory?.usedJSHeapSize ?? 0),
});

function draw({ scene, camera }) {
    renderer.setRenderTarget(target);
    renderer.render(scene, camera);
    renderer.setRenderTarget(null);
}

async function pixels(of) {
    draw(of);
    return new Uint8Array(await renderer.readRenderTargetPixelsAsync(target, 0, 0, SIZE, SIZE));
}

const leaf = (part) => ({ opacityNode: fract(uv().x.mul(8)).mul(float(part)), alphaTest: 0.4 });

/** One material whose text changes to and fro. */
globalThis.recompile = async (count) => {
    const of = sceneOf({ material: 'opacityNode, alphaTest' });
    const preshade = await Preshade.of(renderer, { cache: false });
    preshade.shadows(of.scene);
    preshade.prepass(of.scene);
    const found = [];
    let rows = 0;
    for (let i = 0; i <= count; i++) {
        Object.assign(of.material, leaf(i % 2 ? 0.9 : 1));
        of.material.needsUpdate = true;
        if (i < 4) await settle(preshade, () => draw(of), 5);
        draw(of);
        if (i % 20 === 0) await frame();
        if (i === count >> 2 || i === count) {
            await settle(preshade, () => draw(of), 3);
            await frame();
            found.push(counts());
            rows = preshade.report().length;
        }
    }
    preshade.dispose();
    return { found, rows };
};

/** Materials that come and go. */
globalThis.replace = async (count) => {
    const of = sceneOf({ material: 'opacityNode, alphaTest' });
    const preshade = await Preshade.of(renderer, { cache: false });
    preshade.shadows(of.scene);
    preshade.prepass(of.scene);
    preshade.velocity(of.scene);
    const found = [];
    let last;
    for (let i = 0; i <= count; i++) {
        const { material } = of.mesh;
        of.mesh.material = material.clone();
        material.dispose();
        last = material;
        for (let k = 0; k < (i < 2 ? 6 : 2); k++) {
            draw(of);
            await preshade.settled();
        }
        await frame();
        if (i !== count >> 2 && i !== count) continue;
        // What velocities keep of a material goes some frames after it.
        for (let k = 0; k < 32; k++) {
            draw(of);
            await frame();
        }
        found.push(counts());
    }
    of.mesh.material.dispose();
    await frame();
    const rows = preshade.report().filter(({ uuid }) => uuid === of.mesh.material.uuid);
    const listeners = [last, of.mesh.material].map(({ _listeners }) => _listeners.dispose.length);
    preshade.dispose();
    return { found, rows, listeners };
};

/** preshade, come and gone. */
globalThis.cycle = async (count) => {
    const of = sceneOf({ material: 'opacityNode, alphaTest' });
    const before = await pixels(of);
    const own = () => [...Object.keys(renderer), ...Object.keys(renderer.backend)].sort().join();
    const names = own();
    const found = [];
    for (let i = 0; i <= count; i++) {
        const preshade = await Preshade.of(renderer);
        preshade.shadows(of.scene);
        preshade.prepass(of.scene, { measure: i % 2 === 1 });
        preshade.velocity(of.scene);
        preshade.override(of.scene);
        for (let k = 0; k < 3; k++) {
            draw(of);
            await preshade.settled();
        }
        preshade.dispose();
        if (i === count >> 2 || i === count) {
            await frame();
            found.push(counts());
        }
    }
    await frame();
    return { found, same: own() === names, differ: differ(before, await pixels(of), 4) };
};

/** What makes three.js compile another program: the picture is that of a renderer without preshade. */
globalThis.changed = async () => {
    const changes = {
        fog: ({ scene }) => (scene.fog = new THREE.Fog(0xff0000, 2, 12)),
        'no fog': ({ scene }) => (scene.fog = null),
        light: ({ scene }) => scene.add(new THREE.PointLight(0x00ff00, 5)),
        environment({ scene }) {
            scene.environmentNode = vec4(0.2, 0.3, 0.4, 1);
        },
        side: ({ material }) => Object.assign(material, { side: THREE.FrontSide }),
        transparent: ({ material }) => Object.assign(material, { transparent: true }),
        opaque: ({ material }) => Object.assign(material, { transparent: false }),
        map({ material }) {
            material.map = new THREE.DataTexture(new Uint8Array([9, 99, 199, 255]), 1, 1);
            material.map.needsUpdate = true;
            material.needsUpdate = true;
        },
    };
    const run = async (preshade) => {
        const of = sceneOf({ material: 'vertexNode' });
        of.sun.shadow.autoUpdate = true;
        preshade?.prepass(of.scene);
        const found = {};
        for (const [name, change] of Object.entries(changes)) {
            change(of);
            // The first frame after a change, and one when all is ready.
            const first = await pixels(of);
            for (let i = 0; i < 5; i++) {
                draw(of);
                await preshade?.settled();
            }
            found[name] = [first, await pixels(of)];
        }
        const rows = preshade?.report().filter(({ uuid }) => uuid === of.material.uuid);
        return { found, rows };
    };
    const plain = await run(null);
    const preshade = await Preshade.of(renderer, { cache: false });
    const { found, rows } = await run(preshade);
    preshade.dispose();
    const counted = Object.entries(found).map(([name, pictures]) => [
        name,
        pictures.map((picture, i) => differ(picture, plain.found[name][i], 4)),
    ]);
    return { differ: Object.fromEntries(counted), rows };
};

/** Main-thread milliseconds of a frame of `count` casters: the median before and with preshade. */
globalThis.cost = async (count) => {
    const of = sceneOf({ material: 'opacityNode, alphaTest' });
    for (let i = 1; i < count; i++) {
        const mesh = new THREE.Mesh(of.mesh.geometry, of.material);
        mesh.position.set((i % 15) - 7, 0, -((i / 15) | 0));
        mesh.scale.setScalar(0.3);
        mesh.castShadow = true;
        of.scene.add(mesh);
    }
    Object.assign(of.sun.shadow.camera, { left: -10, right: 10, top: 10, bottom: -10, far: 40 });
    of.sun.shadow.camera.updateProjectionMatrix();
    const { scene, camera } = of;
    const frames = async (total) => {
        const times = [];
        for (let i = 0; i < total; i++) {
            await frame();
            const began = performance.now();
            renderer.setRenderTarget(target);
            renderer.render(scene, camera);
            times.push(performance.now() - began);
            renderer.setRenderTarget(null);
            await renderer.backend.device.queue.onSubmittedWorkDone();
        }
        times.sort((a, b) => a - b);
        return { median: times[total >> 1], longest: times[total - 1] };
    };
    await frames(5);
    const before = await frames(30);
    const preshade = await Preshade.of(renderer, { cache: false });
    preshade.shadows(scene);
    const shadowsMake = await frames(15);
    await preshade.settled();
    const shadows = await frames(30);
    preshade.prepass(scene);
    const prepassMakes = await frames(15);
    await preshade.settled();
    const both = await frames(30);
    preshade.dispose();
    return { before, shadowsMake, shadows, prepassMakes, both };
};

globalThis.lose = async () => {
    const of = sceneOf({ material: 'opacityNode, alphaTest' });
    const preshade = await Preshade.of(renderer, { cache: false });
    preshade.shadows(of.scene);
    draw(of);
    renderer.backend.device.destroy();
    await renderer.backend.device.lost;
    await frame();
    return preshade.report();
};

/** Two of one renderer: the second does nothing, and says so. */
globalThis.twice = async () => {
    const [first, second] = [await Preshade.of(renderer), await Preshade.of(renderer)];
    const rows = second.report();
    second.dispose();
    first.dispose();
    const third = await Preshade.of(renderer);
    const after = third.report();
    third.dispose();
    return { rows, after };
};

/** Parts of a scene: asked for twice, disposed of, and asked for again. */
globalThis.parts = async () => {
    const of = sceneOf({ material: 'opacityNode, alphaTest' });
    const preshade = await Preshade.of(renderer, { cache: false });
    const states = () => preshade.report().map(({ pass, state }) => `${pass} ${state}`);
    const found = {};
    const old = {};
    for (const name of ['shadows', 'prepass', 'velocity']) {
        const ask = () => preshade[name](of.scene);
        const first = (old[name] = ask());
        let second;
        try {
            second = ask() === first ? 'the same' : 'another';
        } catch (error) {
            second = error.message;
        }
        // Pictures until it is there, each with all that is made by then.
        for (let i = 0; i < 20 && !(states().some((of) => of.endsWith('done')) && (first.isSettled ?? true)); i++) {
            draw(of);
            await preshade.settled();
            await frame();
        }
        const before = first.report().map(({ state }) => state);
        first.dispose();
        const after = states();
        const again = ask();
        first.dispose();
        draw(of);
        await preshade.settled();
        draw(of);
        found[name] = { second, before, after, isOther: again !== first, again: again.report().length };
        again.dispose();
    }
    preshade.dispose();
    return found;
};

/** What a part has after one picture, and after `settled`. */
globalThis.settledAfterOne = async () => {
    const of = sceneOf({ material: 'vertexNode' });
    const preshade = await Preshade.of(renderer, { cache: false });
    preshade.shadows(of.scene);
    preshade.velocity(of.scene);
    const prepass = preshade.prepass(of.scene);
    const rows = () => preshade.report().filter(({ uuid }) => uuid === of.material.uuid);
    const told = () => rows().map(({ pass, state }) => `${pass} ${state}`);
    draw(of);
    const first = prepass.isSettled;
    await preshade.settled();
    const settled = told();
    let pictures = 0;
    while (!prepass.isSettled && pictures++ < 20) {
        draw(of);
        await preshade.settled();
    }
    const then = told();
    preshade.dispose();
    return { first, settled, then };
};

globalThis.unfit = async () => {
    const other = new THREE.WebGPURenderer({ forceWebGL: true });
    await other.init();
    const preshade = await Preshade.of(other);
    const of = sceneOf({});
    preshade.shadows(of.scene);
    preshade.prepass(of.scene);
    preshade.override(of.scene);
    other.render(of.scene, of.camera);
    await preshade.settled();
    const rows = preshade.report();
    preshade.dispose();
    other.dispose();
    return rows;
};
globalThis.ready = true;
