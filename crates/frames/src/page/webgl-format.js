// WebGL's texture formats, the nearest of WebGPU, and texels in them.

/** GL's constants, by name. */
const GL = globalThis.WebGL2RenderingContext ?? globalThis.WebGLRenderingContext;

/** Sized formats: `[WebGPU's format, kind of texel]`. `rgb`: GL has no alpha there, and WebGPU does. */
const SIZED = {
    R8: ['r8unorm', 'unorm'],
    RG8: ['rg8unorm', 'unorm'],
    RGB8: ['rgba8unorm', 'unorm', 'rgb'],
    RGB565: ['rgba8unorm', 'unorm', 'rgb'],
    RGBA8: ['rgba8unorm', 'unorm'],
    RGBA4: ['rgba8unorm', 'unorm'],
    RGB5_A1: ['rgba8unorm', 'unorm'],
    SRGB8: ['rgba8unorm-srgb', 'srgb', 'rgb'],
    SRGB8_ALPHA8: ['rgba8unorm-srgb', 'srgb'],
    R8_SNORM: ['r8snorm', 'snorm'],
    RG8_SNORM: ['rg8snorm', 'snorm'],
    RGB8_SNORM: ['rgba8snorm', 'snorm', 'rgb'],
    RGBA8_SNORM: ['rgba8snorm', 'snorm'],
    R16F: ['r16float', 'float'],
    RG16F: ['rg16float', 'float'],
    RGB16F: ['rgba16float', 'float', 'rgb'],
    RGBA16F: ['rgba16float', 'float'],
    R32F: ['r32float', 'float'],
    RG32F: ['rg32float', 'float'],
    RGB32F: ['rgba32float', 'float', 'rgb'],
    RGBA32F: ['rgba32float', 'float'],
    R11F_G11F_B10F: ['rg11b10ufloat', 'float'],
    RGB9_E5: ['rgba16float', 'float', 'rgb'],
    RGB10_A2: ['rgb10a2unorm', 'float'],
    RGB10_A2UI: ['rgb10a2uint', 'uint'],
    DEPTH_COMPONENT16: ['depth16unorm', 'depth'],
    DEPTH_COMPONENT24: ['depth24plus', 'depth'],
    DEPTH_COMPONENT32F: ['depth32float', 'depth'],
    DEPTH24_STENCIL8: ['depth24plus-stencil8', 'depth'],
    DEPTH32F_STENCIL8: ['depth32float-stencil8', 'depth'],
    STENCIL_INDEX8: ['stencil8', 'stencil'],
    DEPTH_STENCIL: ['depth24plus-stencil8', 'depth'],
};
const formats = new Map();

function installFormats() {
    for (const [name, entry] of Object.entries(SIZED)) formats.set(WebGL2RenderingContext[name], entry);
    for (const bits of [8, 16, 32]) {
        for (const [letter, kind] of [
            ['I', 'sint'],
            ['UI', 'uint'],
        ]) {
            const add = (channels, ours, rgb) => {
                const internal = WebGL2RenderingContext[`${channels}${bits}${letter}`];
                formats.set(internal, [`${ours}${bits}${kind}`, kind, rgb]);
            };
            add('R', 'r');
            add('RG', 'rg');
            add('RGB', 'rgba', 'rgb');
            add('RGBA', 'rgba');
        }
    }
}

const HALF_FLOAT_OES = 0x8d61;
const SRGB_EXT = 0x8c40;
const SRGB_ALPHA_EXT = 0x8c42;

/** `{format, kind, rgb}` of an internal format, sized or not; compressed ones are written out as texels. */
function textureFormat(internal, type) {
    const [format, kind, rgb] = formats.get(internal) ?? unsized(internal, type) ?? compressed(internal);
    return { format, kind, rgb: Boolean(rgb) };
}

function unsized(internal, type) {
    const rgb = internal === GL.RGB || internal === GL.LUMINANCE || internal === SRGB_EXT ? 'rgb' : undefined;
    switch (internal) {
        case GL.DEPTH_COMPONENT:
            return type === GL.UNSIGNED_SHORT ? ['depth16unorm', 'depth'] : ['depth24plus', 'depth'];
        case SRGB_EXT:
        case SRGB_ALPHA_EXT:
            return ['rgba8unorm-srgb', 'srgb', rgb];
        case GL.RGB:
        case GL.RGBA:
        case GL.LUMINANCE:
        case GL.ALPHA:
        case GL.LUMINANCE_ALPHA:
            if (type === GL.FLOAT) return ['rgba32float', 'float', rgb];
            if (type === HALF_FLOAT_OES || type === WebGL2RenderingContext.HALF_FLOAT) {
                return ['rgba16float', 'float', rgb];
            }
            return ['rgba8unorm', 'unorm', rgb];
        default:
            return null;
    }
}

