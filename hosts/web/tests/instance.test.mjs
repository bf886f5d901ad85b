// What a call leaves behind that panics, or that fills the engine's stack.

import assert from 'node:assert/strict';
import test from 'node:test';
import { Instance } from '../instance.js';
import { PreshadeSync } from '../sync.js';
import { FIXTURES, read } from './support.mjs';

const section = (id, ...bytes) => [id, bytes.length, ...bytes];
const text = (name) => [name.length, ...Buffer.from(name)];
const body = (...code) => [code.length + 2, 0, ...code, 0x0b];
const constant = (n) => [0x41, n];

/** A module with the compiler's exports. `answer` has this code. */
function module(answer) {
    const functions = ['room', 'answer', 'answer_at'];
    const exported = functions.flatMap((name, index) => [...text(name), 0, index]);
    return new WebAssembly.Module(
        new Uint8Array([
            ...[0, 0x61, 0x73, 0x6d, 1, 0, 0, 0],
            ...section(1, 2, 0x60, 1, 0x7f, 1, 0x7f, 0x60, 0, 1, 0x7f),
            ...section(3, 3, 0, 1, 1),
            ...section(5, 1, 0, 1),
            ...section(7, 4, ...text('memory'), 2, 0, ...exported),
            ...section(10, 3, ...body(...constant(32)), ...body(...answer), ...body(...constant(8))),
        ]),
    );
}

test('a panic is an error, and the instance is replaced', () => {
    const instance = new Instance(module([0x00]));
    for (let round = 0; round < 2; round++) {
        const { error } = instance.call({});
        assert.equal(error.code, 'panic');
        assert.match(error.rendered, /native program/);
        assert.equal(instance.memory, 0);
    }
});

test('a full stack is an error, and the instance is replaced', () => {
    // It calls itself.
    const { error } = new Instance(module([0x10, 1])).call({});
    assert.equal(error.code, 'too-deep');
});

test('nesting is an error or none, and the next call works', () => {
    const compiler = new PreshadeSync();
    const leaf = read(FIXTURES, 'agree/leaf.wgsl');
    const nested = (text) => `
        @vertex fn vs() -> @builtin(position) vec4<f32> { return vec4(0.0); }
        @fragment fn fs(@builtin(position) p: vec4<f32>) -> @location(0) vec4<f32> {
            var x = p.x;
            ${text}
            return vec4(x);
        }`;
    const told = [];
    for (const depth of [60, 110, 126, 170]) {
        const ifs = `${'if x > 1.0 { '.repeat(depth)}x += 1.0;${' }'.repeat(depth)}`;
        const elses = `${'if x > 1.0 { x += 1.0; } else '.repeat(depth)}{ x += 2.0; }`;
        for (const [name, code] of Object.entries({ ifs, elses })) {
            let outcome = 'accepted';
            try {
                compiler.rewrite(nested(code), { pass: 'depth-prepass' });
            } catch (error) {
                assert.notEqual(error.code, 'panic', error.message);
                outcome = error.code;
            }
            told.push(`${depth} ${name}: ${outcome}`);
            assert.match(compiler.rewrite(leaf, { pass: 'depth-prepass' }).recipe, /^depth-prepass/);
        }
    }
    console.log(`# ${told.join(', ')}`);
});
