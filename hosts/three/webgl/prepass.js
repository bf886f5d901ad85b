// A depth pre-pass of a scene: in each frame of the page, the depth of the opaque objects first, then three.js' own frame, in which only the nearest fragment is shaded.

import { COMPARE } from './derived.js';
import { Frames, hasCallback, sizeOf } from './frames.js';
import { Kept } from './kept.js';
import { Choice, Load } from './measure.js';
import { Overdraw } from './overdraw.js';
import { Planned, stateFor, unfit } from './planned.js';
import { Timer } from './timer.js';

const DEPTH_FORMAT = { 1012: 'depth16unorm', 1015: 'depth32float' };
/** Frames between two counts of fragments, and those after which an unused plan is released. */
const COUNT_EVERY = 90;
const FORGET_AFTER = 900;
/** So many objects of a material are drawn in its self-test. */
const TESTED = 16;
/** Another size than by this factor is another picture. */
const OTHER_SIZE = 1.3;

/** What is measured of one camera and one kind of target: another has other fragments. */
class View {
    size = 0;
    counted = -Infinity;
    perPixel = null;
    wasMeasuring = false;

    constructor(options) {
        this.choice = new Choice(options);
        this.load = new Load(options);
    }
}

export class Prepass {
    #host;
    #scene;
    #options;
    #frames;
    /** Plans by material and by name of text and state. */
    #plans = new Map();
    /** Of each object and material: the programs by kind of target, when they were last seen, and the plan of the current frame. */
    #records = new WeakMap();
    #views = new Map();
    #blocked = null;
    #timer = null;
    #kept = null;
    #overdraw;
    #began = 0;
    #last = 0;
    #number = 0;

    /** Switches the pre-pass off and on; three.js draws as always while it is off. */
    enabled = true;
    /** Draws all pre-passes, whatever was measured: to look at what was found. */
    forced = false;

