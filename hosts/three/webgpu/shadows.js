// Shadow maps in which three.js is wrong: the depth of the author's own program, drawn from the light. three.js' shadow
// material has the author's `positionNode`, `depthNode`, `colorNode`, `maskNode`, `map` and `alphaTest`, so most
// materials are right as they are; what else moves vertices or discards is not in it.

import { Authors, isDoubtful } from './authors.js';
import { Prepared, castingMaterial } from './casting.js';
import { stages } from './pipelines.js';
import { Entries, stateOf } from './programs.js';
import { row } from './rows.js';

const ROLE = 'outputs';

/** What is drawn of one text in one state. */
class Entry {
    state = 'asked';
    /** `sliced`, or `whole`: the author's program as it is, because preshade refuses to slice it. */
    form = 'sliced';
    reason = null;
    remedy = null;
    code = null;
    left = [];
    /** Maps that were drawn without it, by the light's camera: the scenes. */
    waiting = new Map();
    isAwaited = false;
    ms = 0;
    pipeline = null;

    end(state, reason, code = null) {
        Object.assign(this, { state, reason, code, waiting: null });
    }

    ready(pipeline) {
        Object.assign(this, { pipeline, state: 'ready' });
        this.again();
        this.waiting = null;
    }

    again() {
        for (const [camera, scene] of this.waiting ?? []) again({ scene, camera });
    }
}

/** Has a shadow map that is drawn on demand drawn again. */
function again({ scene, camera }) {
    scene.traverse(({ shadow }) => {
        if (shadow?.camera === camera && !shadow.autoUpdate) shadow.needsUpdate = true;
    });
}

const whole = ({ vertex, fragment }) => ({
    vertex: { text: vertex, entry: 'main' },
    fragment: { text: fragment, entry: 'main' },
});

export class Shadows {
    #host;
    /** The part of each scene: `{ view, enabled, report, dispose }`. */
    #scenes = new WeakMap();
    #authors = new Authors();
    #entries;
    #prepared;
    #pending = new Set();

    constructor(host) {
        this.#host = host;
        this.#entries = new Entries(host, () => new Entry());
        this.#prepared = new Prepared(host.renderer, 'preshade shadow');
    }

    /**
     * `view`: what becomes of discards that depend on the viewer, as fades by distance. `drop`: a shadow has none. `keep`:
     * they follow the light.
     */
    use(scene, { view = 'drop' } = {}) {
        if (view !== 'drop' && view !== 'keep')
            throw new TypeError(`preshade: view is "drop" or "keep", not "${view}"`);
        const part = {
            view,
            enabled: true,
            report: () => this.report(),
            dispose: () => this.#scenes.delete(scene),
        };
        this.#scenes.set(scene, part);
        return part;
    }

    /** Draws one object of a shadow map; answers false where three.js is to draw it. */
    draw(call) {
        const { renderer, backend } = this.#host;
        const author = renderer._currentSourceMaterial;
        const part = this.#scenes.get(call.scene);
        if (author === null || !part?.enabled) return false;
        const known = this.#author(author, call.object);
        if (known.state !== 'doubtful') return false;
        const { material } = known;
        material.side = call.material.side;
        const own = this.#prepared.of(material, call);
        if (own === null) {
            queueMicrotask(() => again(call));
            return false;
        }
        const entry = this.#entry(own, known, part);
        if (entry.state === 'ready') {
            own.pipeline = entry.pipeline;
            backend.draw(own, renderer.info);
        } else if (entry.waiting) entry.waiting.set(call.camera, call.scene);
        renderer._nodes.updateAfter(own);
        return entry.state === 'ready';
    }

    #author(author, object) {
        const { renderer, discards } = this.#host;
        const does = discards.of(author);
        const { transmitted } = renderer.shadowMap;
        return this.#authors.of(author, `${author.version} ${does} ${transmitted}`, () => {
            const known = { state: 'same', reason: null, entries: new Map() };
            if (!isDoubtful(author, object, does, { isShadow: true })) return known;
            if (transmitted)
                return { ...known, state: 'unsupported', reason: 'shadowMap.transmitted wants its colour' };
            const material = castingMaterial(author);
            return { ...known, state: 'doubtful', material, materials: [material] };
        });
    }

    #entry(own, known, { view }) {
        const entry = this.#entries.of(own, view, (key, of) => known.entries.set(key, of));
        if (entry.state === 'asked') this.#ask(entry, own, view);
        return entry;
    }

    #ask(entry, own, view) {
        const { variants, backend, pipelines, programs } = this.#host;
        const texts = programs.built(own);
        const state = stateOf(own, backend);
        // Planes are given in the space of whoever views.
        const isClipped = Boolean(own.clippingContext?.cacheKey);
        const pass = `outputs:write=shadow,view=${isClipped ? 'keep' : view},format=${state.depthFormat}`;
        const found = variants.get(texts, { pass, roles: [ROLE], ...state });
        if (found.state === 'pending') {
            if (!entry.isAwaited) found.done.then(() => entry.again());
            entry.isAwaited = true;
            return;
        }
        const { state: answer, reason, remedy, code, ms } = found;
        if (answer === 'failed') return entry.end(answer, reason, code);
        const isSliced = answer === 'ready';
        Object.assign(entry, { ms, state: 'compiling', form: isSliced ? 'sliced' : 'whole', reason, remedy, code });
        if (isSliced) entry.left = found.variant.passes[0].pass.left_out ?? [];
        // The depth state is that of three.js' shadow material: the bias is in the look-up.
        const drawn = { compare: state.depthCompare, write: true, colorWrite: false };
        const of = isSliced ? stages(found.variant, ROLE) : whole(texts);
        const done = pipelines
            .make({ renderObject: own }, of, drawn)
            .then((pipeline) => {
                if (!pipeline) return entry.end('failed', 'the device refuses a pipeline');
                entry.ready(pipeline);
            })
            .catch((error) => entry.end('failed', error.message))
            .finally(() => this.#pending.delete(done));
        this.#pending.add(done);
    }

    async settled() {
        await Promise.all(this.#pending);
    }

    report() {
        return [...this.#authors].flatMap(([material, { state, reason, entries }]) => {
            if (state !== 'doubtful') return [row('shadow', material, { state, reason })];
            return [...entries.values()].map(({ state, form, reason, remedy, code, ms, left }) =>
                row('shadow', material, { state, reason, remedy, code, ms, form, left_out: left }),
            );
        });
    }

    dispose() {
        this.#scenes = new WeakMap();
        this.#authors.release();
        this.#entries.clear();
    }
}
