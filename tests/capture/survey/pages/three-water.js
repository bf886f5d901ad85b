// three.js: sky, water with a planar reflection, a reflector, a cube camera
// Drawn with WebGL.

import { Reflector } from 'three/addons/objects/Reflector.js';
import { Sky } from 'three/addons/objects/Sky.js';
import { Water } from 'three/addons/objects/Water.js';
import { bumps, loaded, loop } from './common.js';
import { THREE, camera, knot, sun, webgl } from './three-common.js';

const renderer = webgl();
const scene = new THREE.Scene();
const eye = camera([4, 2, 7]);
const light = sun(scene);
const sky = new Sky();
sky.scale.setScalar(90);
sky.material.uniforms.sunPosition.value.set(3, 1, -6);
scene.add(sky);
const waves = new THREE.CanvasTexture(bumps());
waves.wrapS = waves.wrapT = THREE.RepeatWrapping;
const water = new Water(new THREE.PlaneGeometry(60, 60), {
    textureWidth: 256,
    textureHeight: 256,
    waterNormals: waves,
    sunDirection: light.position.clone().normalize(),
    sunColor: 0xffffff,
    waterColor: 0x114433,
    distortionScale: 2,
});
water.rotation.x = -Math.PI / 2;
scene.add(water);
const mirror = new Reflector(new THREE.PlaneGeometry(3, 2), { textureWidth: 256, textureHeight: 256, multisample: 4 });
mirror.position.set(-2.4, 1.2, -2);
mirror.rotation.y = 0.6;
scene.add(mirror);
const cube = new THREE.WebGLCubeRenderTarget(64, { generateMipmaps: true, minFilter: THREE.LinearMipmapLinearFilter });
const probe = new THREE.CubeCamera(0.1, 50, cube);
probe.position.set(2, 1.2, 0);
const ball = new THREE.Mesh(
    new THREE.SphereGeometry(0.8, 32, 24),
    new THREE.MeshBasicMaterial({ envMap: cube.texture }),
);
ball.position.copy(probe.position);
scene.add(ball, probe);
const turning = knot(scene);
loaded();
loop((step) => {
    turning.rotation.y = step * 0.05;
    water.material.uniforms.time.value = step / 60;
    ball.visible = false;
    probe.update(renderer, scene);
    ball.visible = true;
    renderer.render(scene, eye);
});
