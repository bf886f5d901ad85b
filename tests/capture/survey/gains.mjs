// What `plan` gains in the frames of frames.json, from what scripts/gains.sh measured: writes a line for each frame into
// docs/results/workload/ADAPTER.json, and the table of docs/results/gains.md.
//
//     node gains.mjs FOLDER NAME      NAME of the adapter, for the file
//
// A frame that FOLDER lacks keeps its line.

import { existsSync } from 'node:fs';
import { mkdir, readFile, writeFile } from 'node:fs/promises';
import { join } from 'node:path';
import { fileURLToPath } from 'node:url';
import { frames, planned, rounded } from './planned.mjs';
import { placed } from './table.mjs';

const RESULTS = fileURLToPath(new URL('../../../docs/results/workload', import.meta.url));
const SAME = { median: 1, low: 1, high: 1 };
const [folder, name] = process.argv.slice(2);

const file = join(RESULTS, `${name}.json`);
const lines = existsSync(file) ? (await readFile(file, 'utf8')).trim().split('\n') : [];
const before = lines.map((line) => JSON.parse(line));
const rows = [];
for (const { id, half } of frames) {
    const kept = before.find(({ frame }) => frame === id);
    if (existsSync(join(folder, `${id}.txt`))) rows.push(await row(id, half));
    else if (kept) rows.push(kept);
}
await mkdir(RESULTS, { recursive: true });
await writeFile(file, rows.map((row) => `${JSON.stringify(row)}\n`).join(''));
const report = fileURLToPath(new URL('../../../docs/results/gains.md', import.meta.url));
const gained = placed(await readFile(report, 'utf8'), name, table(rows));
await writeFile(report, placed(gained, `bounds of ${name}`, bounds(rows)));

async function row(frame, half) {
    const said = await readFile(join(folder, `${frame}.txt`), 'utf8');
    const found = { frame, half, error: /^error: .*/m.exec(said)?.[0], passes: [] };
    const profile = await read(`${frame}.profile.json`);
    const view = profile?.views[0];
    if (view) {
        found.adapter = `${profile.adapter.name} (${profile.adapter.driver})`;
        found.profile = {
            of: Number(/(\d+), [^;]*, which this report is about/.exec(byPass(said))?.[1]),
            ms: view.time_ms.median,
            pass: median(view.draws),
            vertices: median(view.vertices),
            materials: [],
        };
        for (const { material, fragments, arithmetic, textures, fill } of view.materials) {
            const parts = { fragments, arithmetic, textures, fill };
            const each = Object.entries(parts).map(([what, part]) => [what, median(part)]);
            found.profile.materials.push({ material, ...Object.fromEntries(each) });
        }
    }
    for (const share of shares(said)) {
        const plan = await read(`${frame}.${share.pass}.plan.json`);
        const text = join(folder, `${frame}.${share.pass}.txt`);
        const error = !plan && existsSync(text) && /^error: .*/m.exec(await readFile(text, 'utf8'))?.[0];
        found.passes.push({ ...share, ...(plan && planned(plan)), ...(error && { error }) });
    }
    found.same = whole(found.passes, ({ same }) => same);
    found.within = whole(found.passes, ({ within, same }) => within ?? same);
    return found;
}

async function read(file) {
    return existsSync(join(folder, file)) ? JSON.parse(await readFile(join(folder, file), 'utf8')) : undefined;
}

function byPass(said) {
    return /^note: the frame's time by render pass: (.*)/m.exec(said)?.[1] ?? '';
}

/** The parts of a frame's time by render pass, and the pass that was profiled. */
function shares(said) {
    const each = byPass(said)
        .split('; ')
        .map((text) => /^(\d+), (.*) of (\d+) draws?, (\d+) %/.exec(text));
    return each.filter(Boolean).map(([, pass, kind, draws, part]) => ({
        pass: Number(pass),
        kind,
        draws: Number(draws),
        part: part / 100,
    }));
}

