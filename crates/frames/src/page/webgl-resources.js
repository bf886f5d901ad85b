// Textures, buffers and framebuffers of a WebGL context as entries of frame.json, with their content.

/** A buffer that changes while a pass uses it becomes another buffer up to this size; the pass is split above. */
const COPY_LIMIT = 1 << 16;
const ATTACHMENT = 16;
const SAMPLED_USAGE = 7;
/** Vertex, index, uniform, copies. */
const BUFFER_USAGE = 4 | 8 | 16 | 32 | 64;

class GlResources {
    constructor(take, folder, reader) {
        this.take = take;
        this.folder = folder;
        this.reader = reader;
        this.own = take.own;
    }

    texture(entry) {
        return (
            this.folder.entries.textures.push({
                dimension: '2d',
                ...entry,
                viewFormats: [],
            }) - 1
        );
    }

    unknown(entry) {
        this.folder.unknown.push(entry);
    }

    /** The state of `info` in this recording: its number, and the pass that used it last. */
    sync(info, replaced = false) {
        const { take } = this;
        const { taken } = info;
        if (!taken || taken.take !== take || taken.storage !== info.storage) {
            info.taken = this.adopt(info);
            if (!replaced) for (let i = 0; i < info.taken.levels; i++) this.level(info, i, info.changed === take);
            info.dirty = null;
        } else if (info.dirty) {
            if (taken.pass === take.passId) take.endPass();
            for (const level of info.dirty) if (level < taken.levels) this.level(info, level, true);
            info.dirty = null;
        }
        return info.taken;
    }

    adopt(info) {
        const { width, height, depth } = info.levels[0];
        let levels = 1;
        while (info.levels[levels]?.width === Math.max(1, width >> levels)) levels += 1;
        const cube = info.target === TEXTURE_CUBE;
        const number = this.texture({
            size: [width, height, cube ? 6 : depth],
            format: info.format.format,
            dimension: info.target === 0x806f ? '3d' : '2d',
            mipLevelCount: levels,
            sampleCount: 1,
            usage: SAMPLED_USAGE,
        });
        return { take: this.take, storage: info.storage, number, levels, pass: 0 };
    }

    /** Reads a level back: as content at the start, or as a write where the frame changed it. */
    level(info, level, changed) {
        const { number } = info.taken;
        const { width, height, depth } = info.levels[level];
        let bytes;
        try {
            bytes = this.reader.level(info.texture, info, level);
            if (changed && info.taken.drawn) this.take.asCaptured(number, 'an upload to a texture that the frame draws');
        } catch (error) {
            this.unknown({ texture: number, mipLevel: level, why: error.message });
            return;
        }
        if (info.format.format.includes('-stencil')) {
            const why = 'WebGL reads no stencil back';
            this.unknown({ texture: number, mipLevel: level, aspect: 'stencil-only', why });
        }
        if (!changed) {
            if (bytes.some((byte) => byte)) {
                this.folder.start.textures.push({
                    texture: number,
                    mipLevel: level,
                    data: this.folder.data(bytes),
                });
            }
            return;
        }
        const layers = info.target === TEXTURE_CUBE ? 6 : depth;
        this.take.list.push({
            do: 'writeTexture',
            destination: {
                texture: number,
                mipLevel: level,
                origin: [0, 0, 0],
                aspect: 'all',
            },
            data: this.folder.data(bytes),
            layout: {
                offset: 0,
                bytesPerRow: bytes.length / (height * layers),
                rowsPerImage: height,
            },
            size: [width, height, layers],
        });
    }

    /** The number of a buffer with its content as it is now. */
    buffer(buffer) {
        const { take, folder } = this;
        const info = bufferInfo(buffer);
        if (!info.size) info.size = this.bufferSize(buffer);
        const { taken } = info;
        const isNew = !taken || taken.take !== take || taken.storage !== info.storage;
        const inUse = !isNew && info.dirty && taken.pass === take.passId;
        if (isNew || (inUse && info.size <= COPY_LIMIT)) {
            const bytes = this.reader.buffer(buffer, info, 0, info.size);
            const number = folder.entries.buffers.push({ size: info.size, usage: BUFFER_USAGE }) - 1;
            if (bytes.some((byte) => byte)) folder.start.buffers.push({ buffer: number, data: folder.data(bytes) });
            info.taken = { take, storage: info.storage, number };
            info.dirty = null;
        } else if (info.dirty) {
            if (inUse) take.endPass();
            const begin = info.dirty[0] & ~3;
            const end = Math.min(info.size, (info.dirty[1] + 3) & ~3);
            const bytes = this.reader.buffer(buffer, info, begin, end);
            take.list.push({
                do: 'writeBuffer',
                buffer: taken.number,
                offset: begin,
                data: folder.data(bytes),
            });
            info.dirty = null;
        }
        info.taken.pass = take.passId;
        return info.taken;
    }

    /** The size of a buffer that was filled before the recorder came. */
    bufferSize(buffer) {
        const { own: o, take } = this;
        if (!take.two) return 0;
        const bound = o.getParameter(GL.COPY_READ_BUFFER_BINDING);
        o.bindBuffer(GL.COPY_READ_BUFFER, buffer);
        const size = o.getBufferParameter(GL.COPY_READ_BUFFER, GL.BUFFER_SIZE);
        o.bindBuffer(GL.COPY_READ_BUFFER, bound);
        return size;
    }

    /** What the framebuffer draws to: `{key, colors, depth, size, samples, canvas}`. */
    target() {
        const { own: o, take } = this;
        const framebuffer = o.getParameter(GL.FRAMEBUFFER_BINDING);
        return framebuffer ? this.framebuffer(framebuffer, GL.FRAMEBUFFER) : take.canvasTarget();
    }

