// A depth pre-pass within three.js' own render pass: the draws of the opaque list that have one are encoded twice, first
// all that lays depth, then all that shades. Bindings, vertex buffers and callbacks are those of the one draw that
// three.js prepared, so the pre-pass costs the encoder calls and what the device does.

import { EqualDepth, LessDepth, LessEqualDepth, NeverDepth } from 'three/webgpu';
import { Choice, Load } from '../webgl/measure.js';
import { stages } from './pipelines.js';
import { authorOf, stateOf, unfitForPrepass } from './programs.js';
import { row } from './rows.js';
import { selfTest } from './selftest.js';
import { Timer } from './timer.js';

const EQUAL = 'depth-prepass:form=equal';
const BIASED = 'depth-prepass';
/** Frames until the next self-test of a material of which nothing was in view; each time twice as many. */
const UNSEEN = 4;
/** Frames between two looks at how much is drawn. WebGPU's occlusion queries do not count, so it is the draws. */
const LOOK = 60;
/** Lists of a scene without the view that is measured, after which another view is. */
const STRANGERS = 120;

/** What is known of one pipeline of three.js: the same text, state and layout. */
class Entry {
    state = 'asked';
    form = EQUAL;
    reason = null;
    remedy = null;
    code = null;
    ms = 0;
    verdict = null;
    failure = null;
    /** Frames in which it was drawn and not tested, and how many that may be. */
    rested = 0;
    rest = UNSEEN;
    prepass = null;
    main = null;
    plan = null;
    runs = [];

    constructor(material) {
        this.material = material;
    }

    end(state, reason, code = null, remedy = null) {
        Object.assign(this, { state, reason, code, remedy, prepass: null, main: null, runs: [] });
    }
}

/** Which entries are drawn with their pre-pass in the frames of one scene. */
class View {
    #timer;
    #choice;
    #context = null;
    #camera = null;
    #size = '';
    #load = new Load();
    #looked = 0;
    #strangers = 0;

    enabled = true;
    #isMeant;

    constructor(timer, { measure = false, materials = () => true } = {}) {
        this.#timer = timer;
        this.#choice = measure ? new Choice(measure === true ? {} : measure) : null;
        this.#isMeant = Array.isArray(materials) ? (material) => materials.includes(material) : materials;
    }

    /** Whether a material is to have a pre-pass at all. */
    isMeant(material) {
        return this.#isMeant(material);
    }

    add(entry) {
        this.#choice?.add(entry);
    }

    remove(entry) {
        this.#choice?.remove(entry);
    }

    /** What was measured of an entry: `null` while it is, `undefined` if nothing is measured. */
    found(entry) {
        return this.#choice?.found(entry);
    }

