// A-Frame: primitives, text, shadows, an animation
// Drawn with WebGL.

import { loaded, withoutCanvas } from './common.js';

withoutCanvas();
const script = document.createElement('script');
script.src = '/npm/aframe/dist/aframe-master.min.js';
document.head.append(script);
await new Promise((resolve) => (script.onload = resolve));
document.body.insertAdjacentHTML(
    'beforeend',
    `<a-scene renderer="antialias: true" shadow="type: pcf" xr-mode-ui="enabled: false" loading-screen="enabled: false">
<a-box position="-1 0.5 -3" rotation="0 45 0" color="#4CC3D9" shadow animation="property: rotation; to: 0 405 0; loop: true"></a-box>
<a-sphere position="0 1.25 -5" radius="1.25" color="#EF2D5E" shadow></a-sphere>
<a-cylinder position="1 0.75 -3" radius="0.5" height="1.5" color="#FFC65D" shadow></a-cylinder>
<a-torus-knot position="2.4 1.6 -4" radius="0.5" radius-tubular="0.1" metalness="0.6" color="#7BC8A4"></a-torus-knot>
<a-plane rotation="-90 0 0" position="0 0 -4" width="8" height="8" color="#7BC8A4" shadow></a-plane>
<a-light type="directional" position="2 5 2" light="castShadow: true; intensity: 2"></a-light>
<a-light type="ambient" color="#888"></a-light>
<a-sky color="#ECECEC"></a-sky></a-scene>`,
);
const scene = document.querySelector('a-scene');
if (scene.hasLoaded) loaded();
else scene.addEventListener('loaded', loaded);
