// Captures pages and checks the folders.
//
//     node test.mjs [--keep DIR] [--slow] [--late] [PAGE ..]      default: every page; --slow: also what frames cost;
//                                                          --late: the recorder comes after the page, as a bookmarklet does

import { mkdir, readFile, readdir, writeFile } from 'node:fs/promises';
import { dirname, join } from 'node:path';
import { fileURLToPath } from 'node:url';
import { capture, cost, launch, open } from './browser.mjs';
import { check, count } from './check.mjs';
import { serve } from './serve.mjs';

const FRAMES = 2;

const words = process.argv.slice(2);
const keep = words[0] === '--keep' ? words.splice(0, 2)[1] : null;
const slow = words[0] === '--slow' && words.shift();
const late = words[0] === '--late' && words.shift();
const pages = (await readdir(fileURLToPath(new URL('pages', import.meta.url))))
    .filter((name) => !name.endsWith('-scene.js') && (slow || !name.startsWith('stress')))
    .map((name) => name.replace('.js', ''));
const chosen = words.length ? words : pages;

const { server, address } = await serve();
const browser = await launch();
let failed = 0;
for (const name of chosen) {
    try {
        await test(name);
    } catch (error) {
        failed += 1;
        console.log(`${name}: ${error.stack ?? error}`);
    }
}
await browser.close();
server.close();
process.exit(failed ? 1 : 0);

async function test(name) {
    const visited = await open(browser, `${address}/${name}`, { late });
    const { page, errors } = visited;
    try {
        const { files } = await capture(visited, FRAMES);
        if (keep) await store(join(keep, name), files);
        const problems = [...check(files), ...errors];
        const json = JSON.parse(files.get('frame.json'));
        const totals = count(json);
        if (totals.frames !== FRAMES || !totals.draws) problems.push('frames or draws are missing');
        const bytes = [...files.values()].reduce((sum, { length }) => sum + length, 0);
        const text = Object.entries(totals).map(([key, value]) => `${value} ${key}`);
        console.log(`${name}: ${json.source.api}, ${text.join(', ')}, ${(bytes / 2 ** 20).toFixed(2)} MiB`);
        for (const { what, why, count } of json.refused) console.log(`    refused ${what} (${count}): ${why}`);
        for (const { why, ...object } of json.unknown) console.log(`    unknown ${JSON.stringify(object)}: ${why}`);
        problems.push(...(await replayed(json, files)));
        if (slow) {
            const recorded = await cost(page);
            const plain = await open(browser, `${address}/${name}`, { record: false });
            console.log(`    its own frames: ${await cost(plain.page)} ms, with the recorder ${recorded} ms`);
            await plain.page.close();
        }
        if (problems.length) throw new Error([...new Set(problems)].slice(0, 12).join('\n    '));
    } finally {
        await page.close();
    }
}

/** Draws a capture again in the same browser: what differs from the page is a problem. */
async function replayed(json, files) {
    const page = await browser.newPage();
    try {
        await page.goto(`${address}/empty`);
        await page.addScriptTag({
            content: await readFile(
                new URL(`replay-${json.source.api === 'webgpu' ? 'webgpu' : 'webgl'}.js`, import.meta.url),
                'utf8',
            ),
        });
        const data = {};
        for (const [name, bytes] of files) {
            if (name.startsWith('data/')) data[name.slice(5, -4)] = bytes.toString('base64');
        }
        const { different, errors } = await page.evaluate(
            ([json, data]) => globalThis.replay(json, data),
            [json, data],
        );
        console.log(`    replayed: ${different.join(', ')} pixels differ`);
        return different.some(Boolean) ? ['pixels differ', ...errors] : errors;
    } finally {
        await page.close();
    }
}

async function store(folder, files) {
    for (const [name, bytes] of files) {
        const path = join(folder, name);
        await mkdir(dirname(path), { recursive: true });
        await writeFile(path, bytes);
    }
}
