// How many fragments pass the depth test for each pixel, in three.js' own order: what is shaded where there is no pre-pass. WebGL 2 has no query that counts samples (`ANY_SAMPLES_PASSED` is
// only yes or no), so the depth passes are drawn into a small target whose stencil buffer counts, and its bits are added up as colours.

import {
    AddEquation,
    AlwaysDepth,
    BufferGeometry,
    CustomBlending,
    AlwaysStencilFunc,
    EqualStencilFunc,
    GLSL3,
    IncrementStencilOp,
    KeepStencilOp,
    Mesh,
    NearestFilter,
    OneFactor,
    RawShaderMaterial,
    WebGLRenderTarget,
} from 'three';
import { drawItem, within } from './frames.js';

const SIZE = 64;
const BITS = 6;

export class Overdraw {
    #host;
    #target = null;
    #quad = null;
    #pixels = new Uint8Array(SIZE * SIZE * 4);
    #isReading = false;

    constructor(host) {
        this.#host = host;
    }

    /** In a frame: counts these, `{ item, planned }` of each. Resolves to fragments per pixel of those that have any; null where it cannot be told now. */
    count(draws, scene, camera) {
        if (this.#isReading) return Promise.resolve(null);
        const { renderer } = this.#host;
        this.#target ??= new WebGLRenderTarget(SIZE, SIZE, {
            stencilBuffer: true,
            minFilter: NearestFilter,
            magFilter: NearestFilter,
        });
        this.#quad ??= quad();
        within(renderer, this.#target, () => {
            // The page's clear colour stays set.
            renderer.state.buffers.color.setMask(true);
            renderer.getContext().clearBufferfv(renderer.getContext().COLOR, 0, [0, 0, 0, 0]);
            renderer.clear(false, true, true);
            for (const { item, planned } of draws) this.#counted(item, planned, scene, camera);
            for (let bit = 0; bit < BITS; bit++) this.#add(1 << bit, camera);
        });
        return this.#read();
    }

    #counted(item, planned, scene, camera) {
        const material = planned.depth ?? planned.main;
        const { depthFunc, polygonOffset, colorWrite } = material;
        const state = {
            depthFunc: item.material.depthFunc,
            polygonOffset: false,
            colorWrite: false,
            stencilWrite: true,
            stencilWriteMask: 0xff,
            stencilFunc: AlwaysStencilFunc,
            stencilRef: 0,
            stencilFuncMask: 0xff,
            stencilFail: KeepStencilOp,
            stencilZFail: KeepStencilOp,
            stencilZPass: IncrementStencilOp,
        };
        for (const [name, value] of Object.entries(state)) define(material, name, value);
        planned.refresh(material);
        drawItem(this.#host, scene, camera, item, material);
        for (const name of Object.keys(state)) if (name.startsWith('stencil')) delete material[name];
        Object.assign(material, { depthFunc, polygonOffset, colorWrite });
    }

    #add(value, camera) {
        const { mesh, material } = this.#quad;
        Object.assign(material, { stencilRef: value, stencilFuncMask: value, uniformsNeedUpdate: true });
        material.uniforms.value.value = value / 255;
        const item = { object: mesh, geometry: mesh.geometry, group: null, material };
        drawItem(this.#host, null, camera, item, material);
    }

    async #read() {
        this.#isReading = true;
        try {
            const { renderer } = this.#host;
            await renderer.readRenderTargetPixelsAsync(this.#target, 0, 0, SIZE, SIZE, this.#pixels);
            let fragments = 0;
            for (let i = 0; i < this.#pixels.length; i += 4) fragments += this.#pixels[i];
            return fragments / (SIZE * SIZE);
        } catch {
            return null;
        } finally {
            this.#isReading = false;
        }
    }

    dispose() {
        this.#target?.dispose();
        this.#quad?.mesh.geometry.dispose();
        this.#quad?.material.dispose();
        this.#target = this.#quad = null;
    }
}

const define = (object, name, value) =>
    Object.defineProperty(object, name, { value, writable: true, configurable: true, enumerable: true });

/** Covers the target, and adds to its red where the stencil has a bit. */
function quad() {
    const geometry = new BufferGeometry();
    geometry.setDrawRange(0, 3);
    const material = new RawShaderMaterial({
        glslVersion: GLSL3,
        uniforms: { value: { value: 0 } },
        // No attributes: three.js would upload them only for what is in a scene.
        vertexShader:
            'void main() { gl_Position = vec4(gl_VertexID == 1 ? 3.0 : -1.0, gl_VertexID == 2 ? 3.0 : -1.0, 0.0, 1.0); }',
        fragmentShader:
            'precision highp float; uniform float value; out vec4 color; void main() { color = vec4(value); }',
        depthFunc: AlwaysDepth,
        depthTest: false,
        depthWrite: false,
        blending: CustomBlending,
        blendEquation: AddEquation,
        blendSrc: OneFactor,
        blendDst: OneFactor,
        stencilWrite: true,
        stencilFunc: EqualStencilFunc,
        stencilWriteMask: 0,
    });
    const mesh = new Mesh(geometry, material);
    return { mesh, material };
}
