// Captures pages of public libraries, replays each on two software drivers, verifies variants of its materials, and
// writes the table of docs/results/captures.md.
//
//     node survey.mjs [--programs DIR] [--keep DIR] [--demos DIR] [--again] [PAGE ..]
//     node survey.mjs --cost                                what recording costs, in a table of its own
//
// --programs: where cargo put `preshade` and `examples/captures`; default: target/release of this checkout.
// --keep: where captures go, and stay; default: a folder that is removed. --again: those that are there are not
// captured again. --demos: a folder of checkouts; demos.mjs names them. With pages, only their rows are written anew.

import { execFile } from 'node:child_process';
import { existsSync } from 'node:fs';
import { mkdtemp, readFile, rm, writeFile } from 'node:fs/promises';
import { tmpdir } from 'node:os';
import { join, resolve } from 'node:path';
import { fileURLToPath } from 'node:url';
import { promisify } from 'node:util';
import { gunzipSync } from 'node:zlib';
import { count } from '../check.mjs';
import { pages, serve } from './serve.mjs';
import { cost, costTable } from './cost.mjs';
import { placed, table } from './table.mjs';

const run = promisify(execFile);
const ROOT = fileURLToPath(new URL('../../../', import.meta.url));
const RESULTS = join(ROOT, 'docs/results/captures/pages.json');
const REPORT = join(ROOT, 'docs/results/captures.md');
const SWIFTSHADER = ['/usr/lib/chromium/vk_swiftshader_icd.json', '/usr/lib/chromium-browser/vk_swiftshader_icd.json'];
const LAVAPIPE = '/usr/share/vulkan/icd.d/lvp_icd.x86_64.json';
const MINUTES = 60_000;
const FRAMES = 2;
const SIZE = '320x240';

const words = process.argv.slice(2);
const take = (flag) => {
    const at = words.indexOf(flag);
    return at < 0 ? undefined : words.splice(at, 2)[1];
};
const programs = resolve(take('--programs') ?? join(ROOT, 'target/release'));
const keep = take('--keep');
const demos = take('--demos');
const again = words.includes('--again') && words.splice(words.indexOf('--again'), 1);
const drivers = {
    swiftshader: process.env.SWIFTSHADER ?? SWIFTSHADER.find(existsSync),
    llvmpipe: process.env.LAVAPIPE ?? LAVAPIPE,
};
const folder = keep ? resolve(keep) : await mkdtemp(join(tmpdir(), 'preshade-'));

if (words.includes('--cost')) {
    const text = costTable(await cost());
    console.log(text);
    await writeFile(REPORT, placed(await readFile(REPORT, 'utf8'), 'cost', text));
    process.exit();
}
const all = [];
for (const { name, title, apis } of await pages()) {
    for (const api of apis) {
        const id = apis.length > 1 ? `${name}-${api.toLowerCase()}` : name;
        all.push({ id, title, path: `/${name}?api=${api}` });
    }
}
if (demos) all.push(...(await import('./demos.mjs')).list(demos));
const chosen = words.length ? all.filter(({ id }) => words.some((word) => new RegExp(`^${word}$`).test(id))) : all;

const { server, address } = await serve({ demos });
const rows = new Map();
if (existsSync(RESULTS)) {
    for (const line of (await readFile(RESULTS, 'utf8')).trim().split('\n')) {
        const row = JSON.parse(line);
        rows.set(row.page, row);
    }
}
for (const page of chosen) {
    const row = await survey(page);
    rows.set(page.id, row);
    console.log(JSON.stringify(row));
    await report();
}
server.close();
if (!keep) await rm(folder, { recursive: true });

/** Writes the tables. Without the checkouts, rows of their demos stay. */
async function report() {
    const known = all.map(({ id }) => rows.get(id)).filter(Boolean);
    const others = [...rows.values()].filter((row) => !known.includes(row) && !demos);
    const list = [...known, ...others];
    await writeFile(RESULTS, list.map((row) => `${JSON.stringify(row)}\n`).join(''));
    await writeFile(REPORT, placed(await readFile(REPORT, 'utf8'), 'pages', table(list)));
}

/** Captures, replays and verifies one page: a row of the table. */
async function survey({ id, title, path }) {
    const row = { page: id, title };
    const out = join(folder, id);
    const files = ['frame.json', 'frame.json.gz'].map((name) => join(out, name));
    if (!again || !files.some(existsSync)) {
        const options = ['--frames', String(FRAMES), '--size', SIZE, '--wait-for', 'js:globalThis.ready', '--after', '0'];
        const made = await program('preshade', ['capture', address + path, ...options, '-o', out]);
        if (made.failed) return { ...row, error: short(made.errors) };
    }
    const bytes = await readFile(files.find(existsSync));
    const file = JSON.parse(bytes[0] === 0x1f ? gunzipSync(bytes) : bytes);
    const totals = count(file);
    row.api = { webgpu: 'WebGPU', webgl2: 'WebGL 2', webgl1: 'WebGL 1' }[file.source.api];
    row.draws = Math.round(totals.draws / totals.frames);
    row.passes = Math.round(totals.passes / totals.frames);
    row.refused = file.refused.map(({ what, why, count }) => `${what} (${count}): ${why}`);
    row.unknown = file.unknown.length;
    const replays = Object.entries(drivers).map(async ([driver, icd]) => [driver, await replayed(out, icd)]);
    for (const [driver, found] of await Promise.all(replays)) row[driver] = found;
    row.verify = await verified(out);
    return row;
}

/** A capture drawn again by one driver. */
async function replayed(out, icd) {
    const { output, errors } = await program('examples/captures', [out], { VK_DRIVER_FILES: icd });
    try {
        const { found } = JSON.parse(output);
        if (found.error) return { error: short(found.error) };
        const frames = found.frames;
        return {
            differ: frames.map(({ differ }) => differ),
            more: frames.map(({ by_more: more }) => more),
            most: Math.max(0, ...frames.map(({ most }) => most)),
            left: found['left out'].map(({ what, why, count }) => `${what} (${count}): ${short(why)}`),
        };
    } catch {
        return { error: short(errors) };
    }
}

/** Two variants of a capture's materials: how many are measured, and what breaks. */
async function verified(out) {
    const options = ['--variant', 'depth-prepass', '--variant', 'early-discard', '--frames', '1'];
    const { output, errors, failed } = await program('preshade', ['verify', out, ...options, '--time', 'no'], {
        VK_DRIVER_FILES: drivers.llvmpipe,
    });
    if (!failed) return { status: 0 };
    const lines = `${output}\n${errors}`.split('\n');
    const at = lines.findIndex((line) => /^error|broken|not measured:/.test(line));
    return { status: failed, why: short(lines.slice(Math.max(0, at), at + 6).join(' ')) };
}

async function program(name, words, variables = {}) {
    const options = { timeout: 8 * MINUTES, maxBuffer: 1 << 28, env: { ...process.env, ...variables } };
    try {
        const { stdout, stderr } = await run(join(programs, name), words, options);
        return { output: stdout, errors: stderr, failed: 0 };
    } catch ({ stdout = '', stderr = '', code, signal, message }) {
        return { output: stdout, errors: stderr || (stdout ? '' : message), failed: signal ?? code };
    }
}

/** The first lines of a message, without names of this machine. */
function short(text) {
    return String(text).replaceAll(folder, '').replaceAll(address, '').trim().split('\n').slice(0, 3).join(' ').slice(0, 400);
}
