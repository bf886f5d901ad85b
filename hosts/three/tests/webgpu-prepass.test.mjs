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

const page = async (query = '') => {
    const opened = await open(browser, `${served.address}/page/webgpu/prepass${query}`);
    return {
        ...opened,
        call: (name, argument) => opened.page.evaluate(([n, a]) => globalThis[n](a), [name, argument]),
    };
};

async function compared(context, query, cases, form = /^equal$/) {
    const { page: tab, errors, call } = await page(query);
    for (const options of cases) {
        const name = [query, ...Object.values(options)].join(' ');
        const found = await call('compare', options);
        const told = found.rows.map(({ state, form, reason }) => `${state} ${form} ${reason ?? ''}`).join('; ');
        context.diagnostic(`${name}: ${found.differ} pixels differ, ${found.more} more draws, ${told}`);
        assert.ok(found.lit > 1000, `${name}: ${found.lit} pixels`);
        assert.equal(found.differ, 0, name);
        assert.equal(found.again, 0, name);
        assert.equal(found.less, 0, name);
        const { state } = found.rows.at(-1);
        if (state === 'done') assert.ok(found.more >= 3, name);
        if (form) assert.ok(state === 'done' && form.test(found.rows.at(-1).form), name);
    }
    assert.deepEqual(errors, []);
    await tab.close();
}

test('every sort of material keeps its picture', async (context) => {
    const { page: tab, call } = await page();
    const materials = await tab.evaluate(() => globalThis.materials);
    assert.ok(call);
    await tab.close();
    await compared(
        context,
        '',
        materials.map((material) => ({ material })),
        null,
    );
});

test('instanced, batched, skinned and morphed objects', async (context) => {
    const objects = ['instanced', 'batched', 'skinned', 'morphed'];
    await compared(
        context,
        '',
        objects.map((object) => ({ material: 'opacityNode, alphaTest', object })),
    );
});

test('the canvas and several targets', async (context) => {
    const cases = ['plain', 'opacityNode, alphaTest', 'vertexNode'].flatMap((material) =>
        ['canvas', 'mrt'].map((target) => ({ material, target })),
    );
    await compared(context, '', cases);
});

test('the biased form, where it is asked for, and options that there are not', async (context) => {
    await compared(context, '', [{ material: 'opacityNode, alphaTest', form: 'biased' }], /^biased$/);
    const { page: tab, call } = await page();
    const told = await call('refused');
    ['form is', 'is remembered', 'method is', 'velocities in', 'view is'].forEach((text, i) =>
        assert.ok(told[i]?.includes(text), `${i}: ${told[i]}`),
    );
    await tab.close();
});

test('clipping planes, and alpha to coverage with samples', async (context) => {
    await compared(context, '', [{ material: 'opacityNode, alphaTest', clipping: 'clipped' }]);
    await compared(context, '?samples=4', [{ material: 'alphaToCoverage, alphaTest' }], null);
});

for (const query of ['?samples=4', '?reversed', '?logarithmic']) {
    test(`a renderer with ${query}`, async (context) => {
        const cases = ['plain', 'opacityNode, alphaTest'].flatMap((material) =>
            ['canvas', 'texture'].map((target) => ({ material, target })),
        );
        await compared(context, query, cases, query === '?logarithmic' ? null : undefined);
    });
}

test('where the device computes other positions, the biased form is drawn', async (context) => {
    await compared(context, '?perturb', [{ material: 'plain' }, { material: 'opacityNode, alphaTest' }], /^biased$/);
});

test('a pre-pass is drawn only where measured frames are faster', async () => {
    const { page: tab, errors, call } = await page();
    const gain = await call('measured', 0.5);
    assert.ok(gain.more > 0);
    // It is measured again, after two looks that find it so.
    assert.ok(gain.later > 60 && gain.later < 400, `${gain.later} frames`);
    assert.ok(gain.rows.every(({ state, ratio }) => state === 'done' && ratio < 1));
    const loss = await call('measured', 1.02);
    assert.equal(loss.more, 0);
    assert.ok(loss.forced > 0);
    assert.ok(loss.rows.every(({ state, code }) => state === 'off' && code === 'no-gain'));
    assert.deepEqual(errors, []);
    await tab.close();
});

test("the device's own clock decides, and is given back", async (context) => {
    const { page: tab, errors, call } = await page();
    const { frames, worst, rows, left } = await call('timed');
    context.diagnostic(`${frames} frames; ${rows.map(({ state, ratio }) => `${state} ${ratio}`)}`);
    assert.equal(worst, 0);
    assert.ok(rows.length > 0 && rows.every(({ state, code }) => state === 'done' || code === 'no-gain'));
    assert.deepEqual(left, []);
    assert.deepEqual(errors, []);
    await tab.close();
});
