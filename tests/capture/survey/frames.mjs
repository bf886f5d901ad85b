// Captures the frames of frames.json: pages that others wrote, at pinned commits, for measuring passes. Nothing of them
// is kept in this repository.
//
//     node frames.mjs [--programs DIR] [--demos DIR] [--out DIR] [--again] [--freeze] [FRAME ..]
//
// --programs: where cargo put `preshade`; default: target/release of this checkout. --demos: where the repositories
// are fetched to; default: target/frames-demos. --out: where `seen` and `unseen` go; default: target/frames. --again:
// those that are there are not captured again. --freeze: writes what it finds into frames.json. Without it, a frame that
// differs from the list is named, and the exit status is 1.
//
// Frames are sorted by the SHA-256 of their name: the first ten are `seen`, the others `unseen`. Nobody looks at what
// passes gain in the unseen ones before the work on the seen ones is done.
//
// What is frozen: a page's files by the commit, its packages by package-lock.json, and hashes of what it draws. `shaders`
// and `commands`, the pipelines and draws of each pass, are the same in every run. `picture` is not for pages that count
// frames or load in another order, so another picture is no difference.

import { execFile } from 'node:child_process';
import { createHash } from 'node:crypto';
import { existsSync } from 'node:fs';
import { mkdir, readFile, rm, writeFile } from 'node:fs/promises';
import { join, resolve } from 'node:path';
import { fileURLToPath } from 'node:url';
import { promisify } from 'node:util';
import { gunzipSync } from 'node:zlib';
import { count } from '../check.mjs';
import { serve } from './serve.mjs';

const run = promisify(execFile);
const ROOT = fileURLToPath(new URL('../../../', import.meta.url));
const LIST = fileURLToPath(new URL('frames.json', import.meta.url));
const MINUTES = 60_000;
/** A page is loaded when no file has come for so many seconds. */
const QUIET = 5;
const LOADED = `globalThis.surveyLoading = 10;
performance.setResourceTimingBufferSize(1e5);
addEventListener('load', () => {
    let [files, quiet] = [0, 0];
    const timer = setInterval(() => {
        const now = performance.getEntriesByType('resource').length;
        quiet = now === files ? quiet + 1 : 0;
        files = now;
        if (quiet >= ${QUIET}) { globalThis.loaded = true; clearInterval(timer); }
    }, 1000);
});
`;
const hash = (value) => createHash('sha256').update(JSON.stringify(value)).digest('hex').slice(0, 16);

const words = process.argv.slice(2);
const take = (flag) => {
    const at = words.indexOf(flag);
    return at < 0 ? undefined : words.splice(at, 2)[1];
};
const programs = resolve(take('--programs') ?? join(ROOT, 'target/release'));
const demos = resolve(take('--demos') ?? join(ROOT, 'target/frames-demos'));
const out = resolve(take('--out') ?? join(ROOT, 'target/frames'));
const again = words.includes('--again') && words.splice(words.indexOf('--again'), 1);
const freezes = words.includes('--freeze') && words.splice(words.indexOf('--freeze'), 1);

const list = JSON.parse(await readFile(LIST, 'utf8'));
if (freezes) {
    const name = ({ id }) => createHash('sha256').update(id).digest('hex');
    list.frames.sort((a, b) => (name(a) < name(b) ? -1 : 1));
    list.frames.forEach((frame, i) => (frame.half = i < list.frames.length / 2 ? 'seen' : 'unseen'));
}
const chosen = words.length ? list.frames.filter(({ id }) => words.includes(id)) : list.frames;
const { server, address } = await serve({ demos, loaded: LOADED });
let differ = 0;
for (const frame of chosen) {
    try {
        for (const repository of [frame.repository, ...(frame.packages ?? [])]) {
            await checkOut(repository, list.repositories[repository]);
        }
        const found = await captured(frame);
        const changed = Object.keys(found).filter((key) => JSON.stringify(found[key]) !== JSON.stringify(frame[key]));
        const moved = changed.filter((key) => key !== 'picture');
        if (moved.length) differ++;
        const whole = changed.length ? 'as listed, with another picture' : 'as listed';
        console.log(`${frame.id}: ${moved.length ? `differs: ${moved.join(', ')}` : whole}`);
        if (freezes) Object.assign(frame, found);
    } catch (error) {
        differ++;
        console.log(`${frame.id}: not captured: ${error.stderr || error.message}`);
    }
}
server.close();
if (freezes) await writeFile(LIST, `${JSON.stringify(list, null, 4)}\n`);
else process.exitCode = differ ? 1 : 0;

