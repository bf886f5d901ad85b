// A depth pre-pass within three.js' own render pass: the draws of the opaque list that have one are encoded twice, first
// all that lays depth, then all that shades. Bindings, vertex buffers and callbacks are those of the one draw that
// three.js prepared, so the pre-pass costs the encoder calls and what the device does.

import { EqualDepth, LessDepth, LessEqualDepth, NeverDepth } from 'three/webgpu';
import { Choice, Load } from '../measure.js';
import { planRow } from '../rows.js';
import { stages } from './pipelines.js';
import { Pending, authorOf, made, stateOf, unfitForPrepass } from './programs.js';
import { selfTest } from './selftest.js';

const EQUAL = { name: 'depth-prepass:form=equal', form: 'equal' };
const BIASED = { name: 'depth-prepass:form=biased', form: 'biased' };
const FORMS = { equal: EQUAL, biased: BIASED };
/** Frames until the next self-test of a material of which nothing was in view; each time twice as many. */
const UNSEEN = 4;
/** Frames between two looks at how much is drawn. WebGPU's occlusion queries do not count, so it is the draws. */
const LOOK = 60;
/** Lists of a scene without the view that is measured, after which another view is. */
const STRANGERS = 120;

/** What is known of one pipeline of three.js: the same text, state and layout. */
class Entry {
    state = 'asked';
    reason = null;
    remedy = null;
    code = null;
    ms = 0;
    skipped = [];
    verdicts = [];
    failures = [];
    /** Frames in which it was drawn and not tested, and how many that may be. */
    rested = 0;
    rest = UNSEEN;
    prepass = null;
    main = null;
    plan = null;
    runs = [];

    /** `recipe`: one of `FORMS`. */
    constructor(material, recipe) {
        this.material = material;
        this.recipe = recipe;
    }

    /** Whether it is being made or tested. */
    get isOpen() {
        return ['asked', 'compiling', 'compiled', 'testing'].includes(this.state);
    }

    end(state, reason, code = null, remedy = null) {
        Object.assign(this, { state, reason, code, remedy, prepass: null, main: null, runs: [] });
    }
}

/** Which entries are drawn with their pre-pass in the frames of one scene, where that is measured. */
class View {
    #timer;
    #method;
    #choice;
    #context = null;
    #camera = null;
    #size = '';
    #load;
    #looked = 0;
    #strangers = 0;

    constructor(timer, { factor, method = null, ...options }) {
        if (![null, 'timer-query', 'fence'].includes(method))
            throw new TypeError(`preshade: method is "timer-query" or "fence", not "${method}"`);
        this.#timer = timer;
        this.#method = method;
        this.#choice = new Choice(options);
        this.#load = new Load({ factor });
    }

    get isMeasuring() {
        return this.#choice.isMeasuring;
    }

    get isTiming() {
        return this.#choice.isTiming;
    }

    add(entry) {
        this.#choice.add(entry);
    }

    remove(entry) {
        this.#choice.remove(entry);
    }

    /** What was measured of an entry: `null` while it is. */
    found(entry) {
        return this.#choice.found(entry);
    }

    /** Whether an entry is on in this list. One view is measured; the others have what is known by then. */
    on({ context, camera, draws }) {
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
        this.#timer.watch(this.#choice.isTiming ? context : null, this.#method);
        return (entry) => on.has(entry);
    }
}

/** The pre-passes of one scene. */
export class Prepass {
    #host;
    #form;
    #isMeant;
    /** `null`: nothing is measured. */
    #view = null;
    /** By three.js' pipeline. */
    #entries = new Map();
    #pending = new Pending();
    #sweep = () => queueMicrotask(() => this.#forget());

    /** Switches it off and on. */
    enabled = true;
    /** Draws all that are ready, whatever was measured. */
    forced = false;

    /**
     * `measure`: whether to draw pre-passes only if frames with them are faster; an object has the options of `Choice`
     * and `Load`, and `method`, see `Timer`. `materials`: those that it is for, as a list or a function. `form`: the first
     * that is tried.
     */
    constructor(host, { measure = false, materials = () => true, form = 'equal', remember = false } = {}) {
        if (remember) throw new TypeError('preshade: with a WebGPURenderer nothing that was measured is remembered');
        if (!Object.hasOwn(FORMS, form)) throw new TypeError(`preshade: form is "equal" or "biased", not "${form}"`);
        this.#host = host;
        this.#form = FORMS[form];
        this.#isMeant = Array.isArray(materials) ? (material) => materials.includes(material) : materials;
        if (measure) this.#view = new View(host.timer, measure === true ? {} : measure);
    }

