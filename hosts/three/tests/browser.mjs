// Chromium, headless, drawing WebGL and WebGPU in software.

import { chromium } from 'playwright-core';
import { launch as start } from '../../../scripts/chromium.mjs';

/** A browser; `webgpu`: with WebGPU. `args`: more of Chromium's flags. */
export const launch = (options) => start(chromium, options);

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
