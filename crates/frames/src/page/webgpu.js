// WebGPU: every object keeps what it was made from, every encoder its commands while a capture is near.

const THING = Symbol('preshade');

/** Live buffers and textures: what a capture reads at its start. */
const live = new Set();
const forget = new FinalizationRegistry((ref) => live.delete(ref));

/** The commands of the frame that is recorded, and canvases that it drew to. */
let stream = null;
const drawnCanvases = new Map();

function remember(thing) {
    thing.ref = new WeakRef(thing);
    live.add(thing.ref);
    forget.register(thing.object, thing.ref);
}

function thingOf(object) {
    return object[THING] ?? foreign(object);
}

/** Objects that the page made before the recorder came: buffers and textures say what they are. */
function foreign(object) {
    const { label } = object;
    let thing;
    if (object instanceof GPUBuffer) {
        thing = new Thing('buffer', object, {
            label,
            size: object.size,
            usage: object.usage,
        });
    } else if (object instanceof GPUTexture) {
        thing = new Thing('texture', object, textureDescriptor(object));
    } else {
        thing = new Thing('foreign', object, { label });
        thing.refused = 'made before the recorder';
    }
    object[THING] = thing;
    return thing;
}

function textureDescriptor(texture) {
    const { label, width, height, depthOrArrayLayers, format, dimension, mipLevelCount, sampleCount } = texture;
    return {
        label,
        size: [width, height, depthOrArrayLayers],
        format,
        dimension,
        mipLevelCount,
        sampleCount,
        usage: texture.usage,
        viewFormats: [],
    };
}

const GPU_TYPES = () => [
    GPUBuffer,
    GPUTexture,
    GPUTextureView,
    GPUSampler,
    GPUShaderModule,
    GPUBindGroup,
    GPUBindGroupLayout,
    GPUPipelineLayout,
    GPURenderPipeline,
    GPUComputePipeline,
    GPUQuerySet,
    GPUExternalTexture,
];
let gpuTypes = [];

function isPlain(value) {
    return Object.getPrototypeOf(value) === Object.prototype;
}

/** The members of WebGPU's dictionaries. Pages may pass objects with members of their own, which we leave out. */
const MEMBERS = new Set(
    `label size usage addressModeU addressModeV addressModeW magFilter minFilter mipmapFilter lodMinClamp lodMaxClamp
    compare maxAnisotropy entries binding visibility buffer type hasDynamicOffset minBindingSize sampler texture
    sampleType viewDimension multisampled storageTexture access format externalTexture bindGroupLayouts layout resource
    offset vertex fragment compute module entryPoint constants buffers arrayStride stepMode attributes shaderLocation
    primitive topology stripIndexFormat frontFace cullMode unclippedDepth depthStencil depthWriteEnabled depthCompare
    stencilFront stencilBack failOp depthFailOp passOp stencilReadMask stencilWriteMask depthBias depthBiasSlopeScale
    depthBiasClamp multisample count mask alphaToCoverageEnabled targets blend color alpha srcFactor dstFactor operation
    writeMask dimension aspect baseMipLevel mipLevelCount baseArrayLayer arrayLayerCount swizzle view depthSlice
    resolveTarget loadOp storeOp depthClearValue depthLoadOp depthStoreOp depthReadOnly stencilClearValue stencilLoadOp
    stencilStoreOp stencilReadOnly`.split(/\s+/),
);

/** A copy of a descriptor that the page cannot change any more, with Things for objects. */
function copyOf(value) {
    if (typeof value !== 'object' || value === null) return value;
    if (value[THING]) return value[THING];
    if (Array.isArray(value)) return value.map(copyOf);
    if (!isPlain(value) && gpuTypes.some((type) => value instanceof type)) return foreign(value);
    if (Symbol.iterator in value) return Array.from(value, copyOf);
    const copy = {};
    for (const key in value) {
        if (value[key] === undefined) continue;
        if (key === 'constants') copy.constants = { ...value.constants };
        else if (MEMBERS.has(key)) copy[key] = copyOf(value[key]);
    }
    return copy;
}

/** Wraps a method that makes an object. */
function wrapMaker(type, name, kind, copy = copyOf) {
    wrap(
        type,
        name,
        (original) =>
            function (descriptor) {
                const object = original.apply(this, arguments);
                object[THING] = new Thing(kind, object, copy(descriptor ?? {}));
                object[THING].device = this;
                return object;
            },
    );
    wrap(
        type,
        `${name}Async`,
        (original) =>
            function (descriptor) {
                const copied = copy(descriptor ?? {});
                return original.apply(this, arguments).then((object) => {
                    object[THING] = new Thing(kind, object, copied);
                    return object;
                });
            },
    );
}

