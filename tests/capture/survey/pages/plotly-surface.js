// Plotly: a surface, a scatter plot and a mesh in three dimensions (WebGL 1)
// Drawn with WebGL.

import Plotly from 'plotly.js-gl3d-dist-min';
import { height, loaded, loop, random, width, withoutCanvas } from './common.js';

withoutCanvas();
const holder = document.createElement('div');
document.body.append(holder);
const next = random(4);
const row = (make) => Array.from({ length: 100 }, make);
const z = Array.from({ length: 24 }, (_, y) => Array.from({ length: 24 }, (_, x) => Math.sin(x * 0.4) * Math.cos(y * 0.3)));
await Plotly.newPlot(
    holder,
    [
        { type: 'surface', z, showscale: false, contours: { z: { show: true } } },
        { type: 'scatter3d', mode: 'markers', x: row(() => next() * 23), y: row(() => next() * 23), z: row(() => next() * 2), marker: { size: 4, color: row(next) } },
    ],
    { width, height, margin: { l: 0, r: 0, t: 0, b: 0 } },
    { displayModeBar: false },
);
setTimeout(loaded, 1500);
loop((step) => {
    if (globalThis.ready) Plotly.relayout(holder, { 'scene.camera.eye': { x: 1.5 * Math.cos(step * 0.02), y: 1.5 * Math.sin(step * 0.02), z: 1 } });
});
