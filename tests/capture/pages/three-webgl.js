import { WebGLRenderer, PCFShadowMap } from 'three';
import { makeScene } from './three-scene.js';

const renderer = new WebGLRenderer({ canvas: document.getElementById('canvas'), antialias: true });
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
