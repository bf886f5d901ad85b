// Passes of three.js that override materials: what each writes by preshade, against the authors' whole programs with only their colour replaced.

import * as THREE from 'three';
import { EffectComposer } from 'three/addons/postprocessing/EffectComposer.js';
import { BokehPass } from 'three/addons/postprocessing/BokehPass.js';
import { GTAOPass } from 'three/addons/postprocessing/GTAOPass.js';
import { OutlinePass } from 'three/addons/postprocessing/OutlinePass.js';
import { OutputPass } from 'three/addons/postprocessing/OutputPass.js';
import { RenderPass } from 'three/addons/postprocessing/RenderPass.js';
import { RenderPixelatedPass } from 'three/addons/postprocessing/RenderPixelatedPass.js';
import { SAOPass } from 'three/addons/postprocessing/SAOPass.js';
import { SSAOPass } from 'three/addons/postprocessing/SSAOPass.js';
import { SSRPass } from 'three/addons/postprocessing/SSRPass.js';
import { Preshade } from 'preshade-three';
import { axes, fence, holed, instanced, lit, standard, wobbling } from './lib/cases.js';
import { colours, depths, differing, picture, settle } from './lib/depths.js';
import { scenarios } from './lib/swapping.js';
import { whole } from './lib/whole.js';

const SIZE = 96;
const renderer = new THREE.WebGLRenderer({ preserveDrawingBuffer: true });
renderer.setSize(SIZE, SIZE);
renderer.shadowMap.enabled = true;
document.body.append(renderer.domElement);

function stage() {
    const scene = new THREE.Scene();
    scene.background = new THREE.Color(0x334455);
    const camera = new THREE.PerspectiveCamera(50, 1, 0.5, 12);
    camera.position.set(0, 2, 6);
    camera.lookAt(0, 0, 0);
    const sun = new THREE.DirectionalLight(0xffffff, 2);
    sun.position.set(2, 4, 3);
    sun.castShadow = true;
    scene.add(sun, new THREE.HemisphereLight());
    const sphere = () => new THREE.SphereGeometry(0.7, 24, 16);
    const add = (object, x, y, z) => scene.add((object.position.set(x, y, z), object));
    const wobble = new THREE.Mesh(sphere(), wobbling(standard()));
    add(wobble, -1.2, 0.6, 0.4);
    add(new THREE.Mesh(sphere(), holed(standard({ side: THREE.DoubleSide }))), 0.5, 0.7, 0.3);
    add(new THREE.Mesh(new THREE.PlaneGeometry(2, 1.4, 8, 8), lit()), 1.5, -0.2, 0);
    add(instanced(wobbling(standard())), 0, -0.8, 0.8);
    add(
        new THREE.Mesh(new THREE.PlaneGeometry(2, 1.4), standard({ map: fence(), alphaTest: 0.5, normalMap: fence() })),
        -1.4,
        -0.4,
        1.4,
    );
    add(new THREE.Mesh(new THREE.BoxGeometry(8, 0.2, 8), standard()), 0, -1.6, 0);
    const proud = standard();
    proud.allowOverride = false;
    add(new THREE.Mesh(new THREE.BoxGeometry(0.5, 0.5, 0.5), proud), 2, 1.4, 0);
    return { scene, camera, selected: [wobble] };
}

const passes = {
    GTAOPass: ({ scene, camera }) => new GTAOPass(scene, camera, SIZE, SIZE),
    SAOPass: ({ scene, camera }) => new SAOPass(scene, camera),
    SSAOPass: ({ scene, camera }) => new SSAOPass(scene, camera, SIZE, SIZE),
    SSRPass: ({ scene, camera, selected }) =>
        new SSRPass({ renderer, scene, camera, width: SIZE, height: SIZE, selects: selected, groundReflector: null }),
    BokehPass: ({ scene, camera }) => new BokehPass(scene, camera, { focus: 5, aperture: 0.01, maxblur: 0.01 }),
    OutlinePass: ({ scene, camera, selected }) =>
        new OutlinePass(new THREE.Vector2(SIZE, SIZE), scene, camera, selected),
    RenderPixelatedPass: ({ scene, camera }) => new RenderPixelatedPass(2, scene, camera),
    'RenderPass with MeshNormalMaterial': ({ scene, camera }) =>
        new RenderPass(scene, camera, new THREE.MeshNormalMaterial()),
    'RenderPass with MeshDepthMaterial': ({ scene, camera }) =>
        new RenderPass(scene, camera, new THREE.MeshDepthMaterial()),
};

