// What is left behind: disposal, objects that leave, lost contexts, and memory.

import * as THREE from 'three';
import { Preshade } from 'preshade-three';
import { standard, TIME, wobbling } from './lib/cases.js';
import { differing, picture, settle, shadowDepths } from './lib/depths.js';
import { open, renderer, sphere, stage, states, workers } from './lib/stage.js';

const scenarios = {
    async 'listeners of materials'() {
        const { scene, mesh, material, ground, render } = stage();
        const stock = new THREE.Mesh(sphere, standard());
        stock.castShadow = true;
        scene.add(stock);
        render();
        render();
        const count = () =>
            [material, stock.material, ground.material].map(({ _listeners: of }) => of?.dispose?.length ?? 0);
        const before = count();
        const preshade = await open();
        preshade.shadows(scene);
        await settle(preshade, render);
        const during = count();
        preshade.dispose();
        const result = { before, during, after: count() };
        mesh.material.dispose();
        stock.material.dispose();
        return result;
    },

    async 'a compiler that cannot be loaded'() {
        const { scene, light, render } = stage();
        render();
        render();
        const before = shadowDepths(renderer, light);
        const nothing = new URL('/nothing.wasm', location.href);
        const preshade = await Preshade.of(renderer, { cache: false, wasm: nothing, full: nothing });
        preshade.shadows(scene);
        await settle(preshade, render);
        const [{ state, code }] = preshade.report();
        const result = { state, code, differ: differing(before, shadowDepths(renderer, light)) };
        preshade.dispose();
        return result;
    },

    async 'a page without preshade-full.wasm'() {
        const { scene, render, differ } = stage();
        const full = new URL('/nothing.wasm', location.href);
        const preshade = await Preshade.of(renderer, { cache: false, full });
        preshade.shadows(scene);
        await settle(preshade, render);
        const found = preshade.report().find(({ material }) => material !== 'MeshLambertMaterial');
        const result = { state: found.state, code: found.code, differ: differ() };
        preshade.dispose();
        return result;
    },

    async disposal() {
        const { scene, mesh, material, light, render } = stage();
        // What three.js keeps for a stock caster stays.
        mesh.material = standard();
        render();
        render();
        mesh.material.dispose();
        const start = { programs: renderer.info.programs.length, ...renderer.info.memory };
        mesh.material = material;
        render();
        render();
        const drawn = renderer.info.programs.length;
        const preshade = await open();
        const methods = ['render', 'renderBufferDirect', 'clear'].map((name) => renderer[name]);
        preshade.shadows(scene);
        await settle(preshade, render);
        const withShadows = renderer.info.programs.length;
        material.dispose();
        scene.remove(mesh);
        render();
        const afterMaterial = renderer.info.programs.length;
        // An object that leaves, whose material its author does not dispose of.
        const other = new THREE.Mesh(sphere, wobbling(standard({ name: 'leaves' })));
        other.castShadow = true;
        scene.add(other);
        await settle(preshade, render);
        const rows = states(preshade).length;
        scene.remove(other);
        for (let i = 0; i < 260; i++) render();
        const swept = states(preshade).length;
        preshade.dispose();
        const isOwn = [renderer.render, renderer.renderBufferDirect, renderer.clear].every(
            (method, i) => method !== methods[i],
        );
        render();
        other.material.dispose();
        light.dispose();
        const result = {
            start,
            drawn,
            withShadows,
            afterMaterial,
            rows,
            swept,
            isOwn,
            end: renderer.info.programs.length,
        };
        result.textures = [start.textures, renderer.info.memory.textures];
        result.workers = { ...workers };
        return result;
    },

    async 'a part that was disposed of'() {
        const { scene, render, differ } = stage();
        const preshade = await open();
        const first = preshade.shadows(scene);
        await settle(preshade, render);
        const [before] = states(preshade);
        const prepass = preshade.prepass(scene);
        for (const part of [first, prepass, first]) part.dispose();
        const result = { before, rows: states(preshade).length };
        const second = preshade.shadows(scene);
        await settle(preshade, render);
        Object.assign(result, { isAnother: second !== first, differ: differ(), states: states(preshade) });
        preshade.dispose();
        return result;
    },

    async 'a text of ours that the driver refuses'() {
        const { scene, light, render } = stage();
        render();
        render();
        const before = { depths: shadowDepths(renderer, light), picture: picture(renderer) };
        const gl = renderer.getContext();
        const preshade = await open();
        // From here on all texts are preshade's.
        gl.shaderSource = (shader, text) =>
            WebGL2RenderingContext.prototype.shaderSource.call(
                gl,
                shader,
                text.replace('void main()', 'void nonsense() { missing = 1.0; }\nvoid main()'),
            );
        preshade.shadows(scene);
        const prepass = preshade.prepass(scene);
        await settle(preshade, render);
        for (let i = 0; i < 1000 && !prepass.isSettled; i++) {
            render();
            await new Promise((resolve) => requestAnimationFrame(resolve));
        }
        const rows = preshade.report().map((row) => ({ ...row, rendered: row.rendered, failures: row.failures }));
        const result = { isSettled: prepass.isSettled, rows };
        delete gl.shaderSource;
        render();
        result.differ = differing(before.depths, shadowDepths(renderer, light));
        result.picture = differing(before.picture, picture(renderer));
        preshade.dispose();
        return result;
    },

    async 'a material and a camera that leave the scene'() {
        const { scene, camera, light, ground, mesh, material, render } = stage();
        light.castShadow = false;
        const preshade = await open();
        const materials = (each) => each !== ground.material;
        const part = preshade.prepass(scene, { measure: { frames: 24 }, remember: false, materials });
        const choose = async () => {
            for (let i = 0; i < 1000 && (i < 5 || !part.isSettled); i++) {
                render();
                await new Promise((resolve) => requestAnimationFrame(resolve));
                await preshade.settled();
            }
        };
        const listeners = () => material._listeners.dispose.length;
        await choose();
        const result = { settled: [part.isSettled], listeners: [listeners()] };
        // Once from elsewhere: that view is to be measured, and never drawn again.
        renderer.render(scene, camera.clone());
        result.settled.push(part.isSettled);
        // three.js draws it by the same program.
        mesh.material = wobbling(standard({ name: 'another' }));
        mesh.visible = false;
        const elsewhere = new THREE.WebGLRenderTarget(4, 4);
        renderer.setRenderTarget(elsewhere);
        for (let i = 0; i < 1300; i++) render();
        renderer.setRenderTarget(null);
        elsewhere.dispose();
        mesh.visible = true;
        await choose();
        result.settled.push(part.isSettled);
        result.listeners.push(listeners());
        result.state = part.report().find((row) => row.material === 'another').state;
        preshade.dispose();
        for (const each of [material, mesh.material]) each.dispose();
        return result;
    },

    async 'a context that is lost and restored'() {
        const { scene, render, differ } = stage();
        const preshade = await open();
        preshade.shadows(scene);
        await settle(preshade, render);
        const before = differ();
        const restored = new Promise((resolve) =>
            renderer.domElement.addEventListener('webglcontextrestored', resolve),
        );
        const { lose, restore } = {
            lose: () => renderer.forceContextLoss(),
            restore: () => renderer.forceContextRestore(),
        };
        lose();
        await new Promise((resolve) => setTimeout(resolve, 50));
        render();
        restore();
        await restored;
        await settle(preshade, render);
        const result = { before, after: differ(), states: states(preshade) };
        preshade.dispose();
        return result;
    },
};

