// Draws plans with WebGPU.

import { key } from './plan.js';

const CLEAR = { r: 0.3, g: 0.38, b: 0.48, a: 1 };
const DEPTH_TEXT = `
@group(0) @binding(0) var depth: texture_depth_2d;
@vertex fn corner(@builtin(vertex_index) i: u32) -> @builtin(position) vec4f {
    return vec4f(f32(i & 1u) * 4.0 - 1.0, f32(i >> 1u) * 4.0 - 1.0, 0.0, 1.0);
}
@fragment fn bits(@builtin(position) at: vec4f) -> @location(0) u32 {
    return bitcast<u32>(textureLoad(depth, vec2u(at.xy), 0));
}`;

const camel = { nonfiltering: 'non-filtering' };
const isDepthFormat = (format) => format.startsWith('depth');
const aspect = (format) => (isDepthFormat(format) ? 'depth-only' : 'all');

/** The visitor's adapter by WebGPU, or `null`. */
export async function open() {
    const adapter = await navigator.gpu?.requestAdapter({ powerPreference: 'high-performance' });
    if (!adapter) return null;
    const wanted = ['timestamp-query', 'depth32float-stencil8', 'shader-f16', 'float32-filterable', 'clip-distances'];
    const wantedLater = ['primitive-index', 'subgroups', 'dual-source-blending', 'depth-clip-control'];
    const requiredFeatures = [...wanted, ...wantedLater].filter((feature) => adapter.features.has(feature));
    const device = await adapter.requestDevice({ requiredFeatures });
    return new WebGpu(adapter, device);
}

export class WebGpu {
    name = 'WebGPU';
    language = 'wgsl';
    #device;
    #depthReader;
    lost = null;

    constructor(adapter, device) {
        this.#device = device;
        const { vendor, architecture, device: model, description } = adapter.info ?? {};
        const said = description || [vendor, architecture, model].filter(Boolean).join(' ');
        const isSoftware = adapter.info?.isFallbackAdapter || /swiftshader|llvmpipe|warp|basic render/i.test(said);
        this.adapter = {
            name: said || 'not told by the browser',
            backend: 'webgpu',
            kind: isSoftware ? 'software' : 'other',
            features: [...device.features].sort(),
        };
        this.hasTimestamps = device.features.has('timestamp-query');
        this.clock = this.hasTimestamps ? 'gpu-timestamps' : 'wall-clock';
        device.lost.then(({ message }) => (this.lost = message || 'the device is lost'));
    }

    /** Everything that a drawing needs, made once. Errors of the driver are thrown with its words. */
    async prepare(drawing, inputs, size) {
        const device = this.#device;
        for (const { pass } of drawing.passes)
            for (const feature of pass.features)
                if (!device.features.has(feature)) throw new Error(`this adapter has no ${feature}`);
        device.pushErrorScope('out-of-memory');
        device.pushErrorScope('validation');
        let made;
        let failure;
        try {
            made = await this.#prepare(drawing, inputs, size);
        } catch (error) {
            failure = error;
        }
        for (const error of [await device.popErrorScope(), await device.popErrorScope()])
            if (error) failure ??= new Error(error.message);
        if (failure) throw failure;
        return made;
    }

