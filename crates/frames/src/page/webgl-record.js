// Draws, clears and copies of a WebGL context as passes with pipelines.

class GlTaking {
    constructor(gl, folder) {
        this.gl = gl;
        this.own = gl[OWN] ??= ownMethods(gl);
        this.two = isTwo(gl);
        this.folder = folder;
        this.reader = new GlReader(gl);
        this.resources = new GlResources(this, folder, this.reader);
        this.attributes = this.own.getContextAttributes();
        this.anisotropic = this.own.getExtension('EXT_texture_filter_anisotropic');
        this.drawBuffersExtension = this.two ? null : this.own.getExtension('WEBGL_draw_buffers');
        this.passId = 0;
        /** Which draw of a `multiDraw` is under way. */
        this.drawId = 0;
        this.noted = new Set();
        /** Pointers by vertex array, as far as they were asked. */
        this.arrays = new Map();
        this.feedback = this.two && this.own.getParameter(GL.TRANSFORM_FEEDBACK_ACTIVE);
        for (const name of gl[UNFOLLOWED] ?? []) this.note(name, 'the recorder does not follow this extension');
        if (this.attributes.preserveDrawingBuffer) this.kept = this.reader.picture(gl.drawingBufferWidth, gl.drawingBufferHeight);
        this.beginFrame();
    }

    beginFrame() {
        this.list = [];
        this.pass = null;
        this.stateDirty = this.targetDirty = this.blocksDirty = true;
        /** The browser clears what it showed, unless the page asked it not to. */
        this.fresh = !this.attributes.preserveDrawingBuffer;
        this.canvas = null;
        this.picture = null;
        this.waiting = false;
    }

    /** Runs what records. An error is ours, so the page does not see it. */
    guard(record) {
        try {
            record();
        } catch (error) {
            this.note('WebGL call', error.message);
        }
    }

    note(what, why) {
        this.folder.refuse(what, why);
    }

    showsLater() {
        if (this.waiting) return;
        this.waiting = true;
        queueMicrotask(() => {
            if (!this.waiting) return;
            this.waiting = false;
            this.guard(() => this.show());
        });
    }

    show() {
        const { drawingBufferWidth: width, drawingBufferHeight: height } = this.gl;
        this.picture = {
            data: this.reader.picture(width, height),
            size: [width, height],
        };
    }

    state() {
        if (this.stateDirty) {
            this.fixed = fixedState(this.own, this.two, this.gl[CLIP_CONTROL]);
            this.stateDirty = false;
        }
        return this.fixed;
    }

    target() {
        const { drawingBufferWidth: width, drawingBufferHeight: height } = this.gl;
        const size = `${width}x${height}`;
        if (this.targetDirty || size !== this.targetSize) {
            this.current = this.resources.target();
            this.targetDirty = false;
            this.targetSize = size;
        }
        return this.current;
    }

    /** Draw buffers of the bound framebuffer: attachments, or null. */
    drawBuffers() {
        const { own: o } = this;
        if (!this.two && !this.drawBuffersExtension) return [GL.COLOR_ATTACHMENT0];
        const count = o.getParameter(GL.MAX_DRAW_BUFFERS);
        return Array.from({ length: count }, (_, i) => o.getParameter(GL.DRAW_BUFFER0 + i) || null);
    }

    /** The canvas: drawn with samples and resolved where it has antialiasing. */
    canvasTarget() {
        const { drawingBufferWidth: width, drawingBufferHeight: height } = this.gl;
        const { antialias, alpha, depth, stencil } = this.attributes;
        const samples = antialias && this.own.getParameter(GL.SAMPLES) > 1 ? 4 : 1;
        const size = [width, height];
        const shared = (name, entry) =>
            this.folder.number('textures', `${name} ${size}`, () => ({
                label: name,
                size: [...size, 1],
                dimension: '2d',
                mipLevelCount: 1,
                viewFormats: [],
                ...entry,
            }));
        const usage = ATTACHMENT | SAMPLED_USAGE;
        const format = 'rgba8unorm';
        const color = {
            format,
            kind: 'unorm',
            rgb: !alpha,
            size,
            samples,
            whole: true,
        };
        color.resolve = color.number = shared('canvas', {
            format,
            sampleCount: 1,
            usage,
        });
        this.canvas = color.resolve;
        this.keepCanvas(this.canvas, samples);
        if (samples > 1)
            color.number = shared('canvas samples', {
                format,
                sampleCount: samples,
                usage: ATTACHMENT,
            });
        else delete color.resolve;
        const target = {
            key: `canvas ${size}`,
            colors: [color],
            depth: null,
            size,
            samples,
            canvas: true,
        };
        if (depth || stencil) {
            const format = !stencil ? 'depth24plus' : depth ? 'depth24plus-stencil8' : 'stencil8';
            const number = shared('canvas depth', {
                format,
                sampleCount: samples,
                usage: ATTACHMENT,
            });
            target.depth = {
                format,
                kind: 'depth',
                number,
                size,
                samples,
                whole: true,
            };
        }
        return target;
    }

