import assert from 'node:assert/strict';
import test from 'node:test';
import { rewrite } from 'preshade';
import { launch, open } from './browser.mjs';
import { serve } from './serve.mjs';

test('the package loads, draws nothing otherwise, tells texts, and keeps what each build made', async (context) => {
    const { address, close } = await serve();
    context.after(close);
    const browser = await launch();
    context.after(() => browser.close());
    const { page, errors } = await open(browser, `${address}/page/load`);
    const found = await page.evaluate(() => globalThis.found);
    assert.ok(found.same && found.again);
    const texts = await page.evaluate(() => globalThis.texts());
    const { before, any, one, many, compiles, disposed } = texts;
    assert.deepEqual([texts.wrapped, texts.proxy], [one, one]);
    assert.deepEqual([before, disposed, compiles], [null, null, true]);
    assert.doesNotMatch(one.vertex, /#define USE_INSTANCING/);
    assert.match(many.vertex, /#define USE_INSTANCING/);
    assert.deepEqual(any, many);
    // As `npx preshade` takes it.
    const { errors: wrong, refusals } = await rewrite(one, { pass: 'depth-prepass', emit: 'glsl-es' });
    assert.deepEqual([wrong, refusals], [[], []]);
    const kept = await page.evaluate(() => globalThis.kept());
    const none = undefined;
    assert.deepEqual(kept.visits, [
        [none, 1],
        [1, 2],
        [none, 3],
        [none, none],
        [2, 2],
    ]);
    assert.equal(kept.names.length, 1);
    assert.deepEqual(errors, []);
});
