// Prints what a pre-pass costs and gains in two scenes, by a clock of its own, and what the measured choice says of it. `node tests/prepass-table.mjs [BLOCKS]`

import { launch, open } from './browser.mjs';
import { serve } from './serve.mjs';

const BLOCKS = Number(process.argv[2] ?? 24);
/** Chromium's two ways to draw without a GPU. The first draws hidden fragments too: it tests depth after shading. */
const RENDERERS = {
    SwiftShader: [],
    llvmpipe: ['--use-gl=angle', '--use-angle=gl-egl', '--ignore-gpu-blocklist'],
};
const SCENES = { deep: '8 layers, the nearest last', flat: '45,000 triangles, nothing hidden' };

const { address, close } = await serve();
const range = ({ ratio, low, high }) => `${ratio.toFixed(2)} [${low.toFixed(2)}, ${high.toFixed(2)}]`;
console.log(
    '| renderer | scene | fragments per pixel | without | with | ratio by the clock | ratio that was measured | choice |',
);
console.log('| --- | --- | --- | --- | --- | --- | --- | --- |');
for (const [renderer, args] of Object.entries(RENDERERS)) {
    const browser = await launch({ args });
    for (const [scene, words] of Object.entries(SCENES)) {
        const { page } = await open(browser, `${address}/page/measured?scene=${scene}`);
        await page.evaluate(() => choose());
        const perPixel = await page.evaluate(() => counted());
        const [{ measured, state }] = await page.evaluate(() => report());
        const clock = await page.evaluate((blocks) => table(blocks, true), BLOCKS);
        const cells = [
            renderer,
            words,
            perPixel.toFixed(1),
            `${clock.without.toFixed(1)} ms`,
            `${clock.with.toFixed(1)} ms`,
            range(clock),
            range(measured),
            state === 'done' ? 'on' : 'off',
        ];
        console.log(`| ${cells.join(' | ')} |`);
        await page.close();
    }
    await browser.close();
}
close();
