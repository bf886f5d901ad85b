// p5.js: WEBGL mode with lights, textures, a framebuffer, its own geometry
// Drawn with WebGL.

import p5 from 'p5';
import { height, loaded, width, withoutCanvas } from './common.js';

withoutCanvas();
new p5((sketch) => {
    let buffer;
    sketch.setup = () => {
        sketch.pixelDensity(1);
        sketch.createCanvas(width, height, sketch.WEBGL);
        buffer = sketch.createFramebuffer({ width: 128, height: 128, density: 1 });
        loaded();
    };
    sketch.draw = () => {
        const turn = sketch.frameCount * 0.03;
        buffer.begin();
        sketch.background(40, 20, 60);
        sketch.noStroke();
        sketch.fill(255, 180, 60);
        sketch.rotateZ(turn);
        sketch.rect(-30, -30, 60, 60);
        buffer.end();
        sketch.background(30, 40, 60);
        sketch.ambientLight(70);
        sketch.directionalLight(255, 255, 255, 0.4, 0.8, -1);
        sketch.pointLight(255, 120, 60, 80, -60, 100);
        sketch.push();
        sketch.translate(-70, 0, 0);
        sketch.rotateY(turn);
        sketch.texture(buffer);
        sketch.box(80);
        sketch.pop();
        sketch.push();
        sketch.translate(70, 0, 0);
        sketch.rotateX(turn);
        sketch.specularMaterial(90, 160, 220);
        sketch.shininess(30);
        sketch.noStroke();
        sketch.torus(40, 15);
        sketch.pop();
        sketch.stroke(255);
        sketch.strokeWeight(2);
        sketch.noFill();
        sketch.bezier(-140, 90, 0, -60, -40, 0, 60, 160, 0, 140, 90, 0);
    };
});
