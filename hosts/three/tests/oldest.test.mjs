// The oldest three.js that package.json promises: a part of the tests of shadow maps, overrides and recipes. `THREE=three-oldest npm test` runs all.

import assert from 'node:assert/strict';
import { readFile } from 'node:fs/promises';
import test from 'node:test';
import { launch, open } from './browser.mjs';
import { serve, threeOf } from './serve.mjs';

const FOLDER = 'three-oldest';
const read = async (path) => JSON.parse(await readFile(new URL(`../${path}`, import.meta.url), 'utf8'));

test('the oldest three.js', async (context) => {
    const { version } = await read(`node_modules/${FOLDER}/package.json`);
    assert.equal((await read('package.json')).peerDependencies.three, `>=${version}`);
    const { address, close } = await serve({ imports: threeOf(FOLDER) });
    context.after(close);
    const browser = await launch();
    context.after(() => browser.close());
    const visit = async (name, check) => {
        const { page, errors } = await open(browser, `${address}/page/${name}`);
        assert.equal(
            await page.evaluate(() => import('three').then(({ REVISION }) => REVISION)),
            version.split('.')[1],
        );
        await check(page);
        assert.deepEqual(errors, []);
        await page.close();
    };
    await context.test('shadow maps', () =>
        visit('shadows', async (page) => {
            const names = ['onBeforeCompile, three lights', 'alphaTest by onBeforeCompile', 'stock materials'];
            const results = await page.evaluate((names) => globalThis.runCases(names), names);
            assert.deepEqual(Object.keys(results).sort(), [...names].sort());
            for (const [name, { differ, moved, picture, restored, report }] of Object.entries(results)) {
                const isCovered = name === 'stock materials';
                for (const count of [...differ, ...restored, picture]) assert.equal(count, 0, name);
                for (const count of moved) assert.equal(count > 0, !isCovered, name);
                for (const { state } of report) assert.equal(state, isCovered ? 'same' : 'done', name);
            }
        }),
    );
    await context.test('overrides', () =>
        visit('override', async (page) => {
            const { differ, moved, report } = await page.evaluate(() => globalThis.runPass('GTAOPass'));
            assert.deepEqual(differ, [0]);
            assert.ok(moved[0] > 0);
            for (const { state } of report) assert.ok(['done', 'same'].includes(state));
        }),
    );
    await context.test('recipes, which are for newer ones', () =>
        visit('rewrite', async (page) => {
            const { settled, found, reasons } = await page.evaluate(async () => {
                part('hoist', { pass: ['hoist', 'depth-prepass'] });
                const settled = await settle('hoist');
                const reasons = rows('hoist').map(({ state, reason }) => `${state}: ${reason}`);
                return { settled, found: compare('hoist'), reasons: [...new Set(reasons)] };
            });
            assert.deepEqual([settled.off, found.off, found.unstable, found.more], [0, 0, 0, 0]);
            assert.deepEqual(reasons, ['refused: three.js r182 is too old for it: use r187 or later']);
        }),
    );
});