    /** Whether nothing is made, tested or measured. */
    get isSettled() {
        return ![...this.#entries.values()].some(({ isOpen }) => isOpen) && !this.#view?.isMeasuring;
    }

    wants({ items, scene, context, camera }) {
        if (!this.enabled || scene.overrideMaterial !== null || camera.isArrayCamera) return false;
        return context.depth && items.some(({ material }) => !material.transparent);
    }

    /** Encodes an opaque list; answers false where no draw of it has a pre-pass. */
    draw(list) {
        const { draws, context } = list;
        const measured = this.#view?.on(list);
        const on = (entry) => !measured || this.forced || measured(entry);
        // Who moves depth away from the viewer shows what a pre-pass has hidden.
        const isOrdinary = draws.every(({ renderObject: { material } }) => ordinary(material));
        const laid = new Map();
        for (const draw of draws) {
            if (!this.#isMeant(authorOf(draw.renderObject))) continue;
            const entry = this.#entry(draw);
            if (entry.state === 'unseen' && ++entry.rested > entry.rest) entry.state = 'compiled';
            if (entry.state === 'compiled') this.#wait(entry, this.#test(entry, draw));
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
            entry = new Entry(author, this.#form);
            this.#forget();
            this.#entries.set(draw.pipeline, entry);
            author.addEventListener('dispose', this.#sweep);
            const unfit = unfitForPrepass(draw.renderObject);
            if (unfit) entry.end('refused', unfit, 'material');
        }
        if (entry.state === 'asked') this.#wait(entry, this.#make(entry, draw));
        return entry;
    }

    /** Drops what belongs to pipelines that three.js has released. */
    #forget() {
        const { caches } = this.#host.renderer._pipelines;
        const gone = new Set();
        for (const [pipeline, entry] of this.#entries) {
            if (caches.get(pipeline.cacheKey) === pipeline) continue;
            this.#entries.delete(pipeline);
            this.#view?.remove(entry);
            gone.add(entry.material);
        }
        for (const { material } of this.#entries.values()) gone.delete(material);
        for (const material of gone) material.removeEventListener('dispose', this.#sweep);
    }

    async #make(entry, draw) {
        const { programs, backend } = this.#host;
        const { renderObject, pipeline } = draw;
        entry.state = 'compiling';
        const request = { pass: entry.recipe.name, ...stateOf(renderObject, backend) };
        const found = await made(this.#host, renderObject, programs.of(pipeline), request);
        if (!found || renderObject.pipeline !== pipeline) return Object.assign(entry, { state: 'asked' });
        entry.ms += found.ms;
        if (found.state === 'ready') return this.#compile(entry, draw, found.variant);
        if (entry.recipe !== EQUAL) return entry.end(found.state, found.reason, found.code, found.remedy);
        entry.recipe = BIASED;
        return this.#make(entry, draw);
    }

    /**
     * Makes the pipelines of a variant, and those that its self-test draws with. The main pass of both forms is the
     * author's program, so it is drawn with the modules of three.js, and so is the vertex stage of the form EQUAL: what
     * is the same module is most likely to compute the same positions.
     */
    async #compile(entry, draw, variant) {
        const { pipelines } = this.#host;
        const isEqual = entry.recipe === EQUAL;
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
        const all = [make('prepass'), isEqual ? make('main') : draw.pipeline, ...runs];
        const [prepass, main, ...made] = await Promise.all(all);
        const others = made.flatMap(({ draws }) => draws.map(({ pipeline }) => pipeline));
        if ([prepass, main, ...others].includes(null))
            return entry.end('failed', 'the device refuses a pipeline', 'driver');
        Object.assign(entry, { prepass, main, runs: made, state: 'compiled' });
        if (made.length === 0) this.#ready(entry);
    }

    /** Asks the device whether it keeps what the plan rests on, with this draw. */
    async #test(entry, draw) {
        entry.state = 'testing';
        const { verdict, failure } = await selfTest(this.#host, draw, entry.plan.self_test, entry.runs);
        const { name, form } = entry.recipe;
        if (entry.verdicts.at(-1) === 'unseen') entry.verdicts.pop();
        entry.verdicts.push(verdict === 'broken' ? `broken (${form}): ${failure}` : verdict);
        if (verdict === 'kept') this.#ready(entry);
        if (verdict === 'unseen') Object.assign(entry, { state: 'unseen', rested: 0, rest: 2 * entry.rest });
        if (verdict !== 'broken') return;
        entry.failures.push({ recipe: name, failure });
        if (entry.recipe === EQUAL) Object.assign(entry, { recipe: BIASED, state: 'asked' });
        else entry.end('original', null);
    }

    #ready(entry) {
        Object.assign(entry, { state: 'ready', runs: [] });
        this.#view?.add(entry);
    }

    #wait(entry, promise) {
        this.#pending.add(promise, (message) => entry.end('failed', message, 'failed'));
    }

    settled() {
        return this.#pending.settled();
    }

    /** A row for each program of each material. */
    report() {
        this.#forget();
        return [...this.#entries.values()].map((entry) => {
            return planRow('prepass', entry.material, entry, { measured: this.#view?.found(entry) });
        });
    }

    dispose() {
        for (const { material } of this.#entries.values()) material.removeEventListener('dispose', this.#sweep);
        this.#entries.clear();
        if (this.#view?.isTiming) this.#host.timer.watch(null);
        this.#host.forget(this);
    }
}

/** Whether a draw leaves depth where it was or nearer. */
function ordinary({ depthTest, depthWrite, depthFunc }) {
    if (!depthWrite) return true;
    return depthTest && [LessDepth, LessEqualDepth, EqualDepth, NeverDepth].includes(depthFunc);
}
