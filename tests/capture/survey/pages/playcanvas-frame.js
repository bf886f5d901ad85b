// PlayCanvas: `CameraFrame` with bloom, SSAO and TAA over PBR with clustered lights and shadows
// Drawn with WebGL and WebGPU.

import * as pc from 'playcanvas';
import { bumps, canvas, checks, isWebgpu, loaded } from './common.js';

const device = await pc.createGraphicsDevice(canvas, { deviceTypes: [isWebgpu ? 'webgpu' : 'webgl2'], antialias: false });
const options = new pc.AppOptions();
options.graphicsDevice = device;
options.componentSystems = [pc.RenderComponentSystem, pc.CameraComponentSystem, pc.LightComponentSystem];
options.resourceHandlers = [pc.TextureHandler];
const app = new pc.AppBase(canvas);
app.init(options);
app.start();
const add = (name, component, place = {}) => {
    const made = new pc.Entity();
    made.addComponent(name, component);
    if (place.at) made.setPosition(...place.at);
    if (place.turn) made.setEulerAngles(...place.turn);
    if (place.scale) made.setLocalScale(...place.scale);
    app.root.addChild(made);
    return made;
};
const painted = (source) => {
    const made = new pc.Texture(device, { width: source.width, height: source.height, mipmaps: true, addressU: pc.ADDRESS_REPEAT, addressV: pc.ADDRESS_REPEAT });
    made.setSource(source);
    return made;
};
const material = (values) => {
    const made = Object.assign(new pc.StandardMaterial(), values);
    made.update();
    return made;
};
const floor = material({ diffuseMap: painted(checks()), normalMap: painted(bumps()), gloss: 0.5, useMetalness: true });
floor.diffuseMapTiling = floor.normalMapTiling = new pc.Vec2(6, 6);
floor.update();
add('render', { type: 'plane', material: floor }, { scale: [12, 1, 12] });
const glowing = material({ emissive: new pc.Color(1, 0.4, 0.1), emissiveIntensity: 4 });
const shapes = ['sphere', 'box', 'cone', 'capsule', 'cylinder', 'torus'].map((type, i) =>
    add(
        'render',
        { type, material: i % 3 ? material({ diffuse: new pc.Color(i / 6, 0.5, 1 - i / 6), gloss: 0.7, metalness: i / 6, useMetalness: true }) : glowing },
        { at: [Math.cos(i) * 2.2, 0.8, Math.sin(i) * 2.2] },
    ),
);
add('light', { type: 'directional', castShadows: true, shadowResolution: 512, shadowDistance: 20, numCascades: 2, shadowBias: 0.2, normalOffsetBias: 0.05 }, { turn: [50, 30, 0] });
for (let i = 0; i < 6; i++) {
    const color = new pc.Color(i % 2, 0.6, 1 - (i % 2));
    add('light', { type: i % 2 ? 'omni' : 'spot', color, range: 6, intensity: 2, castShadows: i < 2, shadowBias: 0.2, normalOffsetBias: 0.05 }, { at: [Math.sin(i) * 3, 2.5, Math.cos(i) * 3] });
}
const eye = add('camera', { clearColor: new pc.Color(0.1, 0.12, 0.2), farClip: 60 }, { at: [4, 3.5, 6] });
eye.lookAt(0, 0.6, 0);
const frame = new pc.CameraFrame(app, eye.camera);
frame.rendering.toneMapping = pc.TONEMAP_ACES;
frame.bloom.intensity = 0.03;
frame.ssao.type = pc.SSAOTYPE_LIGHTING;
frame.taa.enabled = true;
frame.update();
app.on('update', () => shapes.forEach((shape) => shape.rotate(1, 2, 0)));
loaded();
