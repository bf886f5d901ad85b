// Draws plans with Dawn on the machine's Vulkan driver, from plan.json, the texts that it names,
// inputs.json beside it, and the files of ../data that this names.
//
// Paths of plan.json files come on stdin, one a line. The last line of stdout is one JSON array:
// [{"path": .., "adapter": .., "lacking": [..], "errors": [..], "colors": [..]}]. `colors` names a file for each colour target,
// rows from the top without padding.
import { readFileSync, writeFileSync } from 'node:fs';
import { dirname, join } from 'node:path';
import { create, globals } from 'webgpu';
import { dawn, pipelines } from './pipelines.mjs';

Object.assign(globalThis, globals);

const { device, name: adapter } = await dawn(create, 'vulkan');
const { render, lacks } = pipelines(device);

const COPY = GPUBufferUsage.COPY_DST;

/** Buffers and textures of the plan at hand: destroyed behind it, because a collector comes too late. */
let owned = [];
const making = (method) => (descriptor) => {
    const made = device[method](descriptor);
    owned.push(made);
    return made;
};
const createBuffer = making('createBuffer');
const createTexture = making('createTexture');

/** The folder of the data that `inputs.json` names. */
let data;
const bytesOf = (name) => readFileSync(join(data, name));

function buffer(name, usage) {
    const bytes = bytesOf(name);
    const made = createBuffer({ size: Math.ceil(bytes.length / 4) * 4, usage: usage | COPY });
    device.queue.writeBuffer(made, 0, bytes);
    return made;
}

/** A texture of `inputs.json`, with its levels. Its texels have a power of two of bytes each, and no blocks. */
function texture({ format, size, layers, view, levels }) {
    const usage = GPUTextureUsage.TEXTURE_BINDING | GPUTextureUsage.COPY_DST;
    const dimension = view === '3d' ? '3d' : '2d';
    const made = createTexture({
        format,
        size: [...size, layers],
        dimension,
        usage,
        mipLevelCount: levels.length,
    });
    levels.forEach((name, mipLevel) => {
        const bytes = bytesOf(name);
        const [width, height] = size.map((n) => Math.max(1, n >> mipLevel));
        const depth = dimension === '3d' ? Math.max(1, layers >> mipLevel) : layers;
        const bytesPerRow = bytes.length / (height * depth);
        device.queue.writeTexture({ texture: made, mipLevel }, bytes, { bytesPerRow, rowsPerImage: height }, [
            width,
            height,
            depth,
        ]);
    });
    return made.createView({ dimension: view });
}

function depthTexture({ size, view, value, layers }) {
    const usage = GPUTextureUsage.TEXTURE_BINDING | GPUTextureUsage.RENDER_ATTACHMENT;
    const made = createTexture({ format: 'depth32float', size: [...size, layers], usage });
    const encoder = device.createCommandEncoder();
    for (let baseArrayLayer = 0; baseArrayLayer < layers; baseArrayLayer++) {
        const layer = made.createView({ dimension: '2d', baseArrayLayer, arrayLayerCount: 1 });
        const depth = { view: layer, depthClearValue: value, depthLoadOp: 'clear', depthStoreOp: 'store' };
        encoder.beginRenderPass({ colorAttachments: [], depthStencilAttachment: depth }).end();
    }
    device.queue.submit([encoder.finish()]);
    return made.createView({ dimension: view });
}

/** What `pass.bindings` lists, bound from a draw's inputs and the frame's attachments. */
function bindGroups(pipeline, pass, draw, attachments) {
    const groups = new Map();
    for (const { group, binding, name, source } of pass.bindings) {
        const at = (list) => list.find((b) => b.group === group && b.binding === binding);
        const [uniform, image, sampler] = [at(draw.buffers), at(draw.textures), at(draw.samplers)];
        let resource;
        if (source.from === 'attachment') {
            const made = attachments.get(source.name ?? source.attachment ?? source.of);
            if (!made) throw new Error(`\`${name}\` reads an attachment that no pass draws to`);
            resource = made.createView({ aspect: made.format.startsWith('depth') ? 'depth-only' : 'all' });
        } else if (uniform) {
            const usage = uniform.kind === 'uniform' ? GPUBufferUsage.UNIFORM : GPUBufferUsage.STORAGE;
            resource = { buffer: buffer(uniform.bytes, usage) };
        } else if (image) resource = image.levels ? texture(image) : depthTexture(image);
        else if (sampler) resource = device.createSampler(sampler.descriptor);
        else throw new Error(`\`${name}\` has no input`);
        groups.set(group, [...(groups.get(group) ?? []), { binding, resource }]);
    }
    for (const [group, entries] of groups)
        groups.set(group, device.createBindGroup({ layout: pipeline.getBindGroupLayout(group), entries }));
    return groups;
}

