// The functions, their errors, and what hostile input does to the calls after it.

import assert from 'node:assert/strict';
import { join } from 'node:path';
import test from 'node:test';
import binaryen from 'binaryen';
import * as preshade from '../index.js';
import * as sync from '../sync.js';
import { FIXTURES, native, read } from './support.mjs';

const LEAF = read(FIXTURES, 'agree/leaf.wgsl');
const PHONG = { vertex: read(FIXTURES, 'glsl/phong.vert'), fragment: read(FIXTURES, 'glsl/phong.frag') };

/** A call that fails with this code. */
async function fails(call, code) {
    const error = await call().then(
        () => assert.fail('it does not fail'),
        (error) => error,
    );
    assert.ok(error instanceof preshade.PreshadeError, String(error.stack));
    assert.equal(error.code, code, error.message);
    return error;
}

test('a rewrite is a variant with its files and plan', async () => {
    const variant = await preshade.rewrite(LEAF, { pass: 'depth-prepass', name: 'leaf' });
    assert.equal(variant.material, 'leaf');
    assert.match(variant.recipe, /^depth-prepass/);
    assert.deepEqual(
        variant.plan.passes.map((pass) => pass.role),
        ['prepass', 'main'],
    );
    assert.ok(variant.files.some(({ name }) => name === 'leaf.plan.json'));
    assert.deepEqual(sync.rewrite(LEAF, { pass: 'depth-prepass', name: 'leaf' }), variant);
    const again = await preshade.rewrite(LEAF, { pass: variant.plan.steps, name: 'leaf' });
    assert.deepEqual(again.files, variant.files);
});

test('GLSL is given as two stages', async () => {
    const variant = await preshade.rewrite(PHONG, { pass: 'depth-prepass', emit: 'glsl-es', name: 'phong' });
    assert.match(variant.recipe, /^depth-prepass/);
    assert.ok(variant.files.some(({ name }) => name.endsWith('.es.frag')));
});

test('the dataflow graph is that of the native program', async () => {
    const { read: files, ...graph } = await preshade.graph(LEAF, { name: 'leaf' });
    assert.deepEqual(files, ['leaf.wgsl']);
    const { stdout } = await native(['graph', join(FIXTURES, 'agree/leaf.wgsl'), '--format', 'json']);
    const expected = JSON.parse(stdout);
    // Lines name the file, which is another here.
    const nameless = (node) => ({ ...node, line: node.line?.replace(/^.*:/, '') });
    assert.deepEqual(graph.nodes.map(nameless), expected.nodes.map(nameless));
    assert.deepEqual(graph.edges, expected.edges);
    assert.ok(graph.edges.length > graph.functions.length);
});

