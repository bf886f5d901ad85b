// Whether the driver keeps what a plan rests on: its self-test, drawn once into a depth buffer of its own, with each draw in an occlusion query.

import { DepthTexture, FloatType, UnsignedIntType, UnsignedShortType, Vector4, WebGLRenderTarget } from 'three';
import { COMPARE } from './derived.js';
import { drawItem, sizeOf, within } from './frames.js';

const DEPTH_TYPE = { depth16unorm: UnsignedShortType, depth24plus: UnsignedIntType, depth32float: FloatType };

/** Away from the viewer, as far as rounding may go. */
const PUSHED = { polygonOffsetFactor: 2, polygonOffsetUnits: 64 };

export class SelfTest {
    #host;
    #planned;
    #test;
    #materials;
    #runs = [];

    /** `test`: the `self_test` of a plan; `runs`: more of them, whose draws may be pushed away by a depth bias. `materials`: by role. */
    constructor(host, planned, test, runs, materials) {
        this.#host = host;
        this.#planned = planned;
        this.#test = { ...test, runs: [...test.runs, ...runs] };
        this.#materials = materials;
    }

    /** Draws it, in a frame, with these items in view. */
    run(items, scene, frame) {
        const { renderer } = this.#host;
        const { width, height } = sizeOf(renderer, frame.target);
        const { name, format, clear } = this.#test.attachment;
        const depthTexture = new DepthTexture(width, height, DEPTH_TYPE[format] ?? UnsignedIntType);
        const target = new WebGLRenderTarget(width, height, { depthTexture });
        target.viewport.copy(renderer.getCurrentViewport(new Vector4()));
        const { depth } = renderer.state.buffers;
        this.#runs = this.#test.runs.map(({ failure, draws }) => {
            const queries = draws.map((draw, i) => {
                if ((draw.attachment ?? name) !== name)
                    throw new Error(`preshade: a self-test draws into ${draw.attachment}`);
                depth.setClear(clear);
                const query = within(renderer, target, () => {
                    // Of a run the first draw clears.
                    if (i === 0) renderer.clear(true, true, false);
                    return this.#query(draw, items, scene, frame.camera);
                });
                depth.setClear(1);
                return { query, samples: draw.samples };
            });
            return { failure, queries };
        });
        target.dispose();
        depthTexture.dispose();
    }

    #query({ role, compare, write, isPushed = false }, items, scene, camera) {
        const { renderer } = this.#host;
        const gl = renderer.getContext();
        const material = this.#materials[role];
        const { depthFunc, depthWrite, polygonOffset, polygonOffsetFactor, polygonOffsetUnits } = material;
        const pushed = isPushed ? { polygonOffset: true, ...PUSHED } : {};
        Object.assign(material, { depthFunc: COMPARE[compare], depthWrite: write, ...pushed });
        const query = gl.createQuery();
        gl.beginQuery(gl.ANY_SAMPLES_PASSED, query);
        for (const item of items) {
            this.#planned.refresh(material);
            drawItem(this.#host, scene, camera, item, material);
        }
        gl.endQuery(gl.ANY_SAMPLES_PASSED);
        Object.assign(material, { depthFunc, depthWrite, polygonOffset, polygonOffsetFactor, polygonOffsetUnits });
        return query;
    }

    /**
     * `kept`, `broken` with the plan's word for it, or `unseen`: nothing that could show it was in view. Null until the queries have answered, which takes another task at least.
     *
     * @returns {{ verdict: 'kept' | 'broken' | 'unseen', failure?: string } | null}
     */
    result() {
        const gl = this.#host.renderer.getContext();
        const all = this.#runs.flatMap(({ queries }) => queries);
        if (!all.every(({ query }) => gl.getQueryParameter(query, gl.QUERY_RESULT_AVAILABLE))) return null;
        let unseen = false;
        for (const { failure, queries } of this.#runs) {
            for (const { query, samples } of queries) {
                const passed = Boolean(gl.getQueryParameter(query, gl.QUERY_RESULT));
                if (passed === (samples === 'some')) continue;
                if (samples === 'none') return { verdict: 'broken', failure };
                unseen = true;
                break;
            }
        }
        return { verdict: unseen ? 'unseen' : 'kept' };
    }

    dispose() {
        const gl = this.#host.renderer.getContext();
        for (const { queries } of this.#runs) for (const { query } of queries) gl.deleteQuery(query);
        this.#runs.length = 0;
    }
}
