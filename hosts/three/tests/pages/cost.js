// What preshade's shadows cost: frame times of a scene of 200 casters without and with them, and the longest piece of work of ours on the main thread.

import * as THREE from 'three';
import { Preshade } from 'preshade-three';
import { holed, standard, TIME, wobbling } from './lib/cases.js';
import { settle } from './lib/depths.js';

// Answers of the compiler are read on the main thread too.
const { Worker } = globalThis;
globalThis.Worker = class extends Worker {
    set onmessage(listener) {
        super.onmessage = (event) => {
            const start = performance.now();
            listener({ data: event.data });
            performance.measure('preshade: answer', { start, end: performance.now() });
        };
    }
};

const renderer = new THREE.WebGLRenderer();
renderer.setSize(96, 96);
renderer.shadowMap.enabled = true;
document.body.append(renderer.domElement);

/** 200 casters of 20 materials with five texts, four stock ones among them; one directional light. */
function stage() {
    const scene = new THREE.Scene();
    const camera = new THREE.PerspectiveCamera(50, 1, 0.1, 80);
    camera.position.set(0, 14, 22);
    camera.lookAt(0, 0, 0);
    const ground = new THREE.Mesh(new THREE.PlaneGeometry(60, 60), new THREE.MeshLambertMaterial());
    ground.rotation.x = -Math.PI / 2;
    ground.position.y = -1;
    ground.receiveShadow = true;
    const light = new THREE.DirectionalLight(0xffffff, 2);
    light.position.set(4, 12, 6);
    light.castShadow = true;
    light.shadow.mapSize.set(128, 128);
    Object.assign(light.shadow.camera, { left: -16, right: 16, top: 16, bottom: -16, far: 40 });
    scene.add(ground, light);
    const kinds = [
        () => wobbling(standard()),
        () => holed(standard()),
        () => wobbling(new THREE.MeshLambertMaterial()),
        () => wobbling(new THREE.MeshPhongMaterial()),
        () => standard(),
    ];
    const materials = Array.from({ length: 20 }, (_, i) => kinds[i % kinds.length]());
    const geometry = new THREE.SphereGeometry(0.5, 16, 12);
    for (let i = 0; i < 200; i++) {
        const mesh = new THREE.Mesh(geometry, materials[i % materials.length]);
        mesh.position.set((i % 20) * 1.3 - 12.5, 0, Math.floor(i / 20) * 1.6 - 8);
        mesh.castShadow = true;
        scene.add(mesh);
    }
    return { scene, render: () => renderer.render(scene, camera) };
}

/** The fastest tenth, the median, and the slowest tenth. */
function spread(times) {
    times.sort((a, b) => a - b);
    return [0.1, 0.5, 0.9].map((share) => Number(times[Math.floor(times.length * share)].toFixed(2)));
}

/** Frames without and with preshade's shadows in turns, A B B A: times in script, and until the picture is there, in milliseconds. */
globalThis.measureCost = async (frames) => {
    const { scene, render } = stage();
    const gl = renderer.getContext();
    render();
    const preshade = await Preshade.of(renderer, { cache: false, marks: true });
    const shadows = preshade.shadows(scene);
    await settle(preshade, render, { frames: 200 });
    const tasks = {};
    for (const { name, duration } of performance.getEntriesByType('measure')) (tasks[name] ??= []).push(duration);
    const times = { without: { script: [], whole: [] }, with: { script: [], whole: [] } };
    for (let i = 0; i < frames; i++) {
        shadows.enabled = i % 4 === 1 || i % 4 === 2;
        const of = shadows.enabled ? times.with : times.without;
        TIME.value += 0.01;
        const start = performance.now();
        render();
        of.script.push(performance.now() - start);
        gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(4));
        of.whole.push(performance.now() - start);
    }
    shadows.enabled = true;
    const states = preshade.report().reduce((all, { state }) => ({ ...all, [state]: (all[state] ?? 0) + 1 }), {});
    preshade.dispose();
    for (const of of Object.values(times)) for (const name of ['script', 'whole']) of[name] = spread(of[name]);
    const longest = Object.fromEntries(
        Object.entries(tasks).map(([name, all]) => [name, { count: all.length, longest: Math.max(...all) }]),
    );
    return { times, longest, states };
};
globalThis.ready = true;
