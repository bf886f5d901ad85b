// three.js: `WebGPURenderer` with shadows of three lights, instances, points, lines and LOD
// Drawn with WebGPU.

import * as THREE from 'three/webgpu';
import { canvas, height, loaded, random, width } from './common.js';
import { base, boxes, camera, ground, knot, sun } from './three-common.js';

const renderer = new THREE.WebGPURenderer({ canvas, antialias: true });
await renderer.init();
renderer.setSize(width, height, false);
renderer.shadowMap.enabled = true;
const scene = base(0x203040);
scene.fog = new THREE.Fog(0x203040, 6, 20);
const eye = camera();
sun(scene).intensity = 1;
const point = new THREE.PointLight(0xffaa66, 20, 20);
point.position.set(-2, 2.5, 1);
point.castShadow = true;
point.shadow.mapSize.set(128, 128);
const spot = new THREE.SpotLight(0x88aaff, 60, 20, 0.5, 0.4);
spot.position.set(3, 5, 3);
spot.castShadow = true;
scene.add(point, spot, spot.target);
ground(scene);
boxes(scene);
const turning = knot(scene, new THREE.MeshPhysicalMaterial({ color: 0xcc6633, clearcoat: 1, roughness: 0.4 }));
const next = random(7);
const cloud = new THREE.BufferGeometry();
cloud.setAttribute('position', new THREE.Float32BufferAttribute(Array.from({ length: 600 }, () => next() * 6 - 3), 3));
scene.add(new THREE.Points(cloud, new THREE.PointsMaterial({ color: 0xffeeaa })));
scene.add(
    new THREE.LineSegments(
        new THREE.EdgesGeometry(new THREE.BoxGeometry(2, 2, 2)),
        new THREE.LineBasicMaterial({ color: 0xffffff }),
    ),
);
const glass = new THREE.Mesh(
    new THREE.SphereGeometry(0.6, 24, 16),
    new THREE.MeshPhongMaterial({ color: 0x66ccff, transparent: true, opacity: 0.5, side: THREE.DoubleSide }),
);
glass.position.set(1.8, 0.7, 1.4);
scene.add(glass);
loaded();
let step = 0;
renderer.setAnimationLoop(() => {
    turning.rotation.y = step++ * 0.05;
    renderer.render(scene, eye);
});
