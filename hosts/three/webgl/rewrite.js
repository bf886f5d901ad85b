// A scene drawn by plans: in each frame of the page, the depth passes of its opaque objects first, then three.js' own frame, in which the plans' main passes shade them. A depth pre-pass
// is one of the recipes.

import { REVISION } from 'three';
import { Attachments, samplesOf } from './attachments.js';
import { COMPARE } from '../compare.js';
import { materialsOf, planRow, row } from '../rows.js';
import { Frames, hasCallback, within } from './frames.js';
import { Measured } from './measured.js';
import { Planned, stateFor, unfit } from './planned.js';

/** Older ones take a program of a material anew whenever the target has another colour space, in the middle of a frame and of a self-test. */
const isTooOld = parseInt(REVISION, 10) < 187;
const DEPTH_FORMAT = { 1012: 'depth16unorm', 1015: 'depth32float' };
/** Frames after which an unused plan is released, and what was measured of a view that is not drawn. */
const FORGET_AFTER = 900;
/** Frames after which a plan is none of the picture any more: three.js has other programs by now. */
const STALE_AFTER = 12;
const CLEARED = ['cleared', 'the page clears the depth in the middle of a frame'];
/** So many objects of a material are drawn in its self-test. */
const TESTED = 16;

export class Rewrite {
    #host;
    #scene;
    #part;
    #recipes;
    #options;
    #attachments = new Attachments();
    /** Recipes by material: a function is asked once for each. */
    #asked = new WeakMap();
    /** The draw of three.js' that is one of ours at the moment. */
    #drawing = null;
    #frames;
    /** Plans by material and by name of text and state. */
    #plans = new Map();
    /** Of each object and material: the programs by kind of target, when they were last seen, and the plan of the current frame. */
    #records = new WeakMap();
    /** Why none of the scene's depth may be laid ahead: the code and the reason. */
    #blocked = null;
    /** Whether the page cleared depth in the middle of the last frame, and not behind its last draw, as for what lies over the picture. */
    #cleared = false;
    /** Null where every plan is drawn. */
    #measured = null;
    #number = 0;

    /** Switches all of it off and on; three.js draws as always while it is off. */
    enabled = true;
    /** Draws by all plans, whatever was measured: to look at what was found. */
    forced = false;

