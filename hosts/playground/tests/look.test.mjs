// The page for everyone: axe in light, dark and narrow, the keyboard all the way, and no sideways scrolling. With
// SCREENSHOTS=FOLDER it leaves pictures to look at.

import assert from 'node:assert/strict';
import { mkdirSync, readFileSync } from 'node:fs';
import { createRequire } from 'node:module';
import { join } from 'node:path';
import { test } from 'node:test';
import { fixture, launch, open, paste, settled } from './support.mjs';

const axe = readFileSync(createRequire(import.meta.url).resolve('axe-core/axe.min.js'), 'utf8');
const pictures = process.env.SCREENSHOTS;
if (pictures) mkdirSync(pictures, { recursive: true });

const VIEWS = [
    { name: 'light', colorScheme: 'light', width: 1280, height: 900 },
    { name: 'dark', colorScheme: 'dark', width: 1280, height: 900 },
    { name: 'narrow', colorScheme: 'light', width: 360, height: 740 },
    { name: 'narrow-dark', colorScheme: 'dark', width: 360, height: 740 },
];

const held = launch();

/** What is wrong with the page as it is now, in this view. */
async function look(page, { name, colorScheme, width, height }, state) {
    await page.emulateMedia({ colorScheme });
    await page.setViewportSize({ width, height });
    // Listeners of the media, and what they lay out.
    await page.evaluate(() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done))));
    const found = await page.evaluate(async () => {
        const { violations } = await globalThis.axe.run(document, {
            runOnly: ['wcag2a', 'wcag2aa', 'wcag21a', 'wcag21aa', 'wcag22aa', 'best-practice'],
        });
        return violations.map(
            (v) => `${v.id}: ${v.help} (${v.nodes.length}: ${v.nodes.map((n) => n.target).slice(0, 3)})`,
        );
    });
    const wide = await page.evaluate(() => document.documentElement.scrollWidth);
    if (wide > width) found.push(`the page is ${wide} pixels wide where ${width} are there`);
    if (pictures) await page.screenshot({ path: join(pictures, `${name}-${state}.png`), fullPage: true });
    return found.map((text) => `${name}, ${state}: ${text}`);
}

test('in light, dark and narrow, axe finds nothing, and nothing needs sideways scrolling', async (context) => {
    const { page, errors, context: browsing } = await open(held, { bypassCSP: true });
    context.after(() => browsing.close());
    await settled(page, 'depth-prepass');
    await page.addScriptTag({ content: axe });
    const found = [];
    const state = async (name) => {
        for (const view of VIEWS) found.push(...(await look(page, view, name)));
    };
    await page.waitForSelector('#diff-words');
    await state('changes');
    await page.check('.pass input[value="early-alpha"]');
    await settled(page, 'early-alpha');
    await page.click('#settings summary');
    await state('refused');
    await page.check('.pass input[value="depth-prepass"]');
    await settled(page, 'depth-prepass');
    await page.click('#tab-plan');
    await state('plan');
    await page.click('#tab-graph');
    await page.waitForSelector('svg.graph');
    await page.click('#panel-graph summary');
    await state('graph');
    await page.click('#tab-files');
    await page.locator('.written summary').first().click();
    await state('files');
    await page.click('#tab-draw');
    await page.selectOption('#draw-size', '128');
    await page.click('#draw');
    await page.waitForSelector('#draw-verdict');
    await page.click('#made-up summary');
    await page.selectOption('#draw-seconds', '1');
    await page.click('#time');
    await page.waitForSelector('#times');
    await state('drawn');
    await page.check('.pass input[value="visibility-buffer:budget=0.02"]');
    await settled(page, 'visibility-buffer');
    await page.click('#draw');
    await page.waitForSelector('#not-drawn');
    await page.click('#share');
    await page.waitForSelector('#link');
    await state('not-drawn');
    await paste(page, fixture('pages/leaf.wgsl').replace('exp(', 'exq('));
    await settled(page);
    await state('error');
    await page.selectOption('#example', { label: 'GLSL: Phong' });
    await settled(page, 'early-discard');
    await page.click('#tab-changes');
    await page.waitForSelector('#diff-words');
    await state('glsl');
    assert.deepEqual(found, []);
    assert.deepEqual(errors, []);
});

