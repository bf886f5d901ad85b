// Reads buffers and textures of the page's device back: a copy now, the bytes later. Errors stay ours.

/** Methods of WebGPU as the browser has them. */
const gpu = {};

function keepMethods() {
    const keep = (type, ...names) => {
        for (const name of names) gpu[name] = type.prototype[name];
    };
    keep(GPUDevice, 'createBuffer', 'createCommandEncoder', 'pushErrorScope', 'popErrorScope');
    keep(GPUCommandEncoder, 'copyBufferToBuffer', 'copyTextureToBuffer', 'finish');
    keep(GPUQueue, 'submit', 'onSubmittedWorkDone');
    keep(GPUBuffer, 'mapAsync', 'getMappedRange', 'unmap', 'destroy');
}

/** What was copied at one moment. `take()` resolves to its bytes, or throws why not. */
class Staged {
    constructor(device, size, copy) {
        gpu.pushErrorScope.call(device, 'validation');
        gpu.pushErrorScope.call(device, 'out-of-memory');
        const usage = GPUBufferUsage.COPY_DST | GPUBufferUsage.MAP_READ;
        this.buffer = gpu.createBuffer.call(device, {
            size: Math.max(4, (size + 3) & ~3),
            usage,
        });
        const encoder = gpu.createCommandEncoder.call(device);
        copy(encoder, this.buffer);
        gpu.submit.call(device.queue, [gpu.finish.call(encoder)]);
        this.error = Promise.all([gpu.popErrorScope.call(device), gpu.popErrorScope.call(device)]);
        this.error.catch(() => {});
        this.size = size;
    }

    async take() {
        const error = (await this.error).find(Boolean);
        if (error) throw new Error(error.message.split('\n')[0]);
        await gpu.mapAsync.call(this.buffer, GPUMapMode.READ);
        const bytes = new Uint8Array(gpu.getMappedRange.call(this.buffer)).slice(0, this.size);
        this.drop();
        return bytes;
    }

    drop() {
        gpu.destroy.call(this.buffer);
    }
}

/** A whole buffer. */
function stageBuffer(thing) {
    // Copies are of whole words.
    const size = thing.descriptor.size & ~3;
    return new Staged(thing.device, size, (encoder, target) => {
        if (size) gpu.copyBufferToBuffer.call(encoder, thing.object, 0, target, 0, size);
    });
}

/** A region of a texture. `take()` resolves to rows without padding. */
function stageTexture(thing, { mipLevel = 0, at = [0, 0, 0], aspect = 'all', size }) {
    const block = blockOf(thing.descriptor.format, aspect);
    const columns = Math.ceil(size[0] / block.width);
    const rows = Math.ceil(size[1] / block.height);
    const row = columns * block.bytes;
    const bytesPerRow = Math.ceil(row / 256) * 256;
    const physical = [columns * block.width, rows * block.height, size[2]];
    const staged = new Staged(thing.device, bytesPerRow * rows * size[2], (encoder, buffer) => {
        const source = { texture: thing.object, mipLevel, origin: at, aspect };
        gpu.copyTextureToBuffer.call(encoder, source, { buffer, bytesPerRow, rowsPerImage: rows }, physical);
    });
    return {
        async take() {
            const bytes = await staged.take();
            if (bytesPerRow === row) return bytes;
            const tight = new Uint8Array(row * rows * size[2]);
            for (let i = 0; i < rows * size[2]; i++) {
                tight.set(bytes.subarray(i * bytesPerRow, i * bytesPerRow + row), i * row);
            }
            return tight;
        },
        drop: () => staged.drop(),
    };
}

/** Why a texture's content cannot be read back, if so. */
function unreadable({ format, sampleCount, usage }) {
    if (sampleCount > 1) return 'WebGPU copies no samples';
    if (usage & 0x20) return 'transient';
    return null;
}
