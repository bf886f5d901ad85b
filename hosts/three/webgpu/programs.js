// The WGSL that three.js made of a material for an object, and the state it is drawn with, as preshade asks for both.

import { BackSide, DoubleSide, LessEqualDepth, NoBlending, NormalBlending } from 'three/webgpu';
import { compareOf } from './pipelines.js';

/** Both stages as `Variants` takes them, with the key by which they are known. */
export class Programs {
    #known = new WeakMap();
    #named;
    /** By author's material: programs of the last draw, and of each object. */
    #seen = new WeakMap();

    constructor(named) {
        this.#named = named;
    }

    /** A draw of three.js. Nothing here keeps a program alive. */
    saw({ material, object, pipeline, _sourceMaterial: source }) {
        if (source !== null) return;
        let seen = this.#seen.get(material);
        if (!seen) this.#seen.set(material, (seen = { last: null, objects: new WeakMap() }));
        let of = seen.objects.get(object);
        if (of?.deref() !== pipeline) seen.objects.set(object, (of = new WeakRef(pipeline)));
        seen.last = of;
    }

    /** `{ vertex, fragment }` of the last draw of a material, or of that of an object. Null before it is drawn. */
    text(material, object) {
        const seen = this.#seen.get(material);
        const { vertexProgram, fragmentProgram } = (object ? seen?.objects.get(object) : seen?.last)?.deref() ?? {};
        return vertexProgram ? { vertex: vertexProgram.code, fragment: fragmentProgram.code } : null;
    }

    /** Of a pipeline of three.js. The object is the same for the same programs. */
    of({ vertexProgram, fragmentProgram }) {
        let byFragment = this.#known.get(vertexProgram);
        if (!byFragment) this.#known.set(vertexProgram, (byFragment = new WeakMap()));
        let texts = byFragment.get(fragmentProgram);
        if (!texts) {
            texts = this.#texts(vertexProgram.code, fragmentProgram.code);
            byFragment.set(fragmentProgram, texts);
        }
        return texts;
    }

    /** Of a render object, whether it has a pipeline or not. */
    built(renderObject) {
        const state = renderObject.getNodeBuilderState();
        let texts = this.#known.get(state);
        if (!texts) {
            texts = this.#texts(state.vertexShader, state.fragmentShader);
            this.#known.set(state, texts);
        }
        return texts;
    }

    #texts(vertex, fragment) {
        return { vertex, fragment, language: 'wgsl', key: this.#named(`${vertex}\0${fragment}`) };
    }
}

/**
 * What is drawn of programs in a state, by text and state: one for all render objects that three.js would draw with one
 * pipeline. Entries live as long as a render object or a report holds them.
 */
export class Entries {
    #make;
    #backend;
    #programs;
    #known = new Map();
    #ofObject = new WeakMap();

    constructor({ backend, programs }, make) {
        this.#make = make;
        this.#backend = backend;
        this.#programs = programs;
    }

    /**
     * `what` tells apart what is drawn otherwise than by text and state. `isNew(key, entry)` is called where the entry was
     * not that of the render object before.
     */
    of(renderObject, what, isNew) {
        const last = this.#ofObject.get(renderObject);
        // Hashes no text and joins no key in each frame. The render object has no pipeline of three.js.
        if (!this.#backend.needsRenderUpdate(renderObject) && last) return last;
        const key = `${this.#programs.built(renderObject).key} ${what} ${this.#backend.getRenderCacheKey(renderObject)}`;
        let entry = this.#known.get(key)?.deref();
        if (!entry) {
            entry = this.#make();
            for (const [of, ref] of this.#known) if (!ref.deref()) this.#known.delete(of);
            this.#known.set(key, new WeakRef(entry));
        }
        this.#ofObject.set(renderObject, entry);
        isNew(key, entry);
        return entry;
    }

    clear() {
        this.#known.clear();
        this.#ofObject = new WeakMap();
    }
}

/** The variant of a render object's texts, once it is made; `null` where the render object is in another state by then. */
export async function made({ variants, backend }, renderObject, texts, request) {
    const key = backend.getRenderCacheKey(renderObject);
    const found = variants.get(texts, request);
    await found.done;
    return backend.getRenderCacheKey(renderObject) === key ? found : null;
}

/** What a part waits for. */
export class Pending {
    #all = new Set();

    /** Errors are told to `failed`. */
    add(promise, failed) {
        const done = promise.catch((error) => failed(error.message)).finally(() => this.#all.delete(done));
        this.#all.add(done);
    }

    async settled() {
        while (this.#all.size) await Promise.all(this.#all);
    }
}

/** The author's own material; that of an override is in `material`. */
export const authorOf = ({ material, _sourceMaterial: source }) => source ?? material;

/** The options of preshade's `rewrite` that tell the pipeline state of a render object. */
export function stateOf(renderObject, backend) {
    const { material, context } = renderObject;
    const reversed = backend.parameters.reversedDepthBuffer === true;
    const samples = backend.utils.getSampleCountRenderContext(context);
    return {
        language: 'wgsl',
        emit: 'wgsl',
        clip: 'zero-to-one',
        cull: material.side === DoubleSide ? 'none' : material.side === BackSide ? 'front' : 'back',
        depthFormat: backend.utils.getCurrentDepthStencilFormat(context),
        depthCompare: material.depthTest ? compareOf(material.depthFunc, reversed) : 'always',
        ...(material.depthWrite ? {} : { noDepthWrite: true }),
        ...(reversed ? { reversedZ: true } : {}),
        ...(samples > 1 ? { samples } : {}),
        ...(samples > 1 && material.alphaToCoverage ? { alphaToCoverage: true } : {}),
    };
}

/** Why a draw is none that a pre-pass is for; `null` where it is. */
export function unfitForPrepass({ object, material, context, camera }) {
    if (!object.isMesh) return 'it draws lines, points or sprites';
    if (!context.depth) return 'the target has no depth buffer';
    if (camera.isArrayCamera) return 'an array camera draws it';
    if (material.wireframe) return 'it is a wireframe';
    if (material.transparent) return 'it is transparent';
    if (material.transmission > 0 || material.transmissionNode || material.backdropNode)
        return 'it shows what is behind it';
    if (![NormalBlending, NoBlending].includes(material.blending)) return 'it is blended';
    if (!material.depthTest || !material.depthWrite) return 'it does not test or does not write depth';
    // With LESS the first of two surfaces at one depth is seen, and with EQUAL the last.
    if (material.depthFunc !== LessEqualDepth) return 'its depth comparison is another than less-equal';
    if (material.stencilWrite) return 'it uses the stencil buffer';
    return null;
}