    /** What the canvas shows before the first frame, where the page asked to keep it. */
    keepCanvas(texture, samples) {
        const { kept, gl, folder } = this;
        if (!kept) return;
        this.kept = null;
        const why = 'the samples of what the canvas shows before the first frame';
        if (samples > 1) return void this.resources.unknown({ texture, why });
        const row = 4 * gl.drawingBufferWidth;
        const bytes = new Uint8Array(kept.length);
        for (let at = 0; at < kept.length; at += row) bytes.set(kept.subarray(at, at + row), kept.length - row - at);
        folder.start.textures.push({ texture, mipLevel: 0, data: folder.data(bytes) });
    }

    /** The pass that draws to the framebuffer; a new one where it changed or is cleared. */
    open(clears) {
        const target = this.target();
        if (this.pass && this.pass.key === target.key) {
            if (!clears) return this.pass;
            if (!this.pass.commands.length) {
                this.clearAttachments(this.pass, clears);
                this.dropReplaced(this.pass);
                return this.pass;
            }
        }
        this.endPass();
        if (target.canvas && this.fresh) {
            this.fresh = false;
            clears = { colors: [[0, 0, 0, 0]], depth: 1, stencil: 0, ...clears };
        }
        const descriptor = {
            colorAttachments: target.colors.map((color, i) => {
                if (!color) return null;
                const made = {
                    view: this.view(color, clears?.colors?.[i]),
                    loadOp: 'load',
                    storeOp: 'store',
                };
                if (color.resolve !== undefined) made.resolveTarget = { texture: color.resolve, view: {} };
                return made;
            }),
        };
        if (target.depth) {
            const { format } = target.depth;
            const depth = format.startsWith('depth') ? clears?.depth !== undefined : true;
            const stencil = format.includes('stencil') ? clears?.stencil !== undefined : true;
            const made = { view: this.view(target.depth, depth && stencil) };
            if (format.startsWith('depth')) Object.assign(made, { depthLoadOp: 'load', depthStoreOp: 'store' });
            if (format.includes('stencil')) Object.assign(made, { stencilLoadOp: 'load', stencilStoreOp: 'store' });
            descriptor.depthStencilAttachment = made;
        }
        this.passId += 1;
        this.pass = {
            key: target.key,
            target,
            descriptor,
            commands: [],
            state: new Map(),
        };
        for (const { info } of [...target.colors, target.depth].filter(Boolean)) {
            if (info) info.taken.pass = this.passId;
        }
        if (clears) this.clearAttachments(this.pass, clears);
        return this.pass;
    }

    view(attachment, replaced) {
        const texture = this.resources.attach(attachment, Boolean(replaced));
        if (attachment.whole) return { texture, view: {} };
        const view = {
            dimension: '2d',
            baseMipLevel: attachment.level,
            mipLevelCount: 1,
        };
        if (attachment.info.target === 0x806f)
            return {
                texture,
                view: { ...view, dimension: '3d' },
                depthSlice: attachment.layer,
            };
        return {
            texture,
            view: { ...view, baseArrayLayer: attachment.layer, arrayLayerCount: 1 },
        };
    }

    clearAttachments({ target, descriptor }, { colors, depth, stencil }) {
        descriptor.colorAttachments.forEach((made, i) => {
            const color = colors?.[i];
            if (!made || !color) return;
            made.loadOp = 'clear';
            made.clearValue = target.colors[i].rgb ? [...color.slice(0, 3), 1] : color;
        });
        const made = descriptor.depthStencilAttachment;
        if (!made) return;
        if (depth !== undefined && made.depthLoadOp)
            Object.assign(made, { depthLoadOp: 'clear', depthClearValue: depth });
        if (stencil !== undefined && made.stencilLoadOp) {
            Object.assign(made, {
                stencilLoadOp: 'clear',
                stencilClearValue: stencil,
            });
        }
    }

    /** `clearBuffer*` clears a pass's attachments one by one. */
    dropReplaced({ target, descriptor }) {
        descriptor.colorAttachments.forEach((made, i) => {
            if (made?.loadOp === 'clear') this.resources.replaced(target.colors[i]);
        });
        const { depthLoadOp, stencilLoadOp } = descriptor.depthStencilAttachment ?? {};
        const all = [depthLoadOp, stencilLoadOp].every((op) => (op ?? 'clear') === 'clear');
        if (all && target.depth) this.resources.replaced(target.depth);
    }

    endPass() {
        const { pass } = this;
        this.pass = null;
        this.passId += 1;
        if (!pass) return;
        const { descriptor, commands } = pass;
        for (const made of descriptor.colorAttachments) {
            if (made?.view.depthSlice === undefined) continue;
            made.depthSlice = made.view.depthSlice;
            delete made.view.depthSlice;
        }
        this.list.push({ do: 'renderPass', descriptor, commands });
    }

