import assert from 'node:assert/strict';
import test, { after, before } from 'node:test';
import { launch, open } from './browser.mjs';
import { serve } from './serve.mjs';

let browser, served;
before(async () => {
    [browser, served] = await Promise.all([launch({ webgpu: true }), serve()]);
});
after(async () => {
    await browser?.close();
    served?.close();
});

async function called(name, options) {
    const { page, errors } = await open(browser, `${served.address}/page/webgpu/pipeline`);
    const found = await page.evaluate(([name, options]) => globalThis[name](options), [name, options]);
    assert.ok(found.lit > 1000);
    assert.ok(found.rows.length > 0 && found.rows.every(({ state }) => state === 'done'));
    assert.deepEqual(errors, []);
    await page.close();
    return found;
}

test('the scene pass of a RenderPipeline keeps its picture', async () => {
    const { differ, texts } = await called('scenePass', { material: 'opacityNode, alphaTest' });
    assert.equal(differ, 0);
    // What three.js made of the material, before and after a frame.
    assert.equal(texts[0], null);
    assert.deepEqual(texts[1], texts[2]);
    assert.match(texts[1].vertex, /@vertex/);
    assert.match(texts[1].fragment, /@fragment[^]*discard/);
});

test('temporal anti-aliasing of displaced geometry that stands still', async (context) => {
    const { again, three, ours } = await called('traa', { material: 'positionNode' });
    context.diagnostic(`pixels unlike those of velocity 0: three.js ${three}, preshade ${ours}`);
    assert.equal(again, 0);
    assert.equal(ours, 0);
    assert.ok(three > 0);
});
