// Materials of seven packages from npm, and the normals of an eighth, as pages use them.

import assert from 'node:assert/strict';
import { existsSync } from 'node:fs';
import test from 'node:test';
import { launch, open } from './browser.mjs';
import { imports } from './packages/imports.mjs';
import { serve } from './serve.mjs';

const STATES = {
    '@pixiv/three-vrm-materials-mtoon': ['same', 'done'],
    '@lume/three-projected-material': ['same'],
    'troika-three-utils': [],
};
/** What these packages complain about without preshade too. */
const OWN = { '@three.ez/instanced-mesh': /attempt to use a deleted object/ };

test('packages', async (context) => {
    assert.ok(existsSync(new URL('packages/node_modules', import.meta.url)), 'install them: npm run packages');
    const { address, close } = await serve({ imports });
    context.after(close);
    const browser = await launch();
    context.after(() => browser.close());
    const { page, errors } = await open(browser, `${address}/page/packages`);
    const quiet = (name) =>
        assert.deepEqual(
            errors.splice(0).filter((message) => !OWN[name]?.test(message)),
            [],
        );
    for (const name of await page.evaluate(() => globalThis.names)) {
        await context.test(name, async (context) => {
            const found = await page.evaluate((name) => globalThis.runPackage(name), name);
            const { differ, moved, texels, picture, restored, report } = found;
            context.diagnostic(`${differ} of ${texels} texels differ; three.js's own differ in ${moved}`);
            assert.deepEqual(
                report.map(({ state }) => state),
                STATES[name] ?? ['done'],
            );
            assert.equal(picture, 0);
            assert.deepEqual(restored, [0]);
            const isReplaced = !STATES[name] || STATES[name].includes('done');
            assert.equal(moved[0] > 0, isReplaced);
            // This package has depth materials of its own, which differ from its material, and stay.
            if (name !== 'troika-three-utils') assert.deepEqual(differ, [0]);
            quiet(name);
        });
    }
    for (const isSwapped of [false, true]) {
        await context.test(
            `postprocessing, NormalPass${isSwapped ? ' with materials in objects' : ''}`,
            async (context) => {
                const { differ, moved, restored, report } = await page.evaluate(
                    (on) => globalThis.runNormalPass(on),
                    isSwapped,
                );
                context.diagnostic(`${differ} values differ; the package's own differ in ${moved}`);
                assert.equal(differ, 0);
                assert.ok(moved > 0);
                assert.equal(restored, 0);
                assert.ok(report.every(({ state }) => state === 'done'));
                quiet();
            },
        );
    }
});
