// Derived materials of one pass: asks for variants, has three.js link their programs ahead of the first draw, shares and releases them.

import { row } from '../rows.js';
import { named } from '../variants.js';
import { derived, driverError, refresh } from './derived.js';
import { kind } from './programs.js';

/** Milliseconds of a frame that may go into new materials. The others wait for the next frame. */
const BUDGET = 3;
/** Frames in which a caster outside of the picture may wait for three.js to make its program. */
const PATIENCE = 2;
const NEVER = { source: null, uniforms: null, version: 0 };
/** So many programs of an author are remembered. */
const SOURCES = 16;
/** Every so many frames materials that are in no scene any more are released. */
const SWEEP = 120;

/**
 * `pass`: its name in reports. `steps(source, mode, author)`: what to ask for, in order: a list of `{ texts, request, accept(variant) }`. The first that is ready and accepted
 * is drawn; one whose `accept` answers `same` has three.js draw as always. `build(variant, step, { mode, source })`: `{ vertex, fragment, blocks, state, uniforms, row }` of it.
 */
export class Derivations {
    #host;
    #pass;
    #steps;
    #build;
    #authors = new Map();
    #queue = [];
    #linking = new Set();
    #frame = 0;
    #spent = 0;
    #timer;
    #disposed = false;
    /**
     * What the last `pick` lacked. `variant`: `ready` tells when it is there. `question`: ask again in the next frame. `program`: the same, if three.js then draws the material,
     * which has changed. Null: nothing.
     */
    lacks = null;
    /** `(author)`, when a material can be drawn that could not before. */
    ready = new Set();

