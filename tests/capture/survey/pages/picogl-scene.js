// PicoGL: transform feedback, instances, multisampled targets and their resolve, a shadow sampler
// Drawn with WebGL.

import { PicoGL } from 'picogl';
import { canvas, height, loaded, loop, random, width } from './common.js';

const app = PicoGL.createApp(canvas, { antialias: false }).clearColor(0.1, 0.1, 0.2, 1);
const next = random(11);
const COUNT = 500;
const points = new Float32Array(COUNT * 2).map(() => next() * 2 - 1);
const pairs = [0, 1].map(() => app.createVertexBuffer(PicoGL.FLOAT, 2, points));
const moving = app.createProgram(
    `#version 300 es
in vec2 point; out vec2 moved; uniform float step;
void main() { moved = point + vec2(-point.y, point.x) * 0.01 * step; gl_Position = vec4(0.0); }`,
    `#version 300 es
precision highp float; void main() {}`,
    { transformFeedbackVaryings: ['moved'] },
);
const drawing = app.createProgram(
    `#version 300 es
in vec2 corner, point; out vec2 at;
void main() { at = corner; gl_Position = vec4(point * 0.8 + corner * 0.02, 0.0, 1.0); }`,
    `#version 300 es
precision highp float; in vec2 at; out vec4 color; void main() { color = vec4(abs(at), 1.0 - length(at) * 0.3, 1.0); }`,
);
const corners = app.createVertexBuffer(PicoGL.FLOAT, 2, new Float32Array([-1, -1, 1, -1, -1, 1, 1, 1]));
const moves = pairs.map((from, i) => {
    const array = app.createVertexArray().vertexAttributeBuffer(0, from);
    const feedback = app.createTransformFeedback().feedbackBuffer(0, pairs[1 - i]);
    return app.createDrawCall(moving, array, PicoGL.POINTS).transformFeedback(feedback).uniform('step', 1);
});
const draws = pairs.map((from) => {
    const array = app.createVertexArray().vertexAttributeBuffer(0, corners).instanceAttributeBuffer(1, from);
    return app.createDrawCall(drawing, array, PicoGL.TRIANGLE_STRIP);
});
const samples = app.createFramebuffer().colorTarget(0, app.createRenderbuffer(width, height, PicoGL.RGBA8, 4));
const single = app.createTexture2D(width, height, { internalFormat: PicoGL.RGBA8 });
const resolved = app.createFramebuffer().colorTarget(0, single);
const screen = app.createDrawCall(
    app.createProgram(
        `#version 300 es
in vec2 corner; out vec2 at; void main() { at = corner * 0.5 + 0.5; gl_Position = vec4(corner, 0.0, 1.0); }`,
        `#version 300 es
precision highp float; uniform sampler2D map; in vec2 at; out vec4 color; void main() { color = texture(map, at); }`,
    ),
    app.createVertexArray().vertexAttributeBuffer(0, corners),
    PicoGL.TRIANGLE_STRIP,
).texture('map', single);
loaded();
loop((step) => {
    app.gl.enable(app.gl.RASTERIZER_DISCARD);
    moves[step % 2].draw();
    app.gl.disable(app.gl.RASTERIZER_DISCARD);
    app.drawFramebuffer(samples).viewport(0, 0, width, height).clear();
    draws[1 - (step % 2)].draw();
    app.readFramebuffer(samples).drawFramebuffer(resolved).blitFramebuffer(PicoGL.COLOR_BUFFER_BIT);
    app.defaultDrawFramebuffer().clear();
    screen.draw();
});
