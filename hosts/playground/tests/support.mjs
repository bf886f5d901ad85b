// The built site below a path of a server, in Chromium that draws WebGPU and WebGL in software.

import assert from 'node:assert/strict';
import { existsSync, readFileSync } from 'node:fs';
import { createServer } from 'node:http';
import { extname, join, normalize } from 'node:path';
import { after, before } from 'node:test';
import { fileURLToPath } from 'node:url';
import { chromium } from 'playwright-core';
import { PLACES, WEBGL, WEBGPU } from '../../../scripts/chromium.mjs';

export const SITE = fileURLToPath(new URL('../dist/', import.meta.url));
export const FIXTURES = fileURLToPath(new URL('../../../fixtures/', import.meta.url));
if (!existsSync(join(SITE, 'index.html'))) throw new Error('the site is not built: npm run build');

/** The site is no root of the server: it has to work from any path. */
const BELOW = '/some/where/';
const TYPES = {
    '.html': 'text/html',
    '.js': 'text/javascript',
    '.css': 'text/css',
    '.svg': 'image/svg+xml',
    '.wasm': 'application/wasm',
};
const ARGUMENTS = [...WEBGL, ...WEBGPU];

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

/** A server and a browser for the tests of one file. The object is filled before the first test. */
export function launch() {
    const held = {};
    before(async () => Object.assign(held, await start()));
    after(async () => held.end?.());
    return held;
}

async function start() {
    const executablePath = process.env.CHROMIUM ?? PLACES.find(existsSync);
    if (!executablePath) throw new Error('no Chromium: scripts/setup.sh three installs it, or name one by CHROMIUM');
    const { server, address } = await serve();
    const browser = await chromium.launch({ executablePath, args: ARGUMENTS, timeout: 120_000 });
    const end = async () => {
        await browser.close();
        server.closeAllConnections();
        server.close();
    };
    return { browser, address, end };
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

/**
 * `visit(context, options)` is a page for one test. Whatever its console complains of fails the test. Tests that
 * name no options share a page, because a new one takes a second to load and to warm up: it is brought back to the
 * first example.
 */
export function visitor(held) {
    let shared = null;
    return async (context, options) => {
        const visited = (!options && shared) || (await open(held, options));
        if (visited === shared) await restart(visited.page);
        shared = options ? shared : null;
        context.after(async () => {
            const errors = visited.errors.splice(0);
            if (options || !context.passed || errors.length) await visited.context.close();
            else shared = visited;
            assert.deepEqual(errors, []);
        });
        return visited.page;
    };
}

/** Shows what a first visit shows, by the page's own means. */
async function restart(page) {
    await page.selectOption('#example', '0');
    await page.click('#tab-changes');
    await page.$eval('#settings', (settings) => (settings.open = false));
    await settled(page, 'depth-prepass');
    await page.selectOption('#diff-file', { index: 0 });
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
