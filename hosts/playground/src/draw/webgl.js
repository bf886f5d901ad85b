// Draws plans with WebGL 2.

import { link } from './reflect.js';
import { key } from './plan.js';

const CLEAR = [0.3, 0.38, 0.48, 1];
const COMPARE = ['never', 'less', 'equal', 'less-equal', 'greater', 'not-equal', 'greater-equal', 'always'];
const DEPTHS = {
    depth16unorm: 'DEPTH_COMPONENT16',
    depth24plus: 'DEPTH_COMPONENT24',
    depth32float: 'DEPTH_COMPONENT32F',
    'depth24plus-stencil8': 'DEPTH24_STENCIL8',
    'depth32float-stencil8': 'DEPTH32F_STENCIL8',
};
const COLORS = { rgba8unorm: 'RGBA8', 'rgba8unorm-srgb': 'SRGB8_ALPHA8', r32float: 'R32F' };
const OPERATIONS = {
    add: 'FUNC_ADD',
    subtract: 'FUNC_SUBTRACT',
    'reverse-subtract': 'FUNC_REVERSE_SUBTRACT',
    min: 'MIN',
    max: 'MAX',
};
const FACTORS = {
    zero: 'ZERO',
    one: 'ONE',
    src: 'SRC_COLOR',
    'one-minus-src': 'ONE_MINUS_SRC_COLOR',
    'src-alpha': 'SRC_ALPHA',
    'one-minus-src-alpha': 'ONE_MINUS_SRC_ALPHA',
    dst: 'DST_COLOR',
    'one-minus-dst': 'ONE_MINUS_DST_COLOR',
    'dst-alpha': 'DST_ALPHA',
    'one-minus-dst-alpha': 'ONE_MINUS_DST_ALPHA',
    'src-alpha-saturated': 'SRC_ALPHA_SATURATE',
};
const READER = [
    '#version 300 es\nvoid main() { gl_Position = vec4(vec2(gl_VertexID & 1, gl_VertexID >> 1) * 4.0 - 1.0, 0.0, 1.0); }\n',
    '#version 300 es\nprecision highp float;\nprecision highp int;\nuniform highp sampler2D depth;\nout uvec4 bits;\n' +
        'void main() { bits = uvec4(floatBitsToUint(texelFetch(depth, ivec2(gl_FragCoord.xy), 0).r)); }\n',
];

/** WebGL 2 on a canvas of its own, or `null`. */
export function open() {
    const canvas = document.createElement('canvas');
    canvas.width = canvas.height = 1;
    const options = { antialias: false, depth: false, powerPreference: 'high-performance' };
    const gl = canvas.getContext('webgl2', options);
    return gl && new WebGl(gl);
}

export class WebGl {
    name = 'WebGL 2';
    language = 'glsl-es';
    #timer;
    #reader;

