import assert from 'node:assert/strict';
import test from 'node:test';
import { launch, open } from './browser.mjs';
import { serve } from './serve.mjs';

test('the package loads, and draws nothing otherwise', async (context) => {
    const { address, close } = await serve();
    context.after(close);
    const browser = await launch();
    context.after(() => browser.close());
    const { page, errors } = await open(browser, `${address}/page/load`);
    const found = await page.evaluate(() => globalThis.found);
    assert.ok(found.same && found.again);
    assert.deepEqual(errors, []);
});
