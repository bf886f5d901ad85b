// Pages as they live: what changes, comes, goes and is lost.

import assert from 'node:assert/strict';
import test from 'node:test';
import { launch, open } from './browser.mjs';
import { serve } from './serve.mjs';

const expected = {
    EffectComposer: (found) => assert.deepEqual(found, { differ: 0, picture: 0 }),
    'lights, fog and an environment change'({ differ, checks, states }) {
        assert.equal(differ, 0);
        assert.ok(checks > 20);
        assert.deepEqual(states, ['done']);
    },
    'the author’s shader of onBeforeCompile'({ extra, differ, moves }) {
        assert.equal(extra, 0, 'the author’s callback was called for us');
        assert.equal(differ, 0);
        assert.ok(moves > 0);
    },
    'objects and materials added later, and outside of the picture'({ added, behind, states }) {
        assert.equal(added, 0);
        assert.equal(behind, 0);
        assert.deepEqual(states, ['done']);
    },
    'the author’s customDepthMaterial': (found) => assert.deepEqual(found, { differ: 0, kept: true }),
    'a material that changes under two maps on demand, in view and out of it'(found) {
        assert.deepEqual(found, [[true, true], [0, 0], [true, true], [0, 0], ['off']]);
    },
    'shadow maps that are drawn on demand'(found) {
        assert.equal(Object.keys(found).length, 3);
        for (const [name, each] of Object.entries(found))
            assert.deepEqual(each, { differ: 0, moved: true, still: 0, again: 0, others: 0, restored: 0 }, name);
    },
    'what is refused is drawn as always'({ differ, rows: [row] }) {
        assert.equal(differ, 0);
        assert.equal(row.state, 'refused');
        assert.equal(row.code, 'viewer-decides');
        assert.ok(row.reason && row.remedy);
    },
    'a fade by distance'({ left_out, drop, keep, fades }) {
        assert.equal(left_out, 1);
        assert.equal(drop, 0, 'the fade is in the shadow');
        assert.equal(keep, 0);
        assert.ok(fades > 0);
    },
    'uniforms that are replaced'({ moves, differ }) {
        assert.ok(moves > 0);
        assert.equal(differ, 0);
    },
    'the cache of the next visit'({ first, second }) {
        assert.equal(first.state, 'done');
        assert.ok(first.ms > 0);
        assert.deepEqual(second, { state: 'done', ms: 0, differ: 0 });
    },
};

test('pages as they live', async (context) => {
    const { address, close } = await serve();
    context.after(close);
    const browser = await launch();
    context.after(() => browser.close());
    const { page, errors } = await open(browser, `${address}/page/life`);
    for (const name of await page.evaluate(() => globalThis.names)) {
        await context.test(name, async () => {
            expected[name](await page.evaluate((name) => globalThis.runScenario(name), name));
            assert.deepEqual(
                errors.splice(0).filter((message) => !/CONTEXT_LOST|Context Lost/i.test(message)),
                [],
            );
        });
    }
});
