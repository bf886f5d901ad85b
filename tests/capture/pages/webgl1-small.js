// WebGL 1: instancing and vertex arrays by extension, luminance, a target, a fan, bytes as indices, a constant
// attribute, a stencil.

const VERTEX = `
attribute vec2 at;
attribute vec2 offset;
attribute vec4 color;
uniform mat3 turn;
varying vec2 uv;
varying vec4 shade;
void main() {
    uv = at + 0.5;
    shade = color;
    gl_Position = vec4((turn * vec3(at, 1.0)).xy + offset, 0.0, 1.0);
}`;
const FRAGMENT = `
precision mediump float;
uniform sampler2D image;
struct Light { vec3 color; float power; };
uniform Light lights[2];
varying vec2 uv;
varying vec4 shade;
void main() {
    vec3 light = lights[0].color * lights[0].power + lights[1].color * lights[1].power;
    gl_FragColor = texture2D(image, uv) * shade * vec4(light, 1.0);
}`;

const gl = document.getElementById('canvas').getContext('webgl', { antialias: false, alpha: false, stencil: true });
const arrays = gl.getExtension('OES_vertex_array_object');
const instances = gl.getExtension('ANGLE_instanced_arrays');

const program = gl.createProgram();
for (const [type, text] of [
    [gl.VERTEX_SHADER, VERTEX],
    [gl.FRAGMENT_SHADER, FRAGMENT],
]) {
    const shader = gl.createShader(type);
    gl.shaderSource(shader, text);
    gl.compileShader(shader);
    gl.attachShader(program, shader);
}
gl.linkProgram(program);
gl.useProgram(program);
const uniform = (name) => gl.getUniformLocation(program, name);
gl.uniform3f(uniform('lights[0].color'), 1, 0.8, 0.6);
gl.uniform1f(uniform('lights[0].power'), 0.7);
gl.uniform3fv(uniform('lights[1].color'), [0.2, 0.4, 1]);
gl.uniform1f(uniform('lights[1].power'), 0.5);

const [at, offset, color] = ['at', 'offset', 'color'].map((name) => gl.getAttribLocation(program, name));
const fill = (target, data) => {
    gl.bindBuffer(target, gl.createBuffer());
    gl.bufferData(target, data, gl.STATIC_DRAW);
};
const array = arrays.createVertexArrayOES();
arrays.bindVertexArrayOES(array);
fill(gl.ARRAY_BUFFER, new Float32Array([-0.5, -0.5, 0.5, -0.5, 0.5, 0.5, -0.5, 0.5]));
gl.enableVertexAttribArray(at);
gl.vertexAttribPointer(at, 2, gl.FLOAT, false, 0, 0);
const moving = gl.createBuffer();
gl.bindBuffer(gl.ARRAY_BUFFER, moving);
gl.bufferData(gl.ARRAY_BUFFER, 32, gl.DYNAMIC_DRAW);
gl.enableVertexAttribArray(offset);
gl.vertexAttribPointer(offset, 2, gl.FLOAT, false, 8, 0);
instances.vertexAttribDivisorANGLE(offset, 1);
fill(gl.ELEMENT_ARRAY_BUFFER, new Uint8Array([0, 1, 2, 0, 2, 3]));
arrays.bindVertexArrayOES(null);

const texels = Uint8Array.from({ length: 64 }, (_, i) => (i % 3 ? 255 : i * 4));
const image = gl.createTexture();
gl.bindTexture(gl.TEXTURE_2D, image);
gl.pixelStorei(gl.UNPACK_FLIP_Y_WEBGL, true);
gl.texImage2D(gl.TEXTURE_2D, 0, gl.LUMINANCE, 8, 8, 0, gl.LUMINANCE, gl.UNSIGNED_BYTE, texels);
gl.generateMipmap(gl.TEXTURE_2D);

const drawn = gl.createTexture();
gl.bindTexture(gl.TEXTURE_2D, drawn);
gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA, 64, 64, 0, gl.RGBA, gl.UNSIGNED_BYTE, null);
gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.LINEAR);
const target = gl.createFramebuffer();
gl.bindFramebuffer(gl.FRAMEBUFFER, target);
gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, drawn, 0);

const copy = gl.createTexture();
gl.bindTexture(gl.TEXTURE_2D, copy);
gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA, 64, 64, 0, gl.RGBA, gl.UNSIGNED_BYTE, null);
gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.LINEAR);

let step = 0;
function frame() {
    step += 1;
    const c = Math.cos(step * 0.1);
    const s = Math.sin(step * 0.1);
    gl.uniformMatrix3fv(uniform('turn'), false, [c * 0.8, s * 0.8, 0, -s * 0.8, c * 0.8, 0, 0, 0, 1]);
    arrays.bindVertexArrayOES(array);
    gl.bindBuffer(gl.ARRAY_BUFFER, moving);
    gl.bufferSubData(gl.ARRAY_BUFFER, 0, new Float32Array([-0.4, c * 0.1, 0.4, 0, 0, s * 0.3, 0.1, 0]));

    gl.bindFramebuffer(gl.FRAMEBUFFER, target);
    gl.viewport(0, 0, 64, 64);
    gl.clearColor(0.1, 0.4, 0.2, 1);
    gl.clear(gl.COLOR_BUFFER_BIT);
    gl.bindTexture(gl.TEXTURE_2D, image);
    gl.vertexAttrib4f(color, 1, 1, 1, 1);
    instances.drawElementsInstancedANGLE(gl.TRIANGLES, 6, gl.UNSIGNED_BYTE, 0, 2);

    // The left half is copied to the right one.
    gl.bindTexture(gl.TEXTURE_2D, copy);
    gl.copyTexSubImage2D(gl.TEXTURE_2D, 0, 32, 0, 0, 0, 32, 64);

    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.viewport(0, 0, 320, 240);
    gl.clearColor(0.2, 0.2, 0.3, 1);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT | gl.STENCIL_BUFFER_BIT);
    gl.enable(gl.STENCIL_TEST);
    gl.stencilFunc(gl.ALWAYS, 1, 0xff);
    gl.stencilOp(gl.KEEP, gl.KEEP, gl.REPLACE);
    gl.bindTexture(gl.TEXTURE_2D, step % 2 ? drawn : copy);
    instances.drawArraysInstancedANGLE(gl.TRIANGLE_FAN, 0, 4, 1);
    gl.stencilFunc(gl.NOTEQUAL, 1, 0xff);
    gl.vertexAttrib4f(color, 1, 0.5, 0.2, 1);
    instances.drawElementsInstancedANGLE(gl.TRIANGLES, 6, gl.UNSIGNED_BYTE, 0, 4);
    gl.disable(gl.STENCIL_TEST);
    arrays.bindVertexArrayOES(null);
    requestAnimationFrame(frame);
    globalThis.ready = true;
}
frame();
