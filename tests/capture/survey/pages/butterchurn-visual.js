// Butterchurn: a Milkdrop preset, warped feedback, waveforms, composites
// Drawn with WebGL.

import butterchurn from 'butterchurn';
import presets from 'butterchurn-presets';
import { canvas, height, loaded, loop, width } from './common.js';

const context = new AudioContext();
const visualizer = (butterchurn.default ?? butterchurn).createVisualizer(context, canvas, { width, height, pixelRatio: 1 });
const all = (presets.default ?? presets).getPresets();
visualizer.loadPreset(all['Flexi, martin + geiss - dedicated to the sherwin maxawow'] ?? Object.values(all)[0], 0);
const levels = new Uint8Array(1024).map((_, i) => 128 + 60 * Math.sin(i * 0.1));
loaded();
loop(() => visualizer.render({ audioLevels: { timeByteArray: levels, timeByteArrayL: levels, timeByteArrayR: levels } }));
