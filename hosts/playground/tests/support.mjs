// The built site below a path of a server, in Chromium that draws WebGPU and WebGL in software.

import { existsSync, readFileSync } from 'node:fs';
import { createServer } from 'node:http';
import { extname, join, normalize } from 'node:path';
import { fileURLToPath } from 'node:url';
import { chromium } from 'playwright-core';

export const SITE = fileURLToPath(new URL('../dist/', import.meta.url));
export const FIXTURES = fileURLToPath(new URL('../../../fixtures/', import.meta.url));
if (!existsSync(join(SITE, 'index.html'))) throw new Error('the site is not built: npm run build');

/** The site is no root of the server: it has to work from any path. */
const BELOW = '/some/where/';
const PLACES = ['/usr/bin/chromium', '/usr/bin/chromium-browser', '/usr/bin/google-chrome'];
const TYPES = {
    '.html': 'text/html',
    '.js': 'text/javascript',
    '.css': 'text/css',
    '.svg': 'image/svg+xml',
    '.wasm': 'application/wasm',
};
const ARGUMENTS = [
    '--no-sandbox',
    '--disable-dev-shm-usage',
    '--use-angle=swiftshader',
    '--enable-unsafe-swiftshader',
    '--enable-unsafe-webgpu',
    '--use-webgpu-adapter=swiftshader',
    '--enable-features=Vulkan',
    '--use-vulkan=swiftshader',
    '--disable-vulkan-surface',
];

export const fixture = (path) => readFileSync(join(FIXTURES, path), 'utf8');

function serve() {
    const server = createServer((request, response) => {
        const path = normalize(new URL(request.url, 'http://localhost').pathname);
        const name = path.startsWith(BELOW) ? path.slice(BELOW.length) || 'index.html' : null;
        const file = name && join(SITE, name);
        if (!file || !existsSync(file)) response.writeHead(404).end();
        else response.writeHead(200, { 'content-type': TYPES[extname(file)] ?? 'text/plain' }).end(readFileSync(file));
    });
    return new Promise((resolve) =>
        server.listen(0, '127.0.0.1', () => {
            resolve({ server, address: `http://127.0.0.1:${server.address().port}${BELOW}` });
        }),
    );
}

/** A server and a browser for the tests of one file. */
export async function launch({ after }) {
    const executablePath = process.env.CHROMIUM ?? PLACES.find(existsSync);
    if (!executablePath) throw new Error('no Chromium: scripts/setup.sh three installs it, or name one by CHROMIUM');
    const { server, address } = await serve();
    const browser = await chromium.launch({ executablePath, args: ARGUMENTS, timeout: 120_000 });
    after(async () => {
        await browser.close();
        server.closeAllConnections();
        server.close();
    });
    return { browser, address };
}

/** An open page that has read its first shader, and all that its console complains of. */
export async function open({ browser, address }, { fragment = '', width = 1280, height = 900, init, ...options } = {}) {
    const context = await browser.newContext({ viewport: { width, height }, colorScheme: 'light', ...options });
    const page = await context.newPage();
    page.setDefaultTimeout(90_000);
    const errors = [];
    page.on('pageerror', (error) => errors.push(error.stack ?? String(error)));
    page.on('console', (message) => {
        // SwiftShader is told to stall by the driver's own messages.
        const isNoise = /GPU stall|powerPreference/.test(message.text());
        if (['error', 'warning'].includes(message.type()) && !isNoise) errors.push(message.text());
    });
    page.on('request', (request) => {
        const url = request.url();
        if (!url.startsWith(address) && !url.startsWith('blob:') && !url.startsWith('data:'))
            errors.push(`fetches ${url}`);
    });
    if (init) await page.addInitScript(init);
    await page.goto(address + fragment);
    await page.waitForSelector('html[data-ready]');
    return { page, errors, context };
}

/** Waits until what is shown is of the current text, and of the recipe. */
export async function settled(page, recipe = '') {
    await page.waitForFunction((recipe) => {
        const isBusy = document.querySelector('#result').ariaBusy !== 'false';
        return !isBusy && document.querySelector('#result-title').textContent.includes(recipe);
    }, recipe);
}

/** Replaces the text of the editor, as a visitor who pastes. */
export async function paste(page, text, editor = 0) {
    const content = page.locator('#editors .cm-content').nth(editor);
    await content.focus();
    await page.keyboard.press('Control+a');
    await content.evaluate((element, text) => {
        const data = new DataTransfer();
        data.setData('text/plain', text);
        element.dispatchEvent(new ClipboardEvent('paste', { clipboardData: data, bubbles: true, cancelable: true }));
    }, text);
}
