// What preshade does for a WebGLRenderer. Each function has a file of its own.

import { Variants } from '../variants.js';
import { Hooks } from './hooks.js';
import { Override } from './override.js';
import { Programs } from './programs.js';
import { prepassOf, recipesOf } from './recipes.js';
import { Shadows } from './shadows.js';

export class Host {
    /** Each has `report()`, a list of rows, and `dispose()`. */
    #parts = new Set();
    #shadows = new Map();
    /** By pass: what undoes it. */
    #overrides = new Map();
    /** Calls of `rewrite` and `prepass`, in order. */
    rewrites = new Set();
    #modules;

    static async of(renderer, options) {
        const [{ Rewrite }, { Velocity }] = await Promise.all([import('./rewrite.js'), import('./velocity.js')]);
        return new Host(renderer, options, { Rewrite, Velocity });
    }

    constructor(renderer, options, modules) {
        this.renderer = renderer;
        this.options = options;
        this.variants = new Variants(options);
        this.hooks = new Hooks(renderer);
        this.programs = new Programs(renderer, this.hooks);
        this.#modules = modules;
    }

    shadows(scene, options) {
        if (!this.#shadows.has(scene)) this.#shadows.set(scene, this.#add(new Shadows(this, scene, options)));
        return this.#shadows.get(scene);
    }

    override(pass, options) {
        this.#overrides.get(pass)?.();
        if (options === false) return pass;
        const undo = () => {
            part.dispose();
            if (this.#overrides.get(pass) === undo) this.#overrides.delete(pass);
        };
        const part = this.#add(new Override(this, pass, options, undo));
        this.#overrides.set(pass, undo);
        return pass;
    }

    rewrite(scene, { pass, fallback = null, ...options } = {}) {
        return this.#add(new this.#modules.Rewrite(this, scene, 'rewrite', recipesOf(pass, fallback), options));
    }

    prepass(scene, { form = 'equal', ...options } = {}) {
        return this.#add(new this.#modules.Rewrite(this, scene, 'prepass', prepassOf(form), options));
    }

    velocity(scene, options) {
        return this.#add(new this.#modules.Velocity(this, scene, options));
    }

    text(material, object) {
        const { vertex, fragment } = this.programs.text(material, object) ?? {};
        return vertex && fragment ? { vertex, fragment } : null;
    }

    report() {
        return [...this.#parts].flatMap((part) => part.report());
    }

    /** Runs a piece of our work on the main thread. With the option `marks` each is in the browser's performance timeline. */
    timed(name, work) {
        const start = performance.now();
        try {
            return work();
        } finally {
            const end = performance.now();
            this.longest = Math.max(this.longest ?? 0, end - start);
            if (this.options.marks) performance.measure(`preshade: ${name}`, { start, end });
        }
    }

    /** Resolves when no variant is being made and each program is linked. */
    async settled() {
        await this.variants.settled();
        for (const part of this.#parts) await part.settled?.();
    }

    dispose() {
        for (const part of this.#parts) part.dispose();
        this.programs.dispose();
        this.hooks.dispose();
        this.variants.dispose();
    }

    /** A part that the page disposes of is in no report, and its scene may have another. */
    #add(part) {
        const dispose = part.dispose.bind(part);
        part.dispose = () => {
            if (!this.#parts.delete(part)) return;
            for (const [scene, shadows] of this.#shadows) if (shadows === part) this.#shadows.delete(scene);
            dispose();
        };
        this.#parts.add(part);
        return part;
    }
}
