// n8ao: ambient occlusion with its denoiser in three.js's composer
// Drawn with WebGL.

import { EffectComposer } from 'three/addons/postprocessing/EffectComposer.js';
import { N8AOPass } from 'n8ao';
import { height, loaded, loop, width } from './common.js';
import { base, boxes, camera, ground, knot, sun, webgl } from './three-common.js';

const renderer = webgl({ antialias: false });
renderer.shadowMap.enabled = true;
const scene = base();
const eye = camera();
sun(scene);
ground(scene);
boxes(scene);
const turning = knot(scene);
const composer = new EffectComposer(renderer);
const pass = new N8AOPass(scene, eye, width, height);
pass.configuration.aoRadius = 1;
pass.configuration.intensity = 4;
composer.addPass(pass);
loaded();
loop((step) => {
    turning.rotation.y = step * 0.05;
    composer.render();
});
