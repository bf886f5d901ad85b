// Velocities against positions that the CPU computed twice.

import assert from 'node:assert/strict';
import test from 'node:test';
import { launch, open } from './browser.mjs';
import { serve } from './serve.mjs';

/** Materials of the page's world, and how many pixels of each are looked at, at least. */
const SEEN = {
    fence: 4000,
    many: 300,
    waves: 400,
    phong: 2000,
    wobbly: 1000,
    bony: 1000,
    lit: 1000,
    batch: 500,
    reed: 200,
};

async function opened(context, parameters = '') {
    const { address, close } = await serve();
    context.after(close);
    const browser = await launch();
    context.after(() => browser.close());
    return open(browser, `${address}/page/velocity?${parameters}`);
}

/** Every pixel within 1/256 of a pixel, beyond the rounding of a half float; and it moved by more than that. */
function exact(found, when) {
    for (const [name, least] of Object.entries(SEEN)) {
        const { pixels, off, most, largest } = found[name];
        assert.ok(pixels >= least, `${name}, ${when}: ${pixels} pixels`);
        assert.equal(off, 0, `${name}, ${when}: off by ${most} pixels`);
        assert.ok(largest > 0.1, `${name}, ${when}: it hardly moves`);
    }
}

for (const [what, parameters] of Object.entries({
    'in device coordinates': '',
    'in parts of the picture, beside a pre-pass': 'units=picture&prepass',
    'with a reversed depth buffer': 'reversed',
})) {
    test(`velocities of all kinds of objects, ${what}`, async (context) => {
        const { page, errors } = await opened(context, parameters);
        await page.evaluate(() => settle());
        const glass = await page.evaluate(() => preshade.report().filter(({ material }) => material === 'glass'));
        assert.ok(glass.some(({ pass, code }) => pass === 'velocity' && code === 'transparent'));
        exact(await page.evaluate(() => compare(0, 0.05)), 'at 0.05');
        exact(await page.evaluate(() => compare(0.7, 0.9)), 'at 0.9');
        // A second picture of the same frame has the same velocities; what moves begins another frame.
        exact(await page.evaluate(() => compare(0.4, 0.5, { shifts: [[null], [null, null]] })), 'drawn twice');
        exact(await page.evaluate(() => compare(0.7, 0.9, { apart: false })), 'without an animation frame between');
        exact(
            await page.evaluate(() =>
                compare(0.1, 0.2, {
                    shifts: [
                        [null, null],
                        [null, null],
                    ],
                    apart: false,
                }),
            ),
            'both',
        );
        // Where nothing moves it is 0, also in the frame after something moved.
        const still = await page.evaluate(() => compare(0.9, 0.9));
        for (const [name, { off, largest }] of Object.entries(still)) assert.deepEqual([off, largest], [0, 0], name);
        assert.equal(await page.evaluate(() => resumed()), 0, 'the first frame after a pause');
        exact(await page.evaluate(() => compare(0.7, 0.9)), 'after a pause');
        const [first, second] = await page.evaluate(() => twice());
        assert.ok(first > 0, 'what a callback moves');
        assert.equal(second, first, 'a second picture, with a callback');
        assert.deepEqual(errors, []);
    });
}

test('a shift of the projection by parts of a pixel is no velocity', async (context) => {
    const { page, errors } = await opened(context);
    const compared = (shifts) => page.evaluate((shifts) => compare(0.3, 0.4, { shifts }), shifts);
    await page.evaluate(() => settle());
    await page.evaluate(() => settle([0.25, 0]));
    exact(await compared([[[0.25, 0]], [[-0.3, 0.4]]]), 'shifted');
    // As antialiasing draws it that takes several samples of one frame.
    exact(
        await compared([
            [
                [0.1, 0.3],
                [0.25, 0],
            ],
            [
                [0.25, 0],
                [-0.3, 0.4],
            ],
        ]),
        'sampled',
    );
    assert.deepEqual(errors, []);
});

test('disposed, nothing is left', async (context) => {
    const { page } = await opened(context);
    const [before, after] = await page.evaluate(async () => {
        const count = () => ({ ...renderer.info.memory, programs: renderer.info.programs.length });
        preshade.dispose();
        renderer.render(scene, camera);
        const before = count();
        const { Preshade } = await import('preshade-three');
        for (let i = 0; i < 3; i++) {
            const again = await Preshade.of(renderer, { cache: false });
            const velocity = again.velocity(scene);
            for (let k = 0; k < 400; k++) {
                set(k / 10);
                renderer.render(scene, camera);
                await new Promise((resolve) => requestAnimationFrame(resolve));
                const rows = again.report().filter(({ code }) => code !== 'transparent');
                if (rows.length >= 10 && rows.every(({ state }) => state === 'done')) break;
            }
            await velocity.settled();
            again.dispose();
        }
        renderer.render(scene, camera);
        return [before, count()];
    });
    assert.deepEqual(after, before);
});