test('the keyboard reaches everything, in order, and the focus is seen', async (context) => {
    const { page, errors, context: browsing } = await open(held);
    context.after(() => browsing.close());
    await settled(page, 'depth-prepass');
    const seen = [];
    for (let i = 0; i < 60; i++) {
        await page.keyboard.press('Tab');
        const at = await page.evaluate(() => {
            const { activeElement: element } = document;
            if (element === document.body) return null;
            const framed = element.closest('.cm-editor.cm-focused, .button:focus-within') ?? element;
            const { outlineStyle, outlineWidth } = getComputedStyle(framed);
            const name = element.id || element.textContent.trim().slice(0, 20) || element.getAttribute('aria-label');
            return {
                name,
                isSeen: outlineStyle !== 'none' && parseFloat(outlineWidth) >= 2,
                label: element.getAttribute('aria-label'),
            };
        });
        if (!at) break;
        seen.push(at);
    }
    const unseen = seen.filter(({ isSeen }) => !isSeen).map(({ name }) => name);
    assert.deepEqual(unseen, []);
    const names = seen.map(({ name }) => name);
    for (const name of ['Skip to the result', 'example', 'language', 'open', 'share', 'tab-changes', 'diff-language'])
        assert.ok(names.includes(name), `${name} in ${names}`);
    // The editors let go of Tab.
    const editor = seen.findIndex(({ label }) => label === 'leaf.wgsl: your shader');
    assert.ok(editor > 0 && editor < seen.length - 3);
    assert.ok(seen.some(({ label }) => label === 'After: leaf.prepass.wgsl'));
    assert.deepEqual(errors, []);
});

test('by keyboard alone: choose a pass, go through the tabs, draw, time', async (context) => {
    const { page, errors, context: browsing } = await open(held);
    context.after(() => browsing.close());
    await settled(page, 'depth-prepass');
    await page.focus('.pass input[value="depth-prepass"]');
    await page.keyboard.press('ArrowDown');
    await settled(page, 'early-discard');
    assert.equal(await page.evaluate(() => document.activeElement.value), 'early-discard');
    await page.focus('#tab-changes');
    for (const name of ['plan', 'draw', 'graph', 'files', 'changes']) {
        await page.keyboard.press('ArrowRight');
        assert.equal(await page.evaluate(() => document.activeElement.id), `tab-${name}`);
        assert.equal(await page.locator(`#panel-${name}`).isVisible(), true);
    }
    await page.keyboard.press('End');
    assert.equal(await page.evaluate(() => document.activeElement.id), 'tab-files');
    await page.keyboard.press('Home');
    await page.keyboard.press('ArrowRight');
    await page.keyboard.press('ArrowRight');
    await page.waitForSelector('#draw');
    await page.focus('#draw-size');
    await page.keyboard.press('Home');
    await page.waitForFunction(() => document.activeElement.id === 'draw-size');
    await page.focus('#draw');
    await page.keyboard.press('Enter');
    await page.waitForSelector('#draw-verdict');
    // What is said is what is shown.
    assert.equal(await page.textContent('#status'), await page.textContent('#draw-verdict'));
    await page.focus('#time');
    await page.keyboard.press('Enter');
    await page.waitForSelector('#time-words');
    await page.waitForFunction(() => document.activeElement.id === 'time');
    assert.deepEqual(errors, []);
});

test('nothing moves for those who asked for that', async (context) => {
    const { page, context: browsing } = await open(held, { reducedMotion: 'reduce' });
    context.after(() => browsing.close());
    await settled(page, 'depth-prepass');
    await page.focus('#editors .cm-content');
    const moving = await page.evaluate(() => {
        const all = [...document.querySelectorAll('*')].map((element) => getComputedStyle(element));
        return all.filter(
            ({ transitionDuration, animationName }) => animationName !== 'none' || /[1-9]/.test(transitionDuration),
        ).length;
    });
    assert.equal(moving, 0);
});

test('a narrow page compares in one column, and a wide one side by side', async (context) => {
    const { page, context: browsing } = await open(held, { width: 360, height: 740 });
    context.after(() => browsing.close());
    await settled(page, 'depth-prepass');
    await page.waitForSelector('.unified .cm-deletedChunk');
    await page.setViewportSize({ width: 1200, height: 800 });
    await page.waitForSelector('.split .cm-mergeView');
});
