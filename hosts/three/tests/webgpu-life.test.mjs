import assert from 'node:assert/strict';
import test, { after, before } from 'node:test';
import { launch, open } from './browser.mjs';
import { serve } from './serve.mjs';

let browser, served;
before(async () => {
    const args = ['--js-flags=--expose-gc', '--enable-precise-memory-info'];
    [browser, served] = await Promise.all([launch({ webgpu: true, args }), serve()]);
});
after(async () => {
    await browser?.close();
    served?.close();
});

async function called(name, argument) {
    const { page, errors } = await open(browser, `${served.address}/page/webgpu/life`);
    const found = await page.evaluate(([name, argument]) => globalThis[name](argument), [name, argument]);
    // A worker ends a little after it is told to.
    for (let i = 0; i < 50 && page.workers().length; i++) await page.waitForTimeout(100);
    assert.equal(page.workers().length, 0);
    await page.close();
    return { found, errors };
}

/** What a page counted after a quarter of its rounds is what it counted at the end, but for a heap that wavers. */
function flat(context, [early, late]) {
    const [{ heap: before, ...counts }, { heap: after, ...rest }] = [early, late];
    context.diagnostic(`${JSON.stringify(rest)}, heap ${((after - before) / 1e6).toFixed(2)} MB more`);
    assert.deepEqual(rest, counts);
    assert.ok(after - before < 3e6);
}

/** The whole count takes minutes: `RECOMPILES=1000`. */
const RECOMPILES = Number(process.env.RECOMPILES ?? 100);

test(`${RECOMPILES} recompiles leave nothing`, async (context) => {
    const { found, errors } = await called('recompile', RECOMPILES);
    flat(context, found.found);
    assert.ok(found.rows <= 4);
    assert.deepEqual(errors, []);
});

test('100 materials that come and go leave nothing', async (context) => {
    const { found, errors } = await called('replace', 100);
    flat(context, found.found);
    assert.deepEqual(found.rows, []);
    assert.deepEqual(found.listeners, [0, 0]);
    assert.deepEqual(errors, []);
});

test('100 times preshade leave the renderer as it was', async (context) => {
    const { found, errors } = await called('cycle', 100);
    flat(context, found.found);
    assert.equal(found.found[1].alive, 0);
    assert.ok(found.same);
    assert.equal(found.differ, 0);
    assert.deepEqual(errors, []);
});

test('fog, lights, maps and states that change keep the picture, from the first frame on', async () => {
    const { found, errors } = await called('changed');
    for (const [name, counts] of Object.entries(found.differ)) assert.deepEqual(counts, [0, 0], name);
    assert.ok(found.rows.every(({ state }) => state === 'done'));
    assert.deepEqual(errors, []);
});

test('a lost device, and a renderer without WebGPU, are told', async () => {
    const lost = await called('lose');
    assert.match(lost.found[0].reason, /the device is lost/);
    const unfit = await called('unfit');
    assert.deepEqual(
        unfit.found.map(({ state, reason }) => [state, reason]),
        [['unsupported', 'the renderer draws with its WebGL 2 backend']],
    );
});

test('two of one renderer', async () => {
    const { found } = await called('twice');
    assert.match(found.rows[0].reason, /another Preshade/);
    assert.deepEqual(found.after, []);
});

test('parts are disposed of one by one', async () => {
    const { found, errors } = await called('parts');
    for (const [name, { second, before, after, isOther, again }] of Object.entries(found)) {
        if (name === 'prepass') assert.match(second, /dispose of them/);
        else assert.equal(second, 'the same', name);
        assert.ok(before.includes('done'), `${name}: ${before}`);
        assert.deepEqual(after, [], name);
        assert.ok(isOther, name);
        assert.ok(again > 0, name);
    }
    assert.deepEqual(errors, []);
});

test('settled waits for all that a picture asked for', async () => {
    const { found, errors } = await called('settledAfterOne');
    assert.equal(found.first, false);
    assert.deepEqual(found.settled, ['shadow done', 'prepass pending', 'velocity done']);
    assert.deepEqual(found.then, ['shadow done', 'prepass done', 'velocity done']);
    assert.deepEqual(errors, []);
});

test('200 casters', async (context) => {
    const { found, errors } = await called('cost', 200);
    for (const [name, { median, longest }] of Object.entries(found))
        context.diagnostic(
            `${name}: ${median.toFixed(1)} ms of the main thread a frame, ${longest.toFixed(1)} at most`,
        );
    assert.deepEqual(errors, []);
});
