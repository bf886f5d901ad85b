// One draw: the pipeline that GL's state makes, the resources it names, and the call.

const VERTEX_ARRAY_BINDING = 0x85b5;
const ARRAY_DIVISOR = 0x88fe;

Object.assign(GlTaking.prototype, {
    uniformSet(args, name) {
        setUniform(this, args, name);
    },

    draw(name, args) {
        const { own: o } = this;
        const program = o.getParameter(GL.CURRENT_PROGRAM);
        if (!program) return;
        const call = drawCall(name, args);
        if (!call.count || !call.instances) return;
        if (this.feedback) return this.note('draw', 'transform feedback');
        const state = this.state();
        if (state.discards) return;
        if (state.cull === GL.FRONT_AND_BACK && call.mode >= 4) return;
        if (state.clip?.upperLeft) this.note('clipControlEXT', 'the recorder does not follow UPPER_LEFT_EXT');
        if (state.sampleCoverage) this.note('SAMPLE_COVERAGE', 'WebGPU has no such state');
        const info = programInfo(this, program);
        const attributes = this.vertexInput(info);
        const index = call.indexType && this.resources.buffer(o.getParameter(GL.ELEMENT_ARRAY_BUFFER_BINDING));
        const named = this.named(info, attributes);
        const pass = this.open();
        // Opening may have ended a pass: these belong to the one that draws.
        for (const { taken } of attributes.used) taken.pass = this.passId;
        for (const taken of named.used) taken.pass = this.passId;
        if (index) index.pass = this.passId;
        this.emit(pass, info, { attributes, index, named, call, state });
    },

    multiDraw(name, args) {
        const [mode, ...rest] = args;
        const elements = name.includes('Elements');
        const instanced = name.includes('Instanced');
        const count = rest[rest.length - 1];
        for (let i = 0; i < count; i++) {
            this.drawId = i;
            if (elements) {
                const instances = instanced ? rest[5][rest[6] + i] : 1;
                const [size, offset] = [rest[0][rest[1] + i], rest[3][rest[4] + i]];
                this.draw('drawElementsInstanced', [mode, size, rest[2], offset, instances]);
            } else {
                const first = rest[0][rest[1] + i];
                const instances = instanced ? rest[4][rest[5] + i] : 1;
                this.draw('drawArraysInstanced', [mode, first, rest[2][rest[3] + i], instances]);
            }
        }
        this.drawId = 0;
    },

    /** Vertex buffers in order of location, and constants of attributes without an array. */
    vertexInput(info) {
        const { own: o } = this;
        const input = { layouts: [], bindings: [], constants: {}, used: [] };
        for (const { name, location, column } of info.attributes) {
            const get = (what) => o.getVertexAttrib(location, GL[`VERTEX_ATTRIB_ARRAY_${what}`]);
            const buffer = get('ENABLED') ? get('BUFFER_BINDING') : null;
            if (!buffer) {
                const key = column === undefined ? name : `${name}[${column}]`;
                input.constants[key] = [...o.getVertexAttrib(location, GL.CURRENT_VERTEX_ATTRIB)].map(finite);
                continue;
            }
            const { type, size, normalized, integer, stride, offset, divisor } = this.pointer(location);
            const { format, bytes } = vertexFormat(type, size, normalized, integer);
            const layout = {
                arrayStride: stride || bytes,
                attributes: [{ name, format, offset: 0 }],
            };
            if (column !== undefined) layout.attributes[0].column = column;
            if (divisor) layout.stepMode = 'instance';
            if (divisor > 1) layout.divisor = divisor;
            const taken = this.resources.buffer(buffer);
            input.layouts.push(layout);
            input.bindings.push({ taken, offset });
            input.used.push({ taken });
        }
        return input;
    },

    /** Pointers of the bound vertex array, by location. */
    pointers() {
        const { own: o, two } = this;
        const extension = two || (this.arrayObjects ??= o.getExtension('OES_vertex_array_object'));
        const array = extension ? o.getParameter(VERTEX_ARRAY_BINDING) : null;
        let known = this.arrays.get(array);
        if (!known) this.arrays.set(array, (known = new Map()));
        return known;
    },

    /** How an array is read. The browser asks the GPU's process for most of it, which takes long, so it is kept. */
    pointer(location) {
        const known = this.pointers();
        let pointer = known.get(location);
        if (!pointer) {
            const { own: o, two } = this;
            const get = (what) => o.getVertexAttrib(location, GL[`VERTEX_ATTRIB_ARRAY_${what}`]);
            const instances = two || (this.instancing ??= o.getExtension('ANGLE_instanced_arrays'));
            pointer = {
                type: get('TYPE'),
                size: get('SIZE'),
                normalized: get('NORMALIZED'),
                integer: two && get('INTEGER'),
                stride: get('STRIDE'),
                offset: o.getVertexAttribOffset(location, GL.VERTEX_ATTRIB_ARRAY_POINTER),
                divisor: instances ? o.getVertexAttrib(location, ARRAY_DIVISOR) : 0,
            };
            known.set(location, pointer);
        }
        return pointer;
    },

    pointerSet(name, [location, ...rest]) {
        const pointer = this.pointers().get(location);
        if (!pointer) return;
        if (name === 'vertexAttribDivisor') [pointer.divisor] = rest;
        else if (name === 'vertexAttribIPointer') {
            const [size, type, stride, offset] = rest;
            Object.assign(pointer, { size, type, stride, offset, normalized: false, integer: true });
        } else {
            const [size, type, normalized, stride, offset] = rest;
            Object.assign(pointer, { size, type, stride, offset, normalized: Boolean(normalized), integer: false });
        }
    },

    /** What the program's names mean in this draw: a number in `named`. */
    named(info, { constants }) {
        const used = [];
        const entry = { uniforms: {}, blocks: {}, textures: {}, constants };
        for (const { name, type, values } of info.uniforms.values()) {
            if (!SAMPLER_TARGETS[type]) entry.uniforms[name] = values.map(finite);
        }
        if (info.sources.vertex?.includes('gl_DrawID')) entry.uniforms.gl_DrawID = [this.drawId];
        for (const { name, index } of info.blocks) entry.blocks[name] = this.block(index, used);
        const active = this.own.getParameter(GL.ACTIVE_TEXTURE);
        for (const { name, type, values } of info.samplers) {
            const units = values.map((unit) => this.unit(unit, SAMPLER_TARGETS[type], used));
            entry.textures[name] = name.endsWith('[0]') || units.length > 1 ? units : units[0];
        }
        this.own.activeTexture(active);
        return { number: this.folder.equal('named', entry), used };
    },

    block(index, used) {
        const { own: o } = this;
        const program = o.getParameter(GL.CURRENT_PROGRAM);
        const binding = o.getActiveUniformBlockParameter(program, index, GL.UNIFORM_BLOCK_BINDING);
        const buffer = o.getIndexedParameter(GL.UNIFORM_BUFFER_BINDING, binding);
        if (!buffer) throw new Error('a uniform block without a buffer');
        const taken = this.resources.buffer(buffer);
        used.push(taken);
        const offset = o.getIndexedParameter(GL.UNIFORM_BUFFER_START, binding);
        const size = o.getIndexedParameter(GL.UNIFORM_BUFFER_SIZE, binding);
        return {
            buffer: taken.number,
            offset,
            size: size || bufferInfo(buffer).size - offset,
        };
    },

    /** The texture and sampler of a texture unit. */
    unit(unit, target, used) {
        const { own: o, two } = this;
        o.activeTexture(GL.TEXTURE0 + unit);
        const texture = o.getParameter(BINDING_OF[target]);
        const info = texture ? textureInfo(texture, target) : null;
        if (info && !info.format) this.reader.guess(info);
        const ask = (name) => o.getTexParameter(target, name);
        if (info?.format && info.levels[0]) info.parameters ??= this.textureParameters(ask);
        if (!info?.format || !info.levels[0] || !isComplete(info)) {
            if (info && !info.format && o.isTexture(texture)) this.unseen(info);
            return {
                ...this.black(target),
                view: { dimension: VIEW_DIMENSIONS[target] },
                sampler: this.sampler({}),
            };
        }
        const taken = this.resources.sync(info);
        used.push(taken);
        const object = two ? o.getParameter(GL.SAMPLER_BINDING) : null;
        const state = object
            ? (object[INFO] ??= samplerState((name) => o.getSamplerParameter(object, name), two, this.anisotropic))
            : info.parameters.sampler;
        const { baseMipLevel, maxLevel } = info.parameters;
        const view = { dimension: VIEW_DIMENSIONS[target] };
        if (baseMipLevel) view.baseMipLevel = baseMipLevel;
        if (maxLevel < taken.levels - 1) view.mipLevelCount = maxLevel - baseMipLevel + 1;
        return { texture: taken.number, view, sampler: this.sampler(state) };
    },

    textureParameters(ask) {
        const { two } = this;
        return {
            sampler: samplerState(ask, two, this.anisotropic),
            min: ask(GL.TEXTURE_MIN_FILTER),
            baseMipLevel: two ? ask(GL.TEXTURE_BASE_LEVEL) : 0,
            maxLevel: two ? ask(GL.TEXTURE_MAX_LEVEL) : 1000,
        };
    },

    unseen(info) {
        if (this.noted.has(info)) return;
        this.noted.add(info);
        this.note('texture', 'made before the recorder: drawn as black');
    },

    sampler(state) {
        return this.folder.equal('samplers', state);
    },

    /** GL samples black from a texture that is none or incomplete. */
    black(target) {
        const layers = target === TEXTURE_CUBE ? 6 : 1;
        const { folder } = this;
        const number = folder.number('textures', `black ${target}`, () => ({
            label: 'black',
            size: [1, 1, layers],
            format: 'rgba8unorm',
            dimension: target === 0x806f ? '3d' : '2d',
            mipLevelCount: 1,
            sampleCount: 1,
            usage: SAMPLED_USAGE,
            viewFormats: [],
        }));
        if (!this.noted.has(number)) {
            this.noted.add(number);
            const texels = new Uint8Array(4 * layers).map((_, i) => (i % 4 === 3 ? 255 : 0));
            folder.start.textures.push({
                texture: number,
                mipLevel: 0,
                data: folder.data(texels),
            });
        }
        return { texture: number };
    },

    pipeline(info, { layouts }, { mode, indexFormat }, state, target) {
        const { folder } = this;
        const { primitive, targets, ...rest } = pipelineState(state, target, mode, indexFormat);
        return folder.equal('renderPipelines', {
            layout: 'auto',
            vertex: {
                module: this.shader(info, 'vertex'),
                entryPoint: 'main',
                buffers: layouts,
            },
            fragment: {
                module: this.shader(info, 'fragment'),
                entryPoint: 'main',
                targets,
            },
            primitive,
            ...rest,
        });
    },

    /** A program's text is long, so its number is kept with it. */
    shader(info, stage) {
        const { folder } = this;
        if (info.numbers?.folder !== folder) info.numbers = { folder };
        return (info.numbers[stage] ??= this.shaderOf(info.sources[stage] ?? '', stage));
    },

    shaderOf(text, stage) {
        const { folder } = this;
        const language = /^\s*#version 300 es/.test(text) ? 'glsl-es-300' : 'glsl-es-100';
        return folder.number('shaders', `${stage} ${text}`, () => ({
            language,
            data: folder.text(text),
        }));
    },

    emit(pass, info, { attributes, index, named, call, state }) {
        const { target } = pass;
        const set = (slot, command) => {
            const text = JSON.stringify(command);
            if (pass.state.get(slot) === text) return;
            pass.state.set(slot, text);
            pass.commands.push(command);
        };
        set('pipeline', {
            do: 'setPipeline',
            pipeline: this.pipeline(info, attributes, call, state, target),
        });
        set('named', { do: 'setNamed', named: named.number });
        attributes.bindings.forEach(({ taken, offset }, slot) =>
            set(`vertex ${slot}`, {
                do: 'setVertexBuffer',
                slot,
                buffer: taken.number,
                offset,
            }),
        );
        const [x, y, width, height] = state.viewport;
        const [minDepth, maxDepth] = state.depthRange;
        set('viewport', {
            do: 'setViewport',
            x,
            y,
            width,
            height,
            minDepth,
            maxDepth,
        });
        const box = state.scissor ? this.clipped(state.scissor, target.size) : [0, 0, ...target.size];
        set('scissor', {
            do: 'setScissorRect',
            x: box[0],
            y: box[1],
            width: box[2],
            height: box[3],
        });
        if (state.constant) set('constant', { do: 'setBlendConstant', color: state.constant });
        if (state.stencil)
            set('reference', {
                do: 'setStencilReference',
                reference: state.reference,
            });
        const instanceCount = call.instances;
        if (!index) {
            const { count: vertexCount, first: firstVertex } = call;
            pass.commands.push({
                do: 'draw',
                vertexCount,
                instanceCount,
                firstVertex,
                firstInstance: 0,
            });
            return;
        }
        const { indexFormat, indexBytes } = call;
        set('index', {
            do: 'setIndexBuffer',
            buffer: index.number,
            indexFormat,
            offset: 0,
        });
        pass.commands.push({
            do: 'drawIndexed',
            indexCount: call.count,
            instanceCount,
            firstIndex: call.offset / indexBytes,
            baseVertex: 0,
            firstInstance: 0,
        });
    },

    /** Multisampled sources resolve; equal ones are copied; what WebGPU cannot do is written as captured. */
    blit(args) {
        const [x0, y0, x1, y1, X0, Y0, X1, Y1, mask] = args;
        this.endPass();
        const { own: o, resources } = this;
        const read = o.getParameter(GL.READ_FRAMEBUFFER_BINDING);
        const draw = o.getParameter(GL.DRAW_FRAMEBUFFER_BINDING);
        const source = read ? this.readTarget() : this.canvasTarget();
        const target = draw ? resources.framebuffer(draw, GL.DRAW_FRAMEBUFFER) : this.canvasTarget();
        if (target.canvas && this.fresh) {
            // The browser clears the canvas before the first command of a frame.
            this.open();
            this.endPass();
        }
        const box = this.state().scissor;
        const [left, bottom, wide, high] = box ?? [0, 0, Infinity, Infinity];
        const inside = X0 >= left && Y0 >= bottom && X1 <= left + wide && Y1 <= bottom + high;
        const same = inside && x0 === X0 && y0 === Y0 && x1 === X1 && y1 === Y1;
        const pairs = [];
        if (mask & GL.COLOR_BUFFER_BIT)
            for (const color of target.colors) if (color) pairs.push([source.colors[0], color]);
        const { depth, stencil } = aspectsIn(source.depth && target.depth, mask);
        if (depth || stencil) pairs.push([source.depth, target.depth]);
        for (const [from, to] of pairs) {
            const box = { same, x: x0, y: y0, x1, y1, depth, stencil };
            if (!from || !this.blitOne(from, to, box)) this.blitAsCaptured(to);
        }
    },

    /** A copy from the framebuffer stays one where formats are equal; the recorder reads others back. */
    copyTexels(info, level, to, [x, y, width, height]) {
        this.endPass();
        const { own: o, resources } = this;
        const bound = o.getParameter(this.two ? GL.READ_FRAMEBUFFER_BINDING : GL.FRAMEBUFFER_BINDING);
        let source;
        if (!bound) source = this.canvasTarget().colors[0];
        else if (this.two) [source] = this.readTarget().colors;
        else [source] = resources.framebuffer(bound, GL.FRAMEBUFFER).colors;
        const inside = source && x >= 0 && y >= 0 && x + width <= source.size[0] && y + height <= source.size[1];
        const { format, rgb } = info.format;
        const single = source && (source.samples === 1 || source.resolve !== undefined);
        if (!inside || !single || source.format !== format || source.rgb !== rgb || source.info === info) {
            dirty(info, level);
            const { number } = resources.sync(info);
            this.asCaptured(number, 'a copy from the framebuffer');
            return;
        }
        const texture = source.resolve ?? resources.attach(source, false);
        const taken = resources.sync(info);
        taken.drawn = true;
        this.list.push({
            do: 'copyTextureToTexture',
            source: { texture, mipLevel: source.level ?? 0, origin: [x, y, source.layer ?? 0], aspect: 'all' },
            destination: { texture: taken.number, mipLevel: level, origin: to, aspect: 'all' },
            size: [width, height, 1],
        });
    },

    /** Vertices that the GPU fed back are written as captured, with the buffer's next use. */
    fedBack() {
        const { own: o } = this;
        for (let i = 0; i < o.getParameter(0x8c8b); i++) {
            const buffer = o.getIndexedParameter(0x8c8f, i);
            if (buffer) dirtyBuffer(bufferInfo(buffer), 0, bufferInfo(buffer).size);
        }
    },

    /** The frame computed a texture's content by what WebGPU does not do: the content is written. */
    asCaptured(number, what) {
        const key = `${what} ${number}`;
        if (this.noted.has(key)) return;
        this.noted.add(key);
        this.resources.unknown({ texture: number, asCaptured: true, why: `${what} is written as captured` });
    },

    readTarget() {
        const { own: o, resources } = this;
        const color = o.getParameter(GL.READ_BUFFER);
        const get = (attachment) => resources.attachment(GL.READ_FRAMEBUFFER, attachment);
        return {
            colors: [color ? get(color) : null],
            depth: get(GL.DEPTH_ATTACHMENT) ?? get(GL.STENCIL_ATTACHMENT),
        };
    },

    blitOne(from, to, box) {
        const { same, x, y, x1, y1 } = box;
        const covers = x === 0 && y === 0 && x1 === from.size[0] && y1 === from.size[1];
        const all = covers && `${from.size}` === `${to.size}`;
        const { resources, list } = this;
        if (!same || from.format !== to.format || x1 <= x || y1 <= y) return false;
        const isPart = this.isPart(from, to, { ...box, all });
        if (from.samples > 1 && to.samples === 1 && !isPart) {
            if (!all) return false;
            const view = this.view(from, false);
            const resolveTarget = this.view(to, true);
            const color = { view, resolveTarget, loadOp: 'load', storeOp: 'store' };
            list.push({
                do: 'renderPass',
                descriptor: { colorAttachments: [color] },
                commands: [],
            });
            return true;
        }
        if (isPart ? to.samples > 1 || !box.depth : from.samples !== to.samples) return false;
        const place = (attachment, replaced) => ({
            texture: resources.attach(attachment, replaced),
            mipLevel: attachment.level ?? 0,
            origin: [x, y, attachment.layer ?? 0],
            aspect: 'all',
        });
        const command = isPart ? 'copyDepth' : 'copyTextureToTexture';
        const [source, destination] = [place(from, false), place(to, all)];
        list.push({ do: command, source, destination, size: [x1 - x, y1 - y, 1] });
        if (isPart && to.format.includes('-stencil')) {
            const why = 'WebGL reads no stencil back, and WebGPU copies none alone';
            resources.unknown({ texture: destination.texture, aspect: 'stencil-only', why });
        }
        return true;
    },

    /** WebGPU copies depth and stencil together, as a whole, and resolves neither. Else depth is drawn. */
    isPart(from, to, { all, depth, stencil }) {
        const has = aspectsIn(to, GL.DEPTH_BUFFER_BIT | GL.STENCIL_BUFFER_BIT);
        if (!has.depth && !has.stencil) return false;
        return !all || from.samples !== to.samples || depth !== has.depth || stencil !== has.stencil;
    },

    blitAsCaptured(to) {
        // WebGL reads no renderbuffer back: it matters only if the frame goes on with its content.
        if (to.renderbuffer) return (to.info.lost = this);
        if (!to.info) return this.note('blitFramebuffer', 'scales or converts into no texture');
        dirty(to.info, to.level);
        const { number } = this.resources.sync(to.info);
        this.asCaptured(number, 'blitFramebuffer that scales or converts');
    },
});

