// Whole frames with and without a pre-pass: not one pixel differs.

import assert from 'node:assert/strict';
import test, { after, before } from 'node:test';
import { launch, open } from './browser.mjs';
import { serve } from './serve.mjs';

/** Draws of the world that have a pre-pass: all but the glass. */
const DRAWS = 21;

// One browser for all: it keeps the programs that it has linked, and most tests draw the same.
let browser, served;
before(async () => {
    [browser, served] = await Promise.all([launch(), serve()]);
});
after(async () => {
    await browser?.close();
    served?.close();
});

async function opened(context, parameters = '') {
    const found = await open(browser, `${served.address}/page/prepass?${parameters}`);
    context.after(() => found.page.close());
    return found;
}

const settle = (page, way = 'canvas') => page.evaluate((way) => settle(way), way);
const rows = (page) => page.evaluate(() => preshade.report());

async function same(page, way, times = [0, 1.3], draws = DRAWS) {
    for (const time of times) {
        const { off, most, unstable, colours, more } = await page.evaluate(
            ([way, time]) => compare(way, time),
            [way, time],
        );
        assert.equal(unstable, 0, `${way}: the picture is the same each time`);
        assert.equal(off, 0, `${way}, at ${time}: ${off} pixels differ, by ${most}`);
        assert.ok(colours > 1000, `${way}: ${colours} colours`);
        assert.equal(
            more,
            draws * (way === 'two views' || way === 'no autoClear' ? 2 : 1),
            `${way}: draws of the pre-pass`,
        );
    }
}

test('into the canvas, into targets of all kinds, under a composer', async (context) => {
    const { page, errors } = await opened(context);
    for (const way of await page.evaluate(() => Object.keys(WAYS))) {
        await settle(page, way);
        await same(page, way);
    }
    for (const row of await rows(page)) {
        if (row.material === 'glass') assert.deepEqual([row.state, row.reason], ['refused', 'transparent']);
        else assert.deepEqual([row.state, row.form, row.selfTest], ['done', 'equal', 'kept'], row.material);
    }
    assert.deepEqual(errors, []);
});

/** Drawn with `FULL=1` only: each takes a minute, and others draw nearly the same. */
const FULL = ['reversed&form=biased', 'antialias', 'effects=pass'];

for (const parameters of ['form=biased', 'reversed', 'logarithmic', 'effects', ...FULL]) {
    const skip = FULL.includes(parameters) && !process.env.FULL && 'FULL=1 draws it';
    test(`with ${parameters}`, { skip }, async (context) => {
        const { page, errors } = await opened(context, parameters);
        for (const way of parameters.startsWith('effects') ? ['canvas'] : ['canvas', 'composer']) {
            await settle(page, way);
            await same(page, way);
        }
        assert.deepEqual(errors, []);
    });
}

test('where the driver breaks a promise, the biased form is drawn, then the original', async (context) => {
    const cases = [
        ['perturb=4e-7', 'done', 'biased', /^broken \(equal\): .*, kept$/, DRAWS],
        ['perturb=-4e-7', 'done', 'biased', /^broken \(equal\): .*, kept$/, DRAWS],
        // Both passes alike: only the author's own text shows it.
        [
            'perturb=-1e-2&roles=prepass main',
            'refused',
            'biased',
            /^broken \(equal\): .*author's.*, broken \(biased\): /,
            0,
        ],
        ['perturb=-1e-2', 'refused', 'biased', /^broken \(equal\): .*, broken \(biased\): /, 0],
    ];
    for (const [parameters, state, form, verdicts, draws] of cases) {
        const { page } = await opened(context, parameters);
        await settle(page);
        await same(page, 'canvas', [0.4], draws);
        for (const row of (await rows(page)).filter(({ material }) => material !== 'glass')) {
            assert.deepEqual([row.state, row.form], [state, form], `${parameters}, ${row.material}: ${row.selfTest}`);
            assert.match(row.selfTest, verdicts, row.material);
        }
    }
});

test('what a page changes counts in the frame in which it does', async (context) => {
    const { page, errors } = await opened(context);
    const less = {
        transparent: 1,
        'a callback': 1,
        'one material for all': DRAWS,
        'a stencil': DRAWS,
        'depth cleared in the middle of a frame': DRAWS,
        'another scene drawn over it in the middle': DRAWS,
        'two surfaces at one depth': -2,
    };
    await settle(page);
    for (const change of await page.evaluate(() => Object.keys(CHANGES))) {
        const off = await page.evaluate((change) => firstAfter(change, 'canvas'), change);
        assert.equal(off, 0, `${change}: ${off} pixels of the first frame differ`);
        await settle(page);
        await same(page, 'canvas', [0.8], DRAWS - (less[change] ?? 0)).catch((error) =>
            assert.fail(`${change}: ${error.message}`),
        );
        await page.evaluate(() => undo());
        await settle(page);
    }
    assert.deepEqual(errors, []);
});

