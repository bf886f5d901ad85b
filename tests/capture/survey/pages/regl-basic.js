// regl: instances, a framebuffer with depth, stencil, cube map (WebGL 1)
// Drawn with WebGL.

import createREGL from 'regl';
import { mat4 } from 'gl-matrix';
import { canvas, checks, height, loaded, random, width } from './common.js';

const regl = createREGL({ canvas, extensions: ['ANGLE_instanced_arrays', 'OES_standard_derivatives'], attributes: { stencil: true, antialias: true } });
const next = random(3);
const COUNT = 200;
const target = regl.framebuffer({ width: 128, height: 128, depth: true, color: regl.texture({ width: 128, height: 128, min: 'linear', mag: 'linear' }) });
const tiles = regl.texture({ data: checks(), wrap: 'repeat', min: 'mipmap', mag: 'linear', mipmap: true });
const faces = regl.cube(...['#f00', '#0f0', '#00f', '#ff0', '#0ff', '#f0f'].map((color) => checks(color, '#888', 32)));
const boxes = regl({
    vert: `precision mediump float; attribute vec2 corner; attribute vec3 place, tint; uniform float time; varying vec3 color; varying vec2 uv;
void main() { color = tint; uv = corner; float a = time + place.z * 6.0; mat2 turn = mat2(cos(a), sin(a), -sin(a), cos(a));
gl_Position = vec4(place.xy + turn * corner * 0.06, place.z, 1.0); }`,
    frag: `#extension GL_OES_standard_derivatives : enable
precision mediump float; varying vec3 color; varying vec2 uv; uniform sampler2D tiles;
void main() { float edge = min(fwidth(uv.x) * 8.0, 1.0); gl_FragColor = vec4(color * texture2D(tiles, uv).rgb + edge * 0.1, 1.0); }`,
    attributes: {
        corner: [[-1, -1], [1, -1], [-1, 1], [1, 1]],
        place: { buffer: Array.from({ length: COUNT }, () => [next() * 2 - 1, next() * 2 - 1, next()]), divisor: 1 },
        tint: { buffer: Array.from({ length: COUNT }, () => [next(), next(), next()]), divisor: 1 },
    },
    uniforms: { time: regl.prop('time'), tiles },
    primitive: 'triangle strip',
    count: 4,
    instances: COUNT,
    framebuffer: regl.prop('framebuffer'),
});
const matrix = mat4.create();
const ball = regl({
    vert: `attribute vec3 position; uniform mat4 view; varying vec3 normal;
void main() { normal = position; gl_Position = view * vec4(position, 1.0); }`,
    frag: `precision mediump float; varying vec3 normal; uniform samplerCube faces; uniform sampler2D drawn;
void main() { gl_FragColor = mix(textureCube(faces, normal), texture2D(drawn, normal.xy * 0.5 + 0.5), 0.5); }`,
    attributes: {
        position: Array.from({ length: 24 * 12 * 6 }, (_, i) => {
            const quad = Math.floor(i / 6);
            const [dx, dy] = [[0, 0], [1, 0], [0, 1], [0, 1], [1, 0], [1, 1]][i % 6];
            const [a, b] = [(((quad % 24) + dx) / 24) * Math.PI * 2, ((Math.floor(quad / 24) + dy) / 12) * Math.PI];
            return [Math.cos(a) * Math.sin(b), Math.cos(b), Math.sin(a) * Math.sin(b)];
        }),
    },
    uniforms: { view: () => matrix, faces, drawn: target },
    count: 24 * 12 * 6,
    stencil: { enable: true, func: { cmp: 'always', ref: 1 }, opFront: { zpass: 'replace' }, opBack: { zpass: 'replace' } },
});
loaded();
regl.frame(({ tick }) => {
    mat4.perspective(matrix, 1, width / height, 0.1, 10);
    mat4.translate(matrix, matrix, [0, 0, -2.6]);
    mat4.rotateY(matrix, matrix, tick * 0.03);
    regl.clear({ framebuffer: target, color: [0.2, 0.1, 0.3, 1], depth: 1 });
    boxes({ time: tick * 0.02, framebuffer: target });
    regl.clear({ color: [0.1, 0.2, 0.2, 1], depth: 1, stencil: 0 });
    boxes({ time: -tick * 0.02, framebuffer: null });
    ball();
});
