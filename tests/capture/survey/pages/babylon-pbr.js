// Babylon.js: PBR, cascaded and blurred shadows, glow layer, fog, instances
// Drawn with WebGL and WebGPU.

import { bumps, checks } from './common.js';
import { B, run, start, texture } from './babylon-common.js';

const { engine, scene, camera } = await start();
scene.clearColor = new B.Color4(0.1, 0.15, 0.25, 1);
scene.fogMode = B.Scene.FOGMODE_EXP2;
scene.fogDensity = 0.02;
const sun = new B.DirectionalLight('sun', new B.Vector3(-1, -2, -1), scene);
sun.position = new B.Vector3(6, 10, 6);
sun.intensity = 3;
const lamp = new B.SpotLight('lamp', new B.Vector3(3, 5, 0), new B.Vector3(-0.5, -1, 0), 1, 2, scene);
lamp.intensity = 60;
new B.HemisphericLight('sky', B.Vector3.Up(), scene).intensity = 0.4;
const shadows = new B.CascadedShadowGenerator(256, sun);
shadows.numCascades = 2;
shadows.shadowMaxZ = 20;
const soft = new B.ShadowGenerator(256, lamp);
soft.useBlurExponentialShadowMap = true;
const ground = B.MeshBuilder.CreateGround('ground', { width: 12, height: 12 }, scene);
const stone = new B.PBRMaterial('stone', scene);
stone.albedoTexture = texture(scene, checks());
stone.bumpTexture = texture(scene, bumps());
stone.metallic = 0;
stone.roughness = 0.8;
ground.material = stone;
ground.receiveShadows = true;
const knot = B.MeshBuilder.CreateTorusKnot('knot', { radius: 0.8, tube: 0.28, radialSegments: 96 }, scene);
knot.position.y = 1.6;
const metal = new B.PBRMaterial('metal', scene);
Object.assign(metal, { metallic: 0.6, roughness: 0.35, albedoColor: new B.Color3(0.8, 0.4, 0.2) });
metal.clearCoat.isEnabled = true;
metal.sheen.isEnabled = true;
knot.material = metal;
knot.receiveShadows = true;
const box = B.MeshBuilder.CreateBox('box', { size: 0.5 }, scene);
const glowing = new B.StandardMaterial('glowing', scene);
glowing.emissiveColor = new B.Color3(0.2, 0.6, 1);
box.material = glowing;
box.position.set(2.5, 0.4, 0);
for (let i = 1; i < 10; i++) {
    const instance = box.createInstance(`box ${i}`);
    instance.position.set(Math.cos(i * 0.63) * 2.5, 0.4, Math.sin(i * 0.63) * 2.5);
    shadows.addShadowCaster(instance);
}
for (const generator of [shadows, soft]) {
    generator.addShadowCaster(knot);
    generator.addShadowCaster(box);
}
new B.GlowLayer('glow', scene, { mainTextureFixedSize: 128 });
run(engine, scene, (step) => (knot.rotation.y = step * 0.05));
