// Variants of programs, made by the package `preshade` in its worker, and cached by text in memory and in IndexedDB.

import { Preshade as Compiler } from 'preshade';
import { version } from 'preshade/version';
import { Store } from './store.js';

/** The form of what is kept. Raise it when `Variants` or `read` come to ask the compiler, or to read its answer, in another way. */
const FORMAT = 1;
/** Whose kept variants can be used: those of the same form, by the same compiler. It does not depend on a minifier. */
export const MAKER = `${FORMAT} ${version}`;

/** A name of a text: its length and 64 bits, after cyrb53. */
export function named(text) {
    let [a, b] = [0xdeadbeef, 0x41c6ce57];
    for (let i = 0; i < text.length; i++) {
        const code = text.charCodeAt(i);
        a = Math.imul(a ^ code, 2654435761);
        b = Math.imul(b ^ code, 1597334677);
    }
    a = Math.imul(a ^ (a >>> 16), 2246822507) ^ Math.imul(b ^ (b >>> 13), 3266489909);
    b = Math.imul(b ^ (b >>> 16), 2246822507) ^ Math.imul(a ^ (a >>> 13), 3266489909);
    const hex = (word) => (word >>> 0).toString(16).padStart(8, '0');
    return hex(a) + hex(b) + text.length.toString(16);
}

// The first text is large: have the engine compile the loop before.
for (let i = 0; i < 4; i++) named(' '.repeat(8000));

/**
 * @typedef {object} Entry
 * @property {'pending' | 'ready' | 'refused' | 'failed'} state
 *   `refused`: preshade does not do it for this text. `failed`: the text has an error, or the compiler failed.
 * @property {object | null} variant `{ plan, passes, notes }` of a rewrite, or the agreement.
 * @property {string | null} reason
 * @property {string | null} remedy Of a refusal: what would make it possible.
 * @property {string | null} code
 * @property {number} ms How long the compiler took, without the wait for others; 0 if the variant was in IndexedDB.
 * @property {Promise<void>} done Resolves when the state is no longer `pending`.
 */

export class Variants {
    #compiler;
    #store;
    #limit;
    #entries = new Map();
    #pending = new Set();
    #disposed = false;
    /** Resolves when the compiler is there. */
    #loaded = null;
    /** When it answered last. */
    #answered = 0;
    /** How many variants were made by the compiler, and how many found in IndexedDB. */
    counts = { compiled: 0, stored: 0 };

    /**
     * `wasm`, `full` and `timeout` are those of the package `preshade`. `cache`: whether to keep variants in IndexedDB. `limit`: how many are kept in memory. `compiler`: another one; tests have it.
     */
    constructor({ wasm, full, timeout = 60_000, cache = true, limit = 512, compiler } = {}) {
        this.#compiler = compiler ?? new Compiler({ wasm, full, timeout });
        this.#store = cache ? new Store('preshade-three', MAKER) : null;
        this.#limit = limit;
    }

    /**
     * The variant of `texts`, which are WGSL or `{ vertex, fragment }`. `request` has the options of preshade's `rewrite` or, with `agree: other texts`, of its `agree`.
     * `texts.key`, where the caller has it, names the texts, and saves to hash them. `request.roles` names the passes to keep, where not all are needed: `['outputs']`.
     * `request.partial`: a step that does not apply is left out, as long as another does.
     *
     * @returns {Entry} Always the same object for the same texts and request.
     */
    get(texts, request) {
        const isGlsl = typeof texts !== 'string';
        const key = `${texts.key ?? named(isGlsl ? `${texts.vertex}\0${texts.fragment}` : texts)} ${this.#asked(request)}`;
        const known = this.#entries.get(key);
        if (known) {
            // The least recently used is first.
            this.#entries.delete(key);
            this.#entries.set(key, known);
            return known;
        }
        const entry = { state: 'pending', variant: null, reason: null, remedy: null, code: null, ms: 0 };
        this.#entries.set(key, entry);
        this.#forget();
        const done = this.#find(key, texts, request, entry).finally(() => this.#pending.delete(done));
        this.#pending.add(done);
        // Not a part of what is kept in IndexedDB.
        Object.defineProperty(entry, 'done', { value: done });
        return entry;
    }

