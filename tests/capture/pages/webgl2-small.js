// What a capture of WebGL 2 must hold, small: a uniform block, instancing, a vertex array, a texture with mip levels
// that changes each frame, layers, a cube, a target with samples that is resolved, scissored clears, a strip.

const VERTEX = `#version 300 es
layout(std140) uniform Frame { mat4 turn; vec4 tint; };
in vec2 at;
in vec3 offset;
in vec4 shade;
out vec2 uv;
out vec4 color;
void main() {
    uv = at + 0.5;
    color = tint * shade;
    gl_Position = turn * vec4(at * 0.5, 0.0, 1.0) + vec4(offset, 0.0);
}`;

const FRAGMENT = `#version 300 es
precision highp float;
uniform sampler2D image;
uniform mediump sampler2DArray layers;
uniform samplerCube sky;
uniform float weights[3];
in vec2 uv;
in vec4 color;
out vec4 texel;
void main() {
    vec4 sum = texture(image, uv * 3.0) * weights[0] + texture(layers, vec3(uv, 1.0)) * weights[1];
    texel = (sum + texture(sky, vec3(uv - 0.5, 0.5)) * weights[2]) * color;
}`;

const COPY = `#version 300 es
precision highp float;
uniform sampler2D image;
in vec2 uv;
out vec4 texel;
void main() { texel = texture(image, uv); }`;

const SCREEN = `#version 300 es
out vec2 uv;
void main() {
    uv = vec2(gl_VertexID & 1, gl_VertexID >> 1);
    gl_Position = vec4(uv * 2.0 - 1.0, 0.5, 1.0);
}`;

const gl = document.getElementById('canvas').getContext('webgl2', { antialias: true });

function program(...texts) {
    const made = gl.createProgram();
    texts.forEach((text, i) => {
        const shader = gl.createShader(i ? gl.FRAGMENT_SHADER : gl.VERTEX_SHADER);
        gl.shaderSource(shader, text);
        gl.compileShader(shader);
        gl.attachShader(made, shader);
    });
    gl.linkProgram(made);
    if (!gl.getProgramParameter(made, gl.LINK_STATUS)) console.error(gl.getProgramInfoLog(made));
    return made;
}

function buffer(target, data, usage = gl.STATIC_DRAW) {
    const made = gl.createBuffer();
    gl.bindBuffer(target, made);
    gl.bufferData(target, data, usage);
    return made;
}

function attribute(program, name, size, type, normalized, stride, offset, divisor) {
    const location = gl.getAttribLocation(program, name);
    gl.enableVertexAttribArray(location);
    gl.vertexAttribPointer(location, size, type, normalized, stride, offset);
    gl.vertexAttribDivisor(location, divisor);
}

const bytes = (count, value) => Uint8Array.from({ length: count }, (_, i) => value(i));

const lit = program(VERTEX, FRAGMENT);
const copy = program(SCREEN, COPY);
gl.uniformBlockBinding(lit, gl.getUniformBlockIndex(lit, 'Frame'), 2);
const block = buffer(gl.UNIFORM_BUFFER, 80, gl.DYNAMIC_DRAW);
gl.bindBufferBase(gl.UNIFORM_BUFFER, 2, block);

const array = gl.createVertexArray();
gl.bindVertexArray(array);
buffer(gl.ARRAY_BUFFER, new Float32Array([-0.5, -0.5, 0.5, -0.5, -0.5, 0.5, 0.5, 0.5]));
attribute(lit, 'at', 2, gl.FLOAT, false, 0, 0, 0);
buffer(gl.ARRAY_BUFFER, new Float32Array([-0.5, -0.4, 0, 0.5, -0.4, 0.1, -0.5, 0.4, 0.2, 0.5, 0.4, 0.3]));
attribute(lit, 'offset', 3, gl.FLOAT, false, 12, 0, 1);
buffer(
    gl.ARRAY_BUFFER,
    bytes(16, (i) => 255 - i * 6),
);
attribute(lit, 'shade', 4, gl.UNSIGNED_BYTE, true, 4, 0, 1);
buffer(gl.ELEMENT_ARRAY_BUFFER, new Uint16Array([0, 1, 2, 2, 1, 3]));
gl.bindVertexArray(null);

const image = gl.createTexture();
gl.bindTexture(gl.TEXTURE_2D, image);
// As three.js counts levels.
gl.texStorage2D(gl.TEXTURE_2D, 6.6, gl.RGBA8, 32, 32);
gl.texSubImage2D(
    gl.TEXTURE_2D,
    0,
    0,
    0,
    32,
    32,
    gl.RGBA,
    gl.UNSIGNED_BYTE,
    bytes(4096, (i) => (i % 4 === 3 ? 255 : i)),
);
gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.LINEAR_MIPMAP_LINEAR);
gl.generateMipmap(gl.TEXTURE_2D);

const layers = gl.createTexture();
gl.activeTexture(gl.TEXTURE1);
gl.bindTexture(gl.TEXTURE_2D_ARRAY, layers);
gl.texImage3D(
    gl.TEXTURE_2D_ARRAY,
    0,
    gl.RGB8,
    4,
    4,
    2,
    0,
    gl.RGB,
    gl.UNSIGNED_BYTE,
    bytes(96, (i) => i * 2),
);
gl.texParameteri(gl.TEXTURE_2D_ARRAY, gl.TEXTURE_MIN_FILTER, gl.NEAREST);

