// WebGPU's encoders: lists of commands with Things in place of objects.

const COMMANDS = Symbol('preshade commands');
const CANVASES = Symbol('preshade canvases');

/** Wraps a method so that an encoder that keeps commands keeps this one. `make` gets the arguments. */
function wrapCommand(types, name, make) {
    for (const type of types) {
        wrap(
            type,
            name,
            (original) =>
                function () {
                    const result = original.apply(this, arguments);
                    const commands = this[COMMANDS];
                    if (commands) {
                        const command = make.apply(this, arguments);
                        if (command) commands.push(command);
                    }
                    return result;
                },
        );
    }
}

function wrapEncoders() {
    wrap(
        GPUDevice,
        'createCommandEncoder',
        (original) =>
            function () {
                const encoder = original.apply(this, arguments);
                if (phase !== IDLE) encoder[COMMANDS] = [];
                return encoder;
            },
    );
    wrap(
        GPUCommandEncoder,
        'finish',
        (original) =>
            function () {
                const object = original.apply(this, arguments);
                const thing = new Thing('commands', object, null);
                thing.commands = this[COMMANDS];
                thing.canvases = this[CANVASES];
                object[THING] = thing;
                return object;
            },
    );
    wrapPasses();
    wrapCopies();
    wrapDraws();
    wrapBundles();
}

function wrapPasses() {
    wrap(
        GPUCommandEncoder,
        'beginRenderPass',
        (original) =>
            function (descriptor) {
                const pass = original.apply(this, arguments);
                for (const attachment of descriptor.colorAttachments) {
                    if (!attachment) continue;
                    markCanvas(this, attachment.view);
                    if (attachment.resolveTarget) markCanvas(this, attachment.resolveTarget);
                }
                const commands = this[COMMANDS];
                if (commands) {
                    pass[COMMANDS] = [];
                    commands.push({
                        do: 'renderPass',
                        descriptor: passDescriptor(descriptor),
                        commands: pass[COMMANDS],
                    });
                }
                return pass;
            },
    );
    wrap(
        GPUCommandEncoder,
        'beginComputePass',
        (original) =>
            function (descriptor) {
                const pass = original.apply(this, arguments);
                const commands = this[COMMANDS];
                if (commands) {
                    pass[COMMANDS] = [];
                    commands.push({
                        do: 'computePass',
                        label: descriptor?.label,
                        commands: pass[COMMANDS],
                    });
                }
                return pass;
            },
    );
}

/** The encoder draws to a canvas if `view` is of one. */
function markCanvas(encoder, view) {
    const thing = view[THING];
    const canvas = (thing?.texture ?? thing)?.canvas;
    if (canvas) (encoder[CANVASES] ??= new Set()).add(canvas);
}

function passDescriptor({ label, colorAttachments, depthStencilAttachment, occlusionQuerySet }) {
    const descriptor = {
        label,
        colorAttachments: Array.from(colorAttachments, (attachment) => {
            if (!attachment) return null;
            const copy = copyOf(attachment);
            if (copy.loadOp === 'clear') copy.clearValue = color(attachment.clearValue);
            else delete copy.clearValue;
            return copy;
        }),
    };
    if (depthStencilAttachment) descriptor.depthStencilAttachment = copyOf(depthStencilAttachment);
    if (occlusionQuerySet) descriptor.queries = true;
    return descriptor;
}

function wrapCopies() {
    const encoders = [GPUCommandEncoder];
    wrapCommand(encoders, 'copyBufferToBuffer', function (source, ...rest) {
        const [sourceOffset, target, destinationOffset, size] =
            typeof rest[0] === 'object' ? [0, rest[0], 0, rest[1]] : rest;
        return {
            do: 'copyBufferToBuffer',
            source: thingOf(source),
            sourceOffset,
            destination: thingOf(target),
            destinationOffset,
            size: size ?? source.size - sourceOffset,
        };
    });
    const inBuffer = ({ buffer, offset = 0, bytesPerRow, rowsPerImage }) => ({
        buffer: thingOf(buffer),
        offset,
        bytesPerRow,
        rowsPerImage,
    });
    const copy = (name, from, to) =>
        wrapCommand(encoders, name, function (source, destination, size) {
            if (destination.texture) markCanvas(this, destination.texture);
            return {
                do: name,
                source: from(source),
                destination: to(destination),
                size: extent(size),
            };
        });
    copy('copyBufferToTexture', inBuffer, place);
    copy('copyTextureToBuffer', place, inBuffer);
    copy('copyTextureToTexture', place, place);
    wrapCommand(encoders, 'clearBuffer', (buffer, offset = 0, size) => ({
        do: 'clearBuffer',
        buffer: thingOf(buffer),
        offset,
        size: size ?? buffer.size - offset,
    }));
    wrapCommand(encoders, 'resolveQuerySet', () => ({
        do: 'refused',
        what: 'resolveQuerySet',
        why: 'results of queries are not recorded',
    }));
}