/** The renders in which `of(scene)` is true, each read back; `instead` draws in their place. */
function captured(run, instead) {
    const found = [];
    const { render } = renderer;
    renderer.render = (scene, camera) => {
        const isOwn = scene.isScene && (scene.overrideMaterial || swapped(scene));
        if (isOwn && instead) instead(scene, () => render.call(renderer, scene, camera));
        else render.call(renderer, scene, camera);
        const target = isOwn && renderer.getRenderTarget();
        if (!target) return;
        const state = [renderer.getActiveCubeFace(), renderer.getActiveMipmapLevel()];
        found.push({
            colour: colours(renderer, target),
            depth: target.depthTexture ? depths(renderer, target.depthTexture, target) : null,
        });
        renderer.setRenderTarget(target, ...state);
    };
    run();
    renderer.render = render;
    return found;
}

const swapped = (scene) => {
    let some = false;
    scene.traverse(({ _SSRPassBackupMaterial: backup, material }) => (some ||= Boolean(backup && backup !== material)));
    return some;
};

globalThis.runPass = async (name) => {
    const { scene, camera, selected } = stage();
    const composer = new EffectComposer(renderer);
    const pass = passes[name]({ scene, camera, selected });
    composer.addPass(new RenderPass(scene, camera));
    composer.addPass(pass);
    composer.addPass(new OutputPass());
    const render = () => composer.render(0.01);
    render();
    render();
    const threes = captured(render);
    const plain = picture(renderer);
    const wholes = whole(renderer, scene);
    const expected = captured(render, wholes);
    wholes.dispose();
    const preshade = await Preshade.of(renderer, { cache: false });
    const same = preshade.override(pass) === pass;
    await settle(preshade, render);
    const drawn = captured(render);
    const report = preshade.report();
    preshade.dispose();
    const restored = captured(render);
    const after = picture(renderer);
    const count = (a, b, of) => a.map((each, i) => (each[of] && b[i]?.[of] ? differing(each[of], b[i][of]) : 0));
    composer.dispose();
    pass.dispose?.();
    return {
        same,
        renders: drawn.length,
        differ: count(drawn, expected, 'colour'),
        depth: count(drawn, expected, 'depth'),
        moved: count(drawn, threes, 'colour'),
        restored: [...count(restored, threes, 'colour'), differing(plain, after)],
        report,
    };
};
/** The normals of a material that is lit in other axes, or not at all: the largest difference, and how many differ. */
globalThis.runAxes = async (name) => {
    const { scene, camera } = stage();
    for (const child of [...scene.children]) if (child.isMesh) scene.remove(child);
    const mesh = new THREE.Mesh(new THREE.PlaneGeometry(3, 3, 48, 48), axes(name));
    mesh.rotation.set(0.3, 0.5, 0.2);
    scene.add(mesh);
    const pass = passes.GTAOPass({ scene, camera });
    const composer = new EffectComposer(renderer);
    for (const each of [new RenderPass(scene, camera), pass, new OutputPass()]) composer.addPass(each);
    const render = () => composer.render(0.01);
    render();
    render();
    const [threes] = captured(render);
    const wholes = whole(renderer, scene);
    const [expected] = captured(render, wholes);
    wholes.dispose();
    const preshade = await Preshade.of(renderer, { cache: false });
    preshade.override(pass, { name: 'occlusion' });
    await settle(preshade, render);
    const [drawn] = captured(render);
    const [{ state, normals, of, mode }] = preshade.report();
    preshade.dispose();
    const most = drawn.colour.reduce((max, value, i) => Math.max(max, Math.abs(value - expected.colour[i])), 0);
    return {
        state,
        normals,
        called: `${of} ${mode}`,
        most,
        differ: differing(drawn.colour, expected.colour),
        moved: differing(drawn.colour, threes.colour),
    };
};
globalThis.runScenario = (name) => scenarios[name](renderer);
globalThis.names = Object.keys(passes);
globalThis.ready = true;
