// What preshade does for a WebGPURenderer: WGSL in, WGSL out.

import { row } from '../rows.js';
import { Variants, named } from '../variants.js';
import { Discards } from './authors.js';
import { Hooks, unfit } from './hooks.js';
import { Override } from './override.js';
import { Pipelines } from './pipelines.js';
import { Prepass } from './prepass.js';
import { Programs } from './programs.js';
import { Shadows } from './shadows.js';
import { Timer } from './timer.js';
import { Velocity } from './velocity.js';

/** A part of a renderer for which nothing can be done; the report of the host says why. */
const nothing = () => ({
    enabled: false,
    forced: false,
    isSettled: true,
    texture: null,
    node: null,
    report: () => [],
    render() {},
    dispose() {},
});

export class Host {
    /** With `await renderer.init()` done. The options are those of `Variants`. */
    static async of(renderer, options = {}) {
        if (!renderer.initialized) await renderer.init();
        return new Host(renderer, options);
    }

    #override = null;
    /** Of each scene. */
    #shadows = new Map();
    #prepasses = new Map();
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
        this.timer = options.timer ?? new Timer(this.backend);
        this.#override = new Override(this);
        this.hooks = new Hooks(renderer, {
            before: (scene, camera) => this.#velocities.get(scene)?.begin(scene, camera),
            wants: (list) => this.#wants(list),
            opaque: (list) => this.#prepasses.get(list.scene)?.draw(list) ?? false,
            drawn: (renderObject) => {
                this.discards.saw(renderObject);
                this.programs.saw(renderObject);
            },
            replaced: (call, draw) => this.#replaced(call, draw),
        });
        this.backend.device.lost.then(({ message }) => {
            this.dispose();
            this.#unfit = `the device is lost${message ? `: ${message}` : ''}`;
        });
    }

    /** `{ view }`: see `Shadows`. A scene that has them keeps those. */
    shadows(scene, options) {
        return this.#part(this.#shadows, scene, () => new Shadows(this, scene, options));
    }

    /** `pass` is a scene whose `overrideMaterial` is set, or has one, as a `PassNode` with an override material. */
    override(pass, options) {
        if (!this.#unfit) this.#override.use(pass, options);
        return pass;
    }

    /** `{ measure, materials, form }`: see `Prepass`. */
    prepass(scene, options) {
        if (this.#prepasses.has(scene))
            throw new TypeError('preshade: this scene has pre-passes: dispose of them before you ask for others');
        return this.#part(this.#prepasses, scene, () => new Prepass(this, options));
    }

    /** The WGSL of both stages that three.js made of a material, or null before it is drawn. */
    text(material, object) {
        return this.programs?.text(material, object) ?? null;
    }

    /** For each material: what is done, what was refused and why. */
    report() {
        if (this.#unfit)
            return [
                row(
                    'all',
                    { name: '', type: 'all', uuid: '' },
                    { state: 'unsupported', reason: this.#unfit, code: 'renderer' },
                ),
            ];
        return this.#parts.flatMap((part) => part.report());
    }

    /** `{ camera, units, transparent, automatic }`: see `Velocity`. A scene that has them keeps those. */
    velocity(scene, options) {
        return this.#part(this.#velocities, scene, () => new Velocity(this, scene, options));
    }

    /** A part that is disposed of. */
    forget(part) {
        for (const parts of [this.#shadows, this.#prepasses, this.#velocities])
            for (const [scene, of] of parts) if (of === part) parts.delete(scene);
    }

    #part(parts, scene, make) {
        if (!scene?.isObject3D) throw new TypeError('preshade: give the scene that you render');
        if (this.#unfit) return nothing();
        if (!parts.has(scene)) parts.set(scene, make());
        return parts.get(scene);
    }

    get #parts() {
        if (this.#unfit) return [];
        return [...this.#shadows.values(), this.#override, ...this.#prepasses.values(), ...this.#velocities.values()];
    }

    #wants(list) {
        if (this.#velocities.get(list.scene)?.isDrawing) return false;
        return this.#prepasses.get(list.scene)?.wants(list) ?? false;
    }

    #replaced(call, draw) {
        if (this.#velocities.get(call.scene)?.draw(call, draw)) return true;
        if (call.material.isShadowPassMaterial) return this.#shadows.get(call.scene)?.draw(call) ?? false;
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
        this.timer?.dispose();
        this.variants?.dispose();
    }
}
