// Shadow maps in which three.js is wrong: the depth of the author's own program, drawn from the light. three.js' shadow
// material has the author's `positionNode`, `depthNode`, `colorNode`, `maskNode`, `map` and `alphaTest`, so most
// materials are right as they are; what else moves vertices or discards is not in it.

import { row } from '../rows.js';
import { Authors, isDoubtful, untold } from './authors.js';
import { Prepared, castingMaterial } from './casting.js';
import { stages } from './pipelines.js';
import { Entries, Pending, made, stateOf } from './programs.js';

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

/** Has the shadow maps of a scene that are drawn on demand drawn again: all that there are, or that of a camera. */
function again({ scene, camera = null }) {
    scene.traverse(({ shadow }) => {
        if (!shadow?.map || shadow.autoUpdate) return;
        if (camera === null || shadow.camera === camera) shadow.needsUpdate = true;
    });
}

const whole = ({ vertex, fragment }) => ({
    vertex: { text: vertex, entry: 'main' },
    fragment: { text: fragment, entry: 'main' },
});

export class Shadows {
    #host;
    #scene;
    #view;
    #authors = new Authors();
    #entries;
    #prepared;
    #pending = new Pending();

    #isEnabled = true;

    /**
     * `view`: what becomes of discards that depend on the viewer, as fades by distance. `drop`: a shadow has none. `keep`:
     * they follow the light.
     */
    constructor(host, scene, { view = 'drop' } = {}) {
        this.#host = host;
        this.#scene = scene;
        this.#view = view;
        this.#entries = new Entries(host, () => new Entry());
        this.#prepared = new Prepared(host.renderer, 'preshade shadow');
        again({ scene });
    }

    get enabled() {
        return this.#isEnabled;
    }

    /** Switches it off and on. */
    set enabled(isEnabled) {
        if (isEnabled === this.#isEnabled) return;
        this.#isEnabled = isEnabled;
        again({ scene: this.#scene });
    }

    /** Draws one object of a shadow map; answers false where three.js is to draw it. */
    draw(call) {
        const { renderer, backend } = this.#host;
        const author = renderer._currentSourceMaterial;
        if (author === null || !this.#isEnabled) return false;
        const known = this.#author(author, call.object);
        if (known.state !== 'doubtful') return false;
        const { material } = known;
        material.side = call.material.side;
        const own = this.#prepared.of(material, call);
        if (own === null) {
            queueMicrotask(() => again(call));
            return false;
        }
        const entry = this.#entry(own, known);
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
        const stamp = `${author.version} ${does === false} ${transmitted}`;
        const known = this.#authors.of(author, stamp, () => ({ ...untold(author), entries: new Map() }));
        if (known.state !== 'same' || !isDoubtful(author, known.nodes, object, does, { isShadow: true })) return known;
        if (transmitted)
            return Object.assign(known, {
                state: 'refused',
                reason: 'shadowMap.transmitted wants its colour',
                code: 'transmitted',
            });
        const material = castingMaterial(author);
        return Object.assign(known, { state: 'doubtful', material, materials: [material] });
    }

    #entry(own, known) {
        const entry = this.#entries.of(own, this.#view, (key, of) => known.entries.set(key, of));
        if (entry.state === 'asked')
            this.#pending.add(this.#make(entry, own), (message) => entry.end('failed', message, 'failed'));
        return entry;
    }

    async #make(entry, own) {
        const { backend, pipelines, programs } = this.#host;
        const texts = programs.built(own);
        const state = stateOf(own, backend);
        // Planes are given in the space of whoever views.
        const view = own.clippingContext?.cacheKey ? 'keep' : this.#view;
        const pass = `outputs:write=shadow,view=${view},format=${state.depthFormat}`;
        entry.state = 'compiling';
        const found = await made(this.#host, own, texts, { pass, roles: [ROLE], ...state });
        if (!found) {
            entry.state = 'asked';
            return entry.again();
        }
        const { state: answer, reason, remedy, code, ms } = found;
        if (answer === 'failed') return entry.end(answer, reason, code);
        const isSliced = answer === 'ready';
        Object.assign(entry, { ms, form: isSliced ? 'sliced' : 'whole', reason, remedy, code });
        if (isSliced) entry.left = found.variant.passes[0].pass.left_out ?? [];
        // The depth state is that of three.js' shadow material: the bias is in the look-up.
        const drawn = { compare: state.depthCompare, write: true, colorWrite: false };
        const pipeline = await pipelines.make(
            { renderObject: own },
            isSliced ? stages(found.variant, ROLE) : whole(texts),
            drawn,
        );
        if (pipeline) entry.ready(pipeline);
        else entry.end('failed', 'the device refuses a pipeline', 'driver');
    }

    settled() {
        return this.#pending.settled();
    }

    report() {
        return [...this.#authors].flatMap(([material, { state, reason, code, entries }]) => {
            if (state !== 'doubtful') return [row('shadow', material, { state, reason, code })];
            return [...entries.values()].map(({ state, form, reason, remedy, code, ms, left }) =>
                row('shadow', material, { state, reason, remedy, code, ms, form, left_out: left }),
            );
        });
    }

    dispose() {
        this.#authors.release();
        this.#entries.clear();
        this.#host.forget(this);
        again({ scene: this.#scene });
    }
}