/** BC6H is of floats; sRGB formats stay sRGB. */
function compressed(internal) {
    if (internal === 0x8e8e || internal === 0x8e8f) return ['rgba16float', 'float'];
    const srgb =
        (internal >= 0x8c4c && internal <= 0x8c4f) ||
        internal === 0x8e8d ||
        (internal >= 0x93d0 && internal <= 0x93dd) ||
        [0x9275, 0x9277, 0x9279].includes(internal);
    return srgb ? ['rgba8unorm-srgb', 'srgb'] : ['rgba8unorm', 'unorm'];
}

const CHANNELS = { r: 1, rg: 2, rgba: 4 };

/** RGBA pixels (bytes, floats or integers) as texels of `format`. */
function encode(pixels, format, kind) {
    if (format === 'rg11b10ufloat')
        return packed(pixels, (r, g, b) => small(r, 6) | (small(g, 6) << 11) | (small(b, 5) << 22));
    if (format === 'rgb10a2unorm') {
        const ten = (value) => Math.round(value * 1023);
        return packed(pixels, (r, g, b, a) => ten(r) | (ten(g) << 10) | (ten(b) << 20) | (Math.round(a * 3) << 30));
    }
    if (format === 'rgb10a2uint') return packed(pixels, (r, g, b, a) => r | (g << 10) | (b << 20) | (a << 30));
    if (format.startsWith('depth16')) return spread(pixels, 1, Uint16Array, (value) => Math.round(value * 65535));
    // The reader draws depths of 24 bits, since WebGPU copies none.
    if (format.startsWith('depth')) return spread(pixels, 1, Float32Array, (value) => value);
    const [, letters, bits] = /^(rgba|rg|r)(8|16|32)/.exec(format);
    const channels = CHANNELS[letters];
    const same = (value) => value;
    switch (kind) {
        case 'unorm':
        case 'srgb':
            if (pixels instanceof Uint8Array)
                return channels === 4 ? pixels : spread(pixels, channels, Uint8Array, same);
            if (kind === 'unorm') return spread(pixels, channels, Uint8Array, (value) => Math.round(value * 255));
            return spread(pixels, channels, Uint8Array, (value, i) =>
                Math.round((i === 3 ? value : gamma(value)) * 255),
            );
        case 'snorm':
            return spread(pixels, channels, Int8Array, (value) => Math.round(value * 127));
        case 'float':
            if (bits === '16') return spread(pixels, channels, Uint16Array, half);
            return spread(pixels, channels, Float32Array, same);
        default: {
            const types = {
                sint: [Int8Array, Int16Array, Int32Array],
                uint: [Uint8Array, Uint16Array, Uint32Array],
            };
            return spread(pixels, channels, types[kind][Math.log2(bits) - 3], same);
        }
    }
}

function spread(pixels, channels, Type, convert) {
    const count = pixels.length / 4;
    const texels = new Type(count * channels);
    for (let i = 0; i < count; i++) {
        for (let c = 0; c < channels; c++) texels[i * channels + c] = convert(pixels[i * 4 + c], c);
    }
    return new Uint8Array(texels.buffer);
}

function packed(pixels, pack) {
    const texels = new Uint32Array(pixels.length / 4);
    for (let i = 0; i < texels.length; i++) {
        texels[i] = pack(pixels[4 * i], pixels[4 * i + 1], pixels[4 * i + 2], pixels[4 * i + 3]);
    }
    return new Uint8Array(texels.buffer);
}

function gamma(value) {
    return value <= 0.0031308 ? value * 12.92 : 1.055 * value ** (1 / 2.4) - 0.055;
}

const floatBits = new Float32Array(1);
const intBits = new Uint32Array(floatBits.buffer);

/** A half float, rounded to the nearest. */
function half(value) {
    floatBits[0] = value;
    const bits = intBits[0];
    const sign = (bits >>> 16) & 0x8000;
    const magnitude = bits & 0x7fffffff;
    if (magnitude > 0x7f800000) return sign | 0x7e00;
    if (magnitude >= 0x47800000) return sign | 0x7c00;
    if (magnitude < 0x38800000) return sign | Math.round(Math.abs(value) * 2 ** 24);
    const rounded = magnitude - 0x38000000 + 0xfff + ((magnitude >>> 13) & 1);
    return sign | (rounded >>> 13);
}

/** An unsigned float of 5 bits of exponent and `bits` of mantissa. */
function small(value, bits) {
    return half(Math.max(0, value)) >>> (10 - bits);
}
