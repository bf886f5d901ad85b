// regl-scatterplot: points in a float texture, drawn through a framebuffer
// Drawn with WebGL.

import createScatterplot from 'regl-scatterplot';
import { canvas, height, loaded, loop, random, width } from './common.js';

const next = random(4);
const plot = createScatterplot({ canvas, width, height, pointSize: 6, colorBy: 'category', pointColor: ['#e66', '#6e6', '#66e', '#ee6'], backgroundColor: '#112' });
await plot.draw(Array.from({ length: 500 }, (_, i) => [next() * 2 - 1, next() * 2 - 1, i % 4, next()]));
loaded();
loop((step) => plot.set({ pointSize: 6 + Math.sin(step * 0.1) }));
