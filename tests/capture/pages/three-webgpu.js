import { WebGPURenderer, PCFShadowMap } from 'three/webgpu';
import { makeScene } from './three-scene.js';

const renderer = new WebGPURenderer({ canvas: document.getElementById('canvas'), antialias: true });
renderer.setSize(320, 240, false);
renderer.shadowMap.enabled = true;
renderer.shadowMap.type = PCFShadowMap;
const { scene, camera, animate } = makeScene();
let step = 0;
renderer.setAnimationLoop(() => {
    animate(step++);
    renderer.render(scene, camera);
    globalThis.ready = step > 3;
});
