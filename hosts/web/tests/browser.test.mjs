// The package's module in Chromium, in a worker: the bytes of node, an error, and times of warm rewrites.

import assert from 'node:assert/strict';
import { existsSync, readFileSync } from 'node:fs';
import { createServer } from 'node:http';
import { extname, join, normalize } from 'node:path';
import test from 'node:test';
import { chromium } from 'playwright-core';
import { rewrite } from '../sync.js';
import { FIXTURES, materials, PACKAGE, read } from './support.mjs';

const PLACES = ['/usr/bin/chromium', '/usr/bin/chromium-browser', '/usr/bin/google-chrome'];
const TYPES = { '.js': 'text/javascript', '.wasm': 'application/wasm', '.html': 'text/html' };
const PAGE = `<!doctype html><meta charset="utf-8" />
<script type="importmap">{ "imports": { "#start": "./start-browser.js", "preshade": "./index.js" } }</script>
<script type="module">
    import * as preshade from 'preshade';
    globalThis.preshade = preshade;
    globalThis.ready = true;
</script>`;

/** Serves the package, with a page that imports it. */
function serve(context) {
    const server = createServer((request, response) => {
        const path = normalize(new URL(request.url, 'http://localhost').pathname);
        const file = join(PACKAGE, path);
        const type = TYPES[extname(path === '/' ? 'page.html' : path)] ?? 'application/octet-stream';
        if (path !== '/' && !existsSync(file)) response.writeHead(404).end();
        else response.writeHead(200, { 'content-type': type }).end(path === '/' ? PAGE : readFileSync(file));
    });
    context.after(() => server.close());
    return new Promise((resolve) => server.listen(0, '127.0.0.1', () => resolve(server.address().port)));
}

const at = (times, share) => times[Math.min(times.length - 1, Math.floor(times.length * share))].toFixed(1);

test('the package works in Chromium', async (context) => {
    const executablePath = process.env.CHROMIUM ?? PLACES.find(existsSync);
    assert.ok(executablePath, 'no Chromium: scripts/setup.sh three installs it, or name one by CHROMIUM');
    const port = await serve(context);
    const browser = await chromium.launch({ executablePath, args: ['--no-sandbox'] });
    context.after(() => browser.close());
    const page = await browser.newPage();
    const errors = [];
    page.on('pageerror', (error) => errors.push(String(error)));
    await page.goto(`http://127.0.0.1:${port}/`);
    await page.waitForFunction(() => globalThis.ready, null, { timeout: 60_000 });

    const asked = materials()
        .filter(([file]) => /^(shaders|glsl|pages|agree)\//.test(file))
        .map((paths) => paths.map((name) => ({ name, text: read(FIXTURES, name) })));
    const options = { pass: 'depth-prepass', emit: ['wgsl', 'glsl-es'] };
    const answers = await page.evaluate(
        async ([asked, options]) => {
            const { rewrite } = globalThis.preshade;
            const answer = async (sources) => {
                const began = performance.now();
                const variant = await rewrite(sources, options).catch(({ code }) => ({ code }));
                return { files: variant.files, code: variant.code, took: performance.now() - began };
            };
            const cold = [];
            for (const sources of asked) cold.push(await answer(sources));
            const warm = [];
            for (let round = 0; round < 3; round++)
                for (const sources of asked) warm.push((await answer(sources)).took);
            return { cold, warm };
        },
        [asked, options],
    );
    for (const [i, { files, code }] of answers.cold.entries()) {
        let expected;
        try {
            expected = rewrite(asked[i], options);
        } catch (error) {
            assert.equal(code, error.code);
            continue;
        }
        assert.deepEqual(files, expected.files, asked[i][0].name);
    }
    const warm = answers.warm.sort((a, b) => a - b);
    const first = answers.cold[0].took.toFixed(0);
    context.diagnostic(
        `${asked.length} materials, two targets each: the first took ${first} ms with loading; warm, half took ` +
            `${at(warm, 0.5)} ms, 90 % ${at(warm, 0.9)} ms at most`,
    );
    const deep = [60, 90, 126].map((depth) => {
        const ifs = `${'if x > 1.0 { '.repeat(depth)}x += 1.0;${' }'.repeat(depth)}`;
        return `
            @vertex fn vs() -> @builtin(position) vec4<f32> { return vec4(0.0); }
            @fragment fn fs(@builtin(position) p: vec4<f32>) -> @location(0) vec4<f32> {
                var x = p.x; ${ifs} return vec4(x);
            }`;
    });
    const nested = await page.evaluate(async (deep) => {
        const answers = [];
        for (const text of deep) answers.push(await globalThis.preshade.rewrite(text).catch(({ code }) => ({ code })));
        return answers.map(({ code }) => code ?? 'accepted');
    }, deep);
    assert.ok(
        nested.every((outcome) => ['accepted', 'too-deep'].includes(outcome)),
        `${nested}`,
    );
    context.diagnostic(`60, 90 and 126 nested ifs: ${nested.join(', ')}`);

    const error = await page.evaluate(() =>
        globalThis.preshade.rewrite('fn f( {').catch(({ code, place }) => ({ code, line: place.line })),
    );
    assert.deepEqual(error, { code: 'parse', line: 1 });
    assert.deepEqual(errors, []);
});