    constructor(gl) {
        this.gl = gl;
        gl.getExtension('EXT_color_buffer_float');
        this.#timer = gl.getExtension('EXT_disjoint_timer_query_webgl2');
        const info = gl.getExtension('WEBGL_debug_renderer_info');
        const name = gl.getParameter(info ? info.UNMASKED_RENDERER_WEBGL : gl.RENDERER);
        this.adapter = {
            name,
            backend: 'webgl2',
            kind: /swiftshader|llvmpipe|software|basic render/i.test(name) ? 'software' : 'other',
            features: gl.getSupportedExtensions().sort(),
        };
        this.hasTimestamps = Boolean(this.#timer);
        this.clock = this.#timer ? 'gpu-timestamps' : 'wall-clock';
    }

    get lost() {
        return this.gl.isContextLost() ? 'the context is lost' : null;
    }

    /** Everything that a drawing needs, made once. */
    async prepare(drawing, inputs, size) {
        const { gl } = this;
        for (const { pass } of drawing.passes)
            if (pass.features.length) throw new Error(`WebGL 2 has no ${pass.features.join(', ')}`);
        while (gl.getError());
        const owned = [];
        const own = (kind, made) => (owned.push([kind, made]), made);
        const buffers = new Map();
        for (const [of, bytes] of inputs.buffers) {
            const buffer = own('Buffer', gl.createBuffer());
            gl.bindBuffer(gl.UNIFORM_BUFFER, buffer);
            gl.bufferData(gl.UNIFORM_BUFFER, bytes, gl.STATIC_DRAW);
            buffers.set(of, buffer);
        }
        const textures = new Map();
        for (const [of, texture] of inputs.textures) textures.set(of, this.#texture(texture, own));
        const samplers = new Map();
        for (const [of, { type }] of inputs.samplers) samplers.set(of, this.#sampler(type, own));
        const plain = this.#sampler('non-filtering', own);
        const target = (format) => {
            const internal = DEPTHS[format] ?? COLORS[format];
            if (!internal) throw new Error(`WebGL 2 draws to no ${format}`);
            const texture = own('Texture', gl.createTexture());
            gl.bindTexture(gl.TEXTURE_2D, texture);
            gl.texStorage2D(gl.TEXTURE_2D, 1, gl[internal], size, size);
            return { kind: gl.TEXTURE_2D, texture, format };
        };
        const attachments = new Map(drawing.attachments.map(({ name, format }) => [name, target(format)]));
        const clears = new Map(drawing.attachments.map(({ name, clear }) => [name, clear]));
        const colors = [];
        const { mesh } = inputs;
        const vertices = mesh.vertices && own('Buffer', gl.createBuffer());
        if (vertices) {
            gl.bindBuffer(gl.ARRAY_BUFFER, vertices);
            gl.bufferData(gl.ARRAY_BUFFER, mesh.vertices, gl.STATIC_DRAW);
        }
        const indices = mesh.indices && own('Buffer', gl.createBuffer());
        const passes = [];
        for (const { pass, vertex, fragment } of drawing.passes) {
            const kinds = new Set(pass.targets.filter(Boolean).map((to) => JSON.stringify([to.blend, to.write_mask])));
            if (kinds.size > 1) throw new Error('WebGL 2 has one blend state and one write mask for all targets');
            const program = own('Program', link(gl, { vertex, fragment }, vertex.attributes));
            pass.targets.forEach((to, i) => {
                if (to) colors[i] ??= target(to.format);
            });
            const framebuffer = own('Framebuffer', gl.createFramebuffer());
            gl.bindFramebuffer(gl.FRAMEBUFFER, framebuffer);
            pass.targets.forEach((to, i) => {
                if (to)
                    gl.framebufferTexture2D(
                        gl.FRAMEBUFFER,
                        gl.COLOR_ATTACHMENT0 + i,
                        gl.TEXTURE_2D,
                        colors[i].texture,
                        0,
                    );
            });
            gl.drawBuffers(
                pass.targets.length
                    ? pass.targets.map((to, i) => (to ? gl.COLOR_ATTACHMENT0 + i : gl.NONE))
                    : [gl.NONE],
            );
            if (pass.depth) {
                const { texture, format } = attachments.get(pass.depth.attachment);
                const point = format.includes('stencil') ? gl.DEPTH_STENCIL_ATTACHMENT : gl.DEPTH_ATTACHMENT;
                gl.framebufferTexture2D(gl.FRAMEBUFFER, point, gl.TEXTURE_2D, texture, 0);
            }
            const status = gl.checkFramebufferStatus(gl.FRAMEBUFFER);
            if (status !== gl.FRAMEBUFFER_COMPLETE)
                throw new Error(`WebGL 2 cannot draw to these attachments (${status})`);
            const array = own('VertexArray', gl.createVertexArray());
            gl.bindVertexArray(array);
            if (vertices) {
                gl.bindBuffer(gl.ARRAY_BUFFER, vertices);
                for (const { location } of pass.attributes) {
                    const { offset, size: count, scalar } = mesh.layout.get(location);
                    gl.enableVertexAttribArray(location);
                    if (scalar === 'f32') gl.vertexAttribPointer(location, count, gl.FLOAT, false, mesh.stride, offset);
                    else
                        gl.vertexAttribIPointer(
                            location,
                            count,
                            scalar === 'i32' ? gl.INT : gl.UNSIGNED_INT,
                            mesh.stride,
                            offset,
                        );
                }
            }
            if (indices) {
                gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, indices);
                gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, mesh.indices, gl.STATIC_DRAW);
            }
            gl.bindVertexArray(null);
            const bind = this.#bound(program, pass, [vertex, fragment].filter(Boolean), {
                inputs,
                buffers,
                textures,
                samplers,
                plain,
                attachments,
            });
            passes.push({ pass, program, framebuffer, array, bind });
        }
        const error = gl.getError();
        if (error) throw new Error(`WebGL 2 reports the error ${error} for what the plan asks for`);
        const draw = () => {
            const seen = new Set();
            const isCleared = (name, asked) => {
                const isFirst = !seen.has(name);
                seen.add(name);
                return asked === 'clear' || (asked === 'clear-first' && isFirst);
            };
            gl.viewport(0, 0, size, size);
            gl.disable(gl.DITHER);
            for (const { pass, program, framebuffer, array, bind } of passes) {
                gl.bindFramebuffer(gl.FRAMEBUFFER, framebuffer);
                gl.colorMask(true, true, true, true);
                gl.depthMask(true);
                pass.targets.forEach((to, i) => {
                    if (to && isCleared(`color ${i}`, to.ops.load)) gl.clearBufferfv(gl.COLOR, i, CLEAR);
                });
                if (pass.depth && isCleared(pass.depth.attachment, pass.depth.ops.load))
                    gl.clearBufferfv(gl.DEPTH, 0, [clears.get(pass.depth.attachment)]);
                this.#state(pass);
                gl.useProgram(program);
                gl.bindVertexArray(array);
                bind();
                if (indices) gl.drawElements(gl.TRIANGLES, mesh.count, gl.UNSIGNED_INT, 0);
                else gl.drawArrays(gl.TRIANGLES, 0, mesh.count);
            }
            gl.bindVertexArray(null);
        };
        return { draw, colors, depth: attachments.get('scene-depth'), size, owned, passes };
    }

    #state({ depth, primitive, targets }) {
        const { gl } = this;
        const set = (what, isOn) => (isOn ? gl.enable(what) : gl.disable(what));
        set(gl.CULL_FACE, primitive.cull !== 'none');
        if (primitive.cull !== 'none') gl.cullFace(primitive.cull === 'back' ? gl.BACK : gl.FRONT);
        gl.frontFace(primitive.front_face === 'cw' ? gl.CW : gl.CCW);
        set(gl.DEPTH_TEST, Boolean(depth));
        if (depth) {
            gl.depthFunc(gl.NEVER + COMPARE.indexOf(depth.compare));
            gl.depthMask(depth.write);
            const { constant, slope_scale: slope } = depth.bias;
            set(gl.POLYGON_OFFSET_FILL, constant !== 0 || slope !== 0);
            gl.polygonOffset(slope, constant);
        }
        const blend = targets.find((target) => target?.blend)?.blend;
        set(gl.BLEND, Boolean(blend));
        if (blend) {
            const { color, alpha } = blend;
            gl.blendEquationSeparate(gl[OPERATIONS[color.operation]], gl[OPERATIONS[alpha.operation]]);
            const factors = [color.src, color.dst, alpha.src, alpha.dst];
            gl.blendFuncSeparate(...factors.map((factor) => gl[FACTORS[factor]]));
        }
        const mask = targets.find(Boolean)?.write_mask ?? 0;
        gl.colorMask(...[1, 2, 4, 8].map((bit) => Boolean(mask & bit)));
    }

    /** A function that binds what a pass reads. */
    #bound(program, pass, stages, { inputs, buffers, textures, samplers, plain, attachments }) {
        const { gl } = this;
        const calls = [];
        gl.useProgram(program);
        const blocks = new Map(
            stages.flatMap((stage) => stage.blocks ?? []).map(({ block, binding }) => [block, binding]),
        );
        for (const [i, [block, binding]] of [...blocks].entries()) {
            const index = gl.getUniformBlockIndex(program, block);
            if (index === gl.INVALID_INDEX) continue;
            gl.uniformBlockBinding(program, index, i);
            const buffer = buffers.get(binding.join('.'));
            calls.push(() => gl.bindBufferBase(gl.UNIFORM_BUFFER, i, buffer));
        }
        const named = new Map(stages.flatMap((stage) => stage.textures ?? []).map((entry) => [entry.name, entry]));
        for (const [unit, { name, texture, sampler }] of [...named.values()].entries()) {
            gl.uniform1i(gl.getUniformLocation(program, name), unit);
            const binding = pass.bindings.find((found) => key(found) === texture.join('.'));
            const isAttachment = binding?.source.from === 'attachment';
            const of = isAttachment ? attachments.get(binding.source.name) : textures.get(texture.join('.'));
            const by = (sampler && samplers.get(sampler.join('.'))) || plain;
            calls.push(() => {
                gl.activeTexture(gl.TEXTURE0 + unit);
                gl.bindTexture(of.kind, of.texture);
                gl.bindSampler(unit, by);
            });
        }
        for (const { name, binding, offset } of stages.flatMap((stage) => stage.uniforms ?? []))
            this.#loose(program, name, inputs.buffers.get(binding.join('.')), offset);
        return () => calls.forEach((call) => call());
    }

    /** Sets a uniform outside of blocks from the bytes of the plan's buffer. */
    #loose(program, asked, bytes, offset) {
        const { gl } = this;
        const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
        const count = gl.getProgramParameter(program, gl.ACTIVE_UNIFORMS);
        for (let i = 0; i < count; i++) {
            const { name, type, size } = gl.getActiveUniform(program, i);
            if (name.replace(/\[0\]$/, '') !== asked) continue;
            const at = gl.getUniformLocation(program, name);
            const side = { [gl.FLOAT_MAT2]: 2, [gl.FLOAT_MAT3]: 3, [gl.FLOAT_MAT4]: 4 }[type];
            const vector = [gl.FLOAT, gl.FLOAT_VEC2, gl.FLOAT_VEC3, gl.FLOAT_VEC4].indexOf(type) + 1;
            const integer = [gl.INT, gl.INT_VEC2, gl.INT_VEC3, gl.INT_VEC4].indexOf(type) + 1;
            const bool = type === gl.BOOL ? 1 : 0;
            const unsigned =
                [gl.UNSIGNED_INT, gl.UNSIGNED_INT_VEC2, gl.UNSIGNED_INT_VEC3, gl.UNSIGNED_INT_VEC4].indexOf(type) + 1;
            const columns = side ?? 1;
            const rows = side ?? (vector || integer || unsigned || bool);
            if (!rows) throw new Error(`the uniform ${name} has a type that this page does not set`);
            const columnStride = rows === 2 && columns > 1 ? 8 : 16;
            const stride = columns > 1 ? columnStride * columns : 16;
            const numbers = [];
            for (let e = 0; e < size; e++)
                for (let c = 0; c < columns; c++)
                    for (let r = 0; r < rows; r++) {
                        const place = offset + e * stride + c * columnStride + r * 4;
                        const isFloat = side || vector;
                        numbers.push(isFloat ? view.getFloat32(place, true) : view.getInt32(place, true));
                    }
            if (side) gl[`uniformMatrix${side}fv`](at, false, numbers);
            else if (vector) gl[`uniform${rows}fv`](at, numbers);
            else if (unsigned) gl[`uniform${rows}uiv`](at, numbers);
            else gl[`uniform${rows}iv`](at, numbers);
        }
    }

    #texture({ dimension, isDepth, side, levels }, own) {
        const { gl } = this;
        const kind = {
            '2d': gl.TEXTURE_2D,
            '2d-array': gl.TEXTURE_2D_ARRAY,
            cube: gl.TEXTURE_CUBE_MAP,
            '3d': gl.TEXTURE_3D,
        }[dimension];
        const texture = own('Texture', gl.createTexture());
        gl.bindTexture(kind, texture);
        const isFlat = dimension === '2d' || dimension === 'cube';
        const faces = dimension === 'cube' ? [0, 1, 2, 3, 4, 5].map((i) => gl.TEXTURE_CUBE_MAP_POSITIVE_X + i) : [kind];
        const internal = isDepth ? gl.DEPTH_COMPONENT32F : gl.RGBA8;
        const all = isDepth
            ? [new Float32Array(side * side).fill(1)]
            : dimension === '3d'
              ? levels.slice(0, 1)
              : levels;
        if (isFlat) gl.texStorage2D(kind, all.length, internal, side, side);
        else gl.texStorage3D(kind, all.length, internal, side, side, 2);
        const [format, type] = isDepth ? [gl.DEPTH_COMPONENT, gl.FLOAT] : [gl.RGBA, gl.UNSIGNED_BYTE];
        for (const [level, texels] of all.entries()) {
            const length = side >> level;
            for (const face of faces) {
                if (isFlat) gl.texSubImage2D(face, level, 0, 0, length, length, format, type, texels);
                else
                    for (const layer of [0, 1])
                        gl.texSubImage3D(kind, level, 0, 0, layer, length, length, 1, format, type, texels);
            }
        }
        return { kind, texture };
    }

    #sampler(type, own) {
        const { gl } = this;
        const sampler = own('Sampler', gl.createSampler());
        const set = (name, value) => gl.samplerParameteri(sampler, gl[name], gl[value]);
        const isLinear = type !== 'non-filtering';
        set('TEXTURE_MIN_FILTER', isLinear && type === 'filtering' ? 'LINEAR_MIPMAP_LINEAR' : 'NEAREST');
        set('TEXTURE_MAG_FILTER', isLinear && type === 'filtering' ? 'LINEAR' : 'NEAREST');
        if (type === 'comparison') {
            set('TEXTURE_COMPARE_MODE', 'COMPARE_REF_TO_TEXTURE');
            set('TEXTURE_COMPARE_FUNC', 'LEQUAL');
        }
        const wrap = type === 'filtering' ? 'REPEAT' : 'CLAMP_TO_EDGE';
        for (const axis of ['S', 'T', 'R']) set(`TEXTURE_WRAP_${axis}`, wrap);
        return sampler;
    }

    /** Draws once and reads everything back: colours of each target, row by row from the top, and bits of depths. */
    async picture({ draw, colors, depth, size }) {
        const { gl } = this;
        draw();
        const framebuffer = gl.createFramebuffer();
        gl.bindFramebuffer(gl.FRAMEBUFFER, framebuffer);
        const read = (texture, format, type, into) => {
            gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, texture, 0);
            gl.readPixels(0, 0, size, size, format, type, into);
            return upright(into, size);
        };
        const texels = colors
            .filter(Boolean)
            .map(({ texture }) => read(texture, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(size * size * 4)));
        let depths = null;
        if (depth) {
            const bits = gl.createTexture();
            gl.bindTexture(gl.TEXTURE_2D, bits);
            gl.texStorage2D(gl.TEXTURE_2D, 1, gl.RGBA32UI, size, size);
            gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, bits, 0);
            this.#readDepth(depth, size);
            const all = new Uint32Array(size * size * 4);
            gl.readPixels(0, 0, size, size, gl.RGBA_INTEGER, gl.UNSIGNED_INT, all);
            depths = upright(
                all.filter((_, i) => i % 4 === 0),
                size,
                1,
            );
            gl.deleteTexture(bits);
        }
        gl.deleteFramebuffer(framebuffer);
        const error = gl.getError();
        if (error) throw new Error(`WebGL 2 reports the error ${error}`);
        if (this.lost) throw new Error(this.lost);
        return { colors: texels.map((content) => new Uint8ClampedArray(content.buffer)), depth: depths, size };
    }

    #readDepth({ texture }, size) {
        const { gl } = this;
        this.#reader ??= link(gl, { vertex: { text: READER[0] }, fragment: { text: READER[1] } });
        for (const off of [gl.DEPTH_TEST, gl.CULL_FACE, gl.BLEND]) gl.disable(off);
        gl.colorMask(true, true, true, true);
        gl.viewport(0, 0, size, size);
        gl.useProgram(this.#reader);
        gl.activeTexture(gl.TEXTURE0);
        gl.bindTexture(gl.TEXTURE_2D, texture);
        const sampler = gl.createSampler();
        for (const name of ['TEXTURE_MIN_FILTER', 'TEXTURE_MAG_FILTER'])
            gl.samplerParameteri(sampler, gl[name], gl.NEAREST);
        gl.bindSampler(0, sampler);
        gl.drawArrays(gl.TRIANGLES, 0, 3);
        gl.bindSampler(0, null);
        gl.deleteSampler(sampler);
    }

    /** Milliseconds a frame: `repeats` frames, one after another. */
    async time({ draw, passes }, repeats) {
        const { gl } = this;
        const timer = this.#timer;
        const query = timer && gl.createQuery();
        const began = performance.now();
        if (query) gl.beginQuery(timer.TIME_ELAPSED_EXT, query);
        for (let i = 0; i < repeats; i++) draw();
        if (query) gl.endQuery(timer.TIME_ELAPSED_EXT);
        // Reading a pixel waits for everything before it.
        const last = passes.findLast(({ pass }) => pass.targets.some(Boolean));
        if (last) {
            gl.bindFramebuffer(gl.FRAMEBUFFER, last.framebuffer);
            gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(4));
        } else gl.finish();
        let took = performance.now() - began;
        if (query) {
            while (!gl.getQueryParameter(query, gl.QUERY_RESULT_AVAILABLE)) {
                if (this.lost) break;
                await new Promise((resolve) => setTimeout(resolve, 1));
            }
            const isBroken = gl.getParameter(timer.GPU_DISJOINT_EXT);
            took = isBroken ? NaN : gl.getQueryParameter(query, gl.QUERY_RESULT) / 1e6;
            gl.deleteQuery(query);
        }
        if (this.lost) throw new Error(this.lost);
        return took / repeats;
    }

    release({ owned }) {
        for (const [kind, made] of owned) this.gl[`delete${kind}`](made);
    }
}

/** Rows from the top: WebGL reads from the bottom. */
function upright(values, size, channels = 4) {
    const row = size * channels;
    const out = new values.constructor(values.length);
    for (let y = 0; y < size; y++) out.set(values.subarray(y * row, (y + 1) * row), (size - 1 - y) * row);
    return out;
}
