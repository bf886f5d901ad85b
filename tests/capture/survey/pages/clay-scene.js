// ClayGL: standard materials with shadows
// Drawn with WebGL.

import * as clay from 'claygl';
import { height, loaded, width, withoutCanvas } from './common.js';

withoutCanvas();
const holder = document.createElement('div');
holder.style.cssText = `width:${width}px;height:${height}px`;
document.body.append(holder);
clay.application.create(holder, {
    graphic: { shadow: true, tonemapping: true, linear: true },
    devicePixelRatio: 1,
    init(app) {
        this.camera = app.createCamera([0, 3, 6], [0, 0, 0]);
        this.cube = app.createCube({ color: '#e63', roughness: 0.4 });
        this.sphere = app.createSphere({ color: '#38e', metalness: 0.6, roughness: 0.3 });
        this.sphere.position.set(2.2, 0.2, 0);
        const plane = app.createPlane({ color: '#ccc', roughness: 1 });
        plane.scale.set(8, 8, 1);
        plane.rotation.rotateX(-Math.PI / 2);
        plane.position.set(0, -1, 0);
        const light = app.createDirectionalLight([-1, -2, -1], '#fff', 1);
        light.castShadow = true;
        app.createAmbientLight('#fff', 0.3);
        loaded();
    },
    loop() {
        this.cube.rotation.rotateY(0.03);
    },
});
