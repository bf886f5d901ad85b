// Draws the page in Chromium and looks at it: each variant against the original, after a resize, with a changed material, with another program of three.js, and where the driver breaks
// a promise.
//
//     node test.mjs [FOLDER]        screenshots go there; default: dist/screenshots

import assert from 'node:assert/strict';
import { mkdir } from 'node:fs/promises';
import { join } from 'node:path';
import { fileURLToPath } from 'node:url';
import { open } from './browser.mjs';
import { prefix } from './prefix.mjs';
import { serve } from './serve.mjs';
import { VARIANTS } from './variants.mjs';

const out = process.argv[2] ?? fileURLToPath(new URL('dist/screenshots', import.meta.url));
const started = Date.now();
const said = (text) => console.log(`${((Date.now() - started) / 1000).toFixed(1).padStart(6)} s  ${text}`);
/** The window where no picture is kept: it is drawn in software, in seconds a frame. */
const SMALL = [240, 160];
/** The window of the pictures to look at. */
const LARGE = [860, 240];
/** What a variant may be off by, of 255: what its recipe allows where that is more than a rounding. */
const BUDGET = { 'hoist-budget': 0.05 * 255 };

/** Each variant's picture against the original's, right after whatever was done to the page. Gives back how many pixels they have. */
async function same(page, names, when) {
    const all = await page.evaluate((names) => window.page.compare(names), names);
    for (const [name, { off, most, pixels }] of Object.entries(all)) {
        said(`${name}, ${when}: ${off} of ${pixels} pixels off by more than 1/255, at most ${most}`);
        const budget = BUDGET[name];
        if (budget) assert.ok(off > 0 && most <= budget, `${name}, ${when}: off by ${most}, and may be by ${budget}`);
        else assert.equal(off, 0, `${name}, ${when}`);
    }
    return all[names[0]].pixels;
}

/** The same for each frame until the variants have followed what was done to the page. */
async function followed(page, names, when) {
    for (const name of names) {
        const { off, most, frames } = await page.evaluate((name) => window.page.follow(name), name);
        said(`${name}, ${when}: ${off} pixels off in any of ${frames} frames, at most ${most}`);
        assert.equal(off, 0, `${name}, ${when}`);
    }
}

const resized = (page, [width, height]) => page.setViewportSize({ width, height });
const rows = (page, name) => page.evaluate((name) => window.page.rows(name), name);
const OPAQUE = ['stone', 'leaf', 'bronze'];
/** What the self-tests of a variant say, and materials that it is not for. */
const FOUND = {
    'prepass-equal': { selfTest: 'kept' },
    'prepass-biased': { selfTest: 'kept' },
    'early-discard': { selfTest: null },
    hoist: { selfTest: 'kept', refused: ['bronze'] },
    'hoist-budget': { refused: ['bronze'] },
    'hoist-prepass': { selfTest: 'kept' },
};

async function pictures(page) {
    const names = VARIANTS.map(({ name }) => name);
    await same(page, names, 'as loaded');
    for (const [name, { selfTest, refused = [] }] of Object.entries(FOUND)) {
        const of = await rows(page, name);
        for (const material of ['glass', 'water'])
            assert.deepEqual([of[material].state, of[material].reason], ['refused', 'transparent']);
        for (const material of OPAQUE) {
            const row = of[material];
            said(
                `${name} of ${material}: ${row.state} ${row.recipe}, ${row.selfTest ?? 'no self-test'}, ${row.ms.toFixed(0)} ms`,
            );
            assert.equal(
                row.state,
                refused.includes(material) ? 'refused' : 'done',
                `${name} of ${material}: ${row.reason}`,
            );
            if (row.state === 'refused') assert.equal(row.code, 'nothing-pays');
            else if (selfTest !== undefined) assert.equal(row.selfTest, selfTest, `${name} of ${material}`);
        }
    }
    // The transparent sphere, and what is behind it, are there.
    for (const name of ['prepass-equal', 'early-discard']) {
        const pixels = await page.evaluate((name) => window.page.seen(name, 'glass'), name);
        said(`${name}: the glass is seen in ${pixels} pixels`);
        assert.ok(pixels > 500);
    }
}

async function resize(page) {
    const size = () => page.$eval('#canvas', ({ width, height }) => [width, height]);
    for (const [width, height] of [
        [305, 290],
        [211, 330],
    ]) {
        const before = await size();
        await page.setViewportSize({ width, height });
        await page.waitForFunction(([width, height]) => {
            const canvas = document.getElementById('canvas');
            return canvas.width !== width && canvas.height !== height;
        }, before);
        const [w, h] = await size();
        const names = ['prepass-equal', 'prepass-biased', 'early-discard'];
        assert.equal(await same(page, names, `resized to ${w} x ${h}`), w * h);
    }
}

/** What a host does to its materials counts in every pass. */
async function changes(page) {
    const set = (values) =>
        page.evaluate((values) => {
            for (const [material, of] of Object.entries(values)) {
                const { color, wind, ...others } = of;
                const to = window.page.materials[material];
                if (color) to.color.set(color);
                if (wind) to.uniformsGroups[0].named.wind.value = wind;
                Object.assign(to, others);
            }
        }, values);
    await set({ bronze: { color: '#ff8877', roughness: 0.9 }, leaf: { wind: 0.3 } });
    const names = ['prepass-equal', 'early-discard'];
    await same(page, names, 'with another colour and more wind');
    await set({ stone: { transparent: true, opacity: 1 } });
    await same(page, names, 'with a material made transparent');
    assert.equal((await rows(page, names[0])).stone.reason, 'transparent');
    await set({ stone: { transparent: false } });
    await followed(page, names, 'with it made opaque again');
    assert.equal((await rows(page, names[0])).stone.state, 'done');
}