    /** Whether an entry is on in this list. One view is measured; the others have what is known by then. */
    on({ context, camera, draws }) {
        if (this.#choice === null) return () => true;
        if (this.#context === null || ++this.#strangers > STRANGERS) {
            [this.#context, this.#camera, this.#strangers] = [context, camera, 0];
            this.#choice.interrupt();
        }
        if (context !== this.#context || camera !== this.#camera)
            return (entry) => this.#choice.found(entry)?.on ?? false;
        this.#strangers = 0;
        const size = `${context.width}x${context.height}`;
        if (size !== this.#size) this.#choice.interrupt();
        this.#size = size;
        if (this.#choice.isMeasuring) this.#load.settle(draws.length);
        else if (++this.#looked % LOOK === 0 && this.#load.see(draws.length)) this.#choice.again();
        const { on, ticket } = this.#choice.frame();
        if (ticket !== null) this.#timer.take((milliseconds) => this.#choice.time(ticket, milliseconds));
        this.#timer.watch(this.#choice.isMeasuring ? context : null);
        return (entry) => on.has(entry);
    }
}

export class Prepass {
    #host;
    #timer;
    #scenes = new Map();
    /** By three.js' pipeline. */
    #entries = new Map();
    #pending = new Set();
    #sweep = () => queueMicrotask(() => this.#forget());

    constructor(host, timer = new Timer(host.backend)) {
        this.#host = host;
        this.#timer = timer;
    }

    /**
     * `measure`: whether to draw pre-passes only if frames with them are faster; an object has the options of `Choice`.
     * `materials`: those that it is for, as a list or a function.
     */
    use(scene, options) {
        const view = new View(this.#timer, options);
        for (const entry of this.#entries.values()) if (entry.state === 'ready') view.add(entry);
        this.#scenes.set(scene, view);
        return Object.assign(view, { report: () => this.report(), dispose: () => this.#scenes.delete(scene) });
    }

    wants({ items, scene, context, camera }) {
        if (!this.#scenes.get(scene)?.enabled || scene.overrideMaterial !== null || camera.isArrayCamera) return false;
        return context.depth && items.some(({ material }) => !material.transparent);
    }

    /** Encodes an opaque list; answers false where no draw of it has a pre-pass. */
    draw(list) {
        const { draws, scene, context } = list;
        const view = this.#scenes.get(scene);
        const on = view.on(list);
        // Who moves depth away from the viewer shows what a pre-pass has hidden.
        const isOrdinary = draws.every(({ renderObject: { material } }) => ordinary(material));
        const laid = new Map();
        for (const draw of draws) {
            if (!view.isMeant(authorOf(draw.renderObject))) continue;
            const entry = this.#entry(draw);
            if (entry.state === 'unseen' && ++entry.rested > entry.rest) entry.state = 'compiled';
            if (entry.state === 'compiled') this.#test(entry, draw);
            if (entry.state === 'ready' && isOrdinary && on(entry)) laid.set(draw, entry);
        }
        if (laid.size === 0) return false;
        const { hooks, backend } = this.#host;
        const { currentPass, currentSets } = backend.get(context);
        for (const [draw, { prepass }] of laid) hooks.encodeInto(draw, prepass, currentPass, currentSets);
        for (const draw of draws) hooks.encode(draw, laid.get(draw)?.main ?? draw.pipeline);
        return true;
    }

    #entry(draw) {
        let entry = this.#entries.get(draw.pipeline);
        if (!entry) {
            const author = authorOf(draw.renderObject);
            entry = new Entry(author);
            this.#forget();
            this.#entries.set(draw.pipeline, entry);
            author.addEventListener('dispose', this.#sweep);
            const unfit = unfitForPrepass(draw.renderObject);
            if (unfit) entry.end('unsupported', unfit);
        }
        if (entry.state === 'asked') this.#ask(entry, draw);
        return entry;
    }

    /** Drops what belongs to pipelines that three.js has released. */
    #forget() {
        const { caches } = this.#host.renderer._pipelines;
        for (const [pipeline, entry] of this.#entries) {
            if (caches.get(pipeline.cacheKey) === pipeline) continue;
            this.#entries.delete(pipeline);
            for (const view of this.#scenes.values()) view.remove(entry);
        }
    }

    #ask(entry, draw) {
        const { variants, programs, backend } = this.#host;
        const state = stateOf(draw.renderObject, backend);
        const found = variants.get(programs.of(draw.pipeline), { pass: entry.form, ...state });
        if (found.state === 'pending') return;
        entry.ms += found.ms;
        if (found.state === 'ready') this.#compile(entry, draw, found.variant);
        else if (entry.form === EQUAL) Object.assign(entry, { form: BIASED, failure: found.reason });
        else entry.end(found.state, found.reason, found.code, found.remedy);
    }

    /**
     * Makes the pipelines of a variant, and those that its self-test draws with. The main pass of both forms is the
     * author's program, so it is drawn with the modules of three.js, and so is the vertex stage of the form EQUAL: what
     * is the same module is most likely to compute the same positions.
     */
    #compile(entry, draw, variant) {
        const { pipelines } = this.#host;
        const isEqual = entry.form === EQUAL;
        entry.state = 'compiling';
        entry.plan = variant.plan;
        const make = (role, over = {}) => {
            const { pass } = variant.passes.find((of) => of.pass.role === role);
            const { compare, write, bias } = pass.depth;
            const colorWrite = pass.targets.some((target) => target?.write_mask);
            const { vertex, fragment } = role === 'main' ? {} : stages(variant, role);
            const own = { vertex: isEqual ? null : vertex, fragment };
            return pipelines.make(draw, own, { compare, write, bias, colorWrite, ...over });
        };
        const tested = ({ role, compare, write }) => make(role, { compare, write });
        const runs = (variant.plan.self_test?.runs ?? []).map(async ({ failure, draws }) => {
            const made = await Promise.all(draws.map(tested));
            return { failure, draws: draws.map(({ samples }, i) => ({ samples, pipeline: made[i] })) };
        });
        const all = Promise.all([make('prepass'), isEqual ? make('main') : draw.pipeline, ...runs]);
        this.#wait(entry, all, ([prepass, main, ...made]) => {
            const pipelines = made.flatMap(({ draws }) => draws.map(({ pipeline }) => pipeline));
            if ([prepass, main, ...pipelines].includes(null))
                return entry.end('failed', 'the device refuses a pipeline');
            Object.assign(entry, { prepass, main, runs: made, state: 'compiled' });
            if (made.length === 0) this.#ready(entry);
        });
    }

    /** Asks the device whether it keeps what the plan rests on, with this draw. */
    #test(entry, draw) {
        entry.state = 'testing';
        const test = selfTest(this.#host, draw, entry.plan.self_test, entry.runs);
        this.#wait(entry, test, ({ verdict, failure }) => {
            Object.assign(entry, { verdict, failure: failure ?? entry.failure });
            if (verdict === 'kept') this.#ready(entry);
            else if (verdict === 'unseen') Object.assign(entry, { state: 'unseen', rested: 0, rest: 2 * entry.rest });
            else if (verdict === 'broken' && entry.form === EQUAL)
                Object.assign(entry, { form: BIASED, state: 'asked' });
            else entry.end('refused', failure, 'self-test');
        });
    }

    #ready(entry) {
        Object.assign(entry, { state: 'ready', runs: [] });
        for (const view of this.#scenes.values()) view.add(entry);
    }

    #wait(entry, promise, then) {
        const done = promise
            .then(then)
            .catch((error) => entry.end('failed', error.message))
            .finally(() => this.#pending.delete(done));
        this.#pending.add(done);
    }

    async settled() {
        await Promise.all(this.#pending);
    }

    /** A row for each program of each material. */
    report() {
        this.#forget();
        const views = [...this.#scenes.values()];
        return [...this.#entries.values()].map((entry) => {
            const { state, form, reason, remedy, code, ms, verdict, failure } = entry;
            const measured = views.map((view) => view.found(entry)).find((found) => found !== undefined);
            const told = { state, reason, remedy, code, ms, form, verdict, failure };
            if (state === 'unseen')
                Object.assign(told, { state: 'waiting', reason: 'nothing of it was in view of the self-test yet' });
            if (state === 'ready' && measured === null)
                Object.assign(told, { state: 'waiting', reason: 'it is measured' });
            if (state === 'ready' && measured?.on === false)
                Object.assign(told, { state: 'refused', code: 'no-gain', reason: 'frames with it are not faster' });
            return row('prepass', entry.material, { ...told, measured: measured ?? null });
        });
    }

    dispose() {
        this.#scenes.clear();
        for (const { material } of this.#entries.values()) material.removeEventListener('dispose', this.#sweep);
        this.#entries.clear();
        this.#timer.dispose();
    }
}

/** Whether a draw leaves depth where it was or nearer. */
function ordinary({ depthTest, depthWrite, depthFunc }) {
    if (!depthWrite) return true;
    return depthTest && [LessDepth, LessEqualDepth, EqualDepth, NeverDepth].includes(depthFunc);
}