async function readBack(made, [width, height], bytesPerTexel, path) {
    const bytesPerRow = Math.ceil((width * bytesPerTexel) / 256) * 256;
    const into = createBuffer({ size: bytesPerRow * height, usage: COPY | GPUBufferUsage.MAP_READ });
    const encoder = device.createCommandEncoder();
    encoder.copyTextureToBuffer({ texture: made }, { buffer: into, bytesPerRow }, [width, height]);
    device.queue.submit([encoder.finish()]);
    await into.mapAsync(GPUMapMode.READ);
    const all = Buffer.from(into.getMappedRange());
    const rows = Array.from({ length: height }, (_, y) =>
        all.subarray(y * bytesPerRow, y * bytesPerRow + width * bytesPerTexel),
    );
    writeFileSync(path, Buffer.concat(rows));
}

async function drawn(path, result) {
    const folder = dirname(path);
    data = join(folder, '../data');
    const plan = JSON.parse(readFileSync(path, 'utf8'));
    const inputs = JSON.parse(readFileSync(join(folder, 'inputs.json'), 'utf8'));
    const attachments = new Map();
    const usage = GPUTextureUsage.RENDER_ATTACHMENT | GPUTextureUsage.TEXTURE_BINDING | GPUTextureUsage.COPY_SRC;
    for (const { name, format } of plan.attachments)
        attachments.set(
            name,
            createTexture({
                format,
                size: inputs.size,
                usage: usage & ~(format.startsWith('depth') ? GPUTextureUsage.COPY_SRC : 0),
            }),
        );
    const encoder = device.createCommandEncoder();
    const colors = [];
    const cleared = new Set();
    const load = (key) => (cleared.has(key) ? 'load' : (cleared.add(key), 'clear'));
    for (const [i, pass] of plan.passes.entries()) {
        result.lacking.push(...lacks(pass));
        if (result.lacking.length > 0) return;
        const colorAttachments = pass.targets.map((target, t) => {
            if (!target) return null;
            colors[t] ??= createTexture({ format: target.format, size: inputs.size, usage });
            return {
                view: colors[t].createView(),
                clearValue: inputs.clear,
                loadOp: load(`color ${t}`),
                storeOp: 'store',
            };
        });
        const { depth } = pass;
        const depthStencilAttachment = depth && {
            view: attachments.get(depth.attachment).createView(),
            ...(depth.read_only
                ? { depthReadOnly: true }
                : { depthClearValue: inputs.depth, depthLoadOp: load(depth.attachment), depthStoreOp: 'store' }),
        };
        const encoded = encoder.beginRenderPass({ colorAttachments, ...(depth && { depthStencilAttachment }) });
        for (const draw of inputs.passes[i]) {
            const pipeline = render(
                plan,
                pass,
                plan.files[i],
                folder,
                draw.vertexBuffers.map((v) => v.layout),
            );
            encoded.setPipeline(pipeline);
            for (const [group, made] of bindGroups(pipeline, pass, draw, attachments))
                encoded.setBindGroup(group, made);
            draw.vertexBuffers.forEach((v, slot) =>
                encoded.setVertexBuffer(slot, buffer(v.bytes, GPUBufferUsage.VERTEX)),
            );
            const { first, count, baseVertex, firstInstance, instances, indices } = draw;
            if (indices) {
                encoded.setIndexBuffer(buffer(indices.bytes, GPUBufferUsage.INDEX), indices.format);
                encoded.drawIndexed(count, instances, first, baseVertex, firstInstance);
            } else encoded.draw(count, instances, first, firstInstance);
        }
        encoded.end();
    }
    device.queue.submit([encoder.finish()]);
    for (const [t, made] of colors.entries()) {
        if (!made) continue;
        const file = join(folder, `color-${t}.bin`);
        await readBack(made, inputs.size, inputs.bytesPerTexel[t], file);
        result.colors.push(file);
    }
}

const results = [];
for (const path of readFileSync(0, 'utf8')
    .split('\n')
    .filter((path) => path !== '')) {
    const result = { path, adapter, lacking: [], errors: [], colors: [] };
    device.pushErrorScope('validation');
    try {
        await drawn(path, result);
    } catch (error) {
        result.errors.push(`${error}`);
    }
    const error = await device.popErrorScope();
    if (error) result.errors.push(error.message);
    results.push(result);
    owned.forEach((made) => made.destroy());
    owned = [];
}
// Dawn's threads keep node alive; leave once the pipe has taken everything.
process.stdout.write(`\n${JSON.stringify(results)}`, () => process.exit(0));
