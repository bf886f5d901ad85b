// three.js: VSM shadows of directional, spot and point lights, cookies, normal maps
// Drawn with WebGL.

import { bumps, checks, loaded, loop } from './common.js';
import { THREE, base, boxes, camera, ground, knot, sun, texture, webgl } from './three-common.js';

const renderer = webgl();
renderer.shadowMap.enabled = true;
renderer.shadowMap.type = THREE.VSMShadowMap;
const scene = base(0x101820);
scene.fog = new THREE.FogExp2(0x101820, 0.05);
const eye = camera();
sun(scene).intensity = 0.7;
const point = new THREE.PointLight(0xffaa66, 20, 20);
point.position.set(-2, 2.5, 1);
point.castShadow = true;
point.shadow.mapSize.set(128, 128);
const spot = new THREE.SpotLight(0x88aaff, 60, 20, 0.5, 0.4);
spot.position.set(3, 5, 3);
spot.castShadow = true;
spot.map = texture(checks('#fff', '#f40'));
scene.add(point, spot, spot.target);
const relief = new THREE.CanvasTexture(bumps());
relief.wrapS = relief.wrapT = THREE.RepeatWrapping;
relief.repeat.set(6, 6);
ground(scene, { normalMap: relief, roughness: 0.5 });
boxes(scene);
const turning = knot(scene);
loaded();
loop((step) => {
    turning.rotation.y = step * 0.05;
    point.position.x = -2 + Math.sin(step * 0.1) * 0.5;
    renderer.render(scene, eye);
});
