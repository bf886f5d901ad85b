// Whether the driver keeps what a plan rests on: its self-test, drawn once into a depth buffer of its own, with each draw in an occlusion query.

import { DepthTexture, UnsignedIntType, Vector4, WebGLRenderTarget } from 'three';
import { DEPTH_TYPE } from './attachments.js';
import { COMPARE } from '../compare.js';
import { drawItem, sizeOf, within } from './frames.js';

/** Away from the viewer, as far as rounding may go. */
const PUSHED = { polygonOffsetFactor: 2, polygonOffsetUnits: 64 };

export class SelfTest {
    #host;
    #planned;
    #test;
    #materials;
    #targetOf;
    #runs = [];

    /**
     * `test`: the `self_test` of a plan; `runs`: more of them, whose draws may be pushed away by a depth bias. `materials`: those of its passes, by role, and `own`, as the author has it.
     * `targetOf(name)`: what to draw into for an attachment of the plan.
     */
    constructor(host, planned, test, runs, materials, targetOf) {
        this.#host = host;
        this.#planned = planned;
        this.#test = { ...test, runs: [...test.runs, ...runs] };
        this.#materials = materials;
        this.#targetOf = targetOf;
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
            const cleared = new Set();
            const queries = draws.map((draw) => {
                const { attachment = name } = draw;
                depth.setClear(attachment === name ? clear : 1);
                const query = within(renderer, attachment === name ? target : this.#targetOf(attachment), () => {
                    // The first draw of a run into an attachment clears it.
                    if (!cleared.has(attachment)) renderer.clear(true, true, false);
                    cleared.add(attachment);
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

    #query({ role, original, compare, write, isPushed = false }, items, scene, camera) {
        const { renderer } = this.#host;
        const gl = renderer.getContext();
        const material = this.#materials[original ? 'own' : role];
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
