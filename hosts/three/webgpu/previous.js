// What uniform and vertex buffers held in the frame before: uniforms in a bind group of their own behind those of
// three.js, vertices in buffers behind its own.

import { StaticDrawUsage } from 'three/webgpu';

/** After so many frames in which nothing asked for it, a copy goes. */
const UNUSED = 30;

/** Copies of the content of three.js' buffers, one frame old. */
export class PreviousBuffers {
    #device;
    #states = new Map();
    #frame = 0;
    #picture = 0;

    constructor(device) {
        this.#device = device;
    }

    /** From here on another picture is drawn: of the same frame, or of a new one. */
    next(isNewFrame) {
        this.#picture++;
        if (!isNewFrame) return;
        this.#frame++;
        for (const [source, { frame, gpu }] of this.#states) {
            if (this.#frame - frame < UNUSED) continue;
            gpu.destroy();
            this.#states.delete(source);
        }
    }

    /**
     * A buffer with what `source`, a uniform buffer or an attribute, held in the last picture of the frame before; the
     * first time, and the first time after a frame that did not ask for it, what it holds now.
     */
    of(source) {
        const { buffer, byteOffset, byteLength } = source.array ?? source.buffer;
        const now = new Uint8Array(buffer, byteOffset, byteLength);
        let state = this.#states.get(source);
        if (state?.last.length !== now.length) {
            state?.gpu.destroy();
            const size = Math.ceil(now.length / 16) * 16;
            const usage = (source.array ? GPUBufferUsage.VERTEX : GPUBufferUsage.UNIFORM) | GPUBufferUsage.COPY_DST;
            const gpu = this.#device.createBuffer({ label: 'preshade previous', size, usage });
            state = { gpu, last: now.slice(), frame: this.#frame - 1, picture: this.#picture - 1 };
            this.#states.set(source, state);
        }
        if (state.frame < this.#frame - 1) state.last.set(now);
        if (state.frame !== this.#frame) this.#device.queue.writeBuffer(state.gpu, 0, state.last);
        if (state.picture !== this.#picture) state.last.set(now);
        Object.assign(state, { frame: this.#frame, picture: this.#picture });
        return state.gpu;
    }

    dispose() {
        for (const { gpu } of this.#states.values()) gpu.destroy();
        this.#states.clear();
    }
}

const dataOf = (attribute) => (attribute.isInterleavedBufferAttribute ? attribute.data : attribute);

/**
 * The vertex buffers of a render object that may change from frame to frame, by their place, each with the names of its
 * attributes: the matrices of instances, and what the CPU moves.
 */
export function movingBuffers(renderObject) {
    const { object } = renderObject;
    const attributes = renderObject.getAttributes();
    const names = renderObject.getNodeBuilderState().nodeAttributes.map(({ name }) => name);
    // three.js leaves out attributes that the geometry has not.
    if (names.length !== attributes.length) return [];
    return renderObject.getVertexBuffers().flatMap((data, index) => {
        if (data !== object.instanceMatrix && (data.usage ?? StaticDrawUsage) === StaticDrawUsage) return [];
        if (!(data.array instanceof Float32Array)) return [];
        return [{ index, data, names: names.filter((_, i) => dataOf(attributes[i]) === data) }];
    });
}

/**
 * What a plan asks of the frame before: `uniforms`, where each buffer is the author's; `vertices`, the layouts of the
 * vertex buffers; and the text with the uniforms in the bind group `group`, which three.js has not. `layouts` are those
 * of the author's vertex buffers. Throws where that is not done here.
 */
export function moved({ pass, vertex, fragment }, group, moving, layouts) {
    const asked = pass.bindings.filter(({ source }) => source.from === 'previous');
    const text = (of) =>
        asked.reduce((text, { group: g, binding: b, name, kind }, index) => {
            if (kind !== 'uniform') throw new Error(`a ${kind} buffer of the frame before`);
            const declared = `@group(${g}) @binding(${b}) var<uniform> ${name}:`;
            return text.replace(declared, `@group(${group}) @binding(${index}) var<uniform> ${name}:`);
        }, of);
    const locations = new Map(pass.attributes.map((of) => [of.previous_of, of.location]));
    const vertices = moving.map(({ index }) => ({
        ...layouts[index],
        attributes: layouts[index].attributes
            .filter(({ shaderLocation }) => locations.has(shaderLocation))
            .map((of) => ({ ...of, shaderLocation: locations.get(of.shaderLocation) })),
    }));
    return {
        uniforms: asked.map(({ source }) => [source.group, source.binding]),
        vertices,
        pass,
        vertex: text(vertex),
        fragment: fragment && text(fragment),
    };
}