    async #prepare(drawing, inputs, size) {
        const device = this.#device;
        const owned = [];
        const own = (resource) => (owned.push(resource), resource);
        const filled = (bytes, usage) => {
            const buffer = own(
                device.createBuffer({
                    size: Math.ceil(bytes.byteLength / 4) * 4 || 4,
                    usage: usage | GPUBufferUsage.COPY_DST,
                }),
            );
            if (bytes.byteLength) device.queue.writeBuffer(buffer, 0, bytes);
            return buffer;
        };
        const resources = new Map();
        for (const [of, bytes] of inputs.buffers) resources.set(of, { buffer: filled(bytes, GPUBufferUsage.UNIFORM) });
        for (const [of, texture] of inputs.textures) resources.set(of, this.#texture(texture, own));
        for (const [of, { type }] of inputs.samplers) resources.set(of, this.#sampler(type));

        const attachments = new Map();
        for (const { name, format } of drawing.attachments) {
            const usage = GPUTextureUsage.RENDER_ATTACHMENT | GPUTextureUsage.TEXTURE_BINDING;
            attachments.set(name, own(device.createTexture({ size: [size, size], format, usage })));
        }
        const clears = new Map(drawing.attachments.map(({ name, clear }) => [name, clear]));
        const colors = [];
        const { mesh } = inputs;
        const vertices = mesh.vertices && filled(mesh.vertices, GPUBufferUsage.VERTEX);
        const indices = mesh.indices && filled(mesh.indices, GPUBufferUsage.INDEX);
        const modules = new Map();
        const passes = [];
        for (const { pass, vertex, fragment } of drawing.passes) {
            const module = async ({ text }) => {
                if (!modules.has(text)) modules.set(text, await this.#compiled(text));
                return modules.get(text);
            };
            const layouts = this.#layouts(pass);
            const buffers = mesh.stride
                ? [
                      {
                          arrayStride: mesh.stride,
                          attributes: pass.attributes.map(({ location }) => {
                              const { offset, size, scalar } = mesh.layout.get(location);
                              const kind = { f32: 'float32', i32: 'sint32', u32: 'uint32' }[scalar];
                              return { shaderLocation: location, offset, format: size > 1 ? `${kind}x${size}` : kind };
                          }),
                      },
                  ]
                : [];
            const { depth, primitive } = pass;
            const depthFormat = depth && drawing.attachments.find(({ name }) => name === depth.attachment).format;
            pass.targets.forEach((target, i) => {
                if (!target || colors[i]) return;
                const usage = GPUTextureUsage.RENDER_ATTACHMENT | GPUTextureUsage.COPY_SRC;
                colors[i] = own(device.createTexture({ size: [size, size], format: target.format, usage }));
            });
            const pipeline = await device.createRenderPipelineAsync({
                layout: device.createPipelineLayout({ bindGroupLayouts: layouts.map(({ layout }) => layout) }),
                vertex: { module: await module(vertex), entryPoint: vertex.entry_point, buffers },
                ...(fragment?.text && {
                    fragment: {
                        module: await module(fragment),
                        entryPoint: fragment.entry_point,
                        targets: pass.targets.map(
                            (target) =>
                                target && {
                                    format: target.format,
                                    writeMask: target.write_mask,
                                    ...(target.blend && { blend: blended(target.blend) }),
                                },
                        ),
                    },
                }),
                primitive: {
                    topology: primitive.topology,
                    cullMode: primitive.cull,
                    frontFace: primitive.front_face,
                    ...(primitive.unclipped_depth && { unclippedDepth: true }),
                },
                ...(depth && {
                    depthStencil: {
                        format: depthFormat,
                        depthCompare: depth.compare,
                        depthWriteEnabled: depth.write,
                        depthBias: depth.bias.constant,
                        depthBiasSlopeScale: depth.bias.slope_scale,
                        depthBiasClamp: depth.bias.clamp,
                    },
                }),
            });
            const groups = layouts.map(({ layout, bindings }) =>
                device.createBindGroup({
                    layout,
                    entries: bindings.map((binding) => ({
                        binding: binding.binding,
                        resource:
                            binding.source.from === 'attachment'
                                ? viewOf(attachments.get(binding.source.name))
                                : resources.get(key(binding)),
                    })),
                }),
            );
            passes.push({ pass, pipeline, groups });
        }
        const encode = (encoder, times = []) => {
            const seen = new Set();
            const load = (name, asked) => {
                const isFirst = !seen.has(name);
                seen.add(name);
                return asked === 'clear' || (asked === 'clear-first' && isFirst) ? 'clear' : 'load';
            };
            for (const [i, { pass, pipeline, groups }] of passes.entries()) {
                const { depth, targets } = pass;
                const timestampWrites = times[i];
                const render = encoder.beginRenderPass({
                    ...(timestampWrites && { timestampWrites }),
                    colorAttachments: targets.map(
                        (target, t) =>
                            target && {
                                view: colors[t].createView(),
                                loadOp: load(`color ${t}`, target.ops.load),
                                storeOp: target.ops.store,
                                clearValue: CLEAR,
                            },
                    ),
                    ...(depth && {
                        depthStencilAttachment: {
                            view: attachments.get(depth.attachment).createView(),
                            depthLoadOp: load(depth.attachment, depth.ops.load),
                            depthStoreOp: depth.ops.store,
                            depthClearValue: clears.get(depth.attachment),
                            ...(attachments.get(depth.attachment).format.includes('stencil') && {
                                stencilLoadOp: 'clear',
                                stencilStoreOp: 'discard',
                            }),
                        },
                    }),
                });
                render.setPipeline(pipeline);
                groups.forEach((group, g) => render.setBindGroup(g, group));
                if (vertices) render.setVertexBuffer(0, vertices);
                if (indices) {
                    render.setIndexBuffer(indices, 'uint32');
                    render.drawIndexed(mesh.count);
                } else render.draw(mesh.count);
                render.end();
            }
        };
        return { encode, colors, depth: attachments.get('scene-depth'), size, count: passes.length, owned };
    }

    async #compiled(text) {
        const module = this.#device.createShaderModule({ code: text });
        const { messages } = await module.getCompilationInfo();
        const found = messages.find(({ type }) => type === 'error');
        if (found) throw new Error(`the browser does not take the WGSL: line ${found.lineNum}: ${found.message}`);
        return module;
    }

    #layouts(pass) {
        const device = this.#device;
        const groups = [];
        for (const binding of pass.bindings) (groups[binding.group] ??= []).push(binding);
        return Array.from(groups, (bindings = []) => {
            const entries = bindings.map(({ binding, visibility, layout }) => ({
                binding,
                visibility:
                    (visibility.vertex ? GPUShaderStage.VERTEX : 0) |
                    (visibility.fragment ? GPUShaderStage.FRAGMENT : 0),
                ...(layout.buffer && {
                    buffer: { type: layout.buffer.type, minBindingSize: layout.buffer.min_binding_size },
                }),
                ...(layout.sampler && { sampler: { type: camel[layout.sampler.type] ?? layout.sampler.type } }),
                ...(layout.texture && {
                    texture: {
                        sampleType: layout.texture.sample_type,
                        viewDimension: layout.texture.view_dimension,
                        multisampled: layout.texture.multisampled,
                    },
                }),
            }));
            return { layout: device.createBindGroupLayout({ entries }), bindings };
        });
    }

