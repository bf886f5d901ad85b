// `npx preshade`: the native program's stdout, files and exit status.

import assert from 'node:assert/strict';
import { mkdirSync, writeFileSync } from 'node:fs';
import { join } from 'node:path';
import test from 'node:test';
import { isOfThree, withThree } from '../three-prefix.js';
import { below, bin, folder, native, read } from './support.mjs';

const LEAF = 'fixtures/agree/leaf.wgsl';
const PHONG = ['fixtures/glsl/phong.vert', 'fixtures/glsl/phong.frag'];

/** Both programs answer alike. */
async function alike(args, options) {
    const [ours, theirs] = await Promise.all([bin(args, options), native(args, options)]);
    assert.equal(ours.stdout, theirs.stdout, `${args.join(' ')}\n${ours.stderr}`);
    assert.equal(ours.status, theirs.status, `${args.join(' ')}\n${ours.stderr}\n${theirs.stderr}`);
    return { ours, theirs };
}

test('stdout and exit status are those of the native program', async () => {
    const input = read(process.cwd(), '../../', LEAF);
    for (const args of [
        ['passes'],
        ['passes', 'hoist'],
        ['passes', '--format', 'json'],
        ['passes', 'hoisst'],
        ['explain', LEAF],
        ['explain', LEAF, '-v'],
        ['explain', ...PHONG, '--pass', 'depth-prepass', '--format', 'json'],
        ['rewrite', LEAF, '--pass', 'depth-prepass'],
        ['rewrite', LEAF],
        ['rewrite', LEAF, '--pass', 'depth-prepass', '--format', 'json'],
        ['rewrite', ...PHONG, '--pass', 'depth-prepass', '--emit', 'glsl-es,wgsl', '--name', 'lit'],
        ['rewrite', LEAF, '--pass', 'depth-prepass', '--blend', 'alpha', '--samples', '4'],
        ['rewrite', LEAF, '--pass', 'depth-prepass', '--reversed-z', '--cull', 'front', '--no-depth-write'],
        ['rewrite', LEAF, '--pass', 'no-such-pass'],
        ['rewrite', LEAF, '--pass', 'depth-prepass', '--emit', 'glsl-tess'],
        ['rewrite', 'no-such-file.wgsl', '--pass', 'depth-prepass'],
        ['rewrite', 'no-such-file.wgsl', '--pass', 'depth-prepass', '--format', 'json'],
        ['rewrite', LEAF, '--pass', 'depth-prepass', '--limits', 'source-bytes=10', '--format', 'json'],
        ['agree', LEAF, '--with', 'fixtures/agree/leaf.shadow.wgsl', '--as', 'shadow'],
        ['agree', LEAF, '--with', 'fixtures/agree/leaf.old-shadow.wgsl', '--as', 'shadow', '--format', 'markdown'],
        ['agree', LEAF, LEAF, '--as', 'same', '--format', 'json'],
    ])
        await alike(args);
    await alike(['rewrite', '-', '--lang', 'wgsl', '--pass', 'early-alpha'], { input });
    await alike(['rewrite', '-', '--pass', 'early-alpha'], { input });
});

test('files are those of the native program, and are written once', async (context) => {
    const out = folder(context);
    const args = (to) => ['rewrite', LEAF, '--pass', 'depth-prepass', '--emit', 'wgsl,glsl-es', '-o', join(out, to)];
    const [ours, theirs] = [await bin(args('a')), await native(args('b'))];
    assert.deepEqual([ours.status, ours.stdout], [theirs.status, theirs.stdout]);
    const files = below(join(out, 'b'));
    assert.deepEqual(below(join(out, 'a')), files);
    for (const file of files) assert.equal(read(out, 'a', file), read(out, 'b', file), file);
    assert.match(ours.stderr, /wrote .*leaf\.plan\.json/);
    const again = await bin(args('a'));
    assert.match(again.stderr, /is up to date/);
});

test('includes and state come from disk', async (context) => {
    const cwd = folder(context);
    const write = (name, text) => writeFileSync(join(cwd, name), text);
    for (const name of ['a', 'lib', 'other']) mkdirSync(join(cwd, name));
    write('a/m.vert', '#version 300 es\nin vec3 p;\nvoid main() { gl_Position = vec4(p, 1.0); }\n');
    const body = 'out vec4 c;\nvoid main() { c = tint(); }\n';
    write('a/m.frag', `#version 300 es\nprecision highp float;\n#include "../lib/tint.glsl"\n${body}`);
    write('lib/tint.glsl', '#include "red.glsl"\n#include <deep/blue.glsl>\nvec4 tint() { return RED + BLUE; }\n');
    write('lib/red.glsl', '#define RED vec4(1.0, 0.0, 0.0, 1.0)\n');
    mkdirSync(join(cwd, 'other/deep'));
    write('other/deep/blue.glsl', '#define BLUE vec4(0.0, 0.0, 1.0, 1.0)\n');
    write('state.toml', 'depth_write = false\n');
    const glsl = ['a/m.vert', 'a/m.frag', '--pass', 'depth-prepass', '--emit', 'glsl-es'];
    await alike(['rewrite', ...glsl, '--include', 'other'], { cwd });
    const lacks = await alike(['rewrite', ...glsl], { cwd });
    assert.equal(lacks.ours.stderr, lacks.theirs.stderr);
    await alike(['rewrite', ...glsl, '--include', 'other', '--state', 'state.toml'], { cwd });
});

