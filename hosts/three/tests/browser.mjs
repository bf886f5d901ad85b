// Chromium, headless, drawing WebGL and WebGPU in software.

import { existsSync } from 'node:fs';
import { chromium } from 'playwright-core';

const PLACES = ['/usr/bin/chromium', '/usr/bin/chromium-browser', '/usr/bin/google-chrome'];
const WEBGL = ['--no-sandbox', '--disable-dev-shm-usage', '--use-angle=swiftshader', '--enable-unsafe-swiftshader'];
const WEBGPU = [
    '--enable-unsafe-webgpu',
    '--use-webgpu-adapter=swiftshader',
    '--enable-features=Vulkan',
    '--use-vulkan=swiftshader',
    '--disable-vulkan-surface',
];

/** A browser; `webgpu`: with WebGPU. `args`: more of Chromium's flags. */
export function launch({ webgpu = false, args = [] } = {}) {
    const executablePath = process.env.CHROMIUM ?? PLACES.find(existsSync);
    if (!executablePath) throw new Error('no Chromium: scripts/setup.sh three installs it, or name one by CHROMIUM');
    return chromium.launch({ executablePath, args: [...WEBGL, ...(webgpu ? WEBGPU : []), ...args], timeout: 120_000 });
}

/** Messages of the browser, and not of a page. */
const NOISE = /GPU stall|Automatic fallback to software WebGL|powerPreference/;

/** Opens a page, whose module sets `globalThis.ready`; what it complains about is in `errors`. */
export async function open(browser, address, { width = 256, height = 256 } = {}) {
    const page = await browser.newPage({ viewport: { width, height } });
    page.setDefaultTimeout(240_000);
    const errors = [];
    page.on('pageerror', (error) => errors.push(error.stack ?? String(error)));
    page.on('console', (message) => {
        if (process.env.VERBOSE) console.log(message.text());
        if (!['error', 'warning'].includes(message.type()) || NOISE.test(message.text())) return;
        errors.push(message.text());
    });
    await page.goto(address);
    const failed = () => new Promise((_, reject) => page.once('pageerror', (error) => reject(error)));
    await Promise.race([page.waitForFunction(() => globalThis.ready, null, { timeout: 240_000 }), failed()]);
    return { page, errors };
}
