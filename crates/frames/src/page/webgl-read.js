// Reads buffers and textures of a WebGL context back, and leaves its state as it was.

/** WebGL's methods as the browser has them: `own(gl).readPixels(..)`. */
function own(gl) {
    return gl[OWN];
}

const OWN = Symbol('preshade own');
const isTwo = (gl) => globalThis.WebGL2RenderingContext && gl instanceof WebGL2RenderingContext;

const CAPABILITIES = [
    'BLEND',
    'CULL_FACE',
    'DEPTH_TEST',
    'DITHER',
    'SCISSOR_TEST',
    'STENCIL_TEST',
    'SAMPLE_ALPHA_TO_COVERAGE',
    'SAMPLE_COVERAGE',
    'POLYGON_OFFSET_FILL',
    'RASTERIZER_DISCARD',
];
const PACKS = ['PACK_ALIGNMENT', 'PACK_ROW_LENGTH', 'PACK_SKIP_PIXELS', 'PACK_SKIP_ROWS'];

class GlReader {
    constructor(gl) {
        this.gl = gl;
        this.own = own(gl);
        this.two = isTwo(gl);
        this.programs = new Map();
        if (this.two) this.own.getExtension('EXT_color_buffer_float');
    }

    /** Runs `read` with state of our own. */
    apart(read) {
        const { own: o, two } = this;
        const get = (name) => o.getParameter(GL[name]);
        const packs = two ? PACKS : PACKS.slice(0, 1);
        const saved = packs.map(get);
        const pixelPack = two ? get('PIXEL_PACK_BUFFER_BINDING') : null;
        const draw = get('FRAMEBUFFER_BINDING');
        const reading = two ? get('READ_FRAMEBUFFER_BINDING') : null;
        try {
            packs.forEach((name) => o.pixelStorei(GL[name], name === 'PACK_ALIGNMENT' ? 1 : 0));
            if (two) o.bindBuffer(GL.PIXEL_PACK_BUFFER, null);
            return read();
        } finally {
            packs.forEach((name, i) => o.pixelStorei(GL[name], saved[i]));
            if (two) {
                o.bindBuffer(GL.PIXEL_PACK_BUFFER, pixelPack);
                o.bindFramebuffer(GL.DRAW_FRAMEBUFFER, draw);
                o.bindFramebuffer(GL.READ_FRAMEBUFFER, reading);
            } else o.bindFramebuffer(GL.FRAMEBUFFER, draw);
        }
    }

    /** Bytes `begin` to `end` of a buffer. */
    buffer(buffer, info, begin, end) {
        if (!this.two && !info.shadow) throw new Error('a buffer filled before the recorder');
        if (!this.two) return info.shadow.slice(begin, end);
        const bytes = new Uint8Array(end - begin);
        const { own: o } = this;
        const bound = o.getParameter(GL.COPY_READ_BUFFER_BINDING);
        o.bindBuffer(GL.COPY_READ_BUFFER, buffer);
        o.getBufferSubData(GL.COPY_READ_BUFFER, begin, bytes);
        o.bindBuffer(GL.COPY_READ_BUFFER, bound);
        return bytes;
    }

    /** The picture of the canvas, upright. */
    picture(width, height) {
        const { own: o } = this;
        const pixels = new Uint8Array(width * height * 4);
        this.apart(() => {
            const previous = this.two ? GL.READ_FRAMEBUFFER : GL.FRAMEBUFFER;
            o.bindFramebuffer(previous, null);
            o.readPixels(0, 0, width, height, GL.RGBA, GL.UNSIGNED_BYTE, pixels);
        });
        const upright = new Uint8Array(pixels.length);
        const row = width * 4;
        for (let y = 0; y < height; y++) upright.set(pixels.subarray(y * row, (y + 1) * row), (height - 1 - y) * row);
        return upright;
    }

    /** A level of a texture, all layers, encoded. Throws why it cannot be read. */
    level(texture, info, level) {
        const { width, height, depth } = info.levels[level];
        const { format, kind } = info.format;
        if (kind === 'stencil') throw new Error('WebGL does not read stencil textures');
        const layers = info.target === GL.TEXTURE_CUBE_MAP ? 6 : depth;
        return this.apart(() => {
            const parts = [];
            for (let layer = 0; layer < layers; layer++) {
                const place = { level, layer, width, height };
                const pixels = this.attached(texture, info, place) ?? this.drawn(texture, info, place);
                parts.push(encode(opaque(pixels, info.format), format, kind));
            }
            return joined(parts);
        });
    }