/** The gain of the whole frame: the rest of it takes the time that it took. */
function whole(passes, of) {
    const total = (end) =>
        1 / (1 - passes.reduce((sum, pass) => sum + pass.part * (1 - 1 / (of(pass)?.speedup ?? SAME)[end]), 0));
    return { median: rounded(total('median')), low: rounded(total('low')), high: rounded(total('high')) };
}

function median(part) {
    return part ? rounded(part.median) : undefined;
}

function table(rows) {
    const lines = rows.map((row) => {
        const { frame, half, profile, passes, same, within, error } = row;
        if (!passes.length) return `| \`${frame}\` | ${half} | ${cell(error ?? '')} | | | | |\n`;
        const plans = passes.filter((p) => p.same || p.within || p.ms !== undefined);
        const told = (p, of) => (of ? `${p.pass}: ${cell(of.plan)} ${ratio(of.speedup)}` : '');
        const kept = plans.map((p) => told(p, p.same)).filter(Boolean);
        const changed = plans
            .map((p) => p.within && `${told(p, p.within)}, FLIP ${p.within.flip.toPrecision(1)}`)
            .filter(Boolean);
        const drawn = passes.filter((p) => p.ms !== undefined);
        const timed = drawn.map((p) => `${p.pass}: ${Math.round(p.part * 100)} %, ${p.ms.toFixed(3)} ms`);
        const cells = [`\`${frame}\``, half, timed.join('<br>'), bound(profile), ofFrame(same), kept.join('<br>')];
        const isOther = within.median > same.median;
        const others = isOther ? [ofFrame(within), changed.join('<br>')] : ['', ''];
        return `| ${[...cells, ...others].join(' | ')} |\n`;
    });
    return `
| frame | half | passes that were planned: part of the frame, time | largest part of the profiled pass | no pixel changes | by | within FLIP 0.01 | by |
|---|---|---|---|--:|---|--:|---|
${lines.join('')}
`;
}

/** What the time of the profiled pass goes to, of frames that gain less than 5 %. */
function bounds(rows) {
    const few = rows.filter(({ same, within, profile }) => profile && Math.max(same.median, within.median) < 1.05);
    const lines = few.map(({ frame, profile, passes }) => {
        const fragments = profile.materials.map((m) => m.fragments).filter((part) => part !== undefined);
        const sum = fragments.length ? fragments.reduce((all, part) => all + part, 0) : undefined;
        const { overdraw } = passes.find(({ pass }) => pass === profile.of) ?? {};
        const parts = [profile.pass, profile.vertices, sum].map((part) => (part === undefined ? '' : percent(part)));
        return `| \`${frame}\` | ${[...parts, overdraw?.toFixed(2) ?? ''].join(' | ')} |\n`;
    });
    return `
| frame | the pass and its draw calls | vertices | fragments | fragments a covered pixel |
|---|--:|--:|--:|--:|
${lines.join('')}
`;
}

function percent(part) {
    return `${Math.round(part * 100)} %`;
}

function cell(text) {
    return text.replaceAll('|', '\\|').replaceAll('\n', ' ').slice(0, 200);
}

/** The gain of a frame. The parts of its passes are whole percents, so it has two digits. */
function ofFrame({ median }) {
    return median === 1 ? '1' : `${median.toFixed(2)}x`;
}

function ratio({ median, low, high }) {
    return `${median.toFixed(3)}x [${low.toFixed(3)}, ${high.toFixed(3)}]`;
}

function bound(profile) {
    if (!profile) return '';
    const parts = [
        ['the pass and its draw calls', profile.pass],
        ['vertices', profile.vertices],
    ];
    for (const { material, arithmetic, textures, fill } of profile.materials) {
        for (const [what, part] of Object.entries({ arithmetic, textures, fill }))
            parts.push([`${what} of \`${material}\``, part]);
    }
    const [what, part] = parts.filter(([, part]) => part !== undefined).sort((a, b) => b[1] - a[1])[0];
    return `${profile.of}: ${what}, ${percent(part)}`;
}
