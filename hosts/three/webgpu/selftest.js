// The self-test of a plan: each run draws into a depth buffer of its own, and occlusion queries tell whether samples
// passed. It is encoded while three.js draws the frame, with the bindings of one of its draws.

/** Nothing of the self-test counts in the renderer's statistics. */
const NO_INFO = { update() {} };

/**
 * @returns {Promise<{ verdict: 'kept' | 'broken' | 'unseen', failure?: string }>} `unseen`: the draw is out of view.
 */
export async function selfTest({ backend, hooks }, draw, { attachment }, runs) {
    const { device } = backend;
    const { context } = draw.renderObject;
    const count = runs.reduce((sum, run) => sum + run.draws.length, 0);
    const queries = device.createQuerySet({ label: 'preshade self-test', type: 'occlusion', count });
    const usage = GPUBufferUsage;
    const resolved = device.createBuffer({ size: 8 * count, usage: usage.QUERY_RESOLVE | usage.COPY_SRC });
    const read = device.createBuffer({ size: 8 * count, usage: usage.MAP_READ | usage.COPY_DST });
    const targets = new Targets(backend, context);
    const encoder = device.createCommandEncoder({ label: 'preshade self-test' });
    let index = 0;
    for (const run of runs) {
        const pass = encoder.beginRenderPass(targets.descriptor(attachment.clear, queries));
        const { x, y, width, height, minDepth, maxDepth } = context.viewportValue;
        if (context.viewport) pass.setViewport(x, y, width, height, minDepth, maxDepth);
        const sets = { attributes: {}, bindingGroups: [], pipeline: null, index: null };
        for (const { pipeline } of run.draws) {
            pass.beginOcclusionQuery(index++);
            hooks.encodeInto(draw, pipeline, pass, sets, NO_INFO);
            pass.endOcclusionQuery();
        }
        pass.end();
    }
    encoder.resolveQuerySet(queries, 0, count, resolved, 0);
    encoder.copyBufferToBuffer(resolved, 0, read, 0, 8 * count);
    device.queue.submit([encoder.finish()]);
    try {
        await read.mapAsync(GPUMapMode.READ);
        const counts = new BigUint64Array(read.getMappedRange());
        return judge(runs, counts);
    } finally {
        for (const of of [queries, resolved, read, targets]) of.destroy();
    }
}

/** A draw that should leave samples and does not is out of view, or covered by nothing of its own: no verdict. */
function judge(runs, counts) {
    let index = 0;
    let result = { verdict: 'kept' };
    for (const { failure, draws } of runs) {
        for (const { samples } of draws) {
            const passed = counts[index++] > 0n;
            if (passed === (samples === 'some') || result.verdict === 'broken') continue;
            if (samples === 'some') result = { verdict: 'unseen' };
            else if (result.verdict === 'kept') result = { verdict: 'broken', failure };
        }
    }
    return result;
}

/** Attachments like those of a render context, that nobody else has. */
class Targets {
    #textures = [];
    #colors;
    #depth;

    constructor(backend, context) {
        const { device, utils } = backend;
        const size = { width: context.width, height: context.height };
        const sampleCount = utils.getSampleCountRenderContext(context);
        const make = (format) => {
            const texture = device.createTexture({
                size,
                format,
                sampleCount,
                usage: GPUTextureUsage.RENDER_ATTACHMENT,
            });
            this.#textures.push(texture);
            return texture.createView();
        };
        this.#colors = utils.getCurrentColorFormats(context).map(make);
        const format = utils.getCurrentDepthStencilFormat(context);
        this.#depth = { view: make(format), hasStencil: format.endsWith('stencil8') };
    }

    descriptor(depthClearValue, occlusionQuerySet) {
        const { view, hasStencil } = this.#depth;
        const color = (view) => ({ view, loadOp: 'clear', storeOp: 'discard' });
        return {
            colorAttachments: this.#colors.map(color),
            depthStencilAttachment: {
                view,
                depthClearValue,
                depthLoadOp: 'clear',
                depthStoreOp: 'discard',
                ...(hasStencil && { stencilClearValue: 0, stencilLoadOp: 'clear', stencilStoreOp: 'discard' }),
            },
            occlusionQuerySet,
        };
    }

    destroy() {
        for (const texture of this.#textures) texture.destroy();
    }
}
