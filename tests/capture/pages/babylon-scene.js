// A small scene for both of Babylon.js's engines.

import { ArcRotateCamera } from '@babylonjs/core/Cameras/arcRotateCamera';
import { DirectionalLight } from '@babylonjs/core/Lights/directionalLight';
import { HemisphericLight } from '@babylonjs/core/Lights/hemisphericLight';
import { ShadowGenerator } from '@babylonjs/core/Lights/Shadows/shadowGenerator';
import '@babylonjs/core/Lights/Shadows/shadowGeneratorSceneComponent';
import { PBRMaterial } from '@babylonjs/core/Materials/PBR/pbrMaterial';
import { StandardMaterial } from '@babylonjs/core/Materials/standardMaterial';
import { RawTexture } from '@babylonjs/core/Materials/Textures/rawTexture';
import { Color3, Vector3 } from '@babylonjs/core/Maths/math';
import { MeshBuilder } from '@babylonjs/core/Meshes/meshBuilder';
import { Scene } from '@babylonjs/core/scene';

export function makeScene(engine) {
    const scene = new Scene(engine);
    scene.clearColor.set(0.5, 0.65, 0.8, 1);
    new ArcRotateCamera('camera', 0.9, 1.1, 8, Vector3.Zero(), scene);
    new HemisphericLight('sky', new Vector3(0, 1, 0), scene).intensity = 0.5;
    const sun = new DirectionalLight('sun', new Vector3(-0.5, -1, -0.3), scene);
    sun.position = new Vector3(4, 8, 3);
    const shadows = new ShadowGenerator(256, sun);

    const ground = MeshBuilder.CreateGround('ground', { width: 8, height: 8 }, scene);
    const checks = new StandardMaterial('checks', scene);
    const texels = Uint8Array.from({ length: 16 * 16 * 4 }, (_, i) => (((i >> 5) + (i >> 9)) % 2 ? 220 : 120));
    checks.diffuseTexture = RawTexture.CreateRGBATexture(texels, 16, 16, scene, true);
    ground.material = checks;
    ground.receiveShadows = true;

    const knot = MeshBuilder.CreateTorusKnot('knot', { radius: 0.8, tube: 0.25, radialSegments: 64 }, scene);
    knot.position.y = 1.5;
    const metal = new PBRMaterial('metal', scene);
    metal.albedoColor = new Color3(0.8, 0.5, 0.2);
    metal.metallic = 0.4;
    metal.roughness = 0.4;
    knot.material = metal;
    shadows.addShadowCaster(knot);

    const box = MeshBuilder.CreateBox('box', { size: 0.5 }, scene);
    box.position.set(-2, 0.3, 0);
    box.material = new StandardMaterial('box', scene);
    for (let i = 1; i < 5; i++) box.createInstance(`box${i}`).position.set(i - 2, 0.3, 2);
    const glass = MeshBuilder.CreateSphere('glass', { diameter: 1 }, scene);
    glass.position.set(1.8, 0.6, 1);
    glass.material = new StandardMaterial('glass', scene);
    glass.material.alpha = 0.5;

    let step = 0;
    scene.executeWhenReady(() => {
        engine.runRenderLoop(() => {
            step += 1;
            knot.rotation.y = step * 0.05;
            scene.render();
            globalThis.ready = step > 3;
        });
    });
}
