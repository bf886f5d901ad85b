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

/** Materials of which three.js' own shadow is that of the whole program. */
const SAME = [
    'plain',
    'positionNode',
    'displacementMap',
    'map, alphaTest',
    'alphaMap, alphaTest',
    'colorNode alpha, alphaTest',
    'maskNode',
    'maskShadowNode',
    'Discard in colorNode',
    'If, Discard in colorNode',
    'discard of wgslFn in colorNode',
    'depthNode',
    'castShadowPositionNode',
    'MeshStandardMaterial: map, alphaTest',
];

/** It discards by the distance to the viewer. */
const DISTANCE = 'opacityNode by distance, alphaTest';

async function compared(context, query, cases) {
    const { page, errors } = await open(browser, `${served.address}/page/webgpu/shadows${query}`);
    for (const options of cases) {
        const name = [query, ...Object.values(options)].join(' ');
        const found = await page.evaluate((options) => globalThis.compare(options), options);
        context.diagnostic(`${name}: ${found.drawn} depths, three.js ${found.three} wrong, preshade ${found.ours}`);
        assert.equal(found.ours, 0, name);
        const states = found.rows.map(({ state }) => state);
        if (SAME.includes(options.material) && !options.change) {
            assert.equal(found.three, 0, name);
            assert.deepEqual(states, ['same'], name);
        } else {
            assert.ok(found.three > 0, name);
            assert.ok(states.length > 0 && states.every((state) => state === 'done'), `${name}: ${states}`);
        }
    }
    assert.deepEqual(errors, []);
    await page.close();
}

test('every sort of material casts the shadow of its whole program', async (context) => {
    const { page } = await open(browser, `${served.address}/page/webgpu/shadows`);
    const materials = await page.evaluate(() => globalThis.materials);
    await page.close();
    const cases = materials.filter((name) => name !== DISTANCE).map((material) => ({ material }));
    await compared(context, '', cases);
});

test('what depends on the viewer is left out, or follows the light', async (context) => {
    await compared(context, '', [{ material: DISTANCE, view: 'keep' }]);
    const { page } = await open(browser, `${served.address}/page/webgpu/shadows`);
    const { three, ours, rows } = await page.evaluate((material) => globalThis.compare({ material }), DISTANCE);
    await page.close();
    // three.js' own shadow has no holes at all here.
    assert.equal(ours, three);
    assert.equal(rows[0].left_out.length, 1);
});

test('instanced, batched, skinned and morphed objects', async (context) => {
    const material = 'opacityNode, alphaTest';
    const objects = ['instanced', 'batched', 'skinned', 'morphed'];
    await compared(
        context,
        '',
        objects.map((object) => ({ material, object })),
    );
});

test('what changes while it is drawn', async (context) => {
    await compared(context, '', [
        { material: 'map, alphaTest', change: 'opacity' },
        { material: 'map, alphaTest', change: 'opacity', update: 'on demand' },
        { material: 'opacityNode, alphaTest', change: 'alphaTest', update: 'on demand' },
        { material: 'map, alphaTest', change: 'alpha of a batch', object: 'batched' },
        { material: 'MeshStandardMaterial: map, alphaTest', change: 'opacity' },
    ]);
});

test('spot and point lights, clipping planes, maps drawn on demand', async (context) => {
    const material = 'opacityNode, alphaTest';
    await compared(context, '', [
        { material, light: 'spot' },
        { material, light: 'point' },
        { material: 'vertexNode', light: 'point' },
        { material, clipping: 'clipped' },
        { material, update: 'on demand' },
    ]);
});

test('maps on demand are drawn again when preshade comes, goes, and is switched', async (context) => {
    const { page, errors } = await open(browser, `${served.address}/page/webgpu/shadows`);
    const found = await page.evaluate(() => globalThis.switched({ material: 'opacityNode, alphaTest' }));
    context.diagnostic(JSON.stringify(found));
    assert.ok(found.differ > 0);
    assert.deepEqual(found.wrong, { off: 0, on: 0, disposed: 0 });
    assert.deepEqual(errors, []);
    await page.close();
});

for (const query of ['?vsm', '?reversed', '?logarithmic']) {
    test(`a renderer with ${query}`, async (context) => {
        await compared(context, query, [
            { material: 'opacityNode, alphaTest' },
            { material: 'vertexNode', light: 'spot' },
        ]);
    });
}