test('includes come from the map of files', async () => {
    const vertex = '#version 300 es\nin vec3 p;\nvoid main() { gl_Position = vec4(p, 1.0); }\n';
    const fragment =
        '#version 300 es\nprecision highp float;\n#include "lib/tint.glsl"\nout vec4 c;\nvoid main() { c = tint(); }\n';
    const files = { 'lib/tint.glsl': 'vec4 tint() { return vec4(1.0); }\n' };
    const variant = await preshade.rewrite({ vertex, fragment }, { files });
    assert.ok(variant.read.includes('lib/tint.glsl'), `${variant.read}`);
    const error = await fails(() => preshade.rewrite({ vertex, fragment }), 'parse');
    assert.deepEqual([error.place.file, error.place.line], ['material.frag', 3]);
    assert.match(error.rendered, /#include "lib\/tint.glsl"/);
    const endless = { 'lib/tint.glsl': '#include "tint.glsl"\n' };
    const rounds = await fails(() => preshade.rewrite({ vertex, fragment }, { files: endless }), 'parse');
    assert.match(rounds.message, /includes itself without end/);

    // WESL would take a sixth of the module.
    const wesl = await fails(() => preshade.rewrite([{ name: 'm.wesl', text: LEAF }]), 'unsupported');
    assert.match(wesl.message, /WESL, which this build cannot read/);
});

test('a refusal has its code, reason, remedy and place', async () => {
    const { refusals, recipe } = await preshade.rewrite(LEAF, { pass: 'depth-prepass', blend: 'alpha' });
    assert.equal(recipe, '');
    const [refusal] = refusals;
    assert.deepEqual([refusal.pass, refusal.code], ['depth-prepass', 'blended']);
    assert.ok(refusal.reason && refusal.remedy && refusal.rendered.includes('depth-prepass/blended'));
});

test('explain, outputs, agree and passes answer', async () => {
    const explained = await preshade.explain(LEAF);
    assert.ok(explained.passes.find(({ pass }) => pass === 'depth-prepass').sites.length);
    const outputs = await preshade.outputs(LEAF, { write: ['depth', 'normal'] });
    assert.match(outputs.recipe, /^outputs/);
    const shadow = read(FIXTURES, 'agree/leaf.shadow.wgsl');
    const same = await preshade.agree(LEAF, LEAF, { as: 'same' });
    assert.ok(same.agrees && !same.isPartial);
    const old = read(FIXTURES, 'agree/leaf.old-shadow.wgsl');
    const map = { 'light.view_proj': 'camera.view_proj' };
    const differs = await preshade.agree(LEAF, old, { as: 'shadow', map });
    assert.equal(differs.agrees, false);
    assert.ok(differs.judged.some(({ breaks }) => breaks));
    assert.ok(shadow.length > 0);
    const passes = await preshade.passes();
    assert.ok(passes.length > 8 && passes.every(({ name, parameters }) => name && parameters));
    const [one] = await preshade.passes({ name: 'hoist' });
    assert.equal(one.name, 'hoist');
});

test('a wrong request says what is wrong', async () => {
    await fails(() => preshade.rewrite(LEAF, { pass: 'depth-prepas' }), 'usage');
    await fails(() => preshade.rewrite(LEAF, { emitt: 'wgsl' }), 'usage');
    await fails(() => preshade.rewrite(LEAF, { emit: 'hlsl' }), 'usage');
    await fails(() => preshade.rewrite(LEAF, { cull: 'sideways' }), 'usage');
    await fails(() => preshade.rewrite(undefined), 'usage');
    await fails(() => preshade.agree(LEAF, LEAF, { as: 'twin' }), 'usage');
    const error = await fails(() => preshade.rewrite('fn f( {'), 'parse');
    assert.deepEqual([error.place.file, error.place.line], ['material.wgsl', 1]);
});

test('hostile input is an error, and the next call works', async () => {
    const vertex = '@vertex fn vs() -> @builtin(position) vec4<f32> { return vec4(0.0); }\n';
    const body = (text) => `${vertex}@fragment fn fs() -> @location(0) vec4<f32> { ${text} }`;
    const deep = (n, open, close, inner) => open.repeat(n) + inner + close.repeat(n);
    const attacks = {
        'ten megabytes': `${LEAF}// ${'x'.repeat(10 << 20)}`,
        brackets: body(`return vec4(${deep(100_000, '(', ')', '1.0')});`),
        'unclosed brackets': '('.repeat(100_000),
        blocks: body(`${deep(100_000, '{', '}', '')} return vec4(1.0);`),
        minuses: body(`return vec4(${'-'.repeat(100_000)}1.0);`),
        'a sum': body(`return vec4(${Array(100_000).fill('1.0').join('+')});`),
        'else ifs': body(`var x = 0.0; ${'if x > 1.0 { x = 2.0; } else '.repeat(5000)} { x = 3.0; } return vec4(x);`),
        types: `alias t = ${deep(100_000, 'array<', ', 2>', 'f32')};`,
    };
    for (const [name, text] of Object.entries(attacks)) {
        const began = performance.now();
        const error = await preshade.rewrite(text, { pass: 'depth-prepass' }).catch((error) => error);
        const took = performance.now() - began;
        if (error instanceof Error) assert.notEqual(error.code, 'worker', name);
        const asked = await native(['rewrite', '-', '--lang', 'wgsl', '--pass', 'depth-prepass'], { input: text });
        const isSame = asked.status === 0 ? !(error instanceof Error) : asked.stderr.includes(`error[${error.code}]`);
        const isReader = name === 'ten megabytes' && error.code === 'too-deep';
        assert.ok(isSame || isReader, `${name}: ${error.code}; the native program: ${asked.stderr.slice(0, 300)}`);
        console.log(`# ${name}: ${error.code ?? 'accepted'} in ${took.toFixed(0)} ms`);
        const next = await preshade.rewrite(LEAF, { pass: 'depth-prepass' });
        assert.match(next.recipe, /^depth-prepass/);
    }
});

test('a call that takes too long is ended, and the next one works', async () => {
    const compiler = new preshade.Preshade({ timeout: 1 });
    await fails(() => compiler.rewrite(LEAF, { pass: 'depth-prepass' }), 'timeout');
    // `agree` is answered by the full module: this one never answers.
    const full = binaryen.parseText(`(module (memory (export "memory") 1)
        (func (export "room") (param i32) (result i32) (i32.const 0))
        (func (export "answer") (result i32) (loop (br 0)) (unreachable))
        (func (export "answer_at") (result i32) (i32.const 0)))`);
    const busy = new preshade.Preshade({ timeout: 10_000, full: full.emitBinary() });
    const endless = busy.agree(LEAF, LEAF);
    const behind = busy.passes();
    await fails(() => endless, 'timeout');
    assert.ok((await behind).length);
    busy.dispose();
    const patient = new preshade.Preshade({ timeout: 60_000 });
    assert.ok((await patient.passes()).length);
    const left = patient.passes();
    patient.dispose();
    await fails(() => left, 'disposed');
    assert.ok((await patient.passes()).length);
    patient.dispose();
    const lost = new preshade.Preshade({ wasm: join(FIXTURES, 'no-such.wasm') });
    await fails(() => lost.passes(), 'worker');
    lost.dispose();
});

test('memory is flat over a thousand rewrites', async () => {
    const compiler = new sync.PreshadeSync();
    const once = () => compiler.rewrite(LEAF, { pass: 'depth-prepass' });
    for (let i = 0; i < 50; i++) once();
    const before = compiler.memory;
    for (let i = 0; i < 1000; i++) once();
    assert.ok(before > 0);
    assert.equal(compiler.memory, before);
});
