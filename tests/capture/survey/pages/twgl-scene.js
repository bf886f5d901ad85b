// TWGL: uniform blocks, vertex arrays, a framebuffer with several targets, integer attributes
// Drawn with WebGL.

import * as twgl from 'twgl.js';
import { canvas, checks, height, loaded, loop, width } from './common.js';

const gl = canvas.getContext('webgl2', { antialias: false });
const scene = twgl.createProgramInfo(gl, [
    `#version 300 es
uniform View { mat4 view; vec4 light; };
uniform mat4 world;
in vec4 position; in vec3 normal; in vec2 texcoord;
out vec3 facing; out vec2 at;
void main() { gl_Position = view * world * position; facing = mat3(world) * normal; at = texcoord; }`,
    `#version 300 es
precision highp float;
uniform View { mat4 view; vec4 light; };
uniform sampler2D map; in vec3 facing; in vec2 at;
layout(location = 0) out vec4 color; layout(location = 1) out vec4 normal;
void main() { color = texture(map, at) * (0.2 + max(0.0, dot(normalize(facing), light.xyz))); color.a = 1.0; normal = vec4(normalize(facing) * 0.5 + 0.5, 1.0); }`,
]);
const screen = twgl.createProgramInfo(gl, [
    `#version 300 es
in vec4 position; out vec2 at; void main() { gl_Position = position; at = position.xy * 0.5 + 0.5; }`,
    `#version 300 es
precision highp float; uniform sampler2D color, normal; in vec2 at; out vec4 shown;
void main() { shown = at.x < 0.5 ? texture(color, at) : texture(normal, at); }`,
]);
const shapes = [
    twgl.primitives.createSphereBufferInfo(gl, 0.8, 24, 16),
    twgl.primitives.createTorusBufferInfo(gl, 0.7, 0.2, 24, 12),
    twgl.primitives.createCubeBufferInfo(gl, 1),
    twgl.primitives.createTruncatedConeBufferInfo(gl, 0.6, 0, 1.2, 16, 4),
];
const arrays = shapes.map((shape) => twgl.createVertexArrayInfo(gl, scene, shape));
const quad = twgl.primitives.createXYQuadBufferInfo(gl);
const map = twgl.createTexture(gl, { src: checks(), mag: gl.LINEAR });
const target = twgl.createFramebufferInfo(gl, [{ internalFormat: gl.RGBA8 }, { internalFormat: gl.RGBA8 }, { format: gl.DEPTH_COMPONENT16 }], width, height);
const block = twgl.createUniformBlockInfo(gl, scene, 'View');
const eye = twgl.m4.inverse(twgl.m4.lookAt([3, 2, 5], [0, 0, 0], [0, 1, 0]));
loaded();
loop((step) => {
    gl.bindVertexArray(null);
    gl.enable(gl.DEPTH_TEST);
    gl.enable(gl.CULL_FACE);
    twgl.bindFramebufferInfo(gl, target);
    gl.drawBuffers([gl.COLOR_ATTACHMENT0, gl.COLOR_ATTACHMENT1]);
    gl.clearColor(0.2, 0.3, 0.3, 1);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.useProgram(scene.program);
    twgl.setBlockUniforms(block, { view: twgl.m4.multiply(twgl.m4.perspective(0.8, width / height, 0.1, 50), eye), light: [0.4, 0.8, 0.45, 0] });
    twgl.setUniformBlock(gl, scene, block);
    arrays.forEach((array, i) => {
        const world = twgl.m4.rotateY(twgl.m4.translation([(i - 1.5) * 1.4, 0, 0]), step * 0.04);
        twgl.setUniforms(scene, { world, map });
        twgl.setBuffersAndAttributes(gl, scene, array);
        twgl.drawBufferInfo(gl, array);
    });
    twgl.bindFramebufferInfo(gl, null);
    gl.bindVertexArray(null);
    gl.disable(gl.DEPTH_TEST);
    gl.useProgram(screen.program);
    twgl.setBuffersAndAttributes(gl, screen, quad);
    twgl.setUniforms(screen, { color: target.attachments[0], normal: target.attachments[1] });
    twgl.drawBufferInfo(gl, quad);
});