test('--three gives the texts of a ShaderMaterial what three.js declares, and says where that is not enough', async (context) => {
    const cwd = folder(context);
    const write = (name, text) => writeFileSync(join(cwd, name), text);
    const vertex = 'void main() { gl_Position = projectionMatrix * modelViewMatrix * vec4(position, 1.0); }\n';
    write('a.vert', vertex);
    write('a.frag', 'void main() { gl_FragColor = vec4(cameraPosition, 1.0); }\n');
    write('chunk.vert', `#include <common>\n${vertex}`);
    const rewrite = (name, ...flags) => bin(['rewrite', name, 'a.frag', '--pass', 'depth-prepass', ...flags], { cwd });
    const bare = await rewrite('a.vert');
    assert.equal(bare.status, 2);
    assert.match(bare.stderr, /error\[foreign\].*three\.js/);
    const whole = await rewrite('a.vert', '--three', '--emit', 'glsl-es');
    assert.equal(whole.status, 0, whole.stderr);
    assert.match(whole.stdout, /in vec3 position;/);
    assert.match(whole.stdout, /a\.prepass\.es\.vert/);
    const chunk = await rewrite('chunk.vert', '--three');
    assert.equal(chunk.status, 2);
    assert.match(chunk.stderr, /--three is for .*preshade\.text\(material\)/);
    // Texts with all their declarations are left alone, and so are names that stand in comments alone.
    const raw = { vertex: `in vec3 position;\nvoid main() { gl_Position = vec4(position, 1.0); } // uv`, fragment: '' };
    assert.equal(isOfThree(raw), false);
    assert.equal(withThree(raw), raw);
    const list = 'attribute vec3 a[2], position,\n    normal;';
    const body = 'void main() { vec3 p = position + normal; gl_Position = vec4(p, 1.0); }';
    assert.equal(isOfThree({ vertex: `${list}\n${body}`, fragment: '' }), false);
    // A value is no declaration.
    assert.equal(isOfThree({ vertex: body, fragment: '' }), true);
});

test('with --three, messages and reports have the lines of the files', async (context) => {
    const cwd = folder(context);
    const write = (name, lines) => writeFileSync(join(cwd, name), lines.join('\n'));
    const position = 'gl_Position = projectionMatrix * vec4(position + offset, 1.0);';
    write('a.vert', ['varying vec2 at;', 'void main() {', '    at = uv;', `    ${position}`, '}']);
    write('a.frag', ['varying vec2 at;', 'void main() {', '    gl_FragColor = vec4(at, at);', '}']);
    const three = (command, ...flags) => bin([command, 'a.vert', 'a.frag', '--three', ...flags], { cwd });
    const wrong = await three('explain');
    assert.match(wrong.stderr, /a\.vert:4:54[^]*\n *4 │ {5}gl_Position/);
    const json = await three('rewrite', '--pass', 'hoist', '--format', 'json');
    assert.match(JSON.parse(json.stdout).errors[0], /a\.vert:4:54[^]*\n *4 │/);
    write('a.vert', [
        'varying vec2 at;',
        'void main() {',
        '    at = uv;',
        `    ${position.replace(' + offset', '')}`,
        '}',
    ]);
    const told = await three('explain', '-v');
    assert.match(told.stdout, /a\.frag:3:\d+[^]*\n *3 │ {5}gl_FragColor/);
    const places = [
        ...(await three('explain', '--format', 'json')).stdout.matchAll(/"file": "a\.(\w+)",\s*"line": (\d+)/g),
    ];
    assert.deepEqual([...new Set(places.map(([, stage, line]) => `${stage} ${line}`))].sort(), ['frag 3', 'vert 4']);
});

test('without --emit, GLSL becomes WGSL, as in the native program, and the help says so', async () => {
    const { ours } = await alike(['rewrite', ...PHONG, '--pass', 'depth-prepass']);
    assert.match(ours.stdout, /phong\.main\.wgsl/);
    assert.match((await bin(['--help'])).stdout, /without it wgsl, of GLSL as well: for WebGL give glsl-es/);
});

test('what it cannot do is said', async () => {
    const says = async (args, pattern, status = 2) => {
        const { stderr, status: was } = await bin(args);
        assert.match(stderr, pattern);
        assert.equal(was, status);
    };
    await says(['verify', 'scene.toml'], /needs the native program/);
    await says(['rewrite', 'scene.toml'], /is a scene/);
    await says(['rewrite', 'fixtures'], /is a folder/);
    await says(['rewite', LEAF], /there is no command/);
    await says(['rewrite', LEAF, '--pas', 'hoist'], /--pas/);
    await says([], /Usage/);
    const { stdout, status } = await bin(['--version']);
    assert.match(stdout, /^preshade \d/);
    assert.equal(status, 0);
    const outputs = await bin(['outputs', LEAF, '--write', 'depth,normal']);
    const rewrite = await native(['rewrite', LEAF, '--pass', 'outputs:write=depth+normal']);
    assert.equal(outputs.stdout, rewrite.stdout);
});
