// WebGL 1 draws a pair as its author wrote it and as preshade writes it in GLSL ES 1.00, and the pictures are compared.
//
//     node webgl1.mjs PRESHADE AUTHOR.vert AUTHOR.frag

import assert from 'node:assert/strict';
import { execFile } from 'node:child_process';
import { mkdtemp, readFile, rm } from 'node:fs/promises';
import { tmpdir } from 'node:os';
import { basename, join } from 'node:path';
import { promisify } from 'node:util';
import { open } from './browser.mjs';

const run = promisify(execFile);
const [preshade, ...author] = process.argv.slice(2);
const read = (paths) => Promise.all(paths.map((path) => readFile(path, 'utf8')));

/** The pair as preshade writes it. */
async function written() {
    const into = await mkdtemp(join(tmpdir(), 'preshade-webgl1-'));
    await run(preshade, ['rewrite', ...author, '--emit', 'glsl-es-100', '-o', into]);
    const plan = JSON.parse(await readFile(join(into, `${basename(author[0], '.vert')}.plan.json`), 'utf8'));
    const [files] = plan.files;
    const names = ['vertex', 'fragment'].map((stage) => files[stage]['glsl-es-100'].file);
    const texts = await read(names.map((name) => join(into, name)));
    await rm(into, { recursive: true });
    return texts;
}

/** In the page: a bent grid that covers most of the picture, with any uniform at a number that its name and place give. */
function draw([vertex, fragment]) {
    const size = 160;
    const gl = Object.assign(document.createElement('canvas'), { width: size, height: size }).getContext('webgl', {
        antialias: false,
    });
    gl.getExtension('OES_standard_derivatives');
    const program = gl.createProgram();
    for (const [type, text] of [
        [gl.VERTEX_SHADER, vertex],
        [gl.FRAGMENT_SHADER, fragment],
    ]) {
        const shader = gl.createShader(type);
        gl.shaderSource(shader, text);
        gl.compileShader(shader);
        if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) return { failed: gl.getShaderInfoLog(shader) };
        gl.attachShader(program, shader);
    }
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS)) return { failed: gl.getProgramInfoLog(program) };
    gl.useProgram(program);

    const side = 24;
    const values = { position: [], normal: [], uv: [] };
    const corner = (x, y) => {
        const [u, v] = [x / side, y / side];
        const z = 0.25 * Math.sin(5 * u) * Math.cos(4 * v);
        const normal = [-1.25 * Math.cos(5 * u) * Math.cos(4 * v), Math.sin(5 * u) * Math.sin(4 * v), 1];
        values.position.push(1.8 * u - 0.9, 1.8 * v - 0.9, z);
        values.normal.push(...normal.map((n) => n / Math.hypot(...normal)));
        values.uv.push(u, v);
    };
    for (let y = 0; y < side; y++)
        for (let x = 0; x < side; x++)
            for (const [i, j] of [
                [0, 0],
                [1, 0],
                [1, 1],
                [0, 0],
                [1, 1],
                [0, 1],
            ])
                corner(x + i, y + j);
    for (const [name, of] of Object.entries(values)) {
        const at = gl.getAttribLocation(program, name);
        if (at < 0) continue;
        gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
        gl.bufferData(gl.ARRAY_BUFFER, new Float32Array(of), gl.STATIC_DRAW);
        gl.enableVertexAttribArray(at);
        gl.vertexAttribPointer(at, name === 'uv' ? 2 : 3, gl.FLOAT, false, 0, 0);
    }

    gl.bindTexture(gl.TEXTURE_2D, gl.createTexture());
    const texels = Uint8Array.from({ length: 4 * 64 * 64 }, (_, i) => (i * 37 + (i >> 6) * 11) % 256);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA, 64, 64, 0, gl.RGBA, gl.UNSIGNED_BYTE, texels);
    gl.generateMipmap(gl.TEXTURE_2D);

    const count = gl.getProgramParameter(program, gl.ACTIVE_UNIFORMS);
    for (let i = 0; i < count; i++) {
        const { name, type, size: length } = gl.getActiveUniform(program, i);
        const at = gl.getUniformLocation(program, name);
        const numbers = (n) => Array.from({ length: n * length }, (_, k) => 0.2 + ((name.length + 3 * k) % 7) / 10);
        // Turned a little, so that no row is a column.
        const matrix = (n) => Array.from({ length: n * n }, (_, k) => (k % (n + 1) === 0 ? 1 : 0.02 * (k % 3)));
        switch (type) {
            case gl.SAMPLER_2D:
            case gl.BOOL:
                gl.uniform1i(at, type === gl.BOOL ? 1 : 0);
                break;
            case gl.FLOAT:
                gl.uniform1fv(at, numbers(1));
                break;
            case gl.FLOAT_VEC3:
                gl.uniform3fv(at, numbers(3));
                break;
            case gl.FLOAT_VEC4:
                gl.uniform4fv(at, numbers(4));
                break;
            case gl.FLOAT_MAT2:
                gl.uniformMatrix2fv(at, false, matrix(2));
                break;
            case gl.FLOAT_MAT4:
                gl.uniformMatrix4fv(at, false, matrix(4));
                break;
            default:
                return { failed: `the uniform ${name} has the type ${type}` };
        }
    }
    gl.clearColor(0, 0, 0, 1);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.enable(gl.DEPTH_TEST);
    gl.drawArrays(gl.TRIANGLES, 0, values.uv.length / 2);
    const pixels = new Uint8Array(4 * size * size);
    gl.readPixels(0, 0, size, size, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
    return { pixels: Array.from(pixels), error: gl.getError() };
}

const { browser, page, errors } = await open(320, 240);
try {
    const picture = async (texts) => {
        const { failed, pixels, error } = await page.evaluate(draw, texts);
        assert.equal(failed, undefined, texts.join('\n'));
        assert.equal(error, 0);
        return pixels;
    };
    const before = await picture(await read(author));
    const drawn = before.filter((value, i) => i % 4 === 0 && value > 0).length;
    assert.ok(drawn > 10_000, `${drawn} pixels are drawn`);
    const colors = new Set(before.filter((_, i) => i % 4 === 1)).size;
    assert.ok(colors > 50, `${colors} greens are seen`);
    const after = await picture(await written());
    const off = after.filter((value, i) => Math.abs(value - before[i]) > 1).length;
    console.log(`${off} channels off by more than 1/255, ${drawn} pixels drawn`);
    assert.equal(off, 0);
    // Chromium's word on what reading a picture costs.
    const complaints = errors.filter((text) => !text.includes('GPU stall due to ReadPixels'));
    assert.deepEqual(complaints, []);
} finally {
    await browser.close();
}
