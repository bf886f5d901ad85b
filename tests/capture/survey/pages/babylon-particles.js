// Babylon.js: particles, sprites, thin instances, morph targets, bones, points, lines, decals
// Drawn with WebGL and WebGPU.

import { checks, random, spot } from './common.js';
import { B, run, start, texture } from './babylon-common.js';

const { engine, scene } = await start();
const next = random(5);
new B.HemisphericLight('sky', B.Vector3.Up(), scene);
const many = B.MeshBuilder.CreateIcoSphere('many', { radius: 0.15, subdivisions: 1 }, scene);
const matrices = new Float32Array(16 * 100);
const colors = new Float32Array(4 * 100);
for (let i = 0; i < 100; i++) {
    B.Matrix.Translation(next() * 6 - 3, next() * 3, next() * 6 - 3).copyToArray(matrices, i * 16);
    colors.set([next(), next(), next(), 1], i * 4);
}
many.thinInstanceSetBuffer('matrix', matrices, 16);
many.thinInstanceSetBuffer('color', colors, 4);
const shape = B.MeshBuilder.CreateSphere('shape', { diameter: 1.4, updatable: true }, scene);
const wide = B.MeshBuilder.CreateSphere('wide', { diameter: 1.4, updatable: true }, scene);
wide.scaling.set(1.6, 0.5, 1.6);
wide.bakeCurrentTransformIntoVertices();
wide.setEnabled(false);
const manager = new B.MorphTargetManager(scene);
const target = B.MorphTarget.FromMesh(wide, 'wide', 0.3);
manager.addTarget(target);
shape.morphTargetManager = manager;
shape.position.y = 1.2;
const paint = new B.StandardMaterial('paint', scene);
paint.diffuseTexture = texture(scene, checks('#d84', '#48d'));
shape.material = paint;
const system = new B.ParticleSystem('fire', 200, scene);
system.particleTexture = texture(scene, spot('#fa6'));
system.emitter = new B.Vector3(-2, 0, 0);
system.minSize = 0.1;
system.maxSize = 0.4;
system.emitRate = 60;
system.blendMode = B.ParticleSystem.BLENDMODE_ADD;
system.start();
B.MeshBuilder.CreateLines(
    'line',
    { points: Array.from({ length: 40 }, (_, i) => new B.Vector3(Math.cos(i * 0.4) * 2, i * 0.06, Math.sin(i * 0.4) * 2)) },
    scene,
);
const ground = B.MeshBuilder.CreateGround('ground', { width: 10, height: 10, subdivisions: 4 }, scene);
const wires = new B.StandardMaterial('wires', scene);
wires.wireframe = true;
ground.material = wires;
run(engine, scene, (step) => (target.influence = 0.5 + 0.5 * Math.sin(step * 0.1)));
