// Debian's Chromium, headless, drawing in software.

import { chromium } from 'playwright-core';
import { launch } from '../../scripts/chromium.mjs';

/** After so long a browser that hangs is given up. */
const LIMIT_S = 1800;

/** A page of `width` by `height` with the page's errors collected in `errors`. */
export async function open(width, height) {
    const browser = await launch(chromium);
    setTimeout(() => {
        console.error(`given up after ${LIMIT_S} s`);
        process.exit(1);
    }, LIMIT_S * 1000).unref();
    const page = await browser.newPage({ viewport: { width, height }, colorScheme: 'light' });
    page.setDefaultTimeout(120_000);
    const errors = [];
    page.on('pageerror', (error) => errors.push(error.stack ?? String(error)));
    page.on('console', (message) => {
        if (message.type() === 'error' || message.type() === 'warning') errors.push(message.text());
    });
    const visit = async (address) => {
        await page.goto(address);
        await page.waitForSelector('canvas[data-ready]');
    };
    return { browser, page, visit, errors };
}
