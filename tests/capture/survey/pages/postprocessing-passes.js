// postprocessing: bloom, depth of field, tone mapping, SMAA in one pass
// Drawn with WebGL.

import { BloomEffect, DepthOfFieldEffect, EffectComposer, EffectPass, RenderPass, SMAAEffect, ToneMappingEffect, VignetteEffect } from 'postprocessing';
import { loaded, loop } from './common.js';
import { THREE, base, boxes, camera, ground, knot, sun, webgl } from './three-common.js';

const renderer = webgl({ antialias: false, stencil: false, depth: false });
renderer.toneMapping = THREE.NoToneMapping;
renderer.shadowMap.enabled = true;
const scene = base(0x223344);
const eye = camera();
sun(scene);
ground(scene);
boxes(scene);
const turning = knot(scene, new THREE.MeshStandardMaterial({ color: 0x222222, emissive: 0xff6611, emissiveIntensity: 2 }));
const composer = new EffectComposer(renderer, { frameBufferType: THREE.HalfFloatType, multisampling: 4 });
composer.addPass(new RenderPass(scene, eye));
composer.addPass(new EffectPass(eye, new BloomEffect({ mipmapBlur: true, luminanceThreshold: 0.8 }), new DepthOfFieldEffect(eye, { focusDistance: 0.06, bokehScale: 2 })));
composer.addPass(new EffectPass(eye, new SMAAEffect(), new VignetteEffect(), new ToneMappingEffect()));
loaded();
loop((step) => {
    turning.rotation.y = step * 0.05;
    composer.render(1 / 60);
});
