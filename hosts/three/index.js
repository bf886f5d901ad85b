// Passes of the real geometry for three.js: each is derived by preshade from the shader that three.js made of a material.

/** What preshade does for one renderer. */
export class Preshade {
    #host;

    constructor(host) {
        this.#host = host;
    }

    /** For a `WebGLRenderer` or a `WebGPURenderer`. Nothing is drawn otherwise until you call a function below. */
    static async of(renderer, options = {}) {
        if (renderer?.isWebGPURenderer) {
            const { WebGPUHost } = await import('./webgpu/host.js');
            return new Preshade(await WebGPUHost.of(renderer, options));
        }
        if (!renderer?.isWebGLRenderer && !renderer?.getContext)
            throw new TypeError('preshade: give a WebGLRenderer or a WebGPURenderer of three.js');
        const { WebGLHost } = await import('./webgl/host.js');
        return new Preshade(await WebGLHost.of(renderer, options));
    }

    /** Right shadows of everything in `scene` that moves vertices or cuts holes, of objects and materials added later too. */
    shadows(scene, options) {
        if (!scene?.isObject3D) throw new TypeError('preshade: `shadows` takes the scene that you render');
        return this.#host.shadows(scene, options);
    }

    /** Normals and depth of the real geometry in a pass that overrides materials. Returns the pass. */
    override(pass) {
        if (!pass) throw new TypeError('preshade: `override` takes a pass');
        return this.#host.override(pass);
    }

    /** A depth pre-pass for each material for which it pays on this device. */
    prepass(scene, options) {
        return this.#host.prepass(scene, options);
    }

    /** Each material drawn by any recipe of preshade's passes. */
    rewrite(scene, options) {
        if (!this.#host.rewrite) throw new TypeError('preshade: rewrite needs a WebGLRenderer');
        return this.#host.rewrite(scene, options);
    }

    /** Velocities of the real geometry. */
    velocity(scene, options) {
        return this.#host.velocity(scene, options);
    }

    /** For each material: what is done, what was refused and why, what it gained, how long it took to compile. */
    report() {
        return this.#host.report();
    }

    /** Resolves when no variant is being made. */
    settled() {
        return this.#host.settled();
    }

    /** Ends the worker, releases every program and texture, and has three.js draw as always. */
    dispose() {
        this.#host.dispose();
    }
}