/** What of a depth attachment is in a mask of GL. */
function aspectsIn(attachment, mask) {
    const format = attachment?.format ?? '';
    return {
        depth: Boolean(mask & GL.DEPTH_BUFFER_BIT) && format.startsWith('depth'),
        stencil: Boolean(mask & GL.STENCIL_BUFFER_BIT) && format.includes('stencil'),
    };
}

/** A draw's arguments by name. */
function drawCall(name, args) {
    const [mode, a, b, c, d, e] = args;
    if (name === 'drawArrays') return { mode, first: a, count: b, instances: 1 };
    if (name === 'drawArraysInstanced') return { mode, first: a, count: b, instances: c };
    const [count, type, offset, instances] =
        name === 'drawElements' ? [a, b, c, 1] : name === 'drawElementsInstanced' ? [a, b, c, d] : [c, d, e, 1];
    const [indexFormat, indexBytes] = INDEX_FORMATS[type];
    return {
        mode,
        count,
        offset,
        instances,
        indexType: type,
        indexFormat,
        indexBytes,
    };
}

/** GL samples nothing from a texture that lacks the mip levels its filter needs. */
function isComplete({ levels, parameters, target }) {
    if (parameters.min < GL.NEAREST_MIPMAP_NEAREST) return true;
    if (parameters.baseMipLevel > parameters.maxLevel) return false;
    const { width, height, depth } = levels[0];
    const largest = Math.max(width, height, target === 0x806f ? depth : 1);
    const needed = Math.min(Math.floor(Math.log2(largest)), parameters.maxLevel);
    for (let i = parameters.baseMipLevel; i <= needed; i++) if (!levels[i]) return false;
    return true;
}
