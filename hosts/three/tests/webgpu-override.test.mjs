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

test('override materials draw where the whole program does', async (context) => {
    const { page, errors } = await open(browser, `${served.address}/page/webgpu/override`);
    const materials = (await page.evaluate(() => globalThis.materials)).filter((name) => name !== 'plain');
    const cases = materials.flatMap((material) => [{ material }, { material, override: 'color' }]);
    const changed = { material: 'alphaMap, alphaTest', override: 'color', change: 'opacity' };
    for (const options of [{ material: 'plain' }, ...cases, changed]) {
        const name = Object.values(options).join(' ');
        const found = await page.evaluate((options) => globalThis.compare(options), options);
        const { three, ours, drawn, undone, rows, left } = found;
        const states = rows.map(({ state }) => state);
        const told = (of) => `${of.depths} depths and ${of.pixels} pixels`;
        context.diagnostic(`${name}: ${drawn} drawn; three.js ${told(three)} wrong, preshade ${told(ours)}; ${states}`);
        assert.equal(ours.depths, 0, name);
        assert.equal(ours.pixels, 0, name);
        assert.equal(undone, 0, name);
        assert.equal(left, 0, name);
        assert.deepEqual(states, three.depths || three.pixels ? ['done'] : states, name);
    }
    const { made, left, ...named } = await page.evaluate(() => globalThis.named());
    assert.deepEqual(named, {
        first: ['first done', 'second done'],
        renamed: ['third done', 'second done'],
        undone: ['second done'],
        again: ['second done', 'fourth done'],
        disposed: [],
    });
    assert.equal(made, 2);
    assert.equal(left, 1);
    assert.match(await page.evaluate(() => globalThis.refusesNormals()), /needs a WebGLRenderer/);
    // three.js' own normal material says so of itself, where the author's material has an alphaMap.
    const own = /Length of 'vec4\(\)' data exceeds/;
    assert.deepEqual(
        errors.filter((error) => !own.test(error)),
        [],
    );
    await page.close();
});
