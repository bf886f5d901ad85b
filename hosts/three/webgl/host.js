// What preshade does for a WebGLRenderer. Each function has a file of its own.

import { Variants } from '../variants.js';
import { Hooks } from './hooks.js';
import { Override } from './override.js';
import { Programs } from './programs.js';
import { prepassOf, recipesOf } from './recipes.js';
import { Shadows } from './shadows.js';

export class WebGLHost {
    /** Each has `report()`, a list of rows, and `dispose()`. */
    #parts = new Set();
    #shadows = new Map();
    /** Calls of `rewrite` and `prepass`, in order. */
    rewrites = new Set();
    #modules;

    static async of(renderer, options) {
        const [{ Rewrite }, { Velocity }] = await Promise.all([import('./rewrite.js'), import('./velocity.js')]);
        return new WebGLHost(renderer, options, { Rewrite, Velocity });
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

    override(pass) {
        this.#add(new Override(this, pass));
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
        this.#parts.clear();
        this.#shadows.clear();
        this.programs.dispose();
        this.hooks.dispose();
        this.variants.dispose();
    }

    #add(part) {
        this.#parts.add(part);
        return part;
    }
}