function wrapDevice() {
    wrapMaker(GPUDevice, 'createSampler', 'sampler');
    wrapMaker(GPUDevice, 'createShaderModule', 'shader', ({ code, label }) => ({
        code,
        label,
    }));
    wrapMaker(GPUDevice, 'createBindGroupLayout', 'bindGroupLayout');
    wrapMaker(GPUDevice, 'createPipelineLayout', 'pipelineLayout');
    wrapMaker(GPUDevice, 'createBindGroup', 'bindGroup');
    wrapMaker(GPUDevice, 'createRenderPipeline', 'renderPipeline');
    wrapMaker(GPUDevice, 'createComputePipeline', 'computePipeline');
    wrapMaker(GPUTexture, 'createView', 'view');
    wrap(
        GPUTexture,
        'createView',
        (original) =>
            function () {
                const view = original.apply(this, arguments);
                view[THING].texture = thingOf(this);
                return view;
            },
    );
    wrap(
        GPUDevice,
        'importExternalTexture',
        (original) =>
            function () {
                const object = original.apply(this, arguments);
                object[THING] = new Thing('external', object, {});
                object[THING].refused = 'external texture';
                return object;
            },
    );
    for (const [type, kind] of [
        [GPURenderPipeline, 'renderPipeline'],
        [GPUComputePipeline, 'computePipeline'],
    ]) {
        wrap(
            type,
            'getBindGroupLayout',
            (original) =>
                function (group) {
                    const object = original.apply(this, arguments);
                    const pipeline = thingOf(this);
                    const { layout } = pipeline.descriptor;
                    const explicit = layout instanceof Thing ? layout.descriptor.bindGroupLayouts?.[group] : null;
                    object[THING] ??= explicit ?? new Thing('derivedLayout', object, { [kind]: pipeline, group });
                    return object;
                },
        );
    }
}

function wrapResources() {
    wrap(
        GPUDevice,
        'createBuffer',
        (original) =>
            function (descriptor) {
                const { label, size, usage, mappedAtCreation } = descriptor;
                // Buffers that the page maps for reading may have no other usage.
                const extra = usage & GPUBufferUsage.MAP_READ ? 0 : GPUBufferUsage.COPY_SRC;
                const object = original.call(this, {
                    label,
                    size,
                    usage: usage | extra,
                    mappedAtCreation,
                });
                const thing = new Thing('buffer', object, { label, size, usage });
                thing.device = this;
                if (mappedAtCreation) thing.mapped = [];
                object[THING] = thing;
                remember(thing);
                return object;
            },
    );
    wrap(
        GPUDevice,
        'createTexture',
        (original) =>
            function (descriptor) {
                const transient = descriptor.usage & 0x20;
                const usage = descriptor.usage | (transient ? 0 : GPUTextureUsage.COPY_SRC);
                const changed = Object.create(descriptor, {
                    usage: { value: usage, enumerable: true },
                });
                const object = original.call(this, changed);
                const thing = new Thing('texture', object, textureDescriptor(object));
                thing.descriptor.usage = descriptor.usage;
                thing.descriptor.viewFormats = [...(descriptor.viewFormats ?? [])];
                thing.device = this;
                object[THING] = thing;
                remember(thing);
                return object;
            },
    );
    for (const type of [GPUBuffer, GPUTexture]) {
        wrap(
            type,
            'destroy',
            (original) =>
                function () {
                    const thing = this[THING];
                    if (thing) {
                        thing.destroyed = true;
                        live.delete(thing.ref);
                    }
                    return original.call(this);
                },
        );
        // The page sees the usage that it asked for.
        const { get } = Object.getOwnPropertyDescriptor(type.prototype, 'usage');
        Object.defineProperty(type.prototype, 'usage', {
            configurable: true,
            enumerable: true,
            get() {
                return this[THING]?.descriptor.usage ?? get.call(this);
            },
        });
    }
}

/** Writes through mapped memory count where the page unmaps it. */
function wrapMapping() {
    wrap(
        GPUBuffer,
        'mapAsync',
        (original) =>
            function (mode) {
                const thing = thingOf(this);
                return original.apply(this, arguments).then((value) => {
                    if (mode & GPUMapMode.WRITE) thing.mapped = [];
                    return value;
                });
            },
    );
    wrap(
        GPUBuffer,
        'getMappedRange',
        (original) =>
            function (offset = 0) {
                const range = original.apply(this, arguments);
                this[THING]?.mapped?.push({ offset, range });
                return range;
            },
    );
    wrap(
        GPUBuffer,
        'unmap',
        (original) =>
            function () {
                const thing = this[THING];
                if (thing?.mapped) {
                    if (stream) {
                        for (const { offset, range } of thing.mapped) {
                            if (range.byteLength) write(thing, offset, new Uint8Array(range.slice(0)));
                        }
                    }
                    thing.mapped = null;
                }
                return original.call(this);
            },
    );
}

function write(buffer, offset, bytes) {
    stream.push({ do: 'writeBuffer', buffer, offset, data: bytes });
}

