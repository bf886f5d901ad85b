import * as pc from 'playcanvas';

const device = globalThis.deviceType ?? 'webgl2';
const canvas = document.getElementById('canvas');

async function main() {
    const graphicsDevice = await pc.createGraphicsDevice(canvas, { deviceTypes: [device], antialias: true });
    const options = new pc.AppOptions();
    options.graphicsDevice = graphicsDevice;
    options.componentSystems = [pc.RenderComponentSystem, pc.CameraComponentSystem, pc.LightComponentSystem];
    const app = new pc.AppBase(canvas);
    app.init(options);
    app.start();
    app.scene.ambientLight = new pc.Color(0.3, 0.35, 0.4);

    const entity = (name, components, at = [0, 0, 0]) => {
        const made = new pc.Entity(name);
        for (const [type, data] of Object.entries(components)) made.addComponent(type, data);
        made.setPosition(...at);
        app.root.addChild(made);
        return made;
    };
    const material = (set) => {
        const made = new pc.StandardMaterial();
        Object.assign(made, set);
        made.update();
        return made;
    };
    const camera = entity('camera', { camera: { clearColor: new pc.Color(0.5, 0.6, 0.8) } }, [4, 3, 6]);
    camera.lookAt(0, 0.5, 0);
    const sun = entity('sun', {
        light: { type: 'directional', castShadows: true, shadowResolution: 256, shadowDistance: 20 },
    });
    sun.setEulerAngles(45, 30, 0);
    const ground = material({ diffuse: new pc.Color(0.5, 0.6, 0.4), gloss: 0.2 });
    entity('ground', { render: { type: 'plane', material: ground } }).setLocalScale(8, 1, 8);
    const red = material({ diffuse: new pc.Color(0.8, 0.3, 0.2), metalness: 0.4, useMetalness: true, gloss: 0.6 });
    const box = entity('box', { render: { type: 'box', material: red } }, [0, 1, 0]);
    const glass = material({ diffuse: new pc.Color(0.3, 0.7, 1), opacity: 0.5, blendType: pc.BLEND_NORMAL });
    entity('ball', { render: { type: 'sphere', material: glass } }, [1.5, 0.6, 1]);
    let step = 0;
    app.on('update', () => {
        box.rotate(1, 2, 0);
        step += 1;
        globalThis.ready = step > 3;
    });
}

main();
