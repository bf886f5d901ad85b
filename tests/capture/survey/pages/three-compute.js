// three.js: TSL, particles in storage buffers moved by compute shaders, instanced sprites
// Drawn with WebGPU.

import * as THREE from 'three/webgpu';
import { Fn, color, float, hash, instanceIndex, instancedArray, mix, time, uniform, vec3 } from 'three/tsl';
import { canvas, height, loaded, width } from './common.js';

const COUNT = 2000;
const renderer = new THREE.WebGPURenderer({ canvas, antialias: true });
await renderer.init();
renderer.setSize(width, height, false);
const scene = new THREE.Scene();
scene.background = new THREE.Color(0x0a0c14);
const eye = new THREE.PerspectiveCamera(50, width / height, 0.1, 50);
eye.position.set(0, 2, 6);
eye.lookAt(0, 0, 0);
const positions = instancedArray(COUNT, 'vec3');
const velocities = instancedArray(COUNT, 'vec3');
const pull = uniform(0.004);
const place = Fn(() => {
    const seed = instanceIndex;
    positions.element(instanceIndex).assign(vec3(hash(seed), hash(seed.add(1)), hash(seed.add(2))).sub(0.5).mul(4));
    velocities.element(instanceIndex).assign(vec3(0));
})().compute(COUNT);
const move = Fn(() => {
    const at = positions.element(instanceIndex);
    const speed = velocities.element(instanceIndex);
    speed.addAssign(at.cross(vec3(0, 0.003, 0)).sub(at.normalize().mul(pull)));
    speed.mulAssign(0.99);
    at.addAssign(speed);
})().compute(COUNT);
const material = new THREE.SpriteNodeMaterial({ transparent: true, blending: THREE.AdditiveBlending, depthWrite: false });
material.positionNode = positions.toAttribute();
material.scaleNode = float(0.06);
material.colorNode = mix(color(0x3366ff), color(0xff7733), velocities.toAttribute().length().mul(20));
const sprites = new THREE.Sprite(material);
sprites.count = COUNT;
sprites.frustumCulled = false;
scene.add(sprites);
const glowing = new THREE.MeshStandardNodeMaterial({ roughness: 0.4 });
glowing.colorNode = vec3(0.2, 0.4, 0.8).add(time.sin().mul(0.1));
scene.add(new THREE.Mesh(new THREE.IcosahedronGeometry(0.7, 4), glowing), new THREE.HemisphereLight(0xffffff, 0x333333, 3));
renderer.compute(place);
loaded();
renderer.setAnimationLoop(() => {
    renderer.compute(move);
    renderer.render(scene, eye);
});