function wrapQueue() {
    wrap(
        GPUQueue,
        'writeBuffer',
        (original) =>
            function (buffer, offset, data, dataOffset = 0, size) {
                const result = original.apply(this, arguments);
                if (stream) {
                    const unit = ArrayBuffer.isView(data) ? (data.BYTES_PER_ELEMENT ?? 1) : 1;
                    const bytes = bytesOf(data);
                    const begin = dataOffset * unit;
                    const end = size === undefined ? bytes.length : begin + size * unit;
                    if (end > begin) write(thingOf(buffer), offset, bytes.slice(begin, end));
                }
                return result;
            },
    );
    wrap(
        GPUQueue,
        'writeTexture',
        (original) =>
            function (destination, data, layout, size) {
                const result = original.apply(this, arguments);
                if (stream) recordWriteTexture(destination, bytesOf(data), layout, extent(size));
                return result;
            },
    );
    wrap(
        GPUQueue,
        'copyExternalImageToTexture',
        (original) =>
            function (source, destination, size) {
                const result = original.apply(this, arguments);
                if (stream) recordImage(destination, extent(size));
                return result;
            },
    );
    wrap(
        GPUQueue,
        'submit',
        (original) =>
            function (buffers) {
                const list = [...buffers];
                const result = original.call(this, list);
                submittedTo(this);
                for (const buffer of list) submitted(thingOf(buffer));
                return result;
            },
    );
}

function submitted(thing) {
    for (const canvas of thing.canvases ?? []) {
        drawnCanvases.set(canvas.context, canvas);
        if (stream) recorder.picture(canvas);
    }
    if (!stream) return;
    if (thing.commands) for (const command of thing.commands) stream.push(command);
    else
        stream.push({
            do: 'refused',
            what: 'command buffer',
            why: 'begun before the capture',
        });
}

function recordWriteTexture(destination, bytes, layout, size) {
    const texture = thingOf(destination.texture);
    const block = blockOf(texture.descriptor.format, destination.aspect);
    const begin = layout.offset ?? 0;
    const columns = Math.ceil(size[0] / block.width) * block.bytes;
    const shape = {
        offset: 0,
        bytesPerRow: layout.bytesPerRow ?? columns,
        rowsPerImage: layout.rowsPerImage ?? Math.ceil(size[1] / block.height),
    };
    const data = bytes.slice(begin, begin + regionBytes(block, shape, size));
    if (data.length)
        stream.push({
            do: 'writeTexture',
            destination: place(destination),
            data,
            layout: shape,
            size,
        });
}

/** An image of the page becomes texels: what the browser made of it is read back at once. */
function recordImage(destination, size) {
    const to = place(destination);
    const { texture } = to;
    const block = blockOf(texture.descriptor.format);
    const staged = stageTexture(texture, {
        mipLevel: to.mipLevel,
        at: to.origin,
        size,
    });
    const layout = {
        offset: 0,
        bytesPerRow: size[0] * block.bytes,
        rowsPerImage: size[1],
    };
    stream.push({
        do: 'writeTexture',
        destination: to,
        data: staged,
        layout,
        size,
    });
    if (texture.canvas) {
        drawnCanvases.set(texture.canvas.context, texture.canvas);
        recorder.picture(texture.canvas);
    }
}

/** A GPUTexelCopyTextureInfo with all its members. */
function place({ texture, mipLevel = 0, origin: at, aspect = 'all' }) {
    return { texture: thingOf(texture), mipLevel, origin: origin(at), aspect };
}

function wrapCanvas() {
    wrap(
        GPUCanvasContext,
        'configure',
        (original) =>
            function (configuration) {
                const usage = (configuration.usage ?? GPUTextureUsage.RENDER_ATTACHMENT) | GPUTextureUsage.COPY_SRC;
                const changed = Object.create(configuration, {
                    usage: { value: usage, enumerable: true },
                });
                const result = original.call(this, changed);
                this[THING] = {
                    context: this,
                    device: configuration.device,
                    viewFormats: configuration.viewFormats,
                    alphaMode: configuration.alphaMode ?? 'opaque',
                };
                return result;
            },
    );
    wrap(
        GPUCanvasContext,
        'getCurrentTexture',
        (original) =>
            function () {
                const object = original.call(this);
                if (!object[THING]) {
                    const thing = new Thing('texture', object, textureDescriptor(object));
                    const canvas = this[THING];
                    thing.descriptor.viewFormats = [...(canvas?.viewFormats ?? [])];
                    thing.device = canvas?.device;
                    thing.canvas = { context: this, thing, alphaMode: canvas?.alphaMode };
                    object[THING] = thing;
                }
                return object;
            },
    );
}

function installWebgpu() {
    if (!globalThis.GPUDevice || !navigator.gpu) return false;
    gpuTypes = GPU_TYPES();
    keepMethods();
    hearDevices();
    wrapDevice();
    wrapResources();
    wrapMapping();
    wrapQueue();
    wrapCanvas();
    wrapEncoders();
    sources.push(recorder);
    return true;
}
