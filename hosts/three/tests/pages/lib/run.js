// One scene: its shadow maps without preshade, with it, and by the authors' whole programs.

import * as THREE from 'three';
import { Preshade } from 'preshade-three';
import { differing, picture, reference, sentinel, settle, shadowDepths } from './depths.js';

const SIZE = 96;

/** Newer than some versions of three.js. */
export const { SunLight } = new THREE.DirectionalLight().shadow.getCamera
    ? await import('three/addons/lights/SunLight.js')
    : {};

export function open(options) {
    const renderer = new THREE.WebGLRenderer({ preserveDrawingBuffer: true, ...options });
    renderer.setSize(SIZE, SIZE);
    renderer.shadowMap.enabled = true;
    document.body.append(renderer.domElement);
    return renderer;
}

/** A scene with a ground, lights and what the case adds. */
function stage(renderer, { lights = ['directional'], add }) {
    const scene = new THREE.Scene();
    const camera = new THREE.PerspectiveCamera(50, 1, 0.1, 30);
    camera.position.set(0, 3, 6);
    camera.lookAt(0, 0.5, 0);
    const ground = new THREE.Mesh(new THREE.PlaneGeometry(12, 12), new THREE.MeshLambertMaterial());
    ground.rotation.x = -Math.PI / 2;
    ground.position.y = -1.2;
    ground.receiveShadow = true;
    scene.add(ground, camera);
    const made = lights.map((kind) => {
        const light = {
            directional: () => new THREE.DirectionalLight(0xffffff, 2),
            spot: () => new THREE.SpotLight(0xffffff, 60, 20, 0.7),
            sun: () => new SunLight(0xffffff, 2),
            point: () => new THREE.PointLight(0xffffff, 40, 20),
        }[kind]();
        light.position.set(2, 4, 2.5);
        if (kind === 'point') light.position.set(0.3, 0.4, 0.2);
        light.castShadow = true;
        light.shadow.mapSize.set(SIZE, SIZE);
        if (kind === 'directional')
            Object.assign(light.shadow.camera, { left: -4, right: 4, top: 4, bottom: -4, far: 20 });
        scene.add(light);
        return light;
    });
    const objects = [add(scene, camera, renderer)].flat();
    for (const object of objects) {
        object.castShadow = true;
        scene.add(object);
    }
    return { scene, camera, lights: made, ground, objects };
}

/** Draws the case without and with preshade, and compares. */
export async function run(renderer, of) {
    const { scene, camera, lights, ground, objects } = stage(renderer, of);
    Object.assign(renderer, { localClippingEnabled: false, clippingPlanes: [] }, of.renderer);
    renderer.shadowMap.type = of.type ?? THREE.PCFShadowMap;
    const render = () => renderer.render(scene, camera);
    const copies = of.type === THREE.VSMShadowMap ? lights.map((light) => sentinel(renderer, scene, light)) : null;
    const read = (light) => (copies ? copies[lights.indexOf(light)].read() : shadowDepths(renderer, light));
    const alone = (draw) => {
        ground.visible = false;
        draw();
        ground.visible = true;
        return picture(renderer);
    };
    render();
    render();
    const before = lights.map((light) => read(light));
    const own = alone(render);
    const preshade = await Preshade.of(renderer, { cache: false });
    preshade.shadows(scene, of.options);
    await settle(preshade, render);
    const found = lights.map((light) => {
        render();
        const drawn = read(light);
        return { drawn, whole: reference(renderer, scene, light) };
    });
    const after = alone(render);
    const result = {
        // Texels that something was drawn to: the others are as the map is cleared.
        covered: found.map(({ drawn }) => drawn.filter((depth) => depth > 0 && depth < 1).length),
        texels: found.reduce((sum, { drawn }) => sum + drawn.length, 0),
        differ: found.map(({ drawn, whole }) => differing(drawn, whole)),
        moved: found.map(({ drawn }, i) => differing(drawn, before[i])),
        picture: differing(own, after),
        report: preshade.report(),
    };
    preshade.dispose();
    render();
    result.restored = lights.map((light, i) => differing(read(light), before[i]));
    scene.traverse((object) => {
        object.geometry?.dispose();
        for (const material of [object.material ?? []].flat()) material.dispose();
        object.dispose?.();
    });
    result.programs = renderer.info.programs.length;
    return result;
}