/** A repository's checkout is at its pinned commit. */
async function checkOut(repository, { commit }) {
    const folder = join(demos, repository.split('/')[1]);
    const git = (...args) => run('git', ['-C', folder, ...args]);
    await mkdir(folder, { recursive: true });
    if (!existsSync(join(folder, '.git'))) await git('init', '--quiet');
    const { stdout } = await git('rev-parse', '--verify', '--quiet', 'HEAD').catch(() => ({ stdout: '' }));
    if (stdout.trim() === commit) return;
    await git('fetch', '--quiet', '--depth', '1', `https://github.com/${repository}`, commit);
    await git('checkout', '--quiet', 'FETCH_HEAD');
}

async function captured({ id, repository, page, half }) {
    const folder = join(out, half ?? '', id);
    if (again && existsSync(folder)) return described(folder);
    await rm(folder, { recursive: true, force: true });
    const ready = ['--wait-for', 'js:globalThis.ready', '--after', '0', '--patience', '120'];
    const options = ['--frames', '1', '--size', '1280x720', ...ready];
    // What a page has from other places does not come, so that it is the same everywhere.
    const alone = '--flag=--host-resolver-rules=MAP * ~NOTFOUND , EXCLUDE 127.0.0.1';
    const url = `${address}/demos/${repository.split('/')[1]}/${page}`;
    await run(join(programs, 'preshade'), ['capture', url, ...options, alone, '-o', folder], { timeout: 10 * MINUTES });
    return described(folder);
}

/** What a frame holds, for the list. */
async function described(folder) {
    const file = ['frame.json', 'frame.json.gz'].map((name) => join(folder, name)).find(existsSync);
    const bytes = await readFile(file);
    const json = JSON.parse(bytes[0] === 0x1f ? gunzipSync(bytes) : bytes);
    const totals = count(json);
    const stage = (stage) => stage && { ...stage, module: json.shaders[stage.module].data };
    const pipeline = ({ label, layout, ...rest }) => ({
        ...rest,
        vertex: stage(rest.vertex),
        fragment: stage(rest.fragment),
    });
    const pipelines = json.renderPipelines.map((each) => hash(pipeline(each)));
    const passes = json.frames[0].commands.filter(({ do: what }) => what.endsWith('Pass'));
    return {
        api: { webgpu: 'WebGPU', webgl2: 'WebGL 2', webgl1: 'WebGL 1' }[json.source.api],
        draws: totals.draws,
        passes: totals.passes,
        refused: json.refused.map(({ what, why, count }) => `${what} (${count}): ${why}`),
        shaders: hash(json.shaders.map(({ data }) => data).sort()),
        commands: hash(passes.map((pass) => drawn(pass, pipelines))),
        picture: json.frames[0].picture.data,
    };
}

/** The draws of a pass with their pipelines, in no order: engines sort what is equally far as it was loaded. */
function drawn({ do: pass, commands }, pipelines) {
    const draws = [];
    let pipeline;
    for (const { do: what, buffer, ...rest } of commands) {
        if (what === 'setPipeline') pipeline = pass === 'renderPass' ? pipelines[rest.pipeline] : 'compute';
        else if (/^(draw|dispatch)/.test(what)) draws.push(hash([pipeline, what, rest]));
    }
    return [pass, draws.sort()];
}