/** What changes the program that three.js makes of a material: it is drawn by three.js in that frame, and by a variant of the new program as soon as there is one. */
async function programs(page, visit, address) {
    const names = ['prepass-equal', 'early-discard'];
    const changes = {
        'one light more': () => {
            const { scene } = window.page;
            const lamp = scene.getObjectByProperty('isPointLight', true).clone();
            lamp.position.set(-1.5, 3, 2.5);
            scene.add(lamp);
        },
        'one map more': () => {
            const { bronze, stone } = window.page.materials;
            bronze.emissiveMap = stone.uniforms.stoneMap.value;
            bronze.emissive.set('#553311');
            bronze.needsUpdate = true;
        },
    };
    await visit(`${address}/`);
    const before = await page.evaluate(() => window.page.compare(['prepass-equal', 'early-discard']));
    for (const { off } of Object.values(before)) assert.equal(off, 0, 'loaded again');
    for (const [what, change] of Object.entries(changes)) {
        const made = {};
        for (const name of names) made[name] = await page.evaluate((name) => window.page.programs(name), name);
        await page.evaluate(change);
        await followed(page, names, `with ${what}`);
        for (const name of names) {
            for (const material of OPAQUE) {
                const { state, reason } = (await rows(page, name))[material];
                assert.equal(state, 'done', `${name} of ${material}, with ${what}: ${reason}`);
            }
            const after = await page.evaluate((name) => window.page.programs(name), name);
            assert.ok(after > made[name], `${name}: a variant of another program`);
        }
    }
}

async function controls(page) {
    await resized(page, LARGE);
    await page.focus('input[name=variant][value=original]');
    await page.keyboard.press('ArrowDown');
    await page.waitForFunction(() => document.getElementById('about').textContent.includes('Self-test'));
    assert.match(await page.textContent('#about'), /passed: the driver keeps the promise/);
    await page.screenshot({ path: join(out, 'prepass-equal.png') });
    await page.focus('input[name=view][value=picture]');
    await page.keyboard.press('ArrowDown');
    await page.screenshot({ path: join(out, 'split.png') });
    await resized(page, [860, 160]);
    await page.focus('#split');
    await page.keyboard.press('Home');
    await page.emulateMedia({ colorScheme: 'dark' });
    await page.evaluate(() => window.page.choose('hoist-budget'));
    await page.click('input[name=view][value=difference]');
    await page.screenshot({ path: join(out, 'hoist-difference-dark.png') });
    await resized(page, [360, 300]);
    await page.click('input[name=view][value=picture]');
    await page.screenshot({ path: join(out, 'narrow-dark.png') });
    assert.ok(
        await page.evaluate(() => document.documentElement.scrollWidth <= innerWidth),
        'the page is wider than a narrow window',
    );
    await resized(page, SMALL);
    const times = await page.evaluate(() => window.page.measure(1));
    said(`one frame each: ${JSON.stringify(times)} ms`);
    assert.deepEqual(Object.keys(times), ['original', ...VARIANTS.map(({ name }) => name)]);
    for (const [name, ms] of Object.entries(times)) assert.ok(ms > 0, name);
}

/** The pre-pass's position off by a few of the depth's steps, either way. */
async function broken(page, visit, address) {
    for (const amount of ['4e-7', '-4e-7']) {
        await visit(`${address}/?perturb=${amount}`);
        await same(page, ['prepass-equal'], 'fallen back to the biased form');
        const found = await rows(page, 'prepass-equal');
        for (const material of OPAQUE) {
            const { state, recipe, selfTest, failures } = found[material];
            said(`pushed by ${amount}, ${material}: ${selfTest}`);
            assert.deepEqual([state, recipe], ['done', 'depth-prepass'], material);
            assert.deepEqual(
                failures.map(({ recipe }) => recipe),
                ['depth-prepass:form=equal'],
            );
        }
    }
    await resized(page, LARGE);
    await page.evaluate(() => window.page.choose('prepass-equal'));
    assert.match(await page.textContent('#about'), /failed: .* Drawn by depth-prepass/);
    await page.screenshot({ path: join(out, 'fallback.png') });
    await resized(page, SMALL);
    // The test would not be worth much if nothing had been wrong.
    await visit(`${address}/?perturb=-4e-7&trust`);
    const { off } = await page.evaluate(async () => (await window.page.compare(['prepass-equal']))['prepass-equal']);
    said(`not looked at: ${off} pixels off`);
    assert.ok(off > 5000);
    await page.evaluate(() => window.page.choose('prepass-equal'));
    await page.screenshot({ path: join(out, 'trusted.png') });
}

await mkdir(out, { recursive: true });
const { server, address } = await serve();
const { browser, page, visit, errors } = await open(...SMALL);
try {
    await visit(`${address}/`);
    said(await page.textContent('#adapter'));
    await prefix(page);
    await pictures(page);
    await resize(page);
    await changes(page);
    await controls(page);
    await broken(page, visit, address);
    await programs(page, visit, address);
    assert.deepEqual(errors, [], 'the page complained');
} finally {
    await browser.close();
    server.close();
}
