// Draws what `plan` chose on a GPU with the software adapters, and counts the pixels that change: writes
// docs/results/workload/pictures.json and the table of docs/results/gains.md. A frame that is not given keeps its rows,
// and without arguments only the table is written.
//
//     node pictures.mjs PROGRAM PLANS OUT FRAME..     PLANS is the folder that scripts/gains.sh wrote
//
// OUT/FRAME.PASS gets `verify`'s report with its pictures, drawn by llvmpipe.

import { execFile } from 'node:child_process';
import { existsSync } from 'node:fs';
import { readFile, writeFile } from 'node:fs/promises';
import { basename, join } from 'node:path';
import { fileURLToPath } from 'node:url';
import { promisify } from 'node:util';
import { chosen, short } from './planned.mjs';
import { placed } from './table.mjs';

const RESULTS = fileURLToPath(new URL('../../../docs/results/workload', import.meta.url));
const ADAPTERS = ['llvmpipe', 'SwiftShader'];
const [program, plans, out, ...frames] = process.argv.slice(2);

const file = join(RESULTS, 'pictures.json');
const lines = existsSync(file) ? (await readFile(file, 'utf8')).trim().split('\n') : [];
let rows = lines.map((line) => JSON.parse(line));
for (const frame of frames) {
    const drawn = [];
    for (let pass = 0; pass < 64; pass++) {
        const plan = join(plans, `${basename(frame)}.${pass}.plan.json`);
        if (!existsSync(plan)) continue;
        const recipes = chosen(JSON.parse(await readFile(plan, 'utf8')));
        for (const adapter of recipes.length ? ADAPTERS : []) {
            drawn.push({ frame: basename(frame), pass, adapter, ...(await verified(frame, pass, adapter, recipes)) });
        }
    }
    // A frame takes minutes: what is drawn is written at once.
    rows = [...rows.filter((row) => row.frame !== basename(frame)), ...drawn];
    await save();
}
await save();

async function save() {
    await writeFile(file, rows.map((row) => `${JSON.stringify(row)}\n`).join(''));
    const report = fileURLToPath(new URL('../../../docs/results/gains.md', import.meta.url));
    await writeFile(report, placed(await readFile(report, 'utf8'), 'pictures', table()));
}

async function verified(frame, pass, adapter, recipes) {
    const variants = recipes.flatMap((recipe) => ['--variant', recipe]);
    const folder = adapter === 'llvmpipe' ? ['--out', join(out, `${basename(frame)}.${pass}`)] : [];
    const words = ['verify', frame, '--render-pass', pass, '--adapter', adapter, '--time', 'no', '--frames', 1];
    const options = { timeout: 600_000, maxBuffer: 1 << 28 };
    // A broken promise is status 1, and still a report.
    const run = promisify(execFile)(
        program,
        [...words, ...variants, ...folder, '--format', 'json'].map(String),
        options,
    );
    const { stdout, stderr } = await run.catch((error) => error);
    if (!stdout) return { error: /^error: .*/m.exec(stderr ?? '')?.[0] ?? 'no report' };
    const { variants: all } = JSON.parse(stdout);
    const each = all.slice(1).map(({ recipe, contract, verdict, error }) => ({
        recipe: short(recipe),
        contract: contract.kind,
        verdict: verdict.kind,
        pixels: error?.changed_pixels,
        flip: error?.flip_mean,
        why: verdict.why,
    }));
    return { variants: each };
}

function table() {
    const lines = rows.map(({ frame, pass, adapter, variants, error }) => {
        const said = (v) => v.why ?? `${v.verdict}, ${v.pixels} px, FLIP ${v.flip?.toPrecision(1)}`;
        const each = (variants ?? []).map((v) => `\`${v.recipe}\`: ${said(v)}`);
        return `| \`${frame}\` | ${pass} | ${adapter} | ${error ?? each.join('<br>')} |\n`;
    });
    return `
| frame | pass | adapter | recipe, on all materials that take it: verdict, pixels that change, mean FLIP |
|---|--:|---|---|
${lines.join('')}
`;
}
