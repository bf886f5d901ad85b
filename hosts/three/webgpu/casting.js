// An author's material as another pass draws it, with all that three.js prepares for it: nodes, uniforms, textures,
// instancing, skinning and the rest. The pass that is drawn decides about lights, side and depth; everything else is
// read through to the author's object, so that what is set there later counts here too.

import { DirectionalLight, NoBlending, LessEqualDepth, TSL } from 'three/webgpu';

/** One light without a shadow: nodes of the lighting are built (some of them discard), but no shadow map is read. */
let plain = null;
export const plainLight = () => (plain ??= TSL.lights([new DirectionalLight()]));

const value = (value) => ({ value, writable: true, configurable: true, enumerable: true });

/**
 * @param {object} overrides Properties that the pass has of its own, and `name`, which tells passes of one author apart.
 */
export function derivedMaterial(author, { name, ...overrides }) {
    const own = {
        // three.js hangs the release of what it makes of a material on its listeners.
        _listeners: undefined,
        name: `${author.name} (${name})`,
        lightsNode: null,
        customProgramCacheKey() {
            return `preshade ${name} ${author.uuid} ${author.version} ${author.customProgramCacheKey()}`;
        },
        ...overrides,
    };
    return Object.create(author, Object.fromEntries(Object.entries(own).map(([key, of]) => [key, value(of)])));
}

/** The author's material as three.js' shadow pass has it draw: the author's wishes for shadows are nodes of their own. */
export function castingMaterial(author) {
    return derivedMaterial(author, {
        name: 'shadow',
        positionNode: author.castShadowPositionNode ?? author.positionNode ?? null,
        maskNode: author.maskShadowNode ?? author.maskNode ?? null,
        side: author.side,
        transparent: false,
        blending: NoBlending,
        fog: false,
        wireframe: false,
        depthTest: true,
        depthWrite: true,
        depthFunc: LessEqualDepth,
        stencilWrite: false,
        polygonOffset: false,
        alphaToCoverage: false,
        colorWrite: true,
        mrtNode: null,
    });
}

/** Milliseconds of a frame in which render objects are made. What is left is drawn by three.js until a later frame. */
const BUDGET = 4;

/** Render objects of derived materials, made a few in each frame. */
export class Prepared {
    #renderer;
    #passId;
    /** Contexts in which an object has one, by material and object. */
    #made = new WeakMap();
    #frame = -1;
    #spent = 0;

    constructor(renderer, passId) {
        this.#renderer = renderer;
        this.#passId = passId;
    }

    /**
     * The render object of `material` in place of the one that three.js draws now, with its uniforms up to date; `null`
     * where its time has not come. It has no pipeline: three.js would compile the whole program.
     */
    of(material, call) {
        const { _currentRenderContext: context, _nodes: nodes } = this.#renderer;
        let objects = this.#made.get(material);
        if (!objects) this.#made.set(material, (objects = new WeakMap()));
        let contexts = objects.get(call.object);
        if (!contexts) objects.set(call.object, (contexts = new WeakSet()));
        if (contexts.has(context)) return this.#update(material, call);
        const { frameId } = nodes.nodeFrame;
        if (this.#frame !== frameId) [this.#frame, this.#spent] = [frameId, 0];
        if (this.#spent > BUDGET) return null;
        const began = performance.now();
        const of = this.#update(material, call);
        this.#spent += performance.now() - began;
        contexts.add(context);
        return of;
    }

    #update(material, { object, scene, camera, group, clippingContext }) {
        const renderer = this.#renderer;
        const source = renderer._currentSourceMaterial;
        const context = renderer._currentRenderContext;
        const lights = plainLight();
        renderer._currentSourceMaterial = null;
        try {
            const id = this.#passId;
            const of = renderer._objects.get(object, material, scene, camera, lights, context, clippingContext, id);
            of.drawRange = object.geometry.drawRange;
            of.group = group;
            renderer._nodes.updateBefore(of);
            renderer._geometries.updateForRender(of);
            renderer._nodes.updateForRender(of);
            renderer._bindings.updateForRender(of);
            return of;
        } finally {
            renderer._currentSourceMaterial = source;
        }
    }
}
