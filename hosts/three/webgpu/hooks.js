// The places where preshade looks into WebGPURenderer. All of them are here: five methods of the renderer and
// its backend, replaced on the objects themselves, so that `dispose` gives the renderer back as it was.
//
// While `Renderer._renderObjects` draws the opaque list of a render, the calls of `backend.draw` are recorded, and
// encoded when the list is complete. three.js has then done all its work (nodes, bindings, pipelines, callbacks of the
// objects) once, and every draw can be encoded again, ahead of all others, with another pipeline.

const METHODS = [
    '_renderScene',
    '_currentSourceMaterial',
    '_renderObjects',
    '_renderObjectDirect',
    '_pipelines',
    '_nodes',
    '_objects',
    '_bindings',
];
const BACKEND = ['draw', '_draw', 'get', 'copyFramebufferToTexture', 'createProgram', 'pipelineUtils'];

/** Why this renderer is none that the hooks fit; `null` where they do. */
export function unfit(renderer) {
    const backend = renderer.backend;
    if (backend?.isWebGPUBackend !== true) return 'the renderer draws with its WebGL 2 backend';
    if (!backend.device) return 'the renderer has no device: await renderer.init() first';
    if (Object.hasOwn(renderer, '_renderObjects'))
        return 'another Preshade, or another library, draws with this renderer';
    const lacks = [
        ...METHODS.filter((name) => !(name in renderer)),
        ...BACKEND.filter((name) => !(name in backend)).map((name) => `backend.${name}`),
    ];
    return lacks.length ? `this version of three.js has no ${lacks.join(', ')}` : null;
}

/** A call of `backend.draw` that waits for its turn. A render object may be drawn again with another group. */
class Draw {
    constructor(renderObject, info) {
        this.renderObject = renderObject;
        this.info = info;
        this.pipeline = renderObject.pipeline;
        this.group = renderObject.group;
        this.drawRange = renderObject.drawRange;
    }

    /** Runs `encode` while the render object is as it was when three.js drew it. */
    replay(encode, pipeline = this.pipeline) {
        const { renderObject } = this;
        const { group, drawRange } = renderObject;
        const own = renderObject.pipeline;
        Object.assign(renderObject, { pipeline, group: this.group, drawRange: this.drawRange });
        try {
            encode(renderObject);
        } finally {
            Object.assign(renderObject, { pipeline: own, group, drawRange });
        }
    }
}

export class Hooks {
    #renderer;
    #backend;
    #lists = [];

    /**
     * `before(scene, camera)`: called ahead of each render.
     *
     * `opaque(list)`: called with the draws of an opaque list, `{ draws, scene, camera, context }`; answers whether it
     * encoded them. `wants(list)`: whether the list is to be recorded at all. `drawn(renderObject)`: any draw that
     * three.js makes of an author's material. `replaced(call, draw)`: an object that three.js is to draw, `{ object,
     * material, scene, camera, lightsNode, group, clippingContext }`; answers whether it is drawn, for example by
     * `draw` with another material.
     */
    constructor(renderer, { before, wants, opaque, drawn, replaced }) {
        this.#renderer = renderer;
        const backend = (this.#backend = renderer.backend);
        const renderObjects = renderer._renderObjects;
        const lists = this.#lists;
        const flush = (list) => {
            const draws = list.draws.splice(0);
            if (draws.length > 0 && !opaque({ ...list, draws })) for (const of of draws) this.encode(of);
        };

        const renderScene = renderer._renderScene;
        renderer._renderScene = function (scene, camera) {
            before(scene, camera);
            return renderScene.apply(this, arguments);
        };
        renderer._renderObjects = function (items, camera, scene, lightsNode, passId = null) {
            const context = this._currentRenderContext;
            const list = { draws: [], items, scene, camera, context };
            const isRecorded = this._currentRenderBundle === null && passId === null && wants(list, this);
            if (!isRecorded) return renderObjects.apply(this, arguments);
            lists.push(list);
            try {
                renderObjects.apply(this, arguments);
            } finally {
                lists.pop();
            }
            flush(list);
        };
        backend.draw = function (renderObject, info) {
            const list = lists.at(-1);
            drawn(renderObject);
            if (list && list.context === renderObject.context) list.draws.push(new Draw(renderObject, info));
            else Object.getPrototypeOf(this).draw.call(this, renderObject, info);
        };
        const direct = renderer._renderObjectDirect;
        renderer._renderObjectDirect = function (
            object,
            material,
            scene,
            camera,
            lightsNode,
            group,
            clippingContext,
            id,
        ) {
            const call = { object, material, scene, camera, lightsNode, group, clippingContext };
            const other = (of) =>
                direct.call(this, object, of.material, scene, camera, of.lightsNode, group, clippingContext, id);
            if (this._currentRenderBundle !== null || !replaced(call, other)) other(call);
        };
        // Some nodes read what is drawn so far.
        backend.copyFramebufferToTexture = function (texture, context) {
            for (const list of lists) if (list.context === context) flush(list);
            return Object.getPrototypeOf(this).copyFramebufferToTexture.apply(this, arguments);
        };
    }

    /** Encodes a recorded draw as three.js does, with `pipeline` in place of its own. */
    encode(draw, pipeline = draw.pipeline) {
        const { prototype } = this.#backend.constructor;
        draw.replay((renderObject) => prototype.draw.call(this.#backend, renderObject, draw.info), pipeline);
    }

    /** Encodes the geometry and the bindings of a recorded draw, into `pass`: no occlusion query, no other camera. */
    encodeInto(draw, pipeline, pass, sets, info = draw.info) {
        const backend = this.#backend;
        const { pipeline: compiled, error } = backend.get(pipeline);
        if (!compiled || error) return;
        draw.replay((of) => {
            const parameters = of.getDrawParameters();
            if (parameters === null) return;
            const data = backend.get(of.context);
            backend._draw(of, info, data, compiled, of.getBindings(), of.getVertexBuffers(), parameters, pass, sets);
        });
    }

    dispose() {
        delete this.#renderer._renderScene;
        delete this.#renderer._renderObjects;
        delete this.#renderer._renderObjectDirect;
        delete this.#backend.draw;
        delete this.#backend.copyFramebufferToTexture;
    }
}
