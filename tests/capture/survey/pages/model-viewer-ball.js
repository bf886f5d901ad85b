// model-viewer: a glTF model with a shadow in a neutral room
// Drawn with WebGL.

import '@google/model-viewer';
import { height, loaded, width, withoutCanvas } from './common.js';
import { model } from './gltf.js';

withoutCanvas();
const viewer = document.createElement('model-viewer');
viewer.style.cssText = `width:${width}px;height:${height}px;background:#445566`;
Object.entries({ 'environment-image': 'neutral', 'shadow-intensity': '1', 'auto-rotate': '', 'auto-rotate-delay': '0', exposure: '1', 'interaction-prompt': 'none' }).forEach(
    ([name, value]) => viewer.setAttribute(name, value),
);
viewer.addEventListener('load', () => setTimeout(loaded, 1500));
viewer.src = URL.createObjectURL(new Blob([JSON.stringify(model())], { type: 'model/gltf+json' }));
document.body.append(viewer);
