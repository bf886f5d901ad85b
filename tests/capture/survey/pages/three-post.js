// three.js: `EffectComposer` with GTAO, bloom and SMAA
// Drawn with WebGL.

import { EffectComposer } from 'three/addons/postprocessing/EffectComposer.js';
import { GTAOPass } from 'three/addons/postprocessing/GTAOPass.js';
import { OutputPass } from 'three/addons/postprocessing/OutputPass.js';
import { RenderPass } from 'three/addons/postprocessing/RenderPass.js';
import { SMAAPass } from 'three/addons/postprocessing/SMAAPass.js';
import { UnrealBloomPass } from 'three/addons/postprocessing/UnrealBloomPass.js';
import { height, loaded, loop, width } from './common.js';
import { THREE, base, boxes, camera, ground, knot, sun, webgl } from './three-common.js';

const renderer = webgl({ antialias: false });
renderer.shadowMap.enabled = true;
const scene = base(0x223344);
const eye = camera();
sun(scene);
ground(scene);
boxes(scene);
const turning = knot(scene, new THREE.MeshStandardMaterial({ color: 0x222222, emissive: 0xff6611, emissiveIntensity: 2 }));
const composer = new EffectComposer(renderer);
composer.addPass(new RenderPass(scene, eye));
composer.addPass(new GTAOPass(scene, eye, width, height));
composer.addPass(new UnrealBloomPass(new THREE.Vector2(width, height), 0.6, 0.4, 0.9));
composer.addPass(new OutputPass());
composer.addPass(new SMAAPass());
loaded();
loop((step) => {
    turning.rotation.y = step * 0.05;
    composer.render(1 / 60);
});
