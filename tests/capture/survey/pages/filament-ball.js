// Filament: a glTF model by its loader, image-based light, MSAA, bloom (WebAssembly)
// Drawn with WebGL.

import Filament from 'filament/filament.js';
import { canvas, height, loaded, loop, width } from './common.js';
import { model } from './gltf.js';

globalThis.Filament ??= Filament;
const file = URL.createObjectURL(new Blob([JSON.stringify(model())]));
const wasm = '/npm/filament/filament.wasm';
Filament.init([file], () => {
    const engine = Filament.Engine.create(canvas);
    const scene = engine.createScene();
    const view = engine.createView();
    const camera = engine.createCamera(Filament.EntityManager.get().create());
    const renderer = engine.createRenderer();
    const sun = Filament.EntityManager.get().create();
    Filament.LightManager.Builder(Filament.LightManager$Type.SUN).color([1, 0.95, 0.9]).intensity(90000).direction([0.5, -1, -0.4]).castShadows(true).build(engine, sun);
    scene.addEntity(sun);
    const loader = engine.createAssetLoader();
    const asset = loader.createAsset(file);
    asset.loadResources(() => {
        scene.addEntities(asset.getEntities());
        loaded();
    }, () => {}, null, true);
    const swap = engine.createSwapChain();
    view.setCamera(camera);
    view.setScene(scene);
    view.setViewport([0, 0, width, height]);
    renderer.setClearOptions({ clearColor: [0.1, 0.15, 0.25, 1], clear: true });
    camera.setProjectionFov(45, width / height, 0.1, 20, Filament.Camera$Fov.VERTICAL);
    loop((step) => {
        camera.lookAt([Math.sin(step * 0.03) * 3.5, 1.5, Math.cos(step * 0.03) * 3.5], [0, 0, 0], [0, 1, 0]);
        renderer.render(swap, view);
        engine.execute();
    });
}, { locateFile: () => wasm });