    /**
     * `measure`: true, or `{ frames, each, factor }` of measure.js and `{ method }` of timer.js; without it each material has its pre-pass. `materials`: a list, or `(material) => boolean`; by default all.
     * `form`: `equal` or `biased`. `keep`: whether to keep what was measured in localStorage.
     */
    constructor(host, scene, { measure = false, materials = null, form = 'equal', keep = true, edit } = {}) {
        if (form !== 'equal' && form !== 'biased')
            throw new TypeError(`preshade: \`form\` is "equal" or "biased", not "${form}"`);
        this.#host = host;
        this.#scene = scene;
        const isMeant = Array.isArray(materials) ? (material) => materials.includes(material) : materials;
        this.#options = { measure: measure === true ? {} : measure, isMeant: isMeant ?? (() => true), form, edit };
        this.#overdraw = new Overdraw(host);
        if (measure) {
            this.#timer = new Timer(host.renderer, this.#options.measure.method);
            this.#kept = keep ? new Kept(host.renderer) : null;
        }
        this.#frames = new Frames(host, scene, {
            before: this.#before,
            begin: this.#begin,
            draw: this.#draw,
            drawn: this.#drawn,
            end: this.#end,
        });
        host.renderer.domElement.addEventListener?.('webglcontextrestored', this.#restored);
        globalThis.document?.addEventListener('visibilitychange', this.#interrupted);
    }

    dispose() {
        this.#frames.dispose();
        this.#timer?.dispose();
        this.#overdraw.dispose();
        for (const author of [...this.#plans.keys()]) this.#forget(author);
        this.#host.renderer.domElement.removeEventListener?.('webglcontextrestored', this.#restored);
        globalThis.document?.removeEventListener('visibilitychange', this.#interrupted);
    }

    /** Whether nothing is compiled, tested or measured. */
    get isSettled() {
        const isOpen = (planned) => ['pending', 'compiling', 'testing'].includes(planned.state);
        if ([...this.#all()].some((planned) => isOpen(planned) && planned.verdicts.at(-1) !== 'unseen')) return false;
        return ![...this.#views.values()].some(({ choice }) => choice.isMeasuring);
    }

    // ---- a frame --------------------------------------------------------------------------------------------------------------------------------------------------------------

    #before = (scene, camera) => {
        this.#began = performance.now();
        // Compiling takes the page's thread some milliseconds: one in a frame.
        for (const planned of this.#all()) if (planned.item && planned.prepare(planned.item, scene, camera)) break;
    };

    #begin = (frame) => {
        this.#number = frame.number;
        this.#blocked = blocked(frame.list.opaque);
        if (frame.number % 300 === 0) this.#release();
        if (!this.enabled || this.#blocked) return;
        const items = this.#collect(frame);
        const busy = this.#warm(items, frame);
        const on = this.#chosen(items, frame, busy);
        for (const { item, record, planned, seen } of items) {
            if (!planned.isReady || (on && !this.forced && !on.has(planned.key))) continue;
            // Its program may be another by now: then it is drawn by three.js until that is known, and so is whatever was last seen before.
            if (seen < planned.doubted) continue;
            if (!planned.drawDepth(item, this.#scene, frame.camera)) {
                planned.doubted = frame.number;
                continue;
            }
            record.frame = frame.number;
            record.planned = planned;
        }
    };

    #draw = (draw, frame) => {
        const record = this.#records.get(draw.object)?.get(draw.material);
        if (record?.frame === frame.number && record.planned.main) draw.material = record.planned.main;
    };

    /** The program that three.js drew the author's material with. */
    #drawn = ({ object, material }, frame) => {
        const own = object.material;
        if (own !== material && !(Array.isArray(own) && own.includes(material))) return;
        const source = this.#host.programs.of(object, material);
        if (!source) return;
        const record = this.#record(object, material);
        record.sources.set(frame.kind, { source, seen: frame.number });
    };

    #end = () => {
        this.#timer?.end();
    };

    #record(object, material) {
        let records = this.#records.get(object);
        if (!records) this.#records.set(object, (records = new Map()));
        let record = records.get(material);
        if (!record) records.set(material, (record = { sources: new Map(), frame: -1, planned: null }));
        return record;
    }

    /** What of the frame's opaque objects has a plan, in three.js' order. */
    #collect(frame) {
        const items = [];
        for (const item of frame.list.opaque) {
            const { object, material } = item;
            if (this.#unfit(item)) continue;
            const record = this.#record(object, material);
            const { source, seen } = record.sources.get(frame.kind) ?? {};
            if (!source?.key) continue;
            const planned = this.#plan(material, source, frame);
            planned.used = frame.number;
            if (!planned.isReady || planned.item === null) planned.item = { ...item };
            items.push({ item, record, planned, seen });
        }
        return items;
    }

    #unfit(item) {
        if (!item.object.isMesh) return 'not a mesh';
        if (!this.#options.isMeant(item.material)) return 'not asked for';
        if (hasCallback(item)) return 'has an onBeforeRender';
        return unfit(item.material);
    }

    #plan(material, source, { kind, target }) {
        let plans = this.#plans.get(material);
        if (!plans) {
            this.#plans.set(material, (plans = new Map()));
            material.addEventListener('dispose', this.#disposed);
        }
        const state = stateFor(material, DEPTH_FORMAT[target?.depthTexture?.type] ?? 'depth24plus');
        const key = `${source.key} ${state.primitive.cull} ${state.depth_compare} ${state.depth_format} ${kind}`;
        let planned = plans.get(key);
        if (!planned) {
            planned = new Planned(this.#host, material, source, state, this.#options);
            planned.key = `${key} ${material.uuid}`;
            planned.name = `${key} ${this.#options.form}`;
            plans.set(key, planned);
        }
        return planned;
    }

    /** Goes on with the self-test of one plan. Returns whether it drew. */
    #warm(items, frame) {
        const planned = items.find(({ planned }) => planned.state === 'testing')?.planned;
        if (!planned) return false;
        const own = items.filter((each) => each.planned === planned).map(({ item }) => item);
        return this.#host.timed('test', () => planned.warm(own.slice(0, TESTED), this.#scene, frame));
    }

    // ---- what is measured -------------------------------------------------------------------------------------------------------------------------------------------------

    /** The keys of the plans to draw by in this frame; null for all. */
    #chosen(items, frame, busy) {
        if (!this.#options.measure) return null;
        this.#timer.poll();
        const view = this.#view(frame);
        const { choice, load } = view;
        for (const { planned } of items) {
            if (!planned.isReady || choice.has(planned.key)) continue;
            const kept = this.#kept?.get(`${planned.name} ${this.#class(view)}`) ?? null;
            choice.add(planned.key, kept);
            if (kept && load.settled === null) load.settle(kept.perPixel);
        }
        if (this.#began - this.#last > 1000) choice.interrupt();
        this.#last = this.#began;
        const isMeasuring = choice.isMeasuring;
        const { on, ticket } = choice.frame();
        if (view.wasMeasuring && !choice.isMeasuring) this.#settle(view, items);
        view.wasMeasuring = isMeasuring;
        const counts = !isMeasuring && !busy && frame.number - view.counted > COUNT_EVERY;
        if (counts) this.#count(view, items, frame);
        if (ticket) {
            // What else was drawn is not to be measured.
            if (busy) choice.time(ticket, null);
            else this.#timer.begin((milliseconds) => choice.time(ticket, milliseconds), this.#began);
        }
        return on;
    }

    #view(frame) {
        const key = `${frame.kind} ${frame.camera.uuid}`;
        let view = this.#views.get(key);
        if (!view) this.#views.set(key, (view = new View(this.#options.measure)));
        const { width, height } = sizeOf(this.#host.renderer, frame.target);
        const size = width * height;
        if (view.size !== size) {
            view.choice.interrupt();
            const factor = Math.max(size, view.size) / Math.min(size, view.size);
            if (view.size !== 0 && factor > OTHER_SIZE) this.#again(view);
            view.size = size;
        }
        return view;
    }

    /** Pictures whose size is so alike that what was kept of one counts for the other. */
    #class({ size }) {
        return Math.round(Math.log(size) / Math.log(OTHER_SIZE ** 2));
    }

    #again(view) {
        view.choice.again();
        view.load.settle();
        view.counted = -Infinity;
    }

    #settle(view, items) {
        view.load.settle();
        view.counted = -Infinity;
        view.unkept = new Set(items.map(({ planned }) => planned).filter((planned) => view.choice.has(planned.key)));
    }

    #count(view, items, { number, camera }) {
        view.counted = number;
        const draws = items.filter(({ planned }) => planned.isReady);
        if (draws.length === 0) return;
        this.#host
            .timed('count', () => this.#overdraw.count(draws, this.#scene, camera))
            .then((perPixel) => {
                if (perPixel === null || view.choice.isMeasuring) return;
                view.perPixel = perPixel;
                if (view.load.see(perPixel)) this.#again(view);
                for (const planned of view.unkept ?? []) {
                    const found = view.choice.found(planned.key);
                    if (found) this.#kept?.set(`${planned.name} ${this.#class(view)}`, { ...found, perPixel });
                }
                view.unkept = null;
            });
    }

    // ---- what happens to the page -----------------------------------------------------------------------------------------------------------------------------------------

    #interrupted = () => {
        for (const { choice } of this.#views.values()) choice.interrupt();
    };

    #restored = () => {
        this.#timer?.restart();
        for (const planned of this.#all()) planned.restart();
        this.#interrupted();
    };

    #disposed = ({ target }) => this.#forget(target);

    *#all() {
        for (const plans of this.#plans.values()) yield* plans.values();
    }

    #forget(author) {
        for (const planned of this.#plans.get(author)?.values() ?? []) this.#drop(planned);
        this.#plans.delete(author);
        author.removeEventListener('dispose', this.#disposed);
    }

    #drop(planned) {
        planned.dispose();
        for (const { choice } of this.#views.values()) choice.remove(planned.key);
    }

    #release() {
        for (const plans of this.#plans.values()) {
            for (const [key, planned] of plans) {
                if (this.#number - planned.used < FORGET_AFTER) continue;
                this.#drop(planned);
                plans.delete(key);
            }
        }
    }

    // ---- report -------------------------------------------------------------------------------------------------------------------------------------------------------------

    report() {
        const rows = [];
        const seen = new Set();
        this.#scene.traverse((object) => {
            for (const material of [object.material ?? []].flat()) {
                if (seen.has(material) || !material.isMaterial) continue;
                seen.add(material);
                rows.push(...this.#rows(object, material));
            }
        });
        return rows;
    }

    #rows(object, material) {
        const row = {
            pass: 'prepass',
            material: material.name || material.type,
            uuid: material.uuid,
            remedy: null,
            code: null,
            ms: 0,
        };
        const reason = this.#unfit({ object, material }) ?? this.#blocked;
        if (reason) return [{ ...row, state: 'refused', reason, code: 'three' }];
        const plans = [...(this.#plans.get(material)?.values() ?? [])];
        if (plans.length === 0) return [{ ...row, state: 'waiting', reason: 'not drawn yet' }];
        const words = {
            pending: 'pending',
            compiling: 'pending',
            testing: 'pending',
            original: 'refused',
            ready: 'done',
        };
        return plans.map((planned) => ({
            ...row,
            state: words[planned.state] ?? planned.state,
            reason: planned.reason ?? (planned.state === 'original' ? planned.verdicts.at(-1) : null),
            remedy: planned.remedy ?? null,
            code: planned.code ?? (planned.state === 'original' ? 'self-test' : null),
            ms: planned.ms,
            form: planned.form,
            selfTest: planned.verdicts.join(', ') || null,
            ...this.#measured(planned),
        }));
    }

    /** Of the view in which it was last measured. */
    #measured(planned) {
        if (!this.#options.measure) return { on: planned.isReady };
        const views = [...this.#views.values()].filter(({ choice }) => choice.has(planned.key));
        if (views.length === 0) return { on: false, measured: null };
        const { choice, perPixel } = views.at(-1);
        return {
            on: choice.found(planned.key)?.on ?? false,
            measured: choice.found(planned.key),
            perPixel,
            method: this.#timer.method,
        };
    }
}

/** What else is drawn must not tell that depth is laid ahead of it; the reason where it would. */
function blocked(items) {
    const { equal, greater, 'not-equal': unequal, 'greater-equal': least } = COMPARE;
    for (const { material } of items) {
        if (material.stencilWrite) return 'an opaque material of the scene uses the stencil';
        if (material.depthTest && [equal, greater, unequal, least].includes(material.depthFunc))
            return 'an opaque material of the scene is drawn behind others, by its depth function';
    }
    return null;
}