const sky = gl.createTexture();
gl.activeTexture(gl.TEXTURE2);
gl.bindTexture(gl.TEXTURE_CUBE_MAP, sky);
for (let face = 0; face < 6; face++) {
    const texels = new Float32Array(16).map((_, i) => (i + face) / 24);
    gl.texImage2D(gl.TEXTURE_CUBE_MAP_POSITIVE_X + face, 0, gl.RGBA16F, 2, 2, 0, gl.RGBA, gl.FLOAT, texels);
}
gl.texParameteri(gl.TEXTURE_CUBE_MAP, gl.TEXTURE_MIN_FILTER, gl.LINEAR);

const renderbuffer = (format) => {
    const made = gl.createRenderbuffer();
    gl.bindRenderbuffer(gl.RENDERBUFFER, made);
    gl.renderbufferStorageMultisample(gl.RENDERBUFFER, 4, format, 160, 120);
    return made;
};
const samples = gl.createFramebuffer();
gl.bindFramebuffer(gl.FRAMEBUFFER, samples);
gl.framebufferRenderbuffer(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.RENDERBUFFER, renderbuffer(gl.RGBA8));
gl.framebufferRenderbuffer(gl.FRAMEBUFFER, gl.DEPTH_ATTACHMENT, gl.RENDERBUFFER, renderbuffer(gl.DEPTH_COMPONENT24));

const resolved = gl.createTexture();
gl.activeTexture(gl.TEXTURE0);
gl.bindTexture(gl.TEXTURE_2D, resolved);
gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA8, 160, 120, 0, gl.RGBA, gl.UNSIGNED_BYTE, null);
gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.LINEAR);
const target = gl.createFramebuffer();
gl.bindFramebuffer(gl.FRAMEBUFFER, target);
gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, resolved, 0);

gl.useProgram(lit);
gl.uniform1i(gl.getUniformLocation(lit, 'layers'), 1);
gl.uniform1i(gl.getUniformLocation(lit, 'sky'), 2);
const weights = gl.getUniformLocation(lit, 'weights');
const last = gl.getUniformLocation(lit, 'weights[2]');
gl.uniform1fv(weights, [0.5, 0.3, 0.2]);

function turned(angle) {
    const c = Math.cos(angle);
    const s = Math.sin(angle);
    return new Float32Array([c, s, 0, 0, -s, c, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 1, 0.9, 0.8, 1]);
}

let step = 0;
function frame() {
    step += 1;
    gl.bindFramebuffer(gl.FRAMEBUFFER, samples);
    gl.viewport(0, 0, 160, 120);
    gl.enable(gl.DEPTH_TEST);
    // One after the other: the depth before does not matter, too.
    gl.clearBufferfv(gl.COLOR, 0, [0.2, 0.3, 0.4, 1]);
    gl.clearBufferfv(gl.DEPTH, 0, [1]);
    gl.useProgram(lit);
    gl.uniform1f(last, 0.2 + 0.1 * Math.sin(step));
    gl.bindVertexArray(array);
    gl.bindTexture(gl.TEXTURE_2D, image);
    gl.texSubImage2D(
        gl.TEXTURE_2D,
        0,
        4,
        4,
        8,
        8,
        gl.RGBA,
        gl.UNSIGNED_BYTE,
        bytes(256, (i) => i + step * 16),
    );
    gl.generateMipmap(gl.TEXTURE_2D);
    for (const direction of [1, -1]) {
        // The block changes between two draws of one pass.
        gl.bindBuffer(gl.UNIFORM_BUFFER, block);
        gl.bufferSubData(gl.UNIFORM_BUFFER, 0, turned(direction * step * 0.05));
        gl.drawElementsInstanced(gl.TRIANGLES, 6, gl.UNSIGNED_SHORT, 0, direction > 0 ? 2 : 4);
    }
    gl.bindFramebuffer(gl.READ_FRAMEBUFFER, samples);
    gl.bindFramebuffer(gl.DRAW_FRAMEBUFFER, target);
    gl.blitFramebuffer(0, 0, 160, 120, 0, 0, 160, 120, gl.COLOR_BUFFER_BIT, gl.NEAREST);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);

    gl.bindVertexArray(null);
    gl.disable(gl.DEPTH_TEST);
    gl.viewport(0, 0, 320, 240);
    gl.clearColor(0, 0, 0, 1);
    gl.clear(gl.COLOR_BUFFER_BIT);
    gl.enable(gl.SCISSOR_TEST);
    gl.scissor(10, 20, 100, 60);
    gl.clearColor(0.8, 0.2, 0.1, 1);
    gl.clear(gl.COLOR_BUFFER_BIT);
    gl.scissor(40, 40, 260, 180);
    gl.enable(gl.BLEND);
    gl.blendFuncSeparate(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA, gl.ONE, gl.ONE);
    gl.useProgram(copy);
    gl.bindTexture(gl.TEXTURE_2D, resolved);
    gl.drawArrays(gl.TRIANGLE_STRIP, 0, 4);
    gl.disable(gl.BLEND);
    gl.disable(gl.SCISSOR_TEST);
    if (gl.getError()) console.error('an error of WebGL');
    requestAnimationFrame(frame);
    globalThis.ready = true;
}
frame();
