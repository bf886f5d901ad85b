// Debian's Chromium, headless, drawing in software.

import { existsSync } from 'node:fs';
import { chromium } from 'playwright-core';

const PLACES = ['/usr/bin/chromium', '/usr/bin/chromium-browser', '/usr/bin/google-chrome'];

/** After so long a browser that hangs is given up. */
const LIMIT_S = 1800;

/** A page of `width` by `height` with the page's errors collected in `errors`. */
export async function open(width, height) {
    const executablePath = process.env.CHROMIUM ?? PLACES.find(existsSync);
    if (!executablePath) throw new Error('no Chromium: scripts/setup.sh three installs it, or name one by CHROMIUM');
    const browser = await chromium.launch({
        executablePath,
        args: ['--no-sandbox', '--use-angle=swiftshader', '--enable-unsafe-swiftshader', '--disable-dev-shm-usage'],
        timeout: 60_000,
    });
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