function wrapDraws() {
    const passes = [GPURenderPassEncoder, GPURenderBundleEncoder];
    const all = [...passes, GPUComputePassEncoder];
    wrapCommand(all, 'setPipeline', (pipeline) => ({
        do: 'setPipeline',
        pipeline: thingOf(pipeline),
    }));
    wrapCommand(all, 'setBindGroup', (index, bindGroup, offsets, start, length) => ({
        do: 'setBindGroup',
        index,
        bindGroup: bindGroup ? thingOf(bindGroup) : null,
        dynamicOffsets: start === undefined ? [...(offsets ?? [])] : [...offsets.subarray(start, start + length)],
    }));
    wrapCommand(passes, 'setVertexBuffer', (slot, buffer, offset = 0, size) => ({
        do: 'setVertexBuffer',
        slot,
        buffer: buffer ? thingOf(buffer) : null,
        offset,
        size,
    }));
    wrapCommand(passes, 'setIndexBuffer', (buffer, indexFormat, offset = 0, size) => ({
        do: 'setIndexBuffer',
        buffer: thingOf(buffer),
        indexFormat,
        offset,
        size,
    }));
    wrapCommand(passes, 'draw', (vertexCount, instanceCount = 1, firstVertex = 0, firstInstance = 0) => ({
        do: 'draw',
        vertexCount,
        instanceCount,
        firstVertex,
        firstInstance,
    }));
    wrapCommand(
        passes,
        'drawIndexed',
        (indexCount, instanceCount = 1, firstIndex = 0, baseVertex = 0, firstInstance = 0) => ({
            do: 'drawIndexed',
            indexCount,
            instanceCount,
            firstIndex,
            baseVertex,
            firstInstance,
        }),
    );
    const indirect = (types, name) =>
        wrapCommand(types, name, (buffer, offset = 0) => ({
            do: name,
            buffer: thingOf(buffer),
            offset,
        }));
    indirect(passes, 'drawIndirect');
    indirect(passes, 'drawIndexedIndirect');
    indirect([GPUComputePassEncoder], 'dispatchWorkgroupsIndirect');
    wrapCommand([GPUComputePassEncoder], 'dispatchWorkgroups', (x, y = 1, z = 1) => ({
        do: 'dispatchWorkgroups',
        x,
        y,
        z,
    }));
    for (const name of ['multiDrawIndirect', 'multiDrawIndexedIndirect']) {
        wrapCommand(passes, name, () => ({
            do: 'refused',
            what: name,
            why: 'counts on the GPU',
        }));
    }
    wrapCommand(all, 'setImmediates', () => ({
        do: 'refused',
        what: 'setImmediates',
        why: 'not in the format',
    }));
    wrapDynamicState();
}

function wrapDynamicState() {
    const passes = [GPURenderPassEncoder];
    wrapCommand(passes, 'setViewport', (x, y, width, height, minDepth, maxDepth) => ({
        do: 'setViewport',
        x,
        y,
        width,
        height,
        minDepth,
        maxDepth,
    }));
    wrapCommand(passes, 'setScissorRect', (x, y, width, height) => ({
        do: 'setScissorRect',
        x,
        y,
        width,
        height,
    }));
    wrapCommand(passes, 'setBlendConstant', (value) => ({
        do: 'setBlendConstant',
        color: color(value),
    }));
    wrapCommand(passes, 'setStencilReference', (reference) => ({
        do: 'setStencilReference',
        reference,
    }));
    wrapCommand(passes, 'beginOcclusionQuery', () => ({
        do: 'refused',
        what: 'occlusion query',
        why: 'its draws are recorded, its result is not',
    }));
}

/** Bundles outlive captures, so they always keep their commands. */
function wrapBundles() {
    wrap(
        GPUDevice,
        'createRenderBundleEncoder',
        (original) =>
            function () {
                const encoder = original.apply(this, arguments);
                encoder[COMMANDS] = [];
                return encoder;
            },
    );
    wrap(
        GPURenderBundleEncoder,
        'finish',
        (original) =>
            function () {
                const bundle = original.apply(this, arguments);
                bundle[COMMANDS] = this[COMMANDS];
                return bundle;
            },
    );
    wrap(
        GPURenderPassEncoder,
        'executeBundles',
        (original) =>
            function (bundles) {
                const list = [...bundles];
                const result = original.call(this, list);
                const commands = this[COMMANDS];
                if (!commands) return result;
                for (const bundle of list) {
                    if (bundle[COMMANDS]) for (const command of bundle[COMMANDS]) commands.push(command);
                    else
                        commands.push({
                            do: 'refused',
                            what: 'render bundle',
                            why: 'made before the recorder',
                        });
                }
                return result;
            },
    );
}
