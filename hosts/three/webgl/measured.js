// Which plans are drawn where frames with and without them are measured: one choice for each view of the scene.

import { Choice, Load } from '../measure.js';
import { sizeOf } from './frames.js';
import { Overdraw } from './overdraw.js';
import { Remembered } from './remembered.js';
import { Timer } from './timer.js';

/** Frames between two counts of fragments. */
const COUNT_EVERY = 90;
/** Another size than by this factor is another picture. */
const OTHER_SIZE = 1.3;

/** What is measured of one camera and one kind of target: another has other fragments. */
class View {
    /** The frame in which it was last drawn. */
    used = 0;
    size = 0;
    counted = -Infinity;
    perPixel = null;
    wasMeasuring = false;
    /** Plans whose results are to be remembered, with the next count of fragments. */
    fresh = null;

    constructor(options) {
        this.choice = new Choice(options);
        this.load = new Load(options);
    }
}

export class Measured {
    #host;
    #scene;
    #options;
    #views = new Map();
    #timer;
    #remembered;
    #overdraw;
    #began = 0;
    #last = 0;

    /** `options`: `{ frames, each, factor, again }` of ../measure.js and `{ method }` of timer.js. `remember`: whether to remember in localStorage what was measured. */
    constructor(host, scene, options, remember) {
        this.#host = host;
        this.#scene = scene;
        this.#options = options;
        this.#overdraw = new Overdraw(host);
        this.#timer = new Timer(host.renderer, options.method);
        this.#remembered = remember ? new Remembered(host.renderer, host.rewrites.size) : null;
    }

    dispose() {
        this.#timer.dispose();
        this.#overdraw.dispose();
    }

    get isMeasuring() {
        return [...this.#views.values()].some(({ choice }) => choice.isMeasuring);
    }

    /** Ahead of a frame. */
    begin() {
        this.#began = performance.now();
    }

    /** After it. */
    end() {
        this.#timer.end();
    }

    /** Something else than drawing took time. */
    interrupt() {
        for (const { choice } of this.#views.values()) choice.interrupt();
    }

    /** The context is another. */
    restart() {
        this.#timer.restart();
        this.interrupt();
    }

    remove(planned) {
        for (const { choice, fresh } of this.#views.values()) {
            choice.remove(planned.key);
            fresh?.delete(planned);
        }
    }

    /** Views that were last drawn in this frame or before. */
    forget(frame) {
        for (const [key, { used }] of this.#views) if (used <= frame) this.#views.delete(key);
    }

    /** The keys of the plans to draw by in this frame. */
    chosen(items, frame, busy) {
        this.#timer.poll();
        const view = this.#view(frame);
        const { choice, load } = view;
        for (const { planned } of items) {
            if (!planned.isReady || choice.has(planned.key)) continue;
            const earlier = this.#remembered?.get(`${planned.name} ${this.#class(view)}`) ?? null;
            choice.add(planned.key, earlier);
            if (earlier && load.settled === null) load.settle(earlier.perPixel);
        }
        if (this.#began - this.#last > 1000) choice.interrupt();
        this.#last = this.#began;
        const isMeasuring = choice.isMeasuring;
        const { on, ticket } = choice.frame(this.#began);
        if (view.wasMeasuring && !choice.isMeasuring) this.#settle(view, items);
        view.wasMeasuring = isMeasuring;
        const isFree = !isMeasuring && !choice.isTiming && !busy;
        const counts = isFree && frame.number - view.counted > COUNT_EVERY;
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
        if (!view) this.#views.set(key, (view = new View(this.#options)));
        view.used = frame.number;
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

    /** Pictures whose size is so alike that what is remembered of one counts for the other. */
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
        view.fresh = new Set(items.map(({ planned }) => planned).filter((planned) => view.choice.has(planned.key)));
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
                for (const planned of view.fresh ?? []) {
                    const found = view.choice.found(planned.key);
                    if (found) this.#remembered?.set(`${planned.name} ${this.#class(view)}`, { ...found, perPixel });
                }
                view.fresh = null;
            });
    }

    /** For the report: of the view in which it was last measured. */
    row(planned) {
        const views = [...this.#views.values()].filter(({ choice }) => choice.has(planned.key));
        if (views.length === 0) return { measured: null };
        const { choice, perPixel } = views.at(-1);
        return {
            measured: choice.found(planned.key),
            perPixel,
            method: this.#timer.method,
        };
    }
}