    /** Reads a layer as a framebuffer's attachment; null where it cannot be one. */
    attached(texture, info, { level, layer, width, height }) {
        const { own: o, two } = this;
        const { kind, format } = info.format;
        if (kind === 'depth' || kind === 'snorm' || /^rgb(10|9)|^rg11/.test(format)) return null;
        const framebuffer = o.createFramebuffer();
        const target = two ? GL.READ_FRAMEBUFFER : GL.FRAMEBUFFER;
        o.bindFramebuffer(target, framebuffer);
        try {
            if (info.target === GL.TEXTURE_2D || info.target === GL.TEXTURE_CUBE_MAP) {
                if (level && !two) return null;
                const face = info.target === GL.TEXTURE_2D ? GL.TEXTURE_2D : GL.TEXTURE_CUBE_MAP_POSITIVE_X + layer;
                o.framebufferTexture2D(target, GL.COLOR_ATTACHMENT0, face, texture, level);
            } else o.framebufferTextureLayer(target, GL.COLOR_ATTACHMENT0, texture, level, layer);
            if (o.checkFramebufferStatus(target) !== GL.FRAMEBUFFER_COMPLETE) return null;
            return this.pixels(kind, width, height);
        } finally {
            o.bindFramebuffer(target, null);
            o.deleteFramebuffer(framebuffer);
            while (o.getError());
        }
    }

    pixels(kind, width, height) {
        const read = (format, type, pixels) => {
            this.own.readPixels(0, 0, width, height, format, type, pixels);
            return pixels;
        };
        const count = width * height * 4;
        if (kind === 'float') return read(GL.RGBA, GL.FLOAT, new Float32Array(count));
        if (kind === 'sint') return read(GL.RGBA_INTEGER, GL.INT, new Int32Array(count));
        if (kind === 'uint') return read(GL.RGBA_INTEGER, GL.UNSIGNED_INT, new Uint32Array(count));
        return read(GL.RGBA, GL.UNSIGNED_BYTE, new Uint8Array(count));
    }

    /** Reads a layer by drawing it into a target of 32 bits a channel. */
    drawn(texture, info, { level, layer, width, height }, asked) {
        const { own: o, two } = this;
        const kind = asked ?? { sint: 'sint', uint: 'uint' }[info.format.kind] ?? (two ? 'float' : 'unorm');
        const internal = { sint: GL.RGBA32I, uint: GL.RGBA32UI, float: GL.RGBA32F, size: GL.RGBA32I }[kind];
        return this.alone(() => {
            const unit = o.getParameter(GL.ACTIVE_TEXTURE);
            o.activeTexture(GL.TEXTURE0);
            const flat = o.getParameter(GL.TEXTURE_BINDING_2D);
            const target = o.createTexture();
            const framebuffer = o.createFramebuffer();
            const sampler = two ? o.getParameter(GL.SAMPLER_BINDING) : null;
            const pixelUnpack = two ? o.getParameter(GL.PIXEL_UNPACK_BUFFER_BINDING) : null;
            if (two) o.bindBuffer(GL.PIXEL_UNPACK_BUFFER, null);
            o.bindTexture(GL.TEXTURE_2D, target);
            if (two) o.texStorage2D(GL.TEXTURE_2D, 1, internal, width, height);
            else o.texImage2D(GL.TEXTURE_2D, 0, GL.RGBA, width, height, 0, GL.RGBA, GL.UNSIGNED_BYTE, null);
            o.bindFramebuffer(GL.FRAMEBUFFER, framebuffer);
            o.framebufferTexture2D(GL.FRAMEBUFFER, GL.COLOR_ATTACHMENT0, GL.TEXTURE_2D, target, 0);
            o.bindTexture(GL.TEXTURE_2D, flat);
            if (two) o.bindSampler(0, null);
            const bound = o.getParameter(BINDING_OF[info.target]);
            o.bindTexture(info.target, texture);
            const restore = this.plainSampling(info, level);
            o.viewport(0, 0, width, height);
            this.draw(info, kind, level, layer);
            const pixels = this.pixels(kind === 'size' ? 'sint' : kind, width, height);
            restore();
            o.bindTexture(info.target, bound);
            if (two) {
                o.bindSampler(0, sampler);
                o.bindBuffer(GL.PIXEL_UNPACK_BUFFER, pixelUnpack);
            }
            o.activeTexture(unit);
            o.deleteFramebuffer(framebuffer);
            o.deleteTexture(target);
            const error = o.getError();
            if (error) throw new Error(`WebGL cannot read it (error ${error})`);
            return pixels;
        });
    }

