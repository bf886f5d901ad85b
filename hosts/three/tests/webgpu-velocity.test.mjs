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

async function compared(context, cases, isRight = true) {
    const { page, errors } = await open(browser, `${served.address}/page/webgpu/velocity`);
    for (const options of cases) {
        const name = Object.values(options).join(' ');
        const found = await page.evaluate((options) => globalThis.compare(options), options);
        const { covered, three, ours, rows, left } = found;
        const states = rows.map(({ state, reason }) => `${state} ${reason ?? ''}`).join('; ');
        context.diagnostic(`${name}: ${covered} pixels, three.js ${three} wrong, preshade ${ours} wrong, ${states}`);
        assert.deepEqual(left, [options.transparent ? undefined : 'transparent', 'object'], name);
        assert.equal(ours, 0, name);
        assert.ok(covered > 500, name);
        if (isRight)
            assert.ok(
                rows.every(({ state }) => state === 'done'),
                `${name}: ${states}`,
            );
    }
    assert.deepEqual(errors, []);
    await page.close();
}

test('what stands still has no velocity', async (context) => {
    const materials = ['plain', 'positionNode', 'vertexNode', 'displacementMap', 'opacityNode, alphaTest', 'depthNode'];
    await compared(context, [
        ...materials.map((material) => ({ material })),
        ...['instanced', 'skinned', 'morphed'].map((object) => ({ object })),
    ]);
});

test('objects, cameras, vertices, instances, bones and morphs that move', async (context) => {
    await compared(context, [
        { motion: 'object' },
        { motion: 'camera', material: 'positionNode' },
        { motion: 'object', material: 'Discard in outputNode' },
        { motion: 'shift', material: 'positionNode' },
        { motion: 'shift', material: 'vertexNode' },
        { motion: 'shift', material: 'positionNode', object: 'instanced' },
        { motion: 'instance', object: 'instanced' },
        { motion: 'instance', object: 'instanced', material: 'map, alphaTest' },
        { motion: 'bone', object: 'skinned' },
        { motion: 'morph', object: 'morphed' },
    ]);
});

test('a frame that is drawn several times', async (context) => {
    await compared(context, [
        { motion: 'object', again: 2 },
        { motion: 'camera', material: 'positionNode', again: 2 },
        { motion: 'shift', material: 'vertexNode', again: 3 },
        { motion: 'instance', object: 'instanced', again: 2 },
    ]);
});

test('what was away for some frames comes back with no velocity', async (context) => {
    await compared(context, [
        { away: 'hidden' },
        { away: 'hidden', material: 'positionNode' },
        { away: 'off' },
        { away: 'off', object: 'instanced' },
    ]);
});

test('units, and transparent objects', async (context) => {
    await compared(context, [
        { motion: 'up' },
        { motion: 'up', units: 'picture' },
        { motion: 'object', units: 'picture', material: 'positionNode' },
        { motion: 'object', material: 'transparent', transparent: true },
    ]);
});
