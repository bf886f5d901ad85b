// Babylon.js: default pipeline (bloom, depth of field, grain, MSAA), SSAO, highlights, a mirror
// Drawn with WebGL and WebGPU.

import { checks } from './common.js';
import { B, run, start, texture } from './babylon-common.js';

const { engine, scene, camera } = await start();
new B.HemisphericLight('sky', B.Vector3.Up(), scene);
const ground = B.MeshBuilder.CreateGround('ground', { width: 12, height: 12 }, scene);
const tiles = new B.StandardMaterial('tiles', scene);
tiles.diffuseTexture = texture(scene, checks());
tiles.reflectionTexture = new B.MirrorTexture('mirror', 128, scene, true);
tiles.reflectionTexture.mirrorPlane = new B.Plane(0, -1, 0, 0);
tiles.reflectionTexture.level = 0.4;
ground.material = tiles;
const balls = Array.from({ length: 7 }, (_, i) => {
    const ball = B.MeshBuilder.CreateSphere(`ball ${i}`, { diameter: 0.9 }, scene);
    ball.position.set((i - 3) * 1.1, 0.6, (i % 2) * 1.2);
    const paint = new B.StandardMaterial(`paint ${i}`, scene);
    paint.diffuseColor = B.Color3.FromHSV(i * 50, 0.7, 0.9);
    if (i % 3 === 0) paint.emissiveColor = paint.diffuseColor;
    ball.material = paint;
    tiles.reflectionTexture.renderList.push(ball);
    return ball;
});
const post = new B.DefaultRenderingPipeline('post', true, scene, [camera]);
post.samples = 4;
post.bloomEnabled = post.fxaaEnabled = post.sharpenEnabled = true;
post.depthOfFieldEnabled = true;
post.depthOfField.focusDistance = 7000;
post.depthOfField.focalLength = 120;
post.imageProcessing.toneMappingEnabled = true;
new B.SSAO2RenderingPipeline('ssao', scene, 0.5, [camera]);
run(engine, scene, (step) => balls.forEach((ball, i) => (ball.position.y = 0.6 + Math.abs(Math.sin(step * 0.05 + i)) * 0.5)));
