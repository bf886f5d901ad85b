// Makes dist/: each material's GLSL as WebGL gets it, taken from the running page, and what preshade makes of it.
//
//     node build.mjs [PRESHADE]        the binary; default: the workspace's, release before debug

import { execFile } from 'node:child_process';
import { existsSync } from 'node:fs';
import { mkdir, readFile, rm, writeFile } from 'node:fs/promises';
import { fileURLToPath } from 'node:url';
import { promisify } from 'node:util';
import { open } from './browser.mjs';
import { serve } from './serve.mjs';
import { VARIANTS } from './variants.mjs';

const run = promisify(execFile);
const here = (path) => fileURLToPath(new URL(path, import.meta.url));
const built = ['release', 'debug'].map((profile) => here(`../../target/${profile}/preshade`));
const preshade = process.argv[2] ?? built.find(existsSync);
if (!preshade) throw new Error('no preshade binary: cargo build --release -p preshade-cli');

/** What WebGL is given for each material that is to be rewritten, by name. */
async function captured() {
    const { server, address } = await serve();
    const { browser, page, visit, errors } = await open(640, 400);
    try {
        await visit(`${address}/?capture`);
        const taken = await page.evaluate(() => window.page.capture());
        if (errors.length) throw new Error(errors.join('\n'));
        return taken;
    } finally {
        await browser.close();
        server.close();
    }
}

/** One variant of one material, as the page's list has it. */
async function rewrite(material, { name, recipe, of }, text) {
    const into = `dist/${name}`;
    const passes = (of?.[material] ?? recipe).flatMap((pass) => ['--pass', pass]);
    const files = [`${material}.vert`, `${material}.frag`].map((file) => here(`dist/captured/${file}`));
    const state = here(`dist/captured/${material}.state.json`);
    const { stderr } = await run(
        preshade,
        ['rewrite', ...files, '--state', state, ...passes, '--emit', 'glsl-es', '-o', here(into)],
        { timeout: 120_000 },
    );
    const path = `${into}/${material}.plan.json`;
    const plan = JSON.parse(await readFile(here(path), 'utf8'));
    const says = stderr.split('\n').filter((line) => line && !line.startsWith('wrote '));
    // A pass that does not apply leaves the material as it was: there is nothing to draw by.
    return { material, variant: name, plan: plan.steps.length ? path : null, text, says };
}

await rm(here('dist'), { recursive: true, force: true });
await mkdir(here('dist/captured'), { recursive: true });
const taken = await captured();
for (const [name, { vertex, fragment, state }] of Object.entries(taken)) {
    await writeFile(here(`dist/captured/${name}.vert`), vertex);
    await writeFile(here(`dist/captured/${name}.frag`), fragment);
    await writeFile(here(`dist/captured/${name}.state.json`), JSON.stringify(state, null, 4));
}
const made = [];
for (const variant of VARIANTS) {
    made.push(
        ...(await Promise.all(Object.entries(taken).map(([material, { text }]) => rewrite(material, variant, text)))),
    );
}
await writeFile(here('dist/variants.json'), JSON.stringify(made, null, 4));
for (const { material, variant, plan, says } of made) {
    console.log(`${variant} of ${material}: ${plan ?? 'does not apply'}`);
    for (const line of says) console.log(`    ${line}`);
}
