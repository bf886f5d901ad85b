// Textures that the page made before the recorder came: WebGL 2 tells a shader their size, and a framebuffer their
// format where it can be drawn to. The format of the rest follows from their values.

const CHANNEL_NAMES = ['RED', 'GREEN', 'BLUE', 'ALPHA'];

Object.assign(GlReader.prototype, {
    /** Fills `info` in. Returns whether it could. */
    guess(info) {
        if (!this.two || info.guessed) return Boolean(info.format);
        info.guessed = true;
        const { own: o } = this;
        const { texture, target } = info;
        try {
            const unknown = { target, format: { format: 'rgba32float', kind: 'float', rgb: false } };
            const place = { level: 0, layer: 0, width: 1, height: 1 };
            const [width, height, depth] = this.apart(() => this.drawn(texture, unknown, place, 'size'));
            if (!width) return false;
            const bound = o.getParameter(BINDING_OF[target]);
            o.bindTexture(target, texture);
            const get = (name) => o.getTexParameter(target, GL[name]);
            const mips = get('TEXTURE_MIN_FILTER') >= GL.NEAREST_MIPMAP_NEAREST;
            const largest = Math.max(width, height, target === 0x806f ? depth : 1);
            const all = mips ? Math.floor(Math.log2(largest)) + 1 : 1;
            const count = get('TEXTURE_IMMUTABLE_FORMAT') ? get('TEXTURE_IMMUTABLE_LEVELS') : all;
            const compares = get('TEXTURE_COMPARE_MODE') !== GL.NONE;
            o.bindTexture(target, bound);
            const shrink = (value, level) => Math.max(1, value >> level);
            info.levels = Array.from({ length: count }, (_, i) => ({
                width: shrink(width, i),
                height: shrink(height, i),
                depth: target === 0x806f ? shrink(depth, i) : depth,
            }));
            info.format = compares
                ? { format: 'depth32float', kind: 'depth', rgb: false }
                : (this.drawableFormat(info) ?? this.valuedFormat(info, unknown));
        } catch {
            // It stays unknown, and the capture says so.
            info.levels = [];
            info.format = null;
        }
        return Boolean(info.format);
    },

    /** The format of a texture that a framebuffer may draw to. */
    drawableFormat({ texture, target }) {
        const { own: o } = this;
        return this.apart(() => {
            const framebuffer = o.createFramebuffer();
            const binding = GL.READ_FRAMEBUFFER;
            o.bindFramebuffer(binding, framebuffer);
            if (target === GL.TEXTURE_2D || target === TEXTURE_CUBE) {
                const face = target === TEXTURE_CUBE ? GL.TEXTURE_CUBE_MAP_POSITIVE_X : target;
                o.framebufferTexture2D(binding, GL.COLOR_ATTACHMENT0, face, texture, 0);
            } else o.framebufferTextureLayer(binding, GL.COLOR_ATTACHMENT0, texture, 0, 0);
            const complete = o.checkFramebufferStatus(binding) === GL.FRAMEBUFFER_COMPLETE;
            const format = complete ? attachmentFormat(o, binding, GL.COLOR_ATTACHMENT0) : null;
            o.deleteFramebuffer(framebuffer);
            while (o.getError());
            return format;
        });
    },

    /** A format that holds the values of the first layer. */
    valuedFormat({ texture, levels }, { target, format }) {
        const [{ width, height }] = levels;
        const values = this.apart(() => this.drawn(texture, { target, format }, { level: 0, layer: 0, width, height }));
        const bytes = values.every((value) => Math.abs(value * 255 - Math.round(value * 255)) < 1e-4);
        if (bytes && values.every((value) => value >= 0 && value <= 1)) {
            return { format: 'rgba8unorm', kind: 'unorm', rgb: false };
        }
        return format;
    },
});

/** The format of an attachment by the sizes of its channels. */
function attachmentFormat(o, binding, attachment) {
    const get = (name) =>
        o.getFramebufferAttachmentParameter(binding, attachment, GL[`FRAMEBUFFER_ATTACHMENT_${name}`]);
    if (attachment !== GL.COLOR_ATTACHMENT0 && !(attachment > GL.COLOR_ATTACHMENT0 && attachment < 0x8cf0)) {
        const depth = get('DEPTH_SIZE');
        const stencil = get('STENCIL_SIZE');
        const name = depth === 16 ? 'depth16unorm' : depth === 32 ? 'depth32float' : depth ? 'depth24plus' : '';
        return { format: stencil ? (name ? `${name}-stencil8` : 'stencil8') : name, kind: 'depth', rgb: false };
    }
    const sizes = CHANNEL_NAMES.map((name) => get(`${name}_SIZE`));
    const [bits] = sizes;
    const channels = sizes.filter(Boolean).length;
    const rgb = channels === 3;
    const letters = ['r', 'rg', 'rgba', 'rgba'][channels - 1];
    if (bits === 11) return { format: 'rg11b10ufloat', kind: 'float', rgb: false };
    const type = get('COMPONENT_TYPE');
    if (bits === 10)
        return { format: type === GL.UNSIGNED_INT ? 'rgb10a2uint' : 'rgb10a2unorm', kind: 'float', rgb: false };
    const kinds = { [GL.FLOAT]: 'float', [GL.INT]: 'sint', [GL.UNSIGNED_INT]: 'uint' };
    const kind = kinds[type];
    if (kind) return { format: `${letters}${bits}${kind}`, kind, rgb };
    if (get('COLOR_ENCODING') === GL.SRGB) return { format: 'rgba8unorm-srgb', kind: 'srgb', rgb };
    return { format: `${letters}8unorm`, kind: 'unorm', rgb };
}
