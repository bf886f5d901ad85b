// three.js: physical materials (transmission, clearcoat, sheen, iridescence, anisotropy) in a prefiltered room
// Drawn with WebGL and WebGPU.

import { WebGPURenderer, PMREMGenerator } from 'three/webgpu';
import { RoomEnvironment } from 'three/addons/environments/RoomEnvironment.js';
import { canvas, checks, height, isWebgpu, loaded, loop, width } from './common.js';
import { THREE, camera, room, texture, webgl } from './three-common.js';

const renderer = isWebgpu ? new WebGPURenderer({ canvas, antialias: true }) : webgl();
const scene = new THREE.Scene();
if (isWebgpu) {
    await renderer.init();
    renderer.setSize(width, height, false);
    renderer.toneMapping = THREE.ACESFilmicToneMapping;
    scene.environment = new PMREMGenerator(renderer).fromScene(new RoomEnvironment(), 0.04).texture;
} else room(scene, renderer);
scene.background = texture(checks('#345', '#a86'), 1);
const eye = camera([0, 1, 7], [0, 0, 0]);
const light = new THREE.DirectionalLight(0xffffff, 2);
light.position.set(2, 4, 5);
scene.add(light);
const kinds = [
    { transmission: 1, thickness: 0.6, roughness: 0.1, ior: 1.5 },
    { color: 0x992211, clearcoat: 1, clearcoatRoughness: 0.1, roughness: 0.6 },
    { color: 0x224488, sheen: 1, sheenColor: 0xffffff, sheenRoughness: 0.4, roughness: 0.9 },
    { color: 0x888888, metalness: 1, roughness: 0.25, iridescence: 1, iridescenceIOR: 1.8 },
    { color: 0xccaa55, metalness: 1, roughness: 0.4, anisotropy: 0.9 },
    { transmission: 0.9, thickness: 1, attenuationColor: 0x33aa66, attenuationDistance: 0.5, roughness: 0.3, dispersion: 2 },
];
const balls = kinds.map((kind, i) => {
    const ball = new THREE.Mesh(new THREE.SphereGeometry(0.8, 32, 24), new THREE.MeshPhysicalMaterial(kind));
    ball.position.set((i % 3) * 2 - 2, i < 3 ? 1 : -1, 0);
    scene.add(ball);
    return ball;
});
loaded();
const draw = (step) => {
    balls.forEach((ball, i) => (ball.position.z = Math.sin(step * 0.05 + i) * 0.3));
    renderer.render(scene, eye);
};
if (isWebgpu) {
    let step = 0;
    renderer.setAnimationLoop(() => draw(step++));
} else loop(draw);
