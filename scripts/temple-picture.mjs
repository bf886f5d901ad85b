// Makes docs/images/temple.jpg, the README's picture, and docs/results/three/temple.json, its figures: the page of
// tests/three, as written beside a depth pre-pass, with the milliseconds and the changed pixels that it measures.
//
//     cd tests/three && npm ci && npm run build && node ../../scripts/temple-picture.mjs [VARIANT]

import { mkdir, readFile, writeFile } from 'node:fs/promises';
import { fileURLToPath } from 'node:url';
import { open } from '../tests/three/browser.mjs';
import { serve } from '../tests/three/serve.mjs';

const variant = process.argv[2] ?? 'prepass-equal';
const root = (path) => fileURLToPath(new URL(`../${path}`, import.meta.url));
const [width, height] = [1200, 520];

/** The page's picture, split in the middle, and its figures. */
async function taken() {
    const { server, address } = await serve();
    const { browser, page, visit } = await open(width + 400, height);
    try {
        await visit(`${address}/`);
        const adapter = await page.textContent('#adapter');
        const clock = await page.textContent('#clock');
        const ms = await page.evaluate((name) => window.page.measure(9, ['original', name]), variant);
        const { off, most, pixels } = (await page.evaluate((name) => window.page.compare([name]), variant))[variant];
        await page.evaluate((name) => window.page.choose(name), variant);
        await page.click('input[name=view][value=split]');
        await page.waitForTimeout(3000);
        const canvas = await page.locator('#canvas').screenshot({ path: '/tmp/temple-canvas.png' });
        return { figures: { adapter, clock, variant, ms, off, most, pixels }, canvas };
    } finally {
        await browser.close();
        server.close();
    }
}

/** The picture with its figures written into it. */
async function composed(canvas, { adapter, ms, off, pixels }) {
    const [before, after] = [ms.original, ms[variant]].map((t) => `${t.toFixed(0)} ms`);
    const count = pixels.toLocaleString('en');
    const on = /SwiftShader/.test(adapter) ? 'SwiftShader, a software renderer' : adapter;
    const html = `<style>
        body { margin: 0; width: ${width}px; font: 600 19px 'DejaVu Sans', sans-serif; color: #fff; background: #16242b }
        img { display: block; width: ${width}px }
        .tag { position: absolute; top: 16px; padding: 8px 16px; border-radius: 6px; background: #0f1c22e0 }
        .tag b { font-size: 30px; display: block; margin-top: 2px }
        .bar { display: flex; justify-content: space-between; align-items: center; padding: 14px 20px }
        .bar b { font-size: 26px; color: #8ff0b4 } .bar span { font-weight: 400; font-size: 16px; color: #c7d4d9 }
        </style><img src="data:image/png;base64,${canvas.toString('base64')}">
        <div class="tag" style="left: 16px">as written<b>${before}</b></div>
        <div class="tag" style="right: 16px; text-align: right">depth pre-pass<b>${after}</b></div>
        <div class="bar"><b>${off} pixels changed</b>
        <span>of ${count}; three.js in Chromium on ${on}; median of 9 frames</span></div>`;
    const { browser, page } = await open(width, height + 80);
    try {
        await page.setContent(html);
        await page.waitForTimeout(300);
        const box = await page.locator('body').boundingBox();
        const clip = { x: 0, y: 0, width, height: Math.ceil(box.height) };
        return await page.screenshot({ type: 'jpeg', quality: 86, clip });
    } finally {
        await browser.close();
    }
}

const { figures, canvas } = await taken();
console.log(figures);
await mkdir(root('docs/results/three'), { recursive: true });
await writeFile(root('docs/results/three/temple.json'), `${JSON.stringify(figures, null, 4)}\n`);
await writeFile(root('docs/images/temple.jpg'), await composed(canvas, figures));
process.exit(0);