    /**
     * `part`: its name in reports. `recipes(material)`: those to try, in order, or null. `measure`: true, or `{ frames, each, factor, again }` of ../measure.js and `{ method }` of timer.js; without it
     * each material is drawn by its plan. `materials`: a list, or `(material) => boolean`; by default all. `remember`: whether to remember in localStorage what was measured.
     */
    constructor(
        host,
        scene,
        part,
        recipes,
        { measure = false, materials = null, remember = true, edit, trust = false } = {},
    ) {
        this.#host = host;
        this.#scene = scene;
        this.#part = part;
        const isMeant = Array.isArray(materials) ? (material) => materials.includes(material) : materials;
        this.#recipes = (material) => ((isMeant?.(material) ?? true) ? this.#recipesOf(material, recipes) : null);
        this.#options = { edit, trust };
        if (measure) this.#measured = new Measured(host, scene, measure === true ? {} : measure, remember);
        this.#frames = new Frames(host, scene, {
            before: this.#before,
            begin: this.#begin,
            draw: this.#draw,
            drawn: this.#drawn,
            end: this.#end,
        });
        host.rewrites.add(this);
        host.renderer.domElement.addEventListener?.('webglcontextrestored', this.#restored);
        globalThis.document?.addEventListener('visibilitychange', this.#interrupted);
    }

    dispose() {
        this.#frames.dispose();
        this.#host.rewrites.delete(this);
        this.#measured?.dispose();
        this.#attachments.dispose();
        for (const author of [...this.#plans.keys()]) this.#forget(author);
        this.#host.renderer.domElement.removeEventListener?.('webglcontextrestored', this.#restored);
        globalThis.document?.removeEventListener('visibilitychange', this.#interrupted);
    }

    /** Whether nothing is compiled, tested or measured. */
    get isSettled() {
        const isOpen = (planned) => ['pending', 'compiling', 'testing'].includes(planned.state);
        if ([...this.#live()].some((planned) => isOpen(planned) && planned.verdicts.at(-1) !== 'unseen')) return false;
        return !this.#measured?.isMeasuring;
    }

    // ---- a frame --------------------------------------------------------------------------------------------------------------------------------------------------------------

    #before = (scene, camera) => {
        this.#measured?.begin();
        // Compiling takes the page's thread some milliseconds: one in a frame.
        for (const planned of this.#live()) if (planned.item && planned.prepare(planned.item, scene, camera)) break;
    };

    #begin = (frame) => {
        this.#number = frame.number;
        this.#blocked = this.#cleared ? CLEARED : blocked(frame.list.opaque);
        if (frame.number % 300 === 0) this.#release();
        if (!this.enabled) return;
        const items = this.#collect(frame).filter(({ planned }) => !(this.#blocked && planned.depth));
        const busy = this.#warm(items, frame);
        const on = this.#measured?.chosen(items, frame, busy);
        const apart = new Map();
        for (const of of items) {
            const { planned, seen } = of;
            if (!planned.isReady || (on && !this.forced && !on.has(planned.key))) continue;
            // Its program may be another by now: then it is drawn by three.js until that is known, and so is whatever was last seen before.
            if (seen < planned.doubted) continue;
            if (!planned.apart) this.#ahead(of, frame);
            else if (apart.has(planned.apart.name)) apart.get(planned.apart.name).push(of);
            else apart.set(planned.apart.name, [of]);
        }
        for (const [first, ...others] of apart.values()) this.#apart([first, ...others], first.planned.apart, frame);
    };

    #ahead({ item, record, planned }, frame) {
        if (planned.drawAhead(item, this.#scene, frame.camera)) Object.assign(record, { frame: frame.number, planned });
        else planned.doubted = frame.number;
    }

    /** Depth passes that have a depth texture for themselves. */
    #apart(items, attachment, frame) {
        const { renderer } = this.#host;
        within(renderer, this.#attachments.target(renderer, frame, attachment), () => {
            renderer.clear(false, true, false);
            for (const of of items) this.#ahead(of, frame);
        });
    }

    #draw = (draw, frame) => {
        const { object, material: author } = draw;
        const record = this.#records.get(object)?.get(author);
        const { planned } = record ?? {};
        if (record?.frame !== frame.number || !planned.main) return;
        // What was laid ahead of it is gone.
        if (frame.cleared && planned.depth) return;
        planned.guard(planned.main);
        draw.material = planned.main;
        this.#drawing = { record, author };
    };

    /** three.js was about to take another program of this material in the middle of a frame, and nothing was drawn: the author's own draws the object at once. */
    #redraw({ camera, scene, geometry, object, group }, { record, author }, frame) {
        record.planned.doubted = frame.number;
        record.frame = -1;
        this.#host.renderer.renderBufferDirect(camera, scene, geometry, author, object, group);
    }

    /** The program that three.js drew the author's material with. */
    #drawn = (draw, frame) => {
        const { object, material } = draw;
        const drawing = this.#drawing;
        if (drawing && material === drawing.record.planned.main) {
            this.#drawing = null;
            if (!drawing.record.planned.unguard()) this.#redraw(draw, drawing, frame);
            return;
        }
        const own = object.material;
        if (own !== material && !(Array.isArray(own) && own.includes(material))) return;
        const source = this.#host.programs.of(object, material);
        if (!source) return;
        const record = this.#record(object, material);
        record.sources.set(frame.kind, { source, seen: frame.number });
    };

    #end = ({ interrupted }) => {
        this.#cleared = interrupted;
        this.#measured?.end();
    };

    #record(object, material) {
        let records = this.#records.get(object);
        if (!records) this.#records.set(object, (records = new WeakMap()));
        let record = records.get(material);
        if (!record) records.set(material, (record = { sources: new Map(), frame: -1, planned: null }));
        return record;
    }

    /** What of the frame's opaque objects has a plan, in three.js' order. */
    #collect(frame) {
        const items = [];
        const { renderer } = this.#host;
        const reversed = renderer.state.buffers.depth.getReversed();
        const limits = { samples: samplesOf(renderer, frame.target), reversed };
        for (const item of frame.list.opaque) {
            const { object, material } = item;
            if (this.#unfit(item)) continue;
            const record = this.#record(object, material);
            const { source, seen } = record.sources.get(frame.kind) ?? {};
            if (!source?.key) continue;
            const planned = this.#plan(material, source, frame, limits);
            planned.used = frame.number;
            if (!planned.isReady || planned.item === null) planned.item = { ...item };
            items.push({ item, record, planned, seen });
        }
        return items;
    }

    /** Why three.js draws it: the code and the reason; or null. */
    #unfit(item) {
        if (isTooOld) return ['version', `three.js r${REVISION} is too old for it: use r187 or later`];
        if (!item.object.isMesh) return ['object', 'not a mesh'];
        if (!this.#recipes(item.material)) return ['not-asked', 'not asked for'];
        if (this.enabled && this.#first(item.material) !== this)
            return ['earlier-call', 'an earlier call of `rewrite` or `prepass` draws it'];
        if (hasCallback(item)) return ['callback', 'has an onBeforeRender'];
        const reason = unfit(item.material);
        return reason && ['material', reason];
    }

    /** Whether the material is this call's to draw, if it is the first one. */
    covers(scene, material) {
        return this.enabled && scene === this.#scene && this.#recipes(material) !== null;
    }

    /** Depth of one plan and colours of another need not be the same bits: a material has one. */
    #first(material) {
        for (const each of this.#host.rewrites) if (each.covers(this.#scene, material)) return each;
        return null;
    }

    #recipesOf(material, recipes) {
        let of = this.#asked.get(material);
        if (of === undefined) this.#asked.set(material, (of = recipes(material)));
        return of;
    }

    #plan(material, source, { kind, target }, limits) {
        let plans = this.#plans.get(material);
        if (!plans) {
            this.#plans.set(material, (plans = new Map()));
            material.addEventListener('dispose', this.#disposed);
        }
        const state = stateFor(material, DEPTH_FORMAT[target?.depthTexture?.type] ?? 'depth24plus');
        const { primitive, depth_compare, depth_format } = state;
        const key = `${source.key} ${primitive.cull} ${depth_compare} ${depth_format} ${limits.samples > 0} ${kind}`;
        let planned = plans.get(key);
        if (!planned) {
            const recipes = this.#recipes(material);
            const options = { ...this.#options, attachments: this.#attachments, recipes, limits };
            planned = new Planned(this.#host, material, source, state, options);
            planned.key = `${key} ${material.uuid}`;
            planned.name = `${key} ${recipes[0].name}`;
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

    // ---- what happens to the page -----------------------------------------------------------------------------------------------------------------------------------------

    #interrupted = () => this.#measured?.interrupt();

    #restored = () => {
        this.#measured?.restart();
        for (const planned of this.#all()) planned.restart();
    };

    #disposed = ({ target }) => this.#forget(target);

    *#all() {
        for (const plans of this.#plans.values()) yield* plans.values();
    }

    /** Those of programs that three.js has now. */
    *#live() {
        for (const planned of this.#all()) if (this.#number - planned.used <= STALE_AFTER) yield planned;
    }

    #forget(author) {
        for (const planned of this.#plans.get(author)?.values() ?? []) this.#drop(planned);
        this.#plans.delete(author);
        author.removeEventListener('dispose', this.#disposed);
    }

    #drop(planned) {
        planned.dispose();
        this.#measured?.remove(planned);
    }

    #release() {
        const since = this.#number - FORGET_AFTER;
        for (const [author, plans] of this.#plans) {
            for (const [key, planned] of plans) {
                if (planned.used > since) continue;
                this.#drop(planned);
                plans.delete(key);
            }
            if (plans.size === 0) this.#forget(author);
        }
        this.#measured?.forget(since);
    }

    // ---- report -------------------------------------------------------------------------------------------------------------------------------------------------------------

    report() {
        return [...materialsOf(this.#scene)].flatMap(([material, object]) => this.#rows(object, material));
    }

    #rows(object, material) {
        const refused = ([code, reason]) => [row(this.#part, material, { state: 'refused', reason, code })];
        const unfit = this.#unfit({ object, material });
        if (unfit) return refused(unfit);
        const plans = [...(this.#plans.get(material)?.values() ?? [])];
        if (this.#blocked && plans.some(({ depth }) => depth)) return refused(this.#blocked);
        if (plans.length === 0) return [row(this.#part, material, { state: 'waiting', reason: 'not drawn yet' })];
        // Lights, fog or another target give a material another program: the current one is that of the last frame.
        const last = Math.max(...plans.map(({ used }) => used));
        return plans.map((planned) => {
            const more = { isCurrent: planned.used === last, ...this.#measured?.row(planned) };
            return planRow(this.#part, material, planned, more);
        });
    }
}

/** What else is drawn must not tell that depth is laid ahead of it; the code and the reason where it would. */
function blocked(items) {
    const { equal, greater, 'not-equal': unequal, 'greater-equal': least } = COMPARE;
    for (const { material } of items) {
        if (material.stencilWrite) return ['scene', 'an opaque material of the scene uses the stencil'];
        if (material.depthTest && [equal, greater, unequal, least].includes(material.depthFunc))
            return ['scene', 'an opaque material of the scene is drawn behind others, by its depth function'];
    }
    return null;
}
