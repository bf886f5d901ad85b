// A small scene with a wobbling caster, for pages that change. Workers are counted.

import * as THREE from 'three';
import { Preshade } from 'preshade-three';
import { standard, wobbling } from './cases.js';
import { differing, reference, shadowDepths } from './depths.js';

const SIZE = 96;
export const workers = { made: 0, ended: 0 };
const { Worker } = globalThis;
globalThis.Worker = class extends Worker {
    constructor(...given) {
        super(...given);
        workers.made++;
    }
    terminate() {
        workers.ended++;
        super.terminate();
    }
};

export const renderer = new THREE.WebGLRenderer({ preserveDrawingBuffer: true });
renderer.setSize(SIZE, SIZE);
renderer.shadowMap.enabled = true;
document.body.append(renderer.domElement);
export const sphere = new THREE.SphereGeometry(0.8, 24, 16);
const plane = new THREE.PlaneGeometry(12, 12);
const white = new THREE.MeshLambertMaterial();

export function stage() {
    const scene = new THREE.Scene();
    const camera = new THREE.PerspectiveCamera(50, 1, 0.1, 30);
    camera.position.set(0, 3, 6);
    camera.lookAt(0, 0.5, 0);
    const ground = new THREE.Mesh(plane, white);
    ground.rotation.x = -Math.PI / 2;
    ground.position.y = -1.2;
    ground.receiveShadow = true;
    const light = new THREE.DirectionalLight(0xffffff, 2);
    light.position.set(2, 4, 2.5);
    light.castShadow = true;
    light.shadow.mapSize.set(SIZE, SIZE);
    Object.assign(light.shadow.camera, { left: -4, right: 4, top: 4, bottom: -4, far: 30 });
    const material = wobbling(standard());
    const mesh = new THREE.Mesh(sphere, material);
    mesh.castShadow = true;
    scene.add(ground, light, mesh);
    const render = () => renderer.render(scene, camera);
    const differ = () => differing(shadowDepths(renderer, light), reference(renderer, scene, light));
    return { scene, camera, ground, light, material, mesh, render, differ };
}

export const open = () => Preshade.of(renderer, { cache: false });
export const states = (preshade) => preshade.report().map(({ state }) => state);
