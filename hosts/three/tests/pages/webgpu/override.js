// A pass that overrides materials: three.js' own, preshade's, and the author's whole program with the override's colour.

import * as THREE from 'three/webgpu';
import { Fn, colorSpaceToWorking, normalView, packNormalToRGB, vec4 } from 'three/tsl';
import { Preshade } from 'preshade-three';
import { CHANGES, MATERIALS, SIZE, depths, differ, renderer as make, scene as sceneOf, settle } from './kit.js';

const renderer = await make();
const preshade = await Preshade.of(renderer, { cache: false });
const targets = {};
for (const name of ['three', 'ours', 'truth'])
    targets[name] = new THREE.RenderTarget(SIZE, SIZE, { depthTexture: new THREE.DepthTexture(SIZE, SIZE) });

const packed = () => colorSpaceToWorking(vec4(packNormalToRGB(normalView), 1), THREE.SRGBColorSpace);
const OVERRIDES = {
    normal: () => new THREE.MeshNormalMaterial({ side: THREE.DoubleSide }),
    color: () => new THREE.MeshBasicMaterial({ color: 0xff0000, side: THREE.DoubleSide }),
};
const WRITES = { normal: packed, color: () => vec4(1, 0, 0, 1) };

async function picture(scene, camera, target) {
    renderer.setRenderTarget(target);
    renderer.render(scene, camera);
    renderer.setRenderTarget(null);
    const pixels = new Uint8Array(await renderer.readRenderTargetPixelsAsync(target, 0, 0, SIZE, SIZE));
    return { pixels, depths: await depths(renderer, target.depthTexture) };
}

globalThis.compare = async ({ override = 'normal', ...options }) => {
    const of = sceneOf(options);
    const { scene, camera, sun, mesh, ground, material } = of;
    const change = CHANGES[options.change];
    sun.castShadow = false;
    ground.visible = false;
    scene.overrideMaterial = OVERRIDES[override]();
    // As it is in the end.
    change?.(of, true);
    const three = await picture(scene, camera, targets.three);
    change?.(of, false);
    const draw = () => picture(scene, camera, targets.ours);
    preshade.override(scene);
    await settle(preshade, draw, 3);
    if (change) {
        change(of, true);
        await settle(preshade, draw, 3);
    }
    const ours = await picture(scene, camera, targets.ours);
    const rows = preshade.report().filter(({ uuid }) => uuid === material.uuid);
    preshade.override(scene, false);
    const left = preshade.report().length;
    const undone = await picture(scene, camera, targets.ours);
    scene.overrideMaterial.dispose();
    scene.overrideMaterial = null;
    // By hand: the author's output is what decides about holes.
    const value = WRITES[override]();
    const before = (node) => Fn(() => (vec4(node).toVar().toStack(), value))();
    if (material.fragmentNode) material.fragmentNode = before(material.fragmentNode);
    else material.outputNode = material.outputNode ? before(material.outputNode) : value;
    material.needsUpdate = true;
    const truth = await picture(scene, camera, targets.truth);
    mesh.geometry.dispose();
    material.dispose();
    const depthsOf = (of) => differ(of.depths, truth.depths);
    const pixelsOf = (of) => differ(of.pixels, truth.pixels, 4, 3);
    return {
        three: { depths: depthsOf(three), pixels: pixelsOf(three) },
        ours: { depths: depthsOf(ours), pixels: pixelsOf(ours) },
        drawn: truth.depths.filter((depth) => depth !== 1).length,
        undone: differ(undone.depths, three.depths) + differ(undone.pixels, three.pixels, 4, 3),
        rows,
        left,
    };
};

/** Rows of one override material in two scenes: as they are at first, renamed, undone, and used again. */
globalThis.named = async () => {
    const override = OVERRIDES.normal();
    const all = ['first', 'second'].map((name) => {
        const of = sceneOf({ material: 'vertexNode' });
        of.sun.castShadow = of.ground.visible = false;
        of.scene.overrideMaterial = override;
        preshade.override(of.scene, { name });
        return of;
    });
    const names = async () => {
        for (const { scene, camera } of all) await picture(scene, camera, targets.ours);
        return preshade.report().map(({ of, state }) => `${of} ${state}`);
    };
    const [{ scene }] = all;
    const objects = () => renderer._objects._renderObjects.size;
    const [before, first] = [objects(), await names()];
    const made = objects() - before;
    preshade.override(scene, { name: 'third' });
    const renamed = await names();
    preshade.override(scene, false);
    const left = objects() - before;
    const undone = await names();
    preshade.override(scene, { name: 'fourth' });
    const again = await names();
    override.dispose();
    const disposed = preshade.report();
    for (const { scene, mesh } of all) {
        preshade.override(scene, false);
        mesh.geometry.dispose();
        mesh.material.dispose();
    }
    return { first, renamed, undone, again, disposed, made, left };
};
globalThis.refusesNormals = () => {
    try {
        preshade.override(new THREE.Scene(), { normals: 'faces' });
    } catch ({ message }) {
        return message;
    }
};
globalThis.materials = Object.keys(MATERIALS);
globalThis.ready = true;
