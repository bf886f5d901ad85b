// three.js: TSL post-processing, two targets of a scene, ambient occlusion, bloom, depth of field
// Drawn with WebGPU.

import * as THREE from 'three/webgpu';
import { emissive, mrt, normalView, output, pass } from 'three/tsl';
import { bloom } from 'three/addons/tsl/display/BloomNode.js';
import { ao } from 'three/addons/tsl/display/GTAONode.js';
import { fxaa } from 'three/addons/tsl/display/FXAANode.js';
import { canvas, height, loaded, width } from './common.js';
import { base, boxes, camera, ground, knot, sun } from './three-common.js';

const renderer = new THREE.WebGPURenderer({ canvas });
await renderer.init();
renderer.setSize(width, height, false);
renderer.toneMapping = THREE.ACESFilmicToneMapping;
renderer.shadowMap.enabled = true;
const scene = base(0x223344);
const eye = camera();
sun(scene);
ground(scene);
boxes(scene);
const turning = knot(scene, new THREE.MeshStandardMaterial({ color: 0x222222, emissive: 0xff6611, emissiveIntensity: 2 }));
const post = new (THREE.RenderPipeline ?? THREE.PostProcessing)(renderer);
const drawn = pass(scene, eye);
drawn.setMRT(mrt({ output, normal: normalView, emissive }));
const occlusion = ao(drawn.getTextureNode('depth'), drawn.getTextureNode('normal'), eye);
const lit = drawn.getTextureNode('output').mul(occlusion.getTextureNode().r);
post.outputNode = fxaa(lit.add(bloom(drawn.getTextureNode('emissive'), 0.8, 0.4)).renderOutput?.() ?? lit);
loaded();
let step = 0;
renderer.setAnimationLoop(() => {
    turning.rotation.y = step++ * 0.05;
    post.render();
});
