// What preshade does for a WebGPURenderer: WGSL in, WGSL out.

import { Variants, named } from '../variants.js';
import { Discards } from './authors.js';
import { Hooks, unfit } from './hooks.js';
import { Override } from './override.js';
import { Pipelines } from './pipelines.js';
import { Prepass } from './prepass.js';
import { Programs } from './programs.js';
import { row } from './rows.js';
import { Shadows } from './shadows.js';
import { Velocity } from './velocity.js';

/** A part of a renderer for which nothing can be done; the report says why. */
const NOTHING = { enabled: false, texture: null, node: null, report: () => [], render() {}, dispose() {} };

function drawable(scene) {
    if (!scene?.isObject3D) throw new TypeError('preshade: give the scene that you render');
}

export class WebGPUHost {
    /** With `await renderer.init()` done. The options are those of `Variants`. */
    static async of(renderer, options = {}) {
        if (!renderer.initialized) await renderer.init();
        return new WebGPUHost(renderer, options);
    }

    #prepass = null;
    #shadows = null;
    #override = null;
    #velocities = new Map();
    #isDisposed = false;
    /** Why nothing is done at all. */
    #unfit;

    constructor(renderer, options) {
        this.renderer = renderer;
        this.backend = renderer.backend;
        this.#unfit = unfit(renderer);
        if (this.#unfit) return;
        this.variants = options.variants ?? new Variants(options);
        this.programs = new Programs(named);
        this.discards = new Discards();
        this.pipelines = new Pipelines(this.backend);
        this.#prepass = new Prepass(this, options.timer);
        this.#shadows = new Shadows(this);
        this.#override = new Override(this);
        this.hooks = new Hooks(renderer, {
            before: (scene, camera) => this.#velocities.get(scene)?.begin(scene, camera),
            wants: (list) => !this.#velocities.get(list.scene)?.isDrawing && this.#prepass.wants(list),
            opaque: (list) => this.#prepass.draw(list),
            drawn: (renderObject) => this.discards.saw(renderObject),
            replaced: (call, draw) => this.#replaced(call, draw),
        });
        this.backend.device.lost.then(({ message }) => {
            this.dispose();
            this.#unfit = `the device is lost${message ? `: ${message}` : ''}`;
        });
    }

    /** `{ view }`: see `Shadows`. */
    shadows(scene, options) {
        return this.#unfit ? NOTHING : this.#shadows.use(scene, options);
    }

    /** `pass` is a scene whose `overrideMaterial` is set, or has one, as a `PassNode` with an override material. */
    override(pass) {
        if (!this.#unfit) this.#override.use(pass);
        return pass;
    }

    /** `{ measure, materials }`: see `Prepass`. */
    prepass(scene, options) {
        drawable(scene);
        return this.#unfit ? NOTHING : this.#prepass.use(scene, options);
    }

    /** For each material: what is done, what was refused and why. */
    report() {
        if (this.#unfit)
            return [row('all', { name: '', type: 'all', uuid: '' }, { state: 'unsupported', reason: this.#unfit })];
        return this.#parts.flatMap((part) => part.report());
    }

    /** `{ camera, automatic }`: see `Velocity`. */
    velocity(scene, options) {
        drawable(scene);
        if (this.#unfit) return NOTHING;
        if (!this.#velocities.has(scene)) this.#velocities.set(scene, new Velocity(this, scene, options));
        return this.#velocities.get(scene);
    }

    /** A velocity that is disposed of. */
    forget(velocity) {
        for (const [scene, of] of this.#velocities) if (of === velocity) this.#velocities.delete(scene);
    }

    get #parts() {
        return this.#unfit ? [] : [this.#shadows, this.#override, this.#prepass, ...this.#velocities.values()];
    }

    #replaced(call, draw) {
        if (this.#velocities.get(call.scene)?.draw(call, draw)) return true;
        if (call.material.isShadowPassMaterial) return this.#shadows.draw(call);
        return this.#override.draw(call, draw);
    }

    async settled() {
        await this.variants?.settled();
        for (const part of this.#parts) await part.settled?.();
    }

    dispose() {
        if (this.#isDisposed) return;
        this.#isDisposed = true;
        this.hooks?.dispose();
        for (const part of this.#parts) part.dispose();
        this.variants?.dispose();
    }
}