    framebuffer(framebuffer, binding) {
        const { own: o, take } = this;
        const buffers = take.drawBuffers(framebuffer);
        const colors = buffers.map((attachment) => (attachment ? this.attachment(binding, attachment) : null));
        while (colors.length && !colors[colors.length - 1]) colors.pop();
        const depth =
            this.attachment(binding, GL.DEPTH_ATTACHMENT) ??
            this.attachment(binding, GL.STENCIL_ATTACHMENT) ??
            (take.two ? null : this.attachment(binding, GL.DEPTH_STENCIL_ATTACHMENT));
        const all = [...colors, depth].filter(Boolean);
        if (!all.length) throw new Error('a framebuffer without attachments');
        const key = [...colors, depth].map((a) => (a ? a.key : '-')).join('|');
        return {
            key,
            colors,
            depth,
            size: all[0].size,
            samples: all[0].samples,
            canvas: false,
        };
    }

    attachment(binding, attachment) {
        const { own: o, take } = this;
        const get = (name) => o.getFramebufferAttachmentParameter(binding, attachment, GL[name]);
        const type = get('FRAMEBUFFER_ATTACHMENT_OBJECT_TYPE');
        if (type === GL.RENDERBUFFER) return this.renderbuffer(get('FRAMEBUFFER_ATTACHMENT_OBJECT_NAME'));
        if (type !== GL.TEXTURE) return null;
        const info = textureInfo(get('FRAMEBUFFER_ATTACHMENT_OBJECT_NAME'));
        if (!info.format) this.seeAttached(info, binding, attachment, get);
        const level = get('FRAMEBUFFER_ATTACHMENT_TEXTURE_LEVEL');
        const face = get('FRAMEBUFFER_ATTACHMENT_TEXTURE_CUBE_MAP_FACE');
        const layer = face ? face - FACES : take.two ? get('FRAMEBUFFER_ATTACHMENT_TEXTURE_LAYER') : 0;
        const { width, height } = info.levels[level];
        return {
            ...info.format,
            info,
            key: `${objectId(info)}:${info.storage}:${level}:${layer}`,
            level,
            layer,
            size: [width, height],
            samples: 1,
            whole: info.levels.length === 1 && info.levels[0].depth === 1 && info.target === 0x0de1,
        };
    }

    /** A texture that was made before the recorder came, as an attachment. */
    seeAttached(info, binding, attachment, get) {
        info.target ??= get('FRAMEBUFFER_ATTACHMENT_TEXTURE_CUBE_MAP_FACE') ? TEXTURE_CUBE : GL.TEXTURE_2D;
        if (!this.reader.guess(info)) throw new Error('a texture made before the recorder');
        info.format = attachmentFormat(this.own, binding, attachment);
    }

    renderbuffer(renderbuffer) {
        const info = (renderbuffer[INFO] ??= this.askRenderbuffer(renderbuffer));
        const format = textureFormat(info.internal);
        const samples = info.samples > 1 ? 4 : 1;
        const key = `${objectId(info)}:${info.storage}`;
        return {
            ...format,
            info,
            key,
            renderbuffer: true,
            size: [info.width, info.height],
            samples,
            whole: true,
        };
    }

    askRenderbuffer(renderbuffer) {
        const { own: o, take } = this;
        const bound = o.getParameter(GL.RENDERBUFFER_BINDING);
        o.bindRenderbuffer(GL.RENDERBUFFER, renderbuffer);
        const get = (name) => o.getRenderbufferParameter(GL.RENDERBUFFER, GL[`RENDERBUFFER_${name}`]);
        const info = {
            internal: get('INTERNAL_FORMAT'),
            width: get('WIDTH'),
            height: get('HEIGHT'),
            storage: 0,
        };
        info.samples = take.two ? get('SAMPLES') : 0;
        o.bindRenderbuffer(GL.RENDERBUFFER, bound);
        return info;
    }

    /** The number of an attachment's texture; `replaced`: its content before does not matter. */
    attach(attachment, replaced) {
        const { take, folder } = this;
        const { info } = attachment;
        if (attachment.number !== undefined) return attachment.number;
        const known = folder.unknown.length;
        if (!attachment.renderbuffer) this.sync(info, replaced && attachment.whole);
        else if (info.taken?.take !== take || info.taken.storage !== info.storage) {
            const { size, format, samples } = attachment;
            const number = this.texture({
                size: [...size, 1],
                format,
                mipLevelCount: 1,
                sampleCount: samples,
                usage: ATTACHMENT | SAMPLED_USAGE,
            });
            info.taken = { take, storage: info.storage, number, levels: 1 };
            if (!replaced)
                this.unknown({
                    texture: number,
                    why: 'a renderbuffer, drawn before the capture',
                });
        }
        if (info.lost === take && !replaced) take.note('blitFramebuffer', 'scales or converts into no texture');
        info.lost = null;
        info.taken.before = folder.unknown.slice(known);
        info.taken.drawn = true;
        folder.entries.textures[info.taken.number].usage |= ATTACHMENT;
        return info.taken.number;
    }

    /** The pass that attached it, and has drawn nothing, clears all of it: its content before does not matter. */
    replaced({ info, whole }) {
        if (!whole || !info?.taken.before.length) return;
        const { folder } = this;
        folder.unknown = folder.unknown.filter((entry) => !info.taken.before.includes(entry));
    }
}

let objectIds = 0;

/** A number for an object, for keys. */
function objectId(info) {
    return (info.id ??= ++objectIds);
}
