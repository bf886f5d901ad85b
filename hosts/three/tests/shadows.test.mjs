// Shadow maps by preshade hold the depths of the authors' whole programs, drawn from the light: not one texel differs.

import assert from 'node:assert/strict';
import test from 'node:test';
import { launch, open } from './browser.mjs';
import { serve } from './serve.mjs';

/** What is drawn by preshade, and leaves what three.js leaves. */
const AS_THREE = ['logarithmic depth, point light'];
/** What three.js draws right by itself. */
const COVERED = ['displacementMap', 'colour only by onBeforeCompile', 'stock materials'];

test('shadow maps', async (context) => {
    const { address, close } = await serve();
    context.after(close);
    const browser = await launch();
    context.after(() => browser.close());
    const { page, errors } = await open(browser, `${address}/page/shadows`);
    for (const name of await page.evaluate(() => globalThis.names)) {
        await context.test(name, async (context) => {
            const found = (await page.evaluate((name) => globalThis.runCases([name]), name))[name];
            const { differ, moved, texels, covered, picture, restored, report } = found;
            context.diagnostic(`${differ} of ${texels} texels differ; three.js's own differ in ${moved}`);
            const isAsThree = AS_THREE.includes(name);
            assert.ok((isAsThree ? moved : differ).every((count) => count === 0));
            assert.ok(
                covered.every((count) => count > 0),
                'nothing is drawn',
            );
            assert.equal(picture, 0, 'the picture itself changed');
            assert.ok(restored.every((count) => count === 0));
            const states = new Set(report.map(({ state }) => state));
            assert.ok(
                !states.has('failed') && !states.has('refused') && !states.has('pending'),
                JSON.stringify(report),
            );
            if (COVERED.includes(name)) {
                assert.deepEqual([...states], ['same']);
                assert.ok(moved.every((count) => count === 0));
            } else {
                assert.ok(states.has('done'));
                assert.ok(isAsThree || moved.every((count) => count > 0), 'three.js draws it right by itself');
            }
            assert.deepEqual(errors.splice(0), []);
        });
    }
});
