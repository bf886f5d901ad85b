// Makes the README's pictures: `npm run images`.

import { mkdir, writeFile } from 'node:fs/promises';
import { launch, open } from './browser.mjs';
import { serve } from './serve.mjs';

const FOLDER = new URL('../images/', import.meta.url);
const LIMIT = 150_000;

const { address, close } = await serve();
const errors = [];
await mkdir(FOLDER, { recursive: true });
for (const webgpu of [false, true]) {
    const browser = await launch({ webgpu });
    const opened = await open(browser, `${address}/page/${webgpu ? 'webgpu/' : ''}images`);
    for (const name of await opened.page.evaluate(() => globalThis.names)) {
        const { url, states } = await opened.page.evaluate((name) => globalThis.draw(name), name);
        const bytes = Buffer.from(url.split(',')[1], 'base64');
        if (bytes.length > LIMIT) errors.push(`${name}: ${bytes.length} bytes, and the limit is ${LIMIT}`);
        await writeFile(new URL(`${name}.png`, FOLDER), bytes);
        console.log(name, bytes.length, states.join());
    }
    errors.push(...opened.errors);
    await browser.close();
}
close();
if (errors.length) {
    console.error(errors.join('\n'));
    process.exitCode = 1;
}