    /** Resolves when nothing is pending. */
    async settled() {
        while (this.#pending.size) await Promise.all(this.#pending);
    }

    /** Ends the worker. What is pending fails. */
    dispose() {
        this.#disposed = true;
        this.#compiler.dispose();
        this.#store?.close();
        this.#entries.clear();
    }

    #asked({ agree, ...options }) {
        const other =
            agree && (agree.key ?? named(typeof agree === 'string' ? agree : `${agree.vertex}\0${agree.fragment}`));
        return JSON.stringify(other ? { agree: other, ...options } : options);
    }

    #forget() {
        for (const [key, { state }] of this.#entries) {
            if (this.#entries.size <= this.#limit) return;
            if (state !== 'pending') this.#entries.delete(key);
        }
    }

    async #find(key, texts, request, entry) {
        const stored = await this.#store?.get(key);
        if (stored) {
            this.counts.stored++;
            Object.assign(entry, stored, { ms: 0 });
            return;
        }
        // The first call would load the module, too.
        await (this.#loaded ??= this.#compiler.ready().catch(() => {}));
        // A call would start another worker.
        if (this.#disposed) {
            Object.assign(entry, failed({ message: 'disposed of', code: 'disposed' }));
            return;
        }
        const asked = performance.now();
        const found = await this.#make(texts, request).catch(failed);
        // The worker answers one call after another: what came before the last answer is the wait for others.
        const now = performance.now();
        Object.assign(entry, found, { ms: now - Math.max(asked, this.#answered) });
        this.#answered = now;
        if (this.#disposed) return;
        this.counts.compiled++;
        // A timeout or a lost worker says nothing about the text.
        if (['ready', 'refused'].includes(entry.state)) await this.#store?.set(key, entry);
        else if (['timeout', 'worker'].includes(entry.code)) this.#entries.delete(key);
    }

    async #make(texts, { agree, roles, partial, ...options }) {
        const sources = sourcesOf(texts);
        if (agree) {
            const other = sourcesOf(agree);
            const { agrees, isPartial, promises, judged, notes } = await this.#compiler.agree(sources, other, options);
            return {
                state: 'ready',
                variant: { agrees, isPartial, promises, judged, notes },
                reason: null,
                code: null,
            };
        }
        const emit = typeof sources === 'string' || texts.language === 'wgsl' ? 'wgsl' : 'glsl-es';
        const result = await this.#compiler.rewrite(sources, { emit, ...options });
        const [refusal] = result.refusals;
        const [error] = result.errors;
        if (refusal && !(partial && result.plan?.steps.length)) {
            const { reason, remedy, code } = refusal;
            return { state: 'refused', variant: null, reason, remedy, code };
        }
        if (error) return { state: 'failed', variant: null, reason: error.message, code: error.code };
        return { state: 'ready', variant: read(result, [emit].flat(), roles), reason: null, code: null };
    }
}

const failed = (error) => ({
    state: 'failed',
    variant: null,
    reason: error.message ?? String(error),
    code: error.code ?? 'failed',
});

/** WGSL; or two stages in GLSL; or, with `language: 'wgsl'`, two in WGSL, each with an entry point of its own. */
function sourcesOf(texts) {
    if (typeof texts === 'string') return texts;
    const { vertex, fragment, language } = texts;
    if (language !== 'wgsl') return { vertex, fragment };
    return [
        { name: 'material.vert.wgsl', text: vertex, language, stage: 'vertex' },
        { name: 'material.frag.wgsl', text: fragment, language, stage: 'fragment' },
    ];
}

/** The passes of a rewrite with their texts, in the first of the languages. */
function read({ plan, files, notes, refusals }, [language], roles) {
    const text = (of) => files.find(({ name }) => name === of?.file || name.endsWith(`/${of?.file}`))?.text ?? null;
    const passes = plan.passes.map((pass, i) => {
        const vertex = plan.files[i].vertex?.[language];
        const fragment = plan.files[i].fragment?.[language];
        const all = (field) => [...(vertex?.[field] ?? []), ...(fragment?.[field] ?? [])];
        return {
            pass,
            vertex: text(vertex),
            fragment: text(fragment),
            textures: all('textures'),
            blocks: all('blocks'),
            uniforms: all('uniforms'),
            attributes: vertex?.attributes ?? [],
        };
    });
    const skipped = refusals.map(({ pass, code, reason, remedy }) => ({ pass, code, reason, remedy }));
    return { plan, passes: roles ? passes.filter(({ pass }) => roles.includes(pass.role)) : passes, notes, skipped };
}
