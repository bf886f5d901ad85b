// Variants: what they cost, and whose they are.

import assert from 'node:assert/strict';
import test from 'node:test';
import { version } from 'preshade/version';
import { MAKER, Variants } from '../variants.js';

const plan = { plan: { passes: [], files: [], steps: [] }, files: [], notes: [], refusals: [], errors: [] };

test('the time of a variant is the compiler’s, without the wait for others', async () => {
    let last = null;
    /** It works at one call at a time, as the worker does. */
    const compiler = {
        ready: async () => {},
        rewrite() {
            last = Promise.resolve(last)
                .then(() => new Promise((resolve) => setTimeout(resolve, 4)))
                .then(() => plan);
            return last;
        },
        dispose() {},
    };
    const variants = new Variants({ cache: false, compiler });
    const began = performance.now();
    const entries = Array.from({ length: 20 }, (_, i) => variants.get(`// ${i}`, { pass: 'hoist' }));
    await variants.settled();
    const all = performance.now() - began;
    assert.ok(entries.every(({ state, ms }) => state === 'ready' && ms > 0));
    const sum = entries.reduce((sum, { ms }) => sum + ms, 0);
    assert.ok(sum <= all, `${sum} ms of ${all} ms`);
});

test('whoever bundles the package, variants are kept by its form and the compiler', () => {
    assert.match(MAKER, new RegExp(`^\\d+ ${version}$`));
});

test('one that is disposed of while the compiler loads asks it nothing', async () => {
    let asked = 0;
    const compiler = { ready: async () => {}, rewrite: async () => (asked++, plan), dispose() {} };
    const variants = new Variants({ cache: false, compiler });
    const entry = variants.get('text', { pass: 'hoist' });
    variants.dispose();
    await entry.done;
    assert.deepEqual([asked, entry.state, entry.code], [0, 'failed', 'disposed']);
});
