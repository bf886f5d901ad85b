// troika-three-text: text as signed distances, which workers and a WebGL context of its own make
// Drawn with WebGL.

import { Text } from 'troika-three-text';
import { loaded, loop } from './common.js';
import { THREE, base, camera, ground, sun, webgl } from './three-common.js';

const renderer = webgl();
const scene = base(0x203040);
const eye = camera();
sun(scene);
ground(scene);
const text = new Text();
Object.assign(text, { text: 'captured\nframes', fontSize: 1, anchorX: 'center', anchorY: 'middle', outlineWidth: 0.03, color: 0xffcc66, font: '/npm/three/examples/fonts/ttf/kenpixel.ttf' });
text.position.y = 1.4;
scene.add(text);
text.sync(loaded);
loop((step) => {
    text.rotation.y = Math.sin(step * 0.03) * 0.5;
    renderer.render(scene, eye);
});
