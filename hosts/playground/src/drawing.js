// Draws the original and a variant on the visitor's GPU, and compares and times them.

import { compare, isBlank, verdict } from './draw/compare.js';
import { inputs } from './draw/inputs.js';
import { authored, drawing, isSame } from './draw/plan.js';
import { members } from './draw/reflect.js';
import { time } from './draw/timing.js';
import * as webgl from './draw/webgl.js';
import * as webgpu from './draw/webgpu.js';

const OPEN = { webgpu: webgpu.open, webgl: webgl.open };
const renderers = new Map();

/** Which of the two the browser has: `{ webgpu, webgl }`. */
export async function available() {
    const has = async (api) => Boolean(await renderer(api).catch(() => null));
    return { webgpu: await has('webgpu'), webgl: await has('webgl') };
}

/** A renderer, opened once; anew if its device was lost. */
export async function renderer(api) {
    if (renderers.get(api)?.lost) renderers.delete(api);
    if (!renderers.get(api)) renderers.set(api, await OPEN[api]());
    return renderers.get(api);
}

/** Why something is not drawn: sentences for the visitor. */
export class NotDrawn extends Error {
    constructor(reasons) {
        super(reasons.join(' '));
        this.reasons = reasons;
    }
}

/** Both drawings with their inputs, or `NotDrawn`. */
async function planned(original, variant, { api, size, order, isReversed }) {
    const by = await renderer(api).catch((error) => {
        throw new NotDrawn([`The browser does not open ${api === 'webgl' ? 'WebGL 2' : 'WebGPU'}: ${error.message}`]);
    });
    if (!by) throw new NotDrawn([`This browser has no ${api === 'webgl' ? 'WebGL 2' : 'WebGPU'}.`]);
    const [first, second] = [original, variant].map(({ plan, files }) => drawing(plan, files, by.language));
    const reasons = [];
    for (const why of first.why) reasons.push(`The original cannot be drawn here: ${why}`);
    for (const why of second.why)
        if (!first.why.includes(why)) reasons.push(`The variant cannot be drawn here: ${why}`);
    const failed = api === 'webgl' ? [...original.errors, ...variant.errors] : [];
    for (const { message } of failed) reasons.push(message);
    if (reasons.length) throw new NotDrawn([...new Set(reasons)]);
    if (isSame(first, second))
        throw new NotDrawn([
            'The variant draws the same picture by the same passes, so there are no two pictures to compare.',
            ...second.notes,
        ]);
    const bindings = authored([first, second]);
    const found = bindings.bindings.some(({ kind }) => kind === 'uniform') ? await uniformsOf(original) : new Map();
    const made = inputs(bindings, { members: found, guard: second.guard, size, order, isReversed });
    if (made.why.length) throw new NotDrawn(made.why.map((why) => `It cannot be drawn here: ${why}`));
    return { by, first, second, made };
}

/** Members of the original's uniforms, which WebGL 2 names. */
async function uniformsOf(original) {
    const gl = await renderer('webgl').catch(() => null);
    const cannot = (why) => new NotDrawn([`The page cannot fill the uniforms: ${why}`]);
    if (!gl) throw cannot('it asks WebGL 2 for the names of their members, and this browser has none.');
    const es = drawing(original.plan, original.files, 'glsl-es');
    if (es.passes.some(({ vertex }) => !vertex?.text))
        throw cannot('it asks WebGL 2 for the names of their members, and GLSL ES cannot express this material.');
    try {
        return members(gl.gl, es);
    } catch (error) {
        throw cannot(error.message);
    }
}

/** Prepares both. The caller releases. */
async function prepared(original, variant, options) {
    const { by, first, second, made } = await planned(original, variant, options);
    const frames = [];
    try {
        for (const [what, drawing] of [
            ['original', first],
            ['variant', second],
        ]) {
            try {
                frames.push(await by.prepare(drawing, made, options.size));
            } catch (error) {
                throw new NotDrawn([`The ${what} cannot be drawn: ${error.message}`]);
            }
        }
    } catch (error) {
        frames.forEach((frame) => by.release(frame));
        throw error;
    }
    return { by, frames, made, notes: second.notes };
}

/** The difference as the eye sees it, computed in a worker. */
function seen(first, second, size) {
    const worker = new Worker(new URL('./draw/flip-worker.js', import.meta.url), { type: 'module', name: 'flip' });
    const answer = new Promise((resolve, reject) => {
        worker.onmessage = ({ data }) => resolve({ flip_mean: data.mean, flip_p99: data.p99, flip_tile: data.tile });
        worker.onerror = (event) => reject(new Error(event.message || 'the worker cannot be loaded'));
    });
    worker.postMessage({ first: first.colors[0], second: second.colors[0], size });
    return answer.finally(() => worker.terminate());
}

/** Draws both once and compares them. The original is drawn twice: a picture that changes by itself proves nothing. */
export async function draw(original, variant, options) {
    const { by, frames, made, notes } = await prepared(original, variant, options);
    try {
        const first = await by.picture(frames[0]);
        const again = await by.picture(frames[0]);
        const second = await by.picture(frames[1]);
        const base = compare(first, again);
        const error = compare(first, second);
        if (error.changed_pixels) Object.assign(error, await seen(first, second, options.size));
        let judged = verdict(variant.contract, error);
        if (isBlank(first))
            judged = {
                kind: 'not-measured',
                why: 'the original\u2019s picture has one colour, so it shows nothing of the material',
            };
        else if (base.changed_pixels || base.changed_depth)
            judged = { kind: 'not-measured', why: 'the original does not repeat itself on this adapter' };
        const { size, order } = options;
        return {
            renderer: by,
            size,
            order,
            base,
            error,
            verdict: judged,
            first,
            second,
            told: made.told,
            mesh: made.mesh.kind,
            notes,
        };
    } finally {
        frames.forEach((frame) => by.release(frame));
    }
}

/** Times both. */
export async function measure(original, variant, options, { seconds, progress, signal }) {
    const { by, frames } = await prepared(original, variant, options);
    try {
        return await time(by, frames[0], frames[1], { seconds, progress, signal });
    } finally {
        frames.forEach((frame) => by.release(frame));
    }
}