    clear(mask) {
        const { own: o } = this;
        const target = this.target();
        const wants = {};
        if (mask & GL.COLOR_BUFFER_BIT) {
            const color = [...o.getParameter(GL.COLOR_CLEAR_VALUE)].map(finite);
            wants.colors = target.colors.map((attachment) => (attachment ? color : null));
        }
        if (mask & GL.DEPTH_BUFFER_BIT) wants.depth = o.getParameter(GL.DEPTH_CLEAR_VALUE);
        if (mask & GL.STENCIL_BUFFER_BIT) wants.stencil = o.getParameter(GL.STENCIL_CLEAR_VALUE);
        this.clearWith(wants);
    }

    clearBuffer(name, [buffer, index, values, more = 0]) {
        const wants = {};
        if (name === 'clearBufferfi') Object.assign(wants, { depth: values, stencil: more });
        else if (buffer === GL.COLOR) {
            const color = [...values].slice(more, more + 4).map(finite);
            wants.colors = this.target().colors.map((_, i) => (i === index ? color : null));
        } else if (buffer === GL.DEPTH) wants.depth = values[more];
        else wants.stencil = values[more];
        this.clearWith(wants);
    }

    /** Clears what the masks leave: as the start of a pass where all of it is cleared. */
    clearWith(wants) {
        const state = this.state();
        if (state.discards) return;
        const target = this.target();
        if (!state.depthMask) delete wants.depth;
        if (!state.stencilMask) delete wants.stencil;
        if (!target.depth?.format.startsWith('depth')) delete wants.depth;
        if (!target.depth?.format.includes('stencil')) delete wants.stencil;
        if (!state.colorMask.some(Boolean) || !wants.colors?.some(Boolean)) delete wants.colors;
        if (!Object.keys(wants).length) return;
        const scissor = state.scissor && this.clipped(state.scissor, target.size);
        const all = !scissor || `${scissor}` === `0,0,${target.size}`;
        const masked =
            (wants.colors &&
                !target.colors.every(
                    (color) => !color || state.colorMask.every((on, i) => on || (i === 3 && color.rgb)),
                )) ||
            (wants.stencil !== undefined && state.stencilMask !== 0xff);
        if (all && !masked) {
            this.open(wants);
            return;
        }
        const command = { do: 'clear' };
        if (wants.colors) {
            command.color = wants.colors.find(Boolean);
            command.colors = wants.colors.map(Boolean);
        }
        if (wants.depth !== undefined) command.depth = wants.depth;
        if (wants.stencil !== undefined) command.stencil = wants.stencil;
        command.mask = {
            color: state.colorMask.reduce((bits, on, i) => bits | (on ? 1 << i : 0), 0),
            stencil: state.stencilMask,
        };
        if (scissor) command.scissor = scissor;
        this.open().commands.push(command);
    }

    /** A rectangle, cut to the target. */
    clipped([x, y, width, height], size) {
        const left = Math.min(Math.max(x, 0), size[0]);
        const bottom = Math.min(Math.max(y, 0), size[1]);
        const right = Math.max(left, Math.min(x + width, size[0]));
        const top = Math.max(bottom, Math.min(y + height, size[1]));
        return [left, bottom, right - left, top - bottom];
    }

    mipmaps(info) {
        if (info.taken?.take !== this || !info.taken.drawn || this.noted.has(info)) return;
        this.noted.add(info);
        this.resources.unknown({
            texture: info.taken.number,
            why: 'mip levels of what the frame drew are written as captured',
        });
    }

    endFrame() {
        this.endPass();
        if (this.waiting) this.show();
        const { picture, folder, list } = this;
        if (this.canvas === null) this.canvasTarget();
        const frame = { size: picture.size, canvas: this.canvas, commands: list };
        frame.picture = {
            data: folder.data(picture.data),
            format: 'rgba8unorm',
            size: picture.size,
        };
        this.beginFrame();
        return frame;
    }
}

const webglRecorder = {
    canvases() {
        const list = [...drawnContexts].map((gl) => ({
            area: visibleArea(gl.canvas),
            gl,
        }));
        drawnContexts.clear();
        return list;
    },

    describe({ gl }) {
        const debug = gl.getExtension('WEBGL_debug_renderer_info');
        const adapter = gl.getParameter(debug ? debug.UNMASKED_RENDERER_WEBGL : gl.RENDERER);
        return {
            api: isTwo(gl) ? 'webgl2' : 'webgl1',
            adapter,
            title: document.title,
            writer: WRITER,
        };
    },

    begin(folder, { gl }) {
        drawnContexts.clear();
        const { getError } = (gl[OWN] ??= ownMethods(gl));
        hearContext(gl, getError);
        taking = new GlTaking(gl, folder);
        this.gl = gl;
    },

    /** An OffscreenCanvas gives its picture away and is empty then. */
    given(canvas) {
        if (taking !== null && taking.gl.canvas === canvas && taking.waiting) {
            taking.waiting = false;
            taking.guard(() => taking.show());
        }
    },

    drawn() {
        return drawnContexts.has(this.gl) && taking.picture !== null;
    },

    endFrame() {
        for (const gl of drawnContexts) if (gl !== this.gl) taking.note('canvas', 'another WebGL canvas of the page');
        drawnContexts.clear();
        const frame = taking.endFrame();
        return { write: async () => frame };
    },

    end() {
        taking = null;
    },

    release() {
        this.gl = null;
    },
};
