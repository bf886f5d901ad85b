// GL's state in WebGPU's words.

const COMPARE = ['never', 'less', 'equal', 'less-equal', 'greater', 'not-equal', 'greater-equal', 'always'];
const compareOf = (value) => COMPARE[value - 0x200];

const FACTORS = {
    0: 'zero',
    1: 'one',
    0x300: 'src',
    0x301: 'one-minus-src',
    0x302: 'src-alpha',
    0x303: 'one-minus-src-alpha',
    0x304: 'dst-alpha',
    0x305: 'one-minus-dst-alpha',
    0x306: 'dst',
    0x307: 'one-minus-dst',
    0x308: 'src-alpha-saturated',
    0x8001: 'constant',
    0x8002: 'one-minus-constant',
    0x8003: 'constant-alpha',
    0x8004: 'one-minus-constant-alpha',
};
const OPERATIONS = {
    0x8006: 'add',
    0x800a: 'subtract',
    0x800b: 'reverse-subtract',
    0x8007: 'min',
    0x8008: 'max',
};
const STENCIL = {
    0x1e00: 'keep',
    0: 'zero',
    0x1e01: 'replace',
    0x1e02: 'increment-clamp',
    0x1e03: 'decrement-clamp',
    0x150a: 'invert',
    0x8507: 'increment-wrap',
    0x8508: 'decrement-wrap',
};

/** WebGPU's word for a value of GL's. An extension may bring values that WebGPU lacks. */
function word(table, value) {
    const found = table[value];
    if (found === undefined) throw new Error(`WebGPU has nothing for the value 0x${value.toString(16)}`);
    return found;
}
const TOPOLOGIES = [
    'point-list',
    'line-list',
    'line-loop',
    'line-strip',
    'triangle-list',
    'triangle-strip',
    'triangle-fan',
];
const WRAPS = {
    0x2901: 'repeat',
    0x812f: 'clamp-to-edge',
    0x8370: 'mirror-repeat',
};
const INDEX_FORMATS = {
    0x1401: ['uint8', 1],
    0x1403: ['uint16', 2],
    0x1405: ['uint32', 4],
};

/** The state that a pipeline and a pass take: asked again after it changed. */
function fixedState(o, two, clipControl) {
    const get = (name) => o.getParameter(GL[name]);
    const on = (name) => o.isEnabled(GL[name]);
    const state = {
        cull: on('CULL_FACE') ? get('CULL_FACE_MODE') : 0,
        frontFace: get('FRONT_FACE') === GL.CW ? 'cw' : 'ccw',
        colorMask: get('COLOR_WRITEMASK'),
        depthMask: get('DEPTH_WRITEMASK'),
        depthTest: on('DEPTH_TEST'),
        viewport: [...get('VIEWPORT')],
        depthRange: [...get('DEPTH_RANGE')],
        scissor: on('SCISSOR_TEST') ? [...get('SCISSOR_BOX')] : null,
        alphaToCoverage: on('SAMPLE_ALPHA_TO_COVERAGE'),
        sampleCoverage: on('SAMPLE_COVERAGE'),
        stencilMask: get('STENCIL_WRITEMASK') & 0xff,
        clip: clipControl && clipOf(o),
        discards: two && on('RASTERIZER_DISCARD'),
    };
    if (state.depthTest) state.depthFunc = compareOf(get('DEPTH_FUNC'));
    if (on('BLEND')) state.blend = blendState(get);
    if (state.blend) state.constant = [...get('BLEND_COLOR')].map(finite);
    if (on('STENCIL_TEST')) Object.assign(state, stencilState(get));
    if (on('POLYGON_OFFSET_FILL')) state.bias = [get('POLYGON_OFFSET_UNITS'), get('POLYGON_OFFSET_FACTOR')];
    return state;
}

/** What `EXT_clip_control` says of clip space. */
function clipOf(o) {
    return { zeroToOne: o.getParameter(0x935d) === 0x935f, upperLeft: o.getParameter(0x935c) === 0x8ca2 };
}