    /** Sampling without filters and comparisons. */
    plainSampling(info, level) {
        const { own: o, two } = this;
        const { target } = info;
        const set = {
            TEXTURE_MIN_FILTER: level ? GL.NEAREST_MIPMAP_NEAREST : GL.NEAREST,
            TEXTURE_MAG_FILTER: GL.NEAREST,
        };
        if (two)
            Object.assign(set, {
                TEXTURE_COMPARE_MODE: 0,
                TEXTURE_BASE_LEVEL: 0,
                TEXTURE_MAX_LEVEL: 1000,
            });
        const saved = Object.keys(set).map((name) => [GL[name], o.getTexParameter(target, GL[name])]);
        for (const name in set) o.texParameteri(target, GL[name], set[name]);
        return () => saved.forEach(([name, value]) => o.texParameteri(target, name, value));
    }

    draw(info, kind, level, layer) {
        const { own: o, two } = this;
        const program = this.program(info.target, kind);
        o.useProgram(program);
        o.uniform1i(o.getUniformLocation(program, 'source'), 0);
        o.uniform2i(o.getUniformLocation(program, 'place'), level, layer);
        if (two) {
            o.bindVertexArray((this.vertexArray ??= o.createVertexArray()));
            o.drawArrays(GL.TRIANGLES, 0, 3);
            return;
        }
        const bound = o.getParameter(GL.ARRAY_BUFFER_BINDING);
        const corners = o.createBuffer();
        o.bindBuffer(GL.ARRAY_BUFFER, corners);
        o.bufferData(GL.ARRAY_BUFFER, new Float32Array([-1, -1, 3, -1, -1, 3]), GL.STATIC_DRAW);
        o.enableVertexAttribArray(0);
        o.vertexAttribPointer(0, 2, GL.FLOAT, false, 0, 0);
        o.drawArrays(GL.TRIANGLES, 0, 3);
        o.bindBuffer(GL.ARRAY_BUFFER, bound);
        o.deleteBuffer(corners);
    }

    program(target, kind) {
        const key = `${target} ${kind}`;
        let program = this.programs.get(key);
        if (program) return program;
        const { own: o } = this;
        program = o.createProgram();
        const [vertex, fragment] = this.two ? readShaders2(target, kind) : readShaders1(target);
        for (const [type, text] of [
            [GL.VERTEX_SHADER, vertex],
            [GL.FRAGMENT_SHADER, fragment],
        ]) {
            const shader = o.createShader(type);
            o.shaderSource(shader, text);
            o.compileShader(shader);
            o.attachShader(program, shader);
        }
        o.bindAttribLocation(program, 0, 'corner');
        o.linkProgram(program);
        if (!o.getProgramParameter(program, GL.LINK_STATUS)) throw new Error(o.getProgramInfoLog(program));
        this.programs.set(key, program);
        return program;
    }

    /** Runs `draw` with tests, blending and the page's arrays off. */
    alone(draw) {
        const { own: o, two } = this;
        const names = CAPABILITIES.slice(0, two ? CAPABILITIES.length : -1);
        const enabled = names.map((name) => o.isEnabled(GL[name]));
        const get = (name) => o.getParameter(GL[name]);
        const [program, viewport, mask] = ['CURRENT_PROGRAM', 'VIEWPORT', 'COLOR_WRITEMASK'].map(get);
        const array = two ? get('VERTEX_ARRAY_BINDING') : this.attribute0();
        names.forEach((name) => o.disable(GL[name]));
        o.colorMask(true, true, true, true);
        try {
            return draw();
        } finally {
            names.forEach((name, i) => enabled[i] && o.enable(GL[name]));
            o.useProgram(program);
            o.viewport(...viewport);
            o.colorMask(...mask);
            if (two) o.bindVertexArray(array);
            else array();
        }
    }

