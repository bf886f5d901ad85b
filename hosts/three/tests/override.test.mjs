// What three.js's passes write by preshade are the values of the authors' whole programs: not one differs.

import assert from 'node:assert/strict';
import test from 'node:test';
import { launch, open } from './browser.mjs';
import { serve } from './serve.mjs';

test('passes that override materials', async (context) => {
    const { address, close } = await serve();
    context.after(close);
    const browser = await launch();
    context.after(() => browser.close());
    const { page, errors } = await open(browser, `${address}/page/override`);
    for (const name of await page.evaluate(() => globalThis.names)) {
        await context.test(name, async (context) => {
            const found = await page.evaluate((name) => globalThis.runPass(name), name);
            const { same, renders, differ, depth, moved, restored, report } = found;
            context.diagnostic(`${differ} values differ in ${renders} renders; three.js's own differ in ${moved}`);
            assert.ok(same && renders > 0);
            assert.ok([...differ, ...depth].every((count) => count === 0));
            assert.ok(
                moved.every((count) => count > 0),
                'three.js draws it right by itself',
            );
            assert.ok(restored.every((count) => count === 0));
            assert.ok(
                report.every(({ state }) => ['done', 'same'].includes(state)),
                JSON.stringify(report),
            );
            assert.deepEqual(errors.splice(0), []);
        });
    }
    for (const [name, words] of [
        ['world', 'of the program, in world axes'],
        ['object', 'of the program, in object axes'],
        ['none', 'of faces'],
    ]) {
        await context.test(`normals: ${words}`, async (context) => {
            const { state, normals, most, differ, moved } = await page.evaluate(
                (name) => globalThis.runAxes(name),
                name,
            );
            context.diagnostic(`${differ} values differ, by ${most} at most; three.js's own differ in ${moved}`);
            assert.equal(state, 'done');
            assert.equal(normals, words);
            assert.ok(moved > 0);
            // A normal of a face is a difference of two positions, and the two ways to those round differently.
            if (name === 'none') assert.ok(most < 0.01);
            else assert.equal(differ, 0);
            assert.deepEqual(errors.splice(0), []);
        });
    }
});
