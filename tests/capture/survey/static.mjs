// How much of the fragment stages of other people's materials `preamble`, `hoist` and `specialize` save, as `explain`
// counts it: writes docs/results/workload/static.json and the table of docs/results/static.md.
//
//     node static.mjs BEFORE AFTER FOLDER..     two builds of preshade; folders of frames, and of shaders
//
// A folder with a frame.json or its archive is a captured frame, whose values are known. Elsewhere a material is a WGSL
// file with both stages, or two GLSL files of one name. Materials of equal stages are counted once. Without arguments
// only the table is written.

import { execFile } from 'node:child_process';
import { existsSync } from 'node:fs';
import { readFile, readdir, writeFile } from 'node:fs/promises';
import { basename, dirname, extname, join } from 'node:path';
import { fileURLToPath } from 'node:url';
import { promisify } from 'node:util';
import { placed } from './table.mjs';

const RESULTS = fileURLToPath(new URL('../../../docs/results/workload', import.meta.url));
const PASSES = ['preamble', 'hoist', 'specialize'];
const LEAST = [0.05, 0.1, 0.25];
const [before, after, ...folders] = process.argv.slice(2);

const found = new Map();
for (const folder of folders) {
    for (const inputs of await materials(folder)) {
        const [old, now] = [await explained(before, inputs), await explained(after, inputs)];
        for (const { material, stages, passes } of now) {
            const key = JSON.stringify(stages);
            const fragment = stages.find(({ stage }) => stage === 'fragment');
            if (!fragment || found.has(key)) continue;
            const was = old.find((other) => other.material === material)?.passes ?? [];
            const each = PASSES.map((pass) => [pass, { before: saved(was, pass), after: saved(passes, pass) }]);
            const kind = inputs.length === 1 && isFrame(inputs[0]) ? 'frame' : 'text';
            found.set(key, {
                of: basename(inputs[0]),
                material,
                kind,
                ops: fragment.cost,
                ...Object.fromEntries(each),
            });
        }
    }
}
const file = join(RESULTS, 'static.json');
if (folders.length) await writeFile(file, [...found.values()].map((one) => `${JSON.stringify(one)}\n`).join(''));
const all = (await readFile(file, 'utf8')).trim().split('\n').map((line) => JSON.parse(line));
const report = fileURLToPath(new URL('../../../docs/results/static.md', import.meta.url));
await writeFile(report, placed(await readFile(report, 'utf8'), 'static', table()));

function isFrame(folder) {
    return ['frame.json', 'frame.json.gz', 'frame.json.zst'].some((name) => existsSync(join(folder, name)));
}

/** The inputs of `explain`, a list for each material or frame. */
async function materials(folder) {
    if (isFrame(folder)) return [[folder]];
    const names = await readdir(folder, { recursive: true });
    const each = names.sort().map((name) => {
        const [path, end] = [join(folder, name), extname(name)];
        if (end === '.wgsl') return [path];
        const other = { '.vert': '.frag', '.vs': '.fs' }[end];
        const pair = other && join(dirname(path), basename(name, end) + other);
        return pair && existsSync(pair) ? [path, pair] : undefined;
    });
    return each.filter(Boolean);
}

/** The materials that a build explains; none of what it cannot read. */
async function explained(program, inputs) {
    const run = promisify(execFile);
    const options = { timeout: 120_000, maxBuffer: 1 << 28 };
    const done = run(program, ['explain', ...inputs, '--format', 'json'], options);
    const { stdout } = await done.catch(() => ({ stdout: '' }));
    return stdout ? JSON.parse(stdout).materials : [];
}

/** The part of a fragment that a pass saves. */
function saved(passes, pass) {
    const sites = passes.find((one) => one.pass === pass)?.sites ?? [];
    const parts = sites.map(({ cost }) => (cost?.whole ? cost.slice / cost.whole : 0));
    return Math.round(1000 * Math.max(0, ...parts)) / 1000;
}

function table() {
    const line = (pass, when, kind) => {
        const of = all.filter((one) => one.kind === kind);
        const counts = LEAST.map((least) => of.filter((one) => one[pass][when] >= least).length);
        return `| \`${pass}\` | ${when} | ${kind === 'frame' ? 'captured, values known' : 'text alone'}: ${of.length} | ${counts.join(' | ')} |\n`;
    };
    const lines = PASSES.flatMap((pass) =>
        ['frame', 'text'].flatMap((kind) => ['before', 'after'].map((when) => line(pass, when, kind))),
    );
    return `
| pass | before or after this work | materials | save 5 % of the fragment stage | 10 % | 25 % |
|---|---|---|--:|--:|--:|
${lines.join('')}
`;
}
