// Looks at reports in headless Chromium: `node check.mjs SCREENSHOTS REPORT...`.
//
// Every page is opened in light and dark, wide and narrow, and on paper. No rule of axe may be broken, nothing may be fetched, no script may fail, and no text may need sideways scrolling outside of
// its own box. The sliders are worked by keyboard. Screenshots are left to be looked at.

import { existsSync, mkdirSync, readFileSync } from 'node:fs';
import { createRequire } from 'node:module';
import { basename, dirname, join, resolve } from 'node:path';
import { pathToFileURL } from 'node:url';
import { chromium } from 'playwright-core';

const PLACES = ['/usr/bin/chromium', '/usr/bin/chromium-browser', '/usr/bin/google-chrome'];
const VIEWS = [
    { name: 'light', scheme: 'light', width: 1280, height: 900 },
    { name: 'dark', scheme: 'dark', width: 1280, height: 900 },
    { name: 'narrow', scheme: 'light', width: 375, height: 812 },
    { name: 'paper', scheme: 'light', width: 1000, height: 1400, media: 'print' },
];

const [screenshots, ...reports] = process.argv.slice(2);
const axe = readFileSync(createRequire(import.meta.url).resolve('axe-core/axe.min.js'), 'utf8');
const executablePath = process.env.CHROMIUM ?? PLACES.find(existsSync);
if (!executablePath) throw new Error('no Chromium: scripts/setup.sh three installs it, or name one by CHROMIUM');
mkdirSync(screenshots, { recursive: true });

// A browser that hangs is given up.
setTimeout(() => {
    console.error('given up after 300 s');
    process.exit(1);
}, 300_000).unref();

const browser = await chromium.launch({ executablePath, args: ['--no-sandbox', '--disable-dev-shm-usage'] });
const troubles = [];

/** What is wrong with a page that is open. */
async function look(page, width) {
    const found = [];
    const broken = await page.evaluate(async () => {
        const { violations } = await globalThis.axe.run(document, {
            runOnly: ['wcag2a', 'wcag2aa', 'wcag21a', 'wcag21aa', 'best-practice'],
        });
        return violations.map((v) => `${v.id}: ${v.help} (${v.nodes.length}, ${v.nodes[0].target})`);
    });
    found.push(...broken);
    const wide = await page.evaluate(() => document.documentElement.scrollWidth);
    if (wide > width) found.push(`the page is ${wide} pixels wide where ${width} are there`);
    return found;
}

/** The first slider, moved by keys: what is cut off has to follow. */
async function slide(page) {
    const slider = page.locator('[data-cut]').first();
    if ((await slider.count()) === 0) return [];
    const cut = () => slider.evaluate((s) => s.previousElementSibling.style.getPropertyValue('--cut'));
    const before = await cut();
    await slider.focus();
    await page.keyboard.press('ArrowRight');
    const after = await cut();
    return before === after ? [`the slider stays at ${before} under the keyboard`] : [];
}

/** A link from a table leads to its section by keyboard. */
async function follow(page) {
    const link = page.locator('td a[href^="#variant-"]').first();
    if ((await link.count()) === 0) return [];
    const target = await link.getAttribute('href');
    await link.focus();
    await page.keyboard.press('Enter');
    const seen = page.waitForFunction(
        (hash) => {
            const box = document.querySelector(hash).getBoundingClientRect();
            return location.hash === hash && box.top > -1 && box.top < innerHeight;
        },
        target,
        { timeout: 5_000 },
    );
    return seen.then(
        () => [],
        () => [`${target} is not seen after its link was followed`],
    );
}

for (const report of reports) {
    const name = basename(dirname(resolve(report)));
    for (const view of VIEWS) {
        // The page's own policy lets no script in but its own.
        const context = await browser.newContext({
            viewport: { width: view.width, height: view.height },
            colorScheme: view.scheme,
            bypassCSP: true,
        });
        const page = await context.newPage();
        const found = [];
        page.on('pageerror', (error) => found.push(String(error)));
        page.on('console', (message) => message.type() === 'error' && found.push(message.text()));
        page.on('request', (request) => {
            const url = request.url();
            if (!url.startsWith('file:') && !url.startsWith('data:')) found.push(`fetches ${url}`);
        });
        await page.goto(pathToFileURL(resolve(report)).href);
        if (view.media) await page.emulateMedia({ media: view.media, colorScheme: view.scheme });
        await page.addScriptTag({ content: axe });
        found.push(...(await look(page, view.width)));
        await page.screenshot({ path: join(screenshots, `${name}-${view.name}.png`), fullPage: true });
        if (!view.media) found.push(...(await slide(page)), ...(await follow(page)));
        troubles.push(...found.map((f) => `${name}, ${view.name}: ${f}`));
        await context.close();
    }
}
await browser.close();
for (const trouble of troubles) console.error(trouble);
console.log(`${reports.length} reports in ${VIEWS.length} views, ${troubles.length} troubles`);
process.exit(troubles.length > 0 ? 1 : 0);
