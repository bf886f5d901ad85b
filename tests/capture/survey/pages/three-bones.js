// three.js: skinning, morph targets, an animation mixer
// Drawn with WebGL and WebGPU.

import { WebGPURenderer } from 'three/webgpu';
import { canvas, height, isWebgpu, loaded, loop, width } from './common.js';
import { THREE, base, camera, ground, sun, webgl } from './three-common.js';

const renderer = isWebgpu ? new WebGPURenderer({ canvas, antialias: true }) : webgl();
if (isWebgpu) {
    await renderer.init();
    renderer.setSize(width, height, false);
}
renderer.shadowMap.enabled = true;
const scene = base();
const eye = camera();
sun(scene);
ground(scene);

const geometry = new THREE.CylinderGeometry(0.4, 0.6, 3, 16, 12);
const at = geometry.attributes.position;
const [indices, weights] = [[], []];
for (let i = 0; i < at.count; i++) {
    const along = Math.min(2.999, Math.max(0, at.getY(i) + 1.5));
    const bone = Math.floor(along);
    indices.push(bone, bone + 1, 0, 0);
    weights.push(1 - (along - bone), along - bone, 0, 0);
}
geometry.setAttribute('skinIndex', new THREE.Uint16BufferAttribute(indices, 4));
geometry.setAttribute('skinWeight', new THREE.Float32BufferAttribute(weights, 4));
const bones = [0, 1, 2, 3].map((i) => {
    const bone = new THREE.Bone();
    bone.position.y = i ? 1 : -1.5;
    return bone;
});
bones.slice(1).forEach((bone, i) => bones[i].add(bone));
const arm = new THREE.SkinnedMesh(geometry, new THREE.MeshStandardMaterial({ color: 0x66aa77 }));
arm.add(bones[0]);
arm.bind(new THREE.Skeleton(bones));
arm.position.set(-1.4, 1.5, 0);
arm.castShadow = true;
scene.add(arm);

const ball = new THREE.SphereGeometry(0.8, 32, 24);
const target = (shape) => {
    const list = new Float32Array(ball.attributes.position.array);
    for (let i = 0; i < list.length; i += 3) shape(list, i);
    return new THREE.Float32BufferAttribute(list, 3);
};
ball.morphAttributes.position = [
    target((list, i) => (list[i + 1] *= 1.8)),
    target((list, i) => (list[i] *= 1 + 0.5 * Math.sin(list[i + 1] * 9))),
];
const blob = new THREE.Mesh(ball, new THREE.MeshPhongMaterial({ color: 0xcc5577, shininess: 60 }));
blob.morphTargetInfluences = [0.5, 0.5];
blob.position.set(1.4, 1, 0);
blob.castShadow = true;
scene.add(blob);
loaded();
const draw = (step) => {
    bones.slice(1).forEach((bone) => (bone.rotation.z = Math.sin(step * 0.07) * 0.35));
    blob.morphTargetInfluences[0] = 0.5 + 0.5 * Math.sin(step * 0.1);
    renderer.render(scene, eye);
};
if (isWebgpu) {
    let step = 0;
    renderer.setAnimationLoop(() => draw(step++));
} else loop(draw);
