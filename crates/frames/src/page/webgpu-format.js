// Sizes of WebGPU's texture formats, and regions of textures as tight rows.

const BYTES_OF_KIND = { 8: 1, 16: 2, 32: 4 };

/** `{bytes, width, height}` of a format's block; null where WebGPU copies no such format. */
function blockOf(format, aspect) {
    if (aspect === 'stencil-only' || format === 'stencil8') return { bytes: 1, width: 1, height: 1 };
    if (format === 'depth16unorm') return { bytes: 2, width: 1, height: 1 };
    if (format.startsWith('depth32float')) return { bytes: 4, width: 1, height: 1 };
    if (format.startsWith('depth24')) return null;
    if (/^(rgb10a2|rg11b10|rgb9e5)/.test(format)) return { bytes: 4, width: 1, height: 1 };
    const astc = /^astc-(\d+)x(\d+)/.exec(format);
    if (astc) return { bytes: 16, width: Number(astc[1]), height: Number(astc[2]) };
    if (/^(bc[14]-|etc2-rgb8|eac-r11)/.test(format)) return { bytes: 8, width: 4, height: 4 };
    if (/^(bc|etc2|eac)/.test(format)) return { bytes: 16, width: 4, height: 4 };
    const plain = /^(rgba|bgra|rg|r)(8|16|32)/.exec(format);
    if (!plain) return null;
    const channels = { r: 1, rg: 2, rgba: 4, bgra: 4 }[plain[1]];
    return { bytes: channels * BYTES_OF_KIND[plain[2]], width: 1, height: 1 };
}

/** The aspects of a format that hold content. */
function aspectsOf(format) {
    if (!/^(depth|stencil)/.test(format)) return ['all'];
    const aspects = [];
    if (format.startsWith('depth')) aspects.push('depth-only');
    if (format.includes('stencil')) aspects.push('stencil-only');
    return aspects;
}

/** `[width, height, layers]` of a GPUExtent3D. */
function extent(size) {
    if (typeof size !== 'object' || size === null) return [size, 1, 1];
    if (Symbol.iterator in size) {
        const [width, height = 1, layers = 1] = size;
        return [width, height, layers];
    }
    return [size.width, size.height ?? 1, size.depthOrArrayLayers ?? 1];
}

/** `[x, y, z]` of a GPUOrigin3D. */
function origin(value) {
    if (!value) return [0, 0, 0];
    if (Symbol.iterator in value) {
        const [x = 0, y = 0, z = 0] = value;
        return [x, y, z];
    }
    return [value.x ?? 0, value.y ?? 0, value.z ?? 0];
}

/** `[r, g, b, a]` of a GPUColor. */
function color(value) {
    if (!value) return [0, 0, 0, 0];
    return Symbol.iterator in value ? [...value] : [value.r, value.g, value.b, value.a];
}

/** The size of a mip level; layers do not shrink, depth does. */
function levelSize({ size, dimension }, level) {
    const shrink = (value) => Math.max(1, value >> level);
    return [shrink(size[0]), dimension === '1d' ? 1 : shrink(size[1]), dimension === '3d' ? shrink(size[2]) : size[2]];
}

/** The bytes that GPUTexelCopyBufferLayout's region covers. */
function regionBytes(block, { bytesPerRow, rowsPerImage }, size) {
    const columns = Math.ceil(size[0] / block.width);
    const rows = Math.ceil(size[1] / block.height);
    const row = columns * block.bytes;
    if (!columns || !rows || !size[2]) return 0;
    return (bytesPerRow ?? row) * ((rowsPerImage ?? rows) * (size[2] - 1) + rows - 1) + row;
}

/** The bytes of an ArrayBuffer or a view. */
function bytesOf(data) {
    if (ArrayBuffer.isView(data)) return new Uint8Array(data.buffer, data.byteOffset, data.byteLength);
    return new Uint8Array(data);
}
