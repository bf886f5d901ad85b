// Chromium, headless, drawing WebGL and WebGPU in software, and captures of its pages.

import { chromium } from 'playwright-core';
import { launch as start } from '../../scripts/chromium.mjs';
import { recorder } from './recorder.mjs';

export const launch = () => start(chromium, { webgpu: true });

/** A page with its errors, and with the recorder where `record`; `late`: as a bookmarklet brings it. */
export async function open(browser, address, { record = true, late = false, width = 320, height = 240 } = {}) {
    const page = await browser.newPage({ viewport: { width, height } });
    const errors = [];
    const chunks = [];
    page.on('pageerror', (error) => errors.push(error.stack ?? String(error)));
    page.on('console', (message) => {
        if (['error', 'warning'].includes(message.type()) && !/GPU stall/.test(message.text()))
            errors.push(message.text());
        if (process.env.VERBOSE) console.log(message.text());
    });
    if (record) await page.exposeBinding('preshadeSink', (_, chunk) => chunks.push(Buffer.from(chunk, 'base64')));
    if (record && !late) await page.addInitScript(recorder());
    await page.goto(address);
    await page.waitForFunction(() => globalThis.ready, null, { timeout: 60_000 });
    if (late) await page.evaluate(recorder());
    return { page, errors, chunks };
}

/** Milliseconds that the page's callbacks take in a frame: the median of `count`. */
export function cost(page, count = 12) {
    return page.evaluate(
        (count) =>
            new Promise((resolve) => {
                const times = [];
                const request = globalThis.requestAnimationFrame;
                globalThis.requestAnimationFrame = (callback) =>
                    request((time) => {
                        const begin = performance.now();
                        callback(time);
                        times.push(performance.now() - begin);
                        if (times.length < count) return;
                        globalThis.requestAnimationFrame = request;
                        resolve(times.sort((a, b) => a - b)[count >> 1].toFixed(2));
                    });
            }),
        count,
    );
}

/** The files of a capture of an open page, and its summary. */
export async function capture({ page, chunks }, frames) {
    const summary = await page.evaluate((frames) => globalThis.preshadeCapture.start({ frames }), frames);
    return { summary, files: untar(Buffer.concat(chunks)) };
}

/** Names and contents of a tar stream; the last of one name counts. */
export function untar(bytes) {
    const files = new Map();
    for (let at = 0; at + 512 <= bytes.length && bytes[at];) {
        const name = bytes.toString('latin1', at, bytes.indexOf(0, at));
        const size = parseInt(bytes.toString('latin1', at + 124, at + 135), 8);
        files.set(name, bytes.subarray(at + 512, at + 512 + size));
        at += 512 + Math.ceil(size / 512) * 512;
    }
    return files;
}
