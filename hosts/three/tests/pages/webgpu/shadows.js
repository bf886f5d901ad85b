// Shadow maps of one object: three.js' own, preshade's, and the author's whole program drawn from the light.

import * as THREE from 'three/webgpu';
import { Preshade } from 'preshade-three';
import { CHANGES, MATERIALS, SIZE, depths, differ, frame, renderer as make, scene as sceneOf, settle } from './kit.js';

const renderer = await make();
const preshade = await Preshade.of(renderer, { cache: false });

/** The author's own material, lit but without shadows, from the cameras of the light's map. */
async function whole({ scene, mesh, ground, material }, cameras) {
    const parent = mesh.parent;
    const alone = new THREE.Scene();
    alone.add(parent === scene ? mesh : parent, new THREE.DirectionalLight());
    // What receives a VSM shadow is drawn into its map too, from behind.
    if (renderer.shadowMap.type === THREE.VSMShadowMap) alone.add(ground);
    if (material.maskShadowNode) material.maskNode = material.maskShadowNode;
    if (material.castShadowPositionNode) material.positionNode = material.castShadowPositionNode;
    material.needsUpdate = true;
    const found = [];
    for (const camera of cameras) {
        const target = new THREE.RenderTarget(SIZE, SIZE, { depthTexture: new THREE.DepthTexture(SIZE, SIZE) });
        renderer.setRenderTarget(target);
        renderer.render(alone, camera);
        renderer.setRenderTarget(null);
        found.push(await depths(renderer, target.depthTexture));
        target.dispose();
    }
    return found;
}

async function maps({ sun }, count) {
    const texture = sun.shadow.map.depthTexture;
    const found = [];
    for (let layer = 0; layer < count; layer++) found.push(await depths(renderer, texture, layer));
    return found;
}

/** Depths that differ from those of the whole program: of three.js, and of preshade. */
globalThis.compare = async (options) => {
    const of = sceneOf(options);
    const { scene, camera, sun, ground, material } = of;
    // three.js draws a shadow map ahead of the first object that receives it, so here ahead of what casts it.
    ground.renderOrder = -1;
    const change = CHANGES[options.change];
    change?.(of, false);
    const cameras = [];
    const { render } = Object.getPrototypeOf(renderer);
    renderer.render = function (drawn, by) {
        if (by === sun.shadow.camera) cameras.push(by.clone());
        return render.apply(this, arguments);
    };
    const draw = () => renderer.render(scene, camera);
    if (options.update) Object.assign(sun.shadow, { autoUpdate: false, needsUpdate: true });
    draw();
    const faces = cameras.length;
    let three = await maps(of, faces);
    if (options.update) sun.shadow.needsUpdate = true;
    const part = preshade.shadows(scene, { view: options.view });
    await settle(preshade, draw);
    await frame();
    if (change) {
        change(of, true);
        sun.shadow.needsUpdate = true;
        await settle(preshade, draw);
        await frame();
    }
    if (!options.update) cameras.length = 0;
    draw();
    const ours = await maps(of, faces);
    if (change) {
        part.enabled = false;
        sun.shadow.needsUpdate = true;
        await frame();
        draw();
        three = await maps(of, faces);
    }
    delete renderer.render;
    part.enabled = true;
    const own = preshade.report().filter(({ uuid }) => uuid === material.uuid);
    const rows = own.map((row) => ({ ...row, left_out: row.left_out }));
    const truth = await whole(of, cameras.slice(0, faces));
    const sum = (maps) => maps.reduce((count, map, i) => count + differ(map, truth[i]), 0);
    const clear = renderer.reversedDepthBuffer ? 0 : 1;
    const drawn = truth.reduce((count, map) => count + map.filter((depth) => depth !== clear).length, 0);
    part.dispose();
    scene.traverse((object) => object.geometry?.dispose());
    material.dispose();
    return { three: sum(three), ours: sum(ours), drawn, faces, rows };
};

/** Maps drawn on demand that nobody asks for: preshade comes, is switched off and on, and goes. */
globalThis.switched = async (options) => {
    const of = sceneOf(options);
    const { scene, camera, sun, ground } = of;
    ground.renderOrder = -1;
    const draw = () => renderer.render(scene, camera);
    const shown = async () => {
        await settle(preshade, draw);
        return (await maps(of, 1))[0];
    };
    Object.assign(sun.shadow, { autoUpdate: false, needsUpdate: true });
    const three = await shown();
    const part = preshade.shadows(scene);
    const ours = await shown();
    part.enabled = false;
    const off = await shown();
    part.enabled = true;
    const on = await shown();
    part.dispose();
    const disposed = await shown();
    return {
        differ: differ(three, ours),
        wrong: { off: differ(off, three), on: differ(on, ours), disposed: differ(disposed, three) },
    };
};
globalThis.materials = Object.keys(MATERIALS);
globalThis.ready = true;