    /** WebGL 1: gives attribute 0 back as it was. */
    attribute0() {
        const { own: o } = this;
        const get = (name) => o.getVertexAttrib(0, GL[`VERTEX_ATTRIB_ARRAY_${name}`]);
        const [buffer, enabled, size, stride, type, normalized] = [
            'BUFFER_BINDING',
            'ENABLED',
            'SIZE',
            'STRIDE',
            'TYPE',
            'NORMALIZED',
        ].map(get);
        const offset = o.getVertexAttribOffset(0, GL.VERTEX_ATTRIB_ARRAY_POINTER);
        return () => {
            const bound = o.getParameter(GL.ARRAY_BUFFER_BINDING);
            if (buffer) {
                o.bindBuffer(GL.ARRAY_BUFFER, buffer);
                o.vertexAttribPointer(0, size, type, normalized, stride, offset);
                o.bindBuffer(GL.ARRAY_BUFFER, bound);
            }
            if (!enabled) o.disableVertexAttribArray(0);
        };
    }
}

const TEXTURE_CUBE = 0x8513;
const BINDING_OF = {
    0x0de1: 0x8069,
    0x8513: 0x8514,
    0x806f: 0x806a,
    0x8c1a: 0x8c1d,
};
const SAMPLER_OF = {
    0x0de1: 'sampler2D',
    0x8513: 'samplerCube',
    0x806f: 'sampler3D',
    0x8c1a: 'sampler2DArray',
};

const DIRECTION = `
vec3 direction(vec2 p, int face) {
    if (face == 0) return vec3(1.0, -p.y, -p.x);
    if (face == 1) return vec3(-1.0, -p.y, p.x);
    if (face == 2) return vec3(p.x, 1.0, p.y);
    if (face == 3) return vec3(p.x, -1.0, -p.y);
    if (face == 4) return vec3(p.x, -p.y, 1.0);
    return vec3(-p.x, -p.y, -1.0);
}`;

function readShaders2(target, kind) {
    const letter = { sint: 'i', uint: 'u' }[kind] ?? '';
    const at = target === 0x0de1 ? 'ivec2(gl_FragCoord.xy)' : 'ivec3(gl_FragCoord.xy, place.y)';
    const size = target === 0x0de1 || target === TEXTURE_CUBE ? 'textureSize(source, 0), 1' : 'textureSize(source, 0)';
    const fetch =
        kind === 'size'
            ? `texel = ivec4(${size}, 0);`
            : target === TEXTURE_CUBE
              ? `vec2 size = vec2(textureSize(source, place.x));
    texel = textureLod(source, direction(gl_FragCoord.xy / size * 2.0 - 1.0, place.y), float(place.x));`
              : `texel = texelFetch(source, ${at}, place.x);`;
    return [
        `#version 300 es
void main() { gl_Position = vec4(gl_VertexID == 1 ? 3.0 : -1.0, gl_VertexID == 2 ? 3.0 : -1.0, 0.0, 1.0); }`,
        `#version 300 es
precision highp float; precision highp int;
uniform highp ${letter}${SAMPLER_OF[target]} source;
uniform ivec2 place;
out ${kind === 'size' ? 'i' : letter}vec4 texel;
${DIRECTION}
void main() { ${fetch} }`,
    ];
}

/** The target has the level's size, so that the level is what the derivatives choose. */
function readShaders1(target) {
    const fetch =
        target === TEXTURE_CUBE ? 'textureCube(source, direction(at * 2.0 - 1.0, place.y))' : 'texture2D(source, at)';
    return [
        `attribute vec2 corner; varying vec2 at;
void main() { at = corner * 0.5 + 0.5; gl_Position = vec4(corner, 0.0, 1.0); }`,
        `precision highp float; precision highp int;
uniform ${SAMPLER_OF[target]} source; uniform ivec2 place; varying vec2 at;
${DIRECTION}
void main() { gl_FragColor = ${fetch}; }`,
    ];
}

/** Formats without alpha hold 1 there. */
function opaque(pixels, { rgb }) {
    if (!rgb) return pixels;
    const one = pixels instanceof Uint8Array ? 255 : 1;
    for (let i = 3; i < pixels.length; i += 4) pixels[i] = one;
    return pixels;
}

function joined(parts) {
    if (parts.length === 1) return parts[0];
    const all = new Uint8Array(parts.reduce((sum, { length }) => sum + length, 0));
    let at = 0;
    for (const part of parts) {
        all.set(part, at);
        at += part.length;
    }
    return all;
}
