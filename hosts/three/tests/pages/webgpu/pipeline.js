// three.js' RenderPipeline: a scene pass with pre-passes, and temporal anti-aliasing by velocities of both.

import * as THREE from 'three/webgpu';
import { mrt, output, pass, texture, velocity as threes } from 'three/tsl';
import { traa } from 'three/addons/tsl/display/TRAANode.js';
import { Preshade } from 'preshade-three';
import { SIZE, differ, frame, litOf, renderer as make, scene as sceneOf, settle, shownBy } from './kit.js';

const renderer = await make();

/** The picture that a pipeline shows after `count` frames. */
async function shown({ scene, camera }, velocityOf, count = 12) {
    const pipeline = new THREE.RenderPipeline(renderer);
    const scenePass = pass(scene, camera);
    scenePass.setMRT(mrt({ output, velocity: threes }));
    const velocity = await velocityOf(scenePass);
    const [color, depth] = [scenePass.getTextureNode('output'), scenePass.getTextureNode('depth')];
    pipeline.outputNode = velocity.node ? traa(color, depth, velocity.node, camera) : color;
    for (let i = 0; i < count; i++) {
        pipeline.render();
        await velocity.after?.();
        await frame();
    }
    pipeline.render();
    const data = await shownBy(renderer);
    pipeline.dispose();
    scenePass.dispose();
    return data;
}

/** Nothing moves: every velocity is 0, and a texture of zeros gives the right picture. */
globalThis.traa = async (options) => {
    const zeros = new THREE.DataTexture(
        new Float32Array(4 * SIZE * SIZE),
        SIZE,
        SIZE,
        THREE.RGBAFormat,
        THREE.FloatType,
    );
    zeros.needsUpdate = true;
    const preshade = await Preshade.of(renderer, { cache: false });
    const run = (velocityOf) => {
        const of = sceneOf(options);
        // The camera of its own is a fresh one for the jitter and the history.
        return shown(of, (scenePass) => velocityOf(of, scenePass));
    };
    const truth = await run(() => ({ node: texture(zeros) }));
    const again = await run(() => ({ node: texture(zeros) }));
    const three = await run((_, scenePass) => ({ node: scenePass.getTextureNode('velocity') }));
    const ours = await run(async ({ scene, camera }) => {
        const velocity = preshade.velocity(scene);
        // The first frames have no variant yet, and the history would remember them.
        await settle(preshade, () => velocity.render(camera));
        return { node: velocity.node };
    });
    const rows = preshade.report();
    preshade.dispose();
    return {
        lit: litOf(truth),
        again: differ(truth, again, 4),
        three: differ(truth, three, 4),
        ours: differ(truth, ours, 4),
        rows,
    };
};

/** A scene pass with two targets, its shadows and its pre-passes. */
globalThis.scenePass = async (options) => {
    const before = await shown(sceneOf(options), () => ({}));
    const preshade = await Preshade.of(renderer, { cache: false });
    const of = sceneOf(options);
    const texts = [preshade.text(of.material, of.mesh)];
    preshade.prepass(of.scene);
    const after = await shown(of, () => ({ after: () => preshade.settled() }));
    const rows = preshade.report();
    texts.push(preshade.text(of.material, of.mesh), preshade.text(of.material));
    preshade.dispose();
    return { lit: litOf(before), differ: differ(before, after, 4), rows, texts };
};
globalThis.ready = true;