test('after a lost context everything is tested and drawn again', async (context) => {
    const { page } = await opened(context);
    await settle(page);
    await page.evaluate(() => lose());
    await settle(page);
    await same(page, 'canvas', [0.5]);
    for (const { material, selfTest } of await rows(page))
        if (material !== 'glass') assert.equal(selfTest, 'kept', material);
});

test('a disposed material takes its plan along, and dispose leaves nothing', async (context) => {
    const { page } = await opened(context);
    const found = await page.evaluate(async () => {
        const count = () => ({ ...renderer.info.memory, programs: renderer.info.programs.length });
        const { Preshade } = await import('preshade-three');
        preshade.dispose();
        renderer.render(scene, camera);
        const before = count();
        for (let i = 0; i < 3; i++) {
            const again = await Preshade.of(renderer, { cache: false });
            const prepass = again.prepass(scene, { measure: { frames: 24 }, remember: false });
            for (let k = 0; k < 60; k++) {
                renderer.render(scene, camera);
                await next();
            }
            materials.phong.dispose();
            again.dispose();
            void prepass;
        }
        renderer.render(scene, camera);
        return [before, count()];
    });
    assert.deepEqual(found[1], found[0]);
});

test('the choice is that of an independent clock, is remembered, and measured again in another size', async (context) => {
    const { address } = served;
    for (const scene of ['deep', 'flat']) {
        const { page, errors } = await open(browser, `${address}/page/measured?scene=${scene}&remember`);
        const { states } = await page.evaluate(() => choose());
        assert.ok(states.includes('measuring') && !states.includes('done'), `${states}`);
        const [row] = await page.evaluate(() => report());
        const { ratio, low, high } = await page.evaluate(() => table(12, true));
        // On only if the whole interval says faster; where the clock is sure of a loss it must not be on.
        assert.equal(row.state, row.measured.high < 1 ? 'done' : 'off', `${scene}: ${JSON.stringify(row.measured)}`);
        if (row.state === 'off') assert.equal(row.code, row.measured.known ? 'no-gain' : 'not-timed');
        if (low > 1.05) assert.equal(row.state, 'off', `${scene}: ${ratio} [${low}, ${high}]`);
        // Fragments of the planes that are in view: 8 layers, of which the front ones fill the picture.
        const perPixel = await page.evaluate(() => counted());
        const [least, most] = scene === 'deep' ? [7, 8] : [0.2, 0.4];
        assert.ok(perPixel > least && perPixel < most, `${scene}: ${perPixel} fragments per pixel`);
        // Loaded again, the page knows it, and measures nothing.
        await page.reload();
        await page.waitForFunction(() => globalThis.ready);
        await page.evaluate(() => choose());
        const [earlier] = await page.evaluate(() => report());
        assert.deepEqual(earlier.measured, { ...row.measured, perPixel: earlier.measured.perPixel });
        // Of the same text, calls that draw other scenes each have a measurement, and none takes another's away.
        const remembered = await page.evaluate(async () => {
            const { Remembered } = await import('/three/webgl/remembered.js');
            const calls = [0, 1, 2].map((place) => new Remembered(renderer, place));
            calls.forEach((call, place) => call.set('text', place));
            return [0, 1, 2].map((place) => new Remembered(renderer, place).get('text'));
        });
        assert.deepEqual(remembered, [0, 1, 2]);
        // A picture of another size is measured anew.
        await page.evaluate(() => (renderer.setSize(256, 256), go(2)));
        assert.equal(await page.evaluate(() => prepass.isSettled), false);
        await page.evaluate(() => choose());
        const [again] = await page.evaluate(() => report());
        assert.notDeepEqual(again.measured, earlier.measured);
        await page.close();
        assert.deepEqual(errors, []);
    }
});

test('where fragments change, it is measured again; where they waver, it is not', async (context) => {
    const { page, errors } = await open(browser, `${served.address}/page/measured?scene=deep&size=64`);
    await page.evaluate(() => choose());
    assert.ok((await page.evaluate(() => counted())) > 7);
    const layers = (count) =>
        page.evaluate((count) => scene.children.forEach((each, i) => (each.visible = i >= 8 - count)), count);
    /** Whether something is measured in so many frames: two counts. */
    const isMeasured = () =>
        page.evaluate(async () => {
            for (let i = 0; i < 200; i++) {
                await go(1);
                if (!prepass.isSettled) return true;
            }
            return false;
        });
    assert.equal(await isMeasured(), false);
    await layers(7);
    assert.equal(await isMeasured(), false);
    await layers(2);
    assert.equal(await isMeasured(), true);
    await page.evaluate(() => choose());
    assert.ok(Math.abs((await page.evaluate(() => go(100).then(() => counted()))) - 2) < 0.1);
    assert.deepEqual(errors, []);
});
