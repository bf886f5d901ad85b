// Engine and scene for pages of Babylon.js.

import { ArcRotateCamera } from '@babylonjs/core/Cameras/arcRotateCamera.js';
import { WebGPUEngine } from '@babylonjs/core/Engines/webgpuEngine.js';
import * as B from '@babylonjs/core';
import { canvas, isWebgpu, loaded } from './common.js';

export { B };

export async function start() {
    let engine;
    if (isWebgpu) {
        engine = new WebGPUEngine(canvas, { antialias: true });
        await engine.initAsync({}, {});
    } else engine = new B.Engine(canvas, true, { stencil: true });
    const scene = new B.Scene(engine);
    scene.useConstantAnimationDeltaTime = true;
    const camera = new ArcRotateCamera('camera', 0.9, 1.1, 8, new B.Vector3(0, 1, 0), scene);
    return { engine, scene, camera };
}

export function texture(scene, source) {
    const made = new B.DynamicTexture('painted', source.width, scene, true);
    made.getContext().drawImage(source, 0, 0);
    made.update();
    return made;
}

export function run(engine, scene, step = () => {}) {
    let count = 0;
    engine.runRenderLoop(() => {
        step(count++);
        scene.render();
    });
    scene.executeWhenReady(loaded);
}
