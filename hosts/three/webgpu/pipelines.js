// The pipelines of a plan: those of three.js with other programs and another depth state. Layout of the bindings, vertex
// buffers, targets, samples and the rest of the state are as three.js makes them, by its own function.

import { COMPARE, compareName } from '../compare.js';

const REVERSED = {
    less: 'greater',
    greater: 'less',
    'less-equal': 'greater-equal',
    'greater-equal': 'less-equal',
};

/** WebGPU's comparison for three.js' constant, and back: a reversed depth buffer turns both around. */
export function compareOf(depthFunc, reversed) {
    const name = compareName(depthFunc);
    return reversed ? (REVERSED[name] ?? name) : name;
}

/** Writes nothing: a pass with colour targets needs a fragment stage. */
const NOTHING = { text: '@fragment fn nothing() {}', entry: 'nothing' };

/** Text and entry point of both stages of the pass `role` of a variant. */
export function stages({ passes }, role) {
    const { pass, vertex, fragment } = passes.find((of) => of.pass.role === role);
    return {
        vertex: { text: vertex, entry: pass.vertex },
        fragment: fragment ? { text: fragment, entry: pass.fragment } : NOTHING,
    };
}

/** r186 has another name for it. */
const layoutName = (utils) => (utils.getVertexBufferLayout ? 'getVertexBufferLayout' : 'createShaderVertexBuffers');

/** The layouts of a render object's vertex buffers. */
export function vertexLayouts({ attributeUtils }, renderObject) {
    return attributeUtils[layoutName(attributeUtils)](renderObject);
}

/** Layouts behind the author's, whose attributes at a location that they take are those that the pass has no use for. */
function behind(layouts, buffers) {
    const taken = new Set(buffers.flatMap(({ attributes }) => attributes.map((of) => of.shaderLocation)));
    const left = (of) => of.attributes.filter(({ shaderLocation }) => !taken.has(shaderLocation));
    return [...layouts.map((of) => ({ ...of, attributes: left(of) })), ...buffers];
}

export class Pipelines {
    #backend;
    /** Shader modules by text; a module goes with the last pipeline that holds it. */
    #modules = new Map();

    constructor(backend) {
        this.#backend = backend;
    }

    /**
     * The pipeline of `draw` with other stages (without one: its own) and state. `buffers` are the layouts of vertex
     * buffers behind its own. Resolves to the object that three.js draws by; to `null` where the device refuses it.
     */
    async make(draw, { vertex, fragment }, state) {
        const { compare, write, bias = { constant: 0, slope_scale: 0 }, colorWrite, buffers = [] } = state;
        const backend = this.#backend;
        const reversed = backend.parameters.reversedDepthBuffer === true;
        const own = draw.renderObject.material;
        const sign = reversed ? -1 : 1;
        const offset = own.polygonOffset ? { factor: own.polygonOffsetFactor, units: own.polygonOffsetUnits } : null;
        const biased = bias.constant !== 0 || bias.slope_scale !== 0;
        const material = Object.create(own, {
            depthFunc: { value: COMPARE[reversed ? (REVERSED[compare] ?? compare) : compare] },
            depthTest: { value: true },
            depthWrite: { value: write },
            colorWrite: { value: colorWrite && own.colorWrite },
            polygonOffset: { value: biased || offset !== null },
            polygonOffsetFactor: { value: (offset?.factor ?? 0) + sign * bias.slope_scale },
            polygonOffsetUnits: { value: (offset?.units ?? 0) + sign * bias.constant },
        });
        const pipeline = {
            vertexProgram: vertex ? this.#program(vertex, 'vertex') : draw.pipeline.vertexProgram,
            fragmentProgram: fragment ? this.#program(fragment, 'fragment') : draw.pipeline.fragmentProgram,
        };
        const renderObject = Object.create(draw.renderObject, {
            material: { value: material },
            pipeline: { value: pipeline },
        });
        const pending = [];
        const { attributeUtils } = backend;
        const name = layoutName(attributeUtils);
        const layouts = attributeUtils[name];
        try {
            if (buffers.length) attributeUtils[name] = (of) => behind(layouts.call(attributeUtils, of), buffers);
            // three.js logs what the device says of a broken pipeline.
            backend.pipelineUtils.createRenderPipeline(renderObject, pending);
        } finally {
            if (buffers.length) delete attributeUtils[name];
        }
        await Promise.all(pending);
        const { pipeline: compiled, error } = backend.get(pipeline);
        return compiled && !error ? pipeline : null;
    }

    #program({ text, entry }, stage) {
        const program = { code: text, stage, name: 'preshade' };
        let module = this.#modules.get(text)?.deref();
        if (!module) {
            module = this.#backend.device.createShaderModule({ label: 'preshade', code: text });
            this.#modules.set(text, new WeakRef(module));
            for (const [key, of] of this.#modules) if (!of.deref()) this.#modules.delete(key);
        }
        this.#backend.get(program).module = { module, entryPoint: entry };
        return program;
    }
}
