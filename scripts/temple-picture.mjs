// Makes docs/images/temple.jpg, the README's picture, and docs/results/three/temple.json: the page of tests/three, as
// written beside a depth pre-pass, with the changed pixels. Chromium draws in software, so the milliseconds in the picture
// are those of the shrine scene in docs/results/h200-shrine.json.
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
        const canvas = await page.locator('#canvas').screenshot();
        return { figures: { adapter, clock, variant, ms, off, most, pixels }, canvas };
    } finally {
        await browser.close();
        server.close();
    }
}

/** Median milliseconds of a variant of the shrine scene on the GPU, from the published results. */
const shrine = JSON.parse(await readFile(root('docs/results/h200-shrine.json'), 'utf8'));
const time = (name) => `${shrine.variants.find((v) => v.name === name).time_ms.median.toFixed(2)} ms`;

/** The picture with its figures written into it. Times are those of another scene, and say so. */
async function composed(canvas, { off, pixels }) {
    const html = `<!doctype html><style>
        body { margin: 0; width: ${width}px; font: 600 19px 'DejaVu Sans', sans-serif; color: #fff; background: #16242b }
        img { display: block; width: ${width}px }
        .tag { position: absolute; top: 16px; padding: 8px 16px; border-radius: 6px; background: #0f1c22e0 }
        .bar { display: flex; justify-content: space-between; padding: 14px 20px }
        .bar b { display: block; font-size: 26px; color: #8ff0b4 } .bar span { font-weight: 400; font-size: 16px; color: #c7d4d9 }
        </style><img src="data:image/png;base64,${canvas.toString('base64')}">
        <div class="tag" style="left: 16px">as written</div>
        <div class="tag" style="right: 16px">depth pre-pass</div>
        <div class="bar"><div><b>${off} pixels changed</b>
        <span>of ${pixels.toLocaleString('en')}: this temple, three.js</span></div>
        <div style="text-align: right"><b>${time('original')} \u2192 ${time('depth-prepass')}</b>
        <span>another scene: the shrine at its wall, ${shrine.adapter.name}, 1920x1080</span></div></div>`;
    const { browser, page } = await open(width, height + 100);
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
