// What `plan` gains in the frames of frames.json, from what scripts/gains.sh measured: writes a line for each frame into
// docs/results/workload/ADAPTER.json, and the table of docs/results/workload.md.
//
//     node gains.mjs FOLDER NAME      NAME of the adapter, for the file

import { existsSync } from 'node:fs';
import { mkdir, readFile, readdir, writeFile } from 'node:fs/promises';
import { join } from 'node:path';
import { fileURLToPath } from 'node:url';
import { placed } from './table.mjs';

const RESULTS = fileURLToPath(new URL('../../../docs/results/workload', import.meta.url));
const [folder, name] = process.argv.slice(2);
const list = JSON.parse(await readFile(new URL('frames.json', import.meta.url), 'utf8'));

const rows = [];
for (const { id, half } of list.frames ?? list) {
    const file = (end) => join(folder, `${id}.${end}`);
    if (!existsSync(file('txt'))) continue;
    const said = await readFile(file('txt'), 'utf8');
    const read = async (end) => (existsSync(file(end)) ? JSON.parse(await readFile(file(end), 'utf8')) : undefined);
    const [profile, plan, within] = [await read('profile.json'), await read('plan.json'), await read('within.json')];
    rows.push({ ...row(id, half, said, profile, plan), within: within && chosen(within) });
}
await mkdir(RESULTS, { recursive: true });
await writeFile(join(RESULTS, `${name}.json`), rows.map((row) => `${JSON.stringify(row)}\n`).join(''));
const report = `${RESULTS}.md`;
await writeFile(report, placed(await readFile(report, 'utf8'), name, table(rows)));

function row(frame, half, said, profile, plan) {
    const error = /^error: .*/m.exec(said)?.[0];
    const part = /(\d+) %, which this report is about/.exec(said)?.[1];
    const found = { frame, half, part: part && Number(part) / 100, error: plan ? undefined : error };
    const view = profile?.views[0];
    if (view) {
        found.adapter = `${profile.adapter.name} (${profile.adapter.driver})`;
        found.ms = view.time_ms.median;
        found.profile = { pass: median(view.draws), vertices: median(view.vertices), materials: [] };
        for (const { material, fragments, arithmetic, textures, fill } of view.materials) {
            const parts = { fragments, arithmetic, textures, fill };
            const each = Object.entries(parts).map(([what, part]) => [what, median(part)]);
            found.profile.materials.push({ material, ...Object.fromEntries(each) });
        }
    }
    if (plan) Object.assign(found, chosen(plan));
    const sorted = plan?.views[0].sorted;
    if (sorted) {
        const { moved, draws, speedup, changed_pixels } = sorted;
        found.sorted = { moved: moved.length, draws: draws.length, speedup, changed_pixels };
    }
    return found;
}

/** A plan without the keys of what it hoists. */
function short(plan) {
    return plan.replaceAll(/,(carry|vertices-per-fragment)=[^,:;) ]*/g, '');
}

/** The plan that is chosen for the first view. */
function chosen({ plans, views: [{ plan }] }) {
    const { name, by_view, verdict, error } = plans[plan];
    const { predicted_ms, speedup } = by_view[0];
    const predicted = plans[0].by_view[0].predicted_ms / predicted_ms;
    const { changed_pixels = 0, flip_mean = 0 } = (plan > 0 && error) || {};
    return { plan: name, speedup, predicted, verdict, changed_pixels, flip_mean };
}

function median(part) {
    return part ? Math.round(part.median * 1000) / 1000 : undefined;
}

function table(rows) {
    const lines = rows.map((row) => {
        const { frame, half, part, ms, profile, plan, speedup, predicted, sorted, within, error } = row;
        if (error) return `| \`${frame}\` | ${half} | | | | ${error.replaceAll('|', '\\|').slice(0, 120)} | | | | |\n`;
        const gain = plan === 'original' ? '1' : ratio(speedup);
        const sort = sorted ? `${ratio(sorted.speedup)}, ${sorted.moved} of ${sorted.draws}, ${sorted.changed_pixels} px` : '';
        const isOther = within && within.plan !== 'original' && within.plan !== plan;
        const inside = isOther
            ? `${short(within.plan)}: ${ratio(within.speedup)}, ${within.changed_pixels} px, ${within.flip_mean.toPrecision(1)}`
            : '';
        const cells = [`\`${frame}\``, half, percent(part), ms?.toFixed(3), bound(profile), plan, gain, predicted?.toFixed(2), sort, inside];
        return `| ${cells.join(' | ')} |\n`;
    });
    return `
| frame | half | pass / frame | ms of the pass | largest part | plan | measured | predicted | sorted alone: draws that move, pixels that change | within FLIP 0.01, if another plan: pixels that change, mean FLIP |
|---|---|--:|--:|---|---|--:|--:|---|---|
${lines.join('')}
`;
}

function percent(part) {
    return part === undefined ? '' : `${Math.round(part * 100)} %`;
}

function ratio({ median, low, high }) {
    return `${median.toFixed(3)} [${low.toFixed(3)}, ${high.toFixed(3)}]`;
}

function bound(profile) {
    if (!profile) return '';
    const parts = [['the pass and its draw calls', profile.pass], ['vertices', profile.vertices]];
    for (const { material, arithmetic, textures, fill } of profile.materials) {
        for (const [what, part] of Object.entries({ arithmetic, textures, fill })) parts.push([`${what} of \`${material}\``, part]);
    }
    const [what, part] = parts.filter(([, part]) => part !== undefined).sort((a, b) => b[1] - a[1])[0];
    return `${what}, ${percent(part)}`;
}