    constructor(host, { pass, steps, build }) {
        this.#host = host;
        this.#pass = pass;
        this.#steps = steps;
        this.#build = build;
        host.hooks.afterRender.add(this.#rendered);
        host.hooks.restored.add(this.#restored);
    }

    /**
     * The material that draws `object` in place of `author`, or null where three.js has to draw as always. `mode` tells variants of one program apart. `extra` goes to `steps`.
     */
    pick(author, object, mode, extra, scene, camera) {
        const of = this.#authors.get(author) ?? this.#meet(author);
        of.used = this.#frame;
        const which = kind(object);
        const { source, uniforms, version } = this.#host.programs.last(which, author) ?? NEVER;
        this.lacks = 'question';
        if (!source) {
            const compile = () => this.#host.programs.compile(object, author, scene, camera);
            this.#want(of, `${mode} ${which}`, compile);
            return null;
        }
        Object.assign(of, { object, scene, camera, theirs: uniforms });
        let slots = of.slots.get(source);
        if (!slots) of.slots.set(source, (slots = new Map()));
        const slot = slots.get(mode) ?? this.#start(of, source, slots, mode, extra);
        if (slot && version !== author.version) this.lacks = 'program';
        else if (slot) this.lacks = slot.state === 'pending' ? 'variant' : null;
        // The usual case: the same as in the last frame.
        if (slot?.material && slot.which === which && slot.version === version)
            return this.#refreshed(of, slot.material);
        const at = `${mode} ${which}`;
        of.waits.delete(at);
        if (slot) of.now.set(at, slot);
        if (slot?.material || slot?.state === 'same') {
            Object.assign(slot, { which, version });
            of.last.set(at, { slot, version });
        }
        if (slot && slot.state !== 'pending') return this.#refreshed(of, slot.material);
        // Lights, fog or the target changed, and not the author's text: what was drawn before is as right as it was.
        const last = of.last.get(at);
        return last?.version === version ? this.#refreshed(of, last.slot.material) : null;
    }

    /** The material with the author's uniforms as they are now. */
    #refreshed({ author, theirs }, material) {
        if (material) refresh(this.#host.renderer, author, material, material.preshade.uniforms, theirs);
        return material;
    }

    /** Rows for `report`: one for each text. Of a material that lights or targets gave several texts, those that are drawn now. */
    rows() {
        const rows = [];
        for (const { author, now, last, waits } of this.#authors.values()) {
            if (waits.size && !now.size)
                rows.push(row(this.#pass, author, { state: 'waiting', reason: 'not drawn yet' }));
            const slots = [...now].map(([at, slot]) => {
                const before = last.get(at);
                return slot.state === 'pending' && before?.version === author.version ? before.slot : slot;
            });
            for (const { extra, row: own, mode, state, reason, remedy, code, ms } of new Set(slots))
                rows.push(
                    row(this.#pass, author, { mode: extra?.mode ?? mode, state, reason, remedy, code, ms, ...own }),
                );
        }
        return rows;
    }

    /** Resolves when no variant is pending and no program is being linked. */
    async settled() {
        while (this.#linking.size) await Promise.all(this.#linking);
    }

    release(author) {
        const of = this.#authors.get(author);
        if (!of) return;
        this.#authors.delete(author);
        author.removeEventListener('dispose', of.gone);
        for (const { material } of of.shared.values()) this.#free(material);
    }

    dispose() {
        this.#disposed = true;
        this.#host.hooks.afterRender.delete(this.#rendered);
        this.#host.hooks.restored.delete(this.#restored);
        clearTimeout(this.#timer);
        for (const done of this.#queue.splice(0)) done();
        for (const author of [...this.#authors.keys()]) this.release(author);
        this.ready.clear();
    }

    #meet(author) {
        const of = {
            author,
            slots: new Map(),
            shared: new Map(),
            last: new Map(),
            now: new Map(),
            waits: new Map(),
            used: 0,
        };
        of.gone = () => this.release(author);
        author.addEventListener('dispose', of.gone);
        this.#authors.set(author, of);
        return of;
    }

    /** An object that three.js did not draw: outside of the picture, it may stay so. */
    #want(of, at, compile) {
        const waits = of.waits.get(at) ?? { since: this.#frame };
        of.waits.set(at, waits);
        if (waits.queued || this.#frame - waits.since < PATIENCE) return;
        waits.queued = true;
        this.#queue.push(() => {
            of.waits.delete(at);
            if (this.#authors.get(of.author) === of) compile();
        });
    }

    #start(of, source, slots, mode, extra) {
        if (this.#spent > BUDGET) return null;
        const slot = {
            mode,
            source,
            extra,
            state: 'pending',
            material: null,
            reason: null,
            code: null,
            ms: 0,
            row: null,
        };
        const began = performance.now();
        const steps = this.#host.timed('texts', () => source.key && this.#steps(source, mode, of.author, extra));
        this.#spent += performance.now() - began;
        // It has to wait for something, or the program is gone.
        if (!steps) return null;
        slots.set(mode, slot);
        this.#forget(of, source);
        const done = this.#follow(of, slot, steps).finally(() => this.#linking.delete(done));
        this.#linking.add(done);
        return slot;
    }

    /** The oldest programs of the author, and our materials that belong to none any more. */
    #forget(of, source) {
        // The order is that of use.
        const slots = of.slots.get(source);
        of.slots.delete(source);
        of.slots.set(source, slots);
        for (const old of of.slots.keys()) if (of.slots.size > SOURCES || !old.program.program) of.slots.delete(old);
        const kept = new Set([...of.slots.values()].flatMap((each) => [...each.values()]));
        const drawn = new Set([
            ...[...kept].map(({ material }) => material),
            ...[...of.last.values()].map(({ slot }) => slot.material),
        ]);
        for (const [at, slot] of of.now) if (!kept.has(slot)) of.now.delete(at);
        for (const [key, { material, isLinked }] of of.shared) {
            if (!isLinked || drawn.has(material)) continue;
            of.shared.delete(key);
            this.#free(material);
        }
    }

    async #follow(of, slot, steps) {
        for (const step of steps) {
            const { texts, request, accept = () => true } = step;
            const entry = this.#host.variants.get(texts, request);
            await entry.done;
            const isGone = this.#disposed || this.#authors.get(of.author) !== of;
            if (isGone) return;
            slot.ms += entry.ms;
            const answer = entry.state === 'ready' && accept(entry.variant);
            if (answer === 'same') {
                slot.state = 'same';
                return;
            }
            if (!answer) {
                if (entry.state !== 'ready')
                    Object.assign(slot, {
                        reason: entry.reason,
                        remedy: entry.remedy,
                        code: entry.code,
                        left: entry.state,
                    });
                continue;
            }
            Object.assign(slot, { reason: null, remedy: null, code: null });
            await this.#link(of, slot, entry.variant, step).catch(({ message }) =>
                fail(slot, { code: 'link', reason: message }),
            );
            return;
        }
        slot.state = slot.left ?? 'refused';
    }

    /** Makes the material, and waits until its program can be drawn with without a stall. */
    async #link(of, slot, variant, step) {
        const { row, ...made } = this.#host.timed('build', () => this.#build(variant, step, slot));
        slot.row = row ?? null;
        const key = named(`${slot.mode}\0${made.vertex}\0${made.fragment}`);
        const shared = of.shared.get(key);
        if (shared) {
            const error = await shared.linked;
            if (error) fail(slot, error);
            else this.#done(of, slot, shared.material);
            return;
        }
        const { renderer } = this.#host;
        const material = derived(renderer, of.author, made, { ...made, theirs: of.theirs });
        material.preshade = made;
        const share = { material, linked: this.#linked(of, material), isLinked: false };
        of.shared.set(key, share);
        const error = await share.linked;
        share.isLinked = true;
        if (this.#authors.get(of.author) !== of) {
            this.#free(material);
        } else if (error) {
            of.shared.delete(key);
            this.#free(material);
            fail(slot, error);
        } else this.#done(of, slot, material);
    }

    /** Resolves when a draw with the material would not wait for its program, to what the driver has against it if that cannot be. */
    async #linked(of, material) {
        const { renderer, programs } = this.#host;
        await new Promise((resolve) => this.#queue.push(resolve) && this.#soon());
        const gl = renderer.getContext();
        if (this.#authors.get(of.author) !== of || gl.isContextLost()) return null;
        const { object, scene, camera } = of;
        this.#host.timed('link', () => programs.link(object, material, scene, camera));
        const program = () => renderer.properties.get(material).currentProgram;
        while (program() && !program().isReady()) await new Promise((resolve) => setTimeout(resolve, 4));
        const { program: made } = program() ?? {};
        if (!made || gl.isContextLost()) return null;
        const error = driverError(renderer, material);
        if (error) return error;
        // Asks the driver for uniforms and attributes, which the first draw would do; it need not ask for messages again.
        const { checkShaderErrors } = renderer.debug;
        renderer.debug.checkShaderErrors = false;
        this.#host.timed('uniforms', () => program().getUniforms());
        renderer.debug.checkShaderErrors = checkShaderErrors;
        return null;
    }

    #done(of, slot, material) {
        if (this.#authors.get(of.author) !== of) return;
        slot.state = 'done';
        slot.material = material;
        for (const listener of this.ready) listener(of.author);
    }

    #free(material) {
        // The author's own listeners do not hear it: the derived material has none of his.
        material.dispose();
    }

    /** Work outside of a frame, one piece a task, where no frame takes it. */
    #soon() {
        this.#timer ??= setTimeout(() => {
            this.#timer = undefined;
            if (this.#disposed) return;
            this.#host.timed('queue', () => this.#queue.shift()?.());
            if (this.#queue.length) this.#soon();
        });
    }

    /** Another context: three.js makes every program anew, and so do we. */
    #restored = () => {
        for (const author of [...this.#authors.keys()]) this.release(author);
    };

    #rendered = () => {
        if (this.#host.hooks.depth > 0) return;
        this.#spent = 0;
        this.#frame++;
        if (this.#queue.length) this.#soon();
        if (this.#frame % SWEEP === 0) this.#sweep();
    };

    /** Releases what is in no object of its scene, and was not drawn since the last time. */
    #sweep() {
        const met = new Map();
        const isIn = (author, scene) => {
            if (!met.has(scene)) {
                const all = new Set();
                scene.traverse(({ material }) => [material].flat().forEach((each) => all.add(each)));
                met.set(scene, all);
            }
            return met.get(scene).has(author);
        };
        for (const { author, used, scene } of [...this.#authors.values()])
            if (this.#frame - used >= SWEEP && !(scene && isIn(author, scene))) this.release(author);
    }
}

function fail(slot, { code, reason, rendered }) {
    Object.assign(slot, { state: 'failed', code, reason, row: { ...slot.row, ...(rendered && { rendered }) } });
}
