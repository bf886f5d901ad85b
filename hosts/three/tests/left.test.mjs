// What is left behind when things go: programs, textures, workers, memory.

import assert from 'node:assert/strict';
import test from 'node:test';
import { launch, open } from './browser.mjs';
import { serve } from './serve.mjs';

/** The whole count takes minutes: `RECOMPILES=1000`. */
const RECOMPILES = Number(process.env.RECOMPILES ?? 60);
const CYCLES = 100;

const expected = {
    'listeners of materials'({ before, during, after }) {
        assert.ok(during.some((count, i) => count > before[i]));
        assert.deepEqual(after, before);
    },
    'a compiler that cannot be loaded': (found) =>
        assert.deepEqual(found, { state: 'failed', code: 'worker', differ: 0 }),
    'a page without preshade-full.wasm': (found) => assert.deepEqual(found, { state: 'done', code: null, differ: 0 }),
    disposal({ drawn, withShadows, afterMaterial, rows, swept, isOwn, end, start, textures, workers }) {
        assert.ok(withShadows > drawn);
        assert.ok(afterMaterial < withShadows);
        assert.equal(rows, 1);
        assert.equal(swept, 0, 'an object that left is still known');
        assert.ok(isOwn, 'the renderer has our methods');
        assert.ok(end <= start.programs);
        assert.ok(textures[1] <= textures[0]);
        assert.equal(workers.made, workers.ended);
    },
    'a part that was disposed of': (found) =>
        assert.deepEqual(found, { before: 'done', rows: 0, isAnother: true, differ: 0, states: ['done'] }),
    'a text of ours that the driver refuses'({ isSettled, rows, differ, picture }) {
        assert.deepEqual([isSettled, differ, picture], [true, 0, 0]);
        assert.deepEqual(rows.map(({ pass }) => pass).sort(), ['prepass', 'prepass', 'shadow']);
        for (const { pass, state, code, reason, rendered, failures } of rows) {
            assert.deepEqual([state, code], ['failed', 'link']);
            assert.match(reason, /^preshade wrote a text that this driver refuses: 'missing' .*report it/);
            assert.match(rendered, /^vertex shader, line (\d+): 'missing'[^]*\n> +\1 \| void nonsense\(\)/);
            assert.match(rendered, /^fragment shader, line \d+: 'missing'/m);
            assert.equal(failures.length, pass === 'prepass' ? 2 : 0, 'the other form was tried');
        }
    },
    'a material and a camera that leave the scene'({ settled, listeners: [during, after], state }) {
        assert.deepEqual(settled, [true, false, true]);
        assert.equal(after, during - 1, 'the material is still known');
        assert.ok(['done', 'off'].includes(state), state);
    },
    'a context that is lost and restored': (found) =>
        assert.deepEqual(found, { before: 0, after: 0, states: ['done'] }),
};

test('what is left behind', async (context) => {
    const { address, close } = await serve();
    context.after(close);
    const browser = await launch({ args: ['--enable-precise-memory-info', '--js-flags=--expose-gc'] });
    context.after(() => browser.close());
    const { page, errors } = await open(browser, `${address}/page/left`);
    for (const name of await page.evaluate(() => globalThis.names)) {
        await context.test(name, async () => {
            expected[name](await page.evaluate((name) => globalThis.runScenario(name), name));
            assert.deepEqual(
                errors.splice(0).filter((message) => !/CONTEXT_LOST|Context Lost|404/i.test(message)),
                [],
            );
        });
    }
    await context.test(`${CYCLES} times opened and disposed of`, async () => {
        const found = await page.evaluate((count) => globalThis.cycles(count), CYCLES);
        const [first, ...rest] = found;
        for (const each of rest) assert.deepEqual(each, first);
        assert.equal(first.alive, 0);
    });
    await context.test(`${RECOMPILES} recompiles`, async (context) => {
        const found = await page.evaluate((count) => globalThis.recompile(count, count / 4), RECOMPILES);
        context.diagnostic(found.map(({ heap }) => `${(heap / 1e6).toFixed(1)} MB`).join(', '));
        const [, second, third, last] = found;
        assert.equal(second.programs, last.programs);
        assert.equal(second.rows, last.rows);
        assert.ok(last.heap < second.heap * 1.1 + 1e6, 'the heap grows');
        assert.ok(third.heap > 0);
    });
});