    #texture({ dimension, isDepth, side, levels }, own) {
        const device = this.#device;
        const layers = { '2d': 1, '2d-array': 2, cube: 6, '3d': 2 }[dimension];
        const texture = own(
            device.createTexture({
                size: [side, side, layers],
                format: isDepth ? 'depth32float' : 'rgba8unorm',
                dimension: dimension === '3d' ? '3d' : '2d',
                mipLevelCount: isDepth || dimension === '3d' ? 1 : levels.length,
                usage:
                    GPUTextureUsage.TEXTURE_BINDING |
                    (isDepth ? GPUTextureUsage.RENDER_ATTACHMENT : GPUTextureUsage.COPY_DST),
            }),
        );
        if (isDepth) {
            const encoder = device.createCommandEncoder();
            for (let layer = 0; layer < layers; layer++) {
                const view = texture.createView({ dimension: '2d', baseArrayLayer: layer, arrayLayerCount: 1 });
                const ops = { depthLoadOp: 'clear', depthStoreOp: 'store', depthClearValue: 1 };
                encoder.beginRenderPass({ colorAttachments: [], depthStencilAttachment: { view, ...ops } }).end();
            }
            device.queue.submit([encoder.finish()]);
        } else {
            for (let mipLevel = 0; mipLevel < texture.mipLevelCount; mipLevel++) {
                const length = side >> mipLevel;
                for (let layer = 0; layer < layers; layer++)
                    device.queue.writeTexture(
                        { texture, mipLevel, origin: [0, 0, layer] },
                        levels[mipLevel],
                        { bytesPerRow: length * 4, rowsPerImage: length },
                        [length, length, 1],
                    );
            }
        }
        return texture.createView({ dimension });
    }

    #sampler(type) {
        const linear = { magFilter: 'linear', minFilter: 'linear', mipmapFilter: 'linear' };
        const repeat = { addressModeU: 'repeat', addressModeV: 'repeat', addressModeW: 'repeat' };
        if (type === 'comparison') return this.#device.createSampler({ compare: 'less-equal', ...linear });
        return this.#device.createSampler({ ...repeat, ...(type === 'filtering' ? linear : {}) });
    }

    /** Draws once and reads everything back: colours of each target, row by row from the top, and bits of depths. */
    async picture({ encode, colors, depth, size }) {
        const device = this.#device;
        const encoder = device.createCommandEncoder();
        encode(encoder);
        const read = (texture) => {
            const buffer = device.createBuffer({
                size: size * size * 4,
                usage: GPUBufferUsage.MAP_READ | GPUBufferUsage.COPY_DST,
            });
            encoder.copyTextureToBuffer({ texture }, { buffer, bytesPerRow: size * 4 }, [size, size]);
            return buffer;
        };
        const buffers = colors.filter(Boolean).map(read);
        let bits;
        if (depth) {
            const usage = GPUTextureUsage.RENDER_ATTACHMENT | GPUTextureUsage.COPY_SRC;
            bits = device.createTexture({ size: [size, size], format: 'r32uint', usage });
            this.#readDepth(encoder, depth, bits);
            buffers.push(read(bits));
        }
        device.queue.submit([encoder.finish()]);
        const contents = [];
        for (const buffer of buffers) {
            await buffer.mapAsync(GPUMapMode.READ);
            contents.push(buffer.getMappedRange().slice(0));
            buffer.destroy();
        }
        bits?.destroy();
        const depths = depth ? new Uint32Array(contents.pop()) : null;
        return { colors: contents.map((content) => new Uint8ClampedArray(content)), depth: depths, size };
    }

    #readDepth(encoder, depth, to) {
        const device = this.#device;
        if (!this.#depthReader) {
            const module = device.createShaderModule({ code: DEPTH_TEXT });
            this.#depthReader = device.createRenderPipeline({
                layout: 'auto',
                vertex: { module, entryPoint: 'corner' },
                fragment: { module, entryPoint: 'bits', targets: [{ format: 'r32uint' }] },
            });
        }
        const entries = [{ binding: 0, resource: viewOf(depth) }];
        const group = device.createBindGroup({ layout: this.#depthReader.getBindGroupLayout(0), entries });
        const clearValue = { r: 0, g: 0, b: 0, a: 0 };
        const attachment = { view: to.createView(), loadOp: 'clear', storeOp: 'store', clearValue };
        const render = encoder.beginRenderPass({ colorAttachments: [attachment] });
        render.setPipeline(this.#depthReader);
        render.setBindGroup(0, group);
        render.draw(3);
        render.end();
    }

    /** Milliseconds a frame: `repeats` frames in one submission. */
    async time({ encode, count }, repeats) {
        const device = this.#device;
        const encoder = device.createCommandEncoder();
        let set;
        let resolved;
        let mapped;
        if (this.hasTimestamps) {
            set = device.createQuerySet({ type: 'timestamp', count: 2 });
            resolved = device.createBuffer({ size: 16, usage: GPUBufferUsage.QUERY_RESOLVE | GPUBufferUsage.COPY_SRC });
            mapped = device.createBuffer({ size: 16, usage: GPUBufferUsage.MAP_READ | GPUBufferUsage.COPY_DST });
        }
        for (let i = 0; i < repeats; i++) {
            const times = [];
            if (set) {
                const [isFirst, isLast] = [i === 0, i === repeats - 1];
                if (isFirst) times[0] = { querySet: set, beginningOfPassWriteIndex: 0 };
                if (isLast) times[count - 1] = { ...(times[count - 1] ?? { querySet: set }), endOfPassWriteIndex: 1 };
            }
            encode(encoder, times);
        }
        if (set) {
            encoder.resolveQuerySet(set, 0, 2, resolved, 0);
            encoder.copyBufferToBuffer(resolved, 0, mapped, 0, 16);
        }
        const commands = encoder.finish();
        const began = performance.now();
        device.queue.submit([commands]);
        await device.queue.onSubmittedWorkDone();
        let took = performance.now() - began;
        if (set) {
            await mapped.mapAsync(GPUMapMode.READ);
            const [first, last] = new BigInt64Array(mapped.getMappedRange());
            took = Number(last - first) / 1e6;
            for (const resource of [set, resolved, mapped]) resource.destroy();
        }
        if (this.lost) throw new Error(`the GPU was lost: ${this.lost}`);
        return took / repeats;
    }

    release({ owned }) {
        for (const resource of owned) resource.destroy();
    }
}

const viewOf = (texture) => texture.createView({ aspect: aspect(texture.format) });

/** A blend state of a plan, whose names are WebGPU's. */
function blended({ color, alpha }) {
    const part = ({ operation, src: srcFactor, dst: dstFactor }) => ({ operation, srcFactor, dstFactor });
    return { color: part(color), alpha: part(alpha) };
}