function blendState(get) {
    const part = (name) => {
        const operation = word(OPERATIONS, get(`BLEND_EQUATION_${name}`));
        const [srcFactor, dstFactor] = ['SRC', 'DST'].map((side) => word(FACTORS, get(`BLEND_${side}_${name}`)));
        if (operation === 'min' || operation === 'max') return { operation, srcFactor: 'one', dstFactor: 'one' };
        return { operation, srcFactor, dstFactor };
    };
    return { color: part('RGB'), alpha: part('ALPHA') };
}

function stencilState(get) {
    const face = (back) => ({
        compare: compareOf(get(`STENCIL_${back}FUNC`)),
        failOp: word(STENCIL, get(`STENCIL_${back}FAIL`)),
        depthFailOp: word(STENCIL, get(`STENCIL_${back}PASS_DEPTH_FAIL`)),
        passOp: word(STENCIL, get(`STENCIL_${back}PASS_DEPTH_PASS`)),
    });
    return {
        stencil: {
            front: face(''),
            back: face('BACK_'),
            readMask: get('STENCIL_VALUE_MASK') & 0xff,
        },
        reference: get('STENCIL_REF'),
    };
}

/** The parts of a GPURenderPipelineDescriptor that come from state and target. */
function pipelineState(state, target, mode, indexFormat) {
    const topology = TOPOLOGIES[mode];
    const primitive = { topology, frontFace: state.frontFace };
    if (topology.endsWith('strip') && indexFormat) primitive.stripIndexFormat = indexFormat;
    if (state.cull) primitive.cullMode = state.cull === GL.FRONT ? 'front' : 'back';
    const mask = state.colorMask.reduce((bits, on, i) => bits | (on ? 1 << i : 0), 0);
    const targets = target.colors.map((color) => {
        if (!color) return null;
        const { format, rgb, kind } = color;
        const made = { format, writeMask: rgb ? mask & 7 : mask };
        if (state.blend && kind !== 'sint' && kind !== 'uint') made.blend = state.blend;
        return made;
    });
    const parts = { primitive, targets };
    if (state.clip?.zeroToOne) parts.clipSpace = 'zero-to-one';
    if (target.depth) parts.depthStencil = depthState(state, target.depth.format);
    if (target.samples > 1) {
        parts.multisample = {
            count: target.samples,
            alphaToCoverageEnabled: state.alphaToCoverage,
        };
    }
    return parts;
}

function depthState(state, format) {
    const depth = format.startsWith('depth');
    const made = {
        format,
        depthWriteEnabled: depth && state.depthTest && state.depthMask,
        depthCompare: depth && state.depthTest ? state.depthFunc : 'always',
    };
    if (state.stencil && format.includes('stencil')) {
        made.stencilFront = state.stencil.front;
        made.stencilBack = state.stencil.back;
        made.stencilReadMask = state.stencil.readMask;
        made.stencilWriteMask = state.stencilMask;
    }
    if (state.bias) {
        const [units] = state.bias;
        // WebGPU's bias is whole, and WebGPU cuts what a page gives it.
        made.depthBias = Math.trunc(units);
        if (made.depthBias !== units) made.depthBiasUnits = units;
        made.depthBiasSlopeScale = state.bias[1];
    }
    return made;
}

/** A GPUSamplerDescriptor of a texture's or a sampler object's parameters. */
function samplerState(get, two, anisotropic) {
    const min = get(GL.TEXTURE_MIN_FILTER);
    const mips = min >= GL.NEAREST_MIPMAP_NEAREST;
    const wrapOf = (name) => WRAPS[get(name)] ?? 'clamp-to-edge';
    const made = {
        addressModeU: wrapOf(GL.TEXTURE_WRAP_S),
        addressModeV: wrapOf(GL.TEXTURE_WRAP_T),
        addressModeW: two ? wrapOf(GL.TEXTURE_WRAP_R) : 'clamp-to-edge',
        magFilter: get(GL.TEXTURE_MAG_FILTER) === GL.LINEAR ? 'linear' : 'nearest',
        minFilter: min === GL.LINEAR || min === 0x2701 || min === 0x2703 ? 'linear' : 'nearest',
        mipmapFilter: min >= 0x2702 ? 'linear' : 'nearest',
    };
    // Without mip levels GL takes the base level, and still tells minification from magnification.
    if (!mips) made.lodMaxClamp = 0.25;
    else if (two) {
        made.lodMinClamp = Math.max(0, get(GL.TEXTURE_MIN_LOD));
        made.lodMaxClamp = Math.min(32, Math.max(made.lodMinClamp, get(GL.TEXTURE_MAX_LOD)));
    }
    if (two && get(GL.TEXTURE_COMPARE_MODE) === GL.COMPARE_REF_TO_TEXTURE) {
        made.compare = compareOf(get(GL.TEXTURE_COMPARE_FUNC));
    }
    const linear = made.magFilter === 'linear' && made.minFilter === 'linear' && made.mipmapFilter === 'linear';
    if (anisotropic && linear) {
        const anisotropy = Math.floor(get(0x84fe) ?? 1);
        if (anisotropy > 1) made.maxAnisotropy = anisotropy;
    }
    return made;
}

