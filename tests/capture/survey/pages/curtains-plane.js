// curtains.js: a textured plane that waves, and a shader pass
// Drawn with WebGL.

import { Curtains, Plane, ShaderPass } from 'curtainsjs';
import { checks, height, loaded, width, withoutCanvas } from './common.js';

withoutCanvas();
document.body.insertAdjacentHTML(
    'beforeend',
    `<div id="curtains" style="position:fixed;width:${width}px;height:${height}px"></div>
<div id="plane" style="width:80vw;height:80vh;margin:10vh auto"></div>`,
);
const curtains = new Curtains({ container: 'curtains', pixelRatio: 1, watchScroll: false });
const holder = document.getElementById('plane');
const source = checks('#fa6', '#36a');
source.setAttribute('data-sampler', 'map');
holder.append(source);
const plane = new Plane(curtains, holder, {
    widthSegments: 20,
    heightSegments: 20,
    uniforms: { time: { name: 'uTime', type: '1f', value: 0 } },
    vertexShader: `precision mediump float;
attribute vec3 aVertexPosition; attribute vec2 aTextureCoord; uniform mat4 uMVMatrix, uPMatrix, mapMatrix; uniform float uTime;
varying vec2 at;
void main() { vec3 p = aVertexPosition; p.z += sin(p.x * 6.0 + uTime) * 0.1; at = (mapMatrix * vec4(aTextureCoord, 0.0, 1.0)).xy; gl_Position = uPMatrix * uMVMatrix * vec4(p, 1.0); }`,
    fragmentShader: `precision mediump float; varying vec2 at; uniform sampler2D map; void main() { gl_FragColor = texture2D(map, at); }`,
});
plane.onRender(() => (plane.uniforms.time.value += 0.05));
new ShaderPass(curtains, {
    fragmentShader: `precision mediump float; varying vec2 vTextureCoord; uniform sampler2D uRenderTexture;
void main() { vec4 c = texture2D(uRenderTexture, vTextureCoord + sin(vTextureCoord.y * 20.0) * 0.01); gl_FragColor = c; }`,
});
setTimeout(loaded, 800);
