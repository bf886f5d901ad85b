// Hydra: video synthesis with feedback between framebuffers
// Drawn with WebGL.

import Hydra from 'hydra-synth';
import { canvas, height, loaded, width } from './common.js';

new Hydra({ canvas, width, height, detectAudio: false, makeGlobal: true, autoLoop: true, enableStreamCapture: false });
const { osc, noise, src, o0, voronoi } = globalThis;
osc(12, 0.1, 1.2).rotate(0.4).modulate(noise(3), 0.2).blend(src(o0).scale(1.02), 0.6).diff(voronoi(5)).out(o0);
loaded();