const COMPONENT_TYPES = {
    0x1400: ['sint8', 'snorm8', 'sscaled8', 1],
    0x1401: ['uint8', 'unorm8', 'uscaled8', 1],
    0x1402: ['sint16', 'snorm16', 'sscaled16', 2],
    0x1403: ['uint16', 'unorm16', 'uscaled16', 2],
    0x1404: ['sint32', 'snorm32', 'sscaled32', 4],
    0x1405: ['uint32', 'unorm32', 'uscaled32', 4],
    0x1406: ['float32', 'float32', 'float32', 4],
    0x140b: ['float16', 'float16', 'float16', 2],
};

/** `{format, bytes}` of a vertex attribute. */
function vertexFormat(type, size, normalized, integer) {
    if (type === 0x8368)
        return {
            format: normalized ? 'unorm10-10-10-2' : 'uscaled10-10-10-2',
            bytes: 4,
        };
    if (type === 0x8d9f)
        return {
            format: normalized ? 'snorm10-10-10-2' : 'sscaled10-10-10-2',
            bytes: 4,
        };
    const [int, norm, scaled, bytes] = COMPONENT_TYPES[type];
    const name = integer ? int : normalized ? norm : scaled;
    return { format: size === 1 ? name : `${name}x${size}`, bytes: bytes * size };
}

/** Sampler types of GLSL: the texture target that each samples. */
const SAMPLER_TARGETS = {
    0x8b5e: 0x0de1,
    0x8b62: 0x0de1,
    0x8dca: 0x0de1,
    0x8dd2: 0x0de1,
    0x8b5f: 0x806f,
    0x8dcb: 0x806f,
    0x8dd3: 0x806f,
    0x8b60: 0x8513,
    0x8dc5: 0x8513,
    0x8dcc: 0x8513,
    0x8dd4: 0x8513,
    0x8dc1: 0x8c1a,
    0x8dc4: 0x8c1a,
    0x8dcf: 0x8c1a,
    0x8dd7: 0x8c1a,
};
const VIEW_DIMENSIONS = {
    0x0de1: '2d',
    0x806f: '3d',
    0x8513: 'cube',
    0x8c1a: '2d-array',
};

/** Numbers in a value of a uniform's type, and columns of an attribute of a matrix type. */
const SIZES = {
    0x1406: 1,
    0x8b50: 2,
    0x8b51: 3,
    0x8b52: 4,
    0x1404: 1,
    0x8b53: 2,
    0x8b54: 3,
    0x8b55: 4,
    0x8b56: 1,
    0x8b57: 2,
    0x8b58: 3,
    0x8b59: 4,
    0x8b5a: 4,
    0x8b5b: 9,
    0x8b5c: 16,
    0x1405: 1,
    0x8dc6: 2,
    0x8dc7: 3,
    0x8dc8: 4,
    0x8b65: 6,
    0x8b66: 8,
    0x8b67: 6,
    0x8b68: 12,
    0x8b69: 8,
    0x8b6a: 12,
};
const COLUMNS = {
    0x8b5a: 2,
    0x8b5b: 3,
    0x8b5c: 4,
    0x8b65: 2,
    0x8b66: 2,
    0x8b67: 3,
    0x8b68: 3,
    0x8b69: 4,
    0x8b6a: 4,
};