globalThis.runScenario = (name) => scenarios[name]();
/** So many times: a page that opens preshade, draws, and disposes of it and of its materials. */
globalThis.cycles = async (count) => {
    const { scene, render, mesh } = stage();
    const found = [];
    for (let i = 0; i < count; i++) {
        mesh.material = wobbling(standard());
        const preshade = await open();
        preshade.shadows(scene);
        if (i % 20 === 0) await settle(preshade, render);
        else render();
        preshade.dispose();
        mesh.material.dispose();
        if (i % 20 === 0) {
            render();
            mesh.material.dispose();
            found.push({
                programs: renderer.info.programs.length,
                ...renderer.info.memory,
                alive: workers.made - workers.ended,
            });
        }
    }
    return found;
};
/** So many materials, one after the other, each with a text of its own. */
globalThis.recompile = async (count, onEvery) => {
    const { scene, render, mesh, material } = stage();
    material.dispose();
    const preshade = await open();
    preshade.shadows(scene);
    const found = [];
    for (let i = 0; i < count; i++) {
        mesh.material = wobbling(new THREE.MeshBasicMaterial());
        const own = mesh.material.onBeforeCompile;
        mesh.material.onBeforeCompile = (shader) => {
            own(shader);
            shader.vertexShader = shader.vertexShader.replace('* 0.2', `* 0.${1000 + i}`);
        };
        mesh.material.customProgramCacheKey = () => `recompiled ${i}`;
        TIME.value += 0.001;
        let done = false;
        for (let frame = 0; frame < 40 && !done; frame++) {
            render();
            await preshade.settled();
            done = preshade.report().some(({ state, uuid }) => state === 'done' && uuid === mesh.material.uuid);
        }
        if (!done) throw new Error(`${i}: ${JSON.stringify(preshade.report())}`);
        render();
        mesh.material.dispose();
        if (i % onEvery === onEvery - 1) {
            globalThis.gc?.();
            found.push({
                heap: performance.memory?.usedJSHeapSize,
                programs: renderer.info.programs.length,
                rows: preshade.report().length,
            });
        }
    }
    preshade.dispose();
    return found;
};
globalThis.names = Object.keys(scenarios);
globalThis.ready = true;
