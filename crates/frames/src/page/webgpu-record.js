// The WebGPU recorder: content at the start, the stream of each frame, and both as entries of frame.json.

const recorder = {
    canvases() {
        const list = [...drawnCanvases.values()].map(({ context, thing }) => ({
            area: visibleArea(context.canvas),
            context,
            device: thing.device,
        }));
        drawnCanvases.clear();
        return list;
    },

    describe({ device }) {
        const adapter = adapterName(device?.adapterInfo);
        const features = [...(device?.features ?? [])];
        return {
            api: 'webgpu',
            adapter,
            features,
            title: document.title,
            writer: WRITER,
        };
    },

    begin(folder, { context, device }) {
        if (!device) {
            throw new Error(
                'the page made its WebGPU objects before the recorder came: put it first in the page by a script tag',
            );
        }
        this.folder = folder;
        this.writer = new WebgpuWriter(folder);
        this.context = context;
        for (const ref of live) {
            const thing = ref.deref();
            if (thing) this.writer.stage(thing);
        }
        this.beginFrame();
    },

    beginFrame() {
        stream = [];
        drawnCanvases.clear();
        this.pictures = new Map();
    },

    drawn() {
        return drawnCanvases.size > 0;
    },

    /** Keeps what a canvas shows after a submission; the last one of a frame counts. */
    picture(canvas) {
        const { context, thing } = canvas;
        this.pictures.get(context)?.staged.drop();
        this.pictures.set(context, {
            thing,
            staged: stageTexture(thing, { size: thing.descriptor.size }),
        });
    },

    endFrame() {
        const commands = stream;
        const { writer, pictures } = this;
        const shown = this.shown(pictures);
        this.beginFrame();
        return { write: () => writer.frame(commands, shown) };
    },

    /** The canvas that the capture is of; the largest one in a frame that left it alone. */
    shown(pictures) {
        let best = null;
        for (const [context, picture] of pictures) {
            picture.area = context === this.context ? Infinity : visibleArea(context.canvas);
            if (!best || picture.area > best.area) best = picture;
        }
        for (const picture of pictures.values()) if (picture !== best) picture.staged.drop();
        return best;
    },

    /** Recording stops; writing may go on. */
    end() {
        stream = null;
    },

    release() {
        this.writer?.release();
        this.folder = this.writer = this.context = null;
    },
};

/** How much of the page a canvas is: one that is not in the document counts little. */
function visibleArea(canvas) {
    return canvas.width * canvas.height * (canvas.isConnected ? 1 : 1e-3);
}

function adapterName(info) {
    return [info?.vendor, info?.architecture, info?.device, info?.description].filter(Boolean).join(' ');
}

/** JSON knows no NaN and no infinity: null, and a number beyond f32's range. */
function finite(value) {
    if (Number.isFinite(value)) return value;
    return Number.isNaN(value) ? null : Math.sign(value) * 1e300;
}

class WebgpuWriter {
    constructor(folder) {
        this.folder = folder;
        this.staged = new Map();
        this.used = new Set();
        this.wanted = [];
    }

    /** Copies what an object holds now. */
    stage(thing) {
        const { descriptor } = thing;
        if (thing.kind === 'buffer') {
            if (thing.object.mapState !== 'unmapped') this.staged.set(thing, 'mapped while the capture began');
            else if (!(descriptor.usage & GPUBufferUsage.MAP_READ)) this.staged.set(thing, stageBuffer(thing));
            return;
        }
        const why = unreadable(descriptor);
        this.staged.set(thing, why ?? this.levels(thing));
    }

    levels(thing) {
        const levels = [];
        for (let mipLevel = 0; mipLevel < thing.descriptor.mipLevelCount; mipLevel++) {
            const size = levelSize(thing.descriptor, mipLevel);
            for (const aspect of aspectsOf(thing.descriptor.format)) {
                const readable = blockOf(thing.descriptor.format, aspect);
                const staged = readable ? stageTexture(thing, { mipLevel, size, aspect }) : null;
                levels.push({ mipLevel, aspect, staged });
            }
        }
        return levels;
    }

    release() {
        for (const staged of this.staged.values()) {
            if (Array.isArray(staged)) for (const level of staged) level.staged?.drop();
            else if (typeof staged !== 'string') staged.drop();
        }
        this.staged.clear();
    }

    async frame(commands, shown) {
        for (const command of commands) {
            if (command.data && !(command.data instanceof Uint8Array)) command.data = await command.data.take();
        }
        const list = [];
        for (const command of commands) this.command(command, list);
        await this.contents();
        const { thing, staged } = shown;
        const { alphaMode } = thing.canvas;
        const { size, format } = thing.descriptor;
        const picture = {
            data: this.folder.data(await staged.take()),
            format,
            size: size.slice(0, 2),
        };
        return {
            size: size.slice(0, 2),
            canvas: this.value(thing),
            alphaMode,
            commands: list,
            picture,
        };
    }

    /** Start contents of objects that the frames used so far. */
    async contents() {
        const { folder } = this;
        for (const thing of this.wanted.splice(0)) {
            const staged = this.staged.get(thing);
            if (!staged) continue;
            this.staged.delete(thing);
            const entry = { [thing.kind]: this.value(thing) };
            if (typeof staged === 'string') folder.unknown.push({ ...entry, why: staged });
            else if (thing.kind === 'buffer') await this.content(folder.start.buffers, entry, staged);
            else {
                for (const { mipLevel, aspect, staged: level } of staged) {
                    const where = { ...entry, mipLevel };
                    if (aspect !== 'all') where.aspect = aspect;
                    if (level) await this.content(folder.start.textures, where, level);
                    else
                        folder.unknown.push({
                            ...where,
                            why: `WebGPU does not copy ${thing.descriptor.format}`,
                        });
                }
            }
        }
    }

    async content(list, entry, staged) {
        try {
            const bytes = await staged.take();
            if (bytes.some((byte) => byte)) list.push({ ...entry, data: this.folder.data(bytes) });
        } catch (error) {
            this.folder.unknown.push({ ...entry, why: error.message });
        }
    }

    /** The first use of an object by the frames: its content before counts unless all of it is replaced. */
    use(thing, replaced = false) {
        if (this.used.has(thing)) return;
        this.used.add(thing);
        if (!replaced) this.wanted.push(thing);
    }

    command(command, list) {
        if (command.do === 'refused') return this.folder.refuse(command.what, command.why);
        if (command.do === 'renderPass') return this.renderPass(command, list);
        const why = refusedWhy(command);
        if (why) return this.folder.refuse(command.do, why);
        if (command.do === 'writeBuffer') {
            const { buffer, offset, data } = command;
            this.use(buffer, offset === 0 && data.length >= buffer.descriptor.size);
        }
        if (command.do === 'computePass') {
            list.push({
                do: 'computePass',
                label: command.label,
                commands: this.pass(command.commands),
            });
        } else list.push(this.value(command));
    }

    renderPass({ descriptor, commands }, list) {
        const attachments = [...descriptor.colorAttachments.filter(Boolean)];
        const depth = descriptor.depthStencilAttachment;
        const why = [...attachments, depth].map((attachment) => attachment && refusedWhy(attachment)).find(Boolean);
        if (why) return this.folder.refuse('renderPass', why);
        for (const { view, loadOp, resolveTarget } of attachments) {
            this.use(textureOf(view), loadOp === 'clear' && isWhole(view));
            if (resolveTarget) this.use(textureOf(resolveTarget), isWhole(resolveTarget));
        }
        if (depth) {
            const keeps = depth.depthLoadOp === 'load' || depth.stencilLoadOp === 'load';
            const reads = depth.depthReadOnly || depth.stencilReadOnly;
            this.use(textureOf(depth.view), !keeps && !reads && isWhole(depth.view));
        }
        list.push({
            do: 'renderPass',
            descriptor: this.value(descriptor),
            commands: this.pass(commands),
        });
    }

    /** Commands of a pass. A draw that needs something refused is refused, the rest stays. */
    pass(commands) {
        const list = [];
        const reasons = {};
        for (const command of commands) {
            const { do: name } = command;
            if (name === 'refused') {
                this.folder.refuse(command.what, command.why);
                continue;
            }
            if (/^(draw|dispatch)/.test(name)) {
                const why = refusedWhy(command) ?? Object.values(reasons).find(Boolean);
                if (why) this.folder.refuse(name, why);
                else list.push(this.value(command));
                continue;
            }
            const slot = `${name} ${command.index ?? command.slot ?? ''}`;
            reasons[slot] = refusedWhy(command);
            if (!reasons[slot]) list.push(this.value(command));
        }
        return list;
    }

    /** A value of a command or descriptor as JSON. */
    value(value) {
        if (value instanceof Thing) return this.reference(value);
        if (value instanceof Uint8Array) return this.folder.data(value);
        if (typeof value === 'number') return finite(value);
        if (Array.isArray(value)) return value.map((item) => this.value(item));
        if (typeof value !== 'object' || value === null) return value;
        const copy = {};
        for (const key in value) copy[key] = this.value(value[key]);
        return copy;
    }

    reference(thing) {
        const { folder } = this;
        const { kind, descriptor } = thing;
        const make = () => this.value(descriptor);
        switch (kind) {
            case 'buffer':
                this.use(thing);
                return folder.number('buffers', thing, () => ({
                    ...make(),
                    usage: unmapped(descriptor.usage),
                }));
            case 'texture':
                this.use(thing);
                return folder.number('textures', thing, make);
            case 'view':
                return { texture: this.reference(thing.texture), view: make() };
            case 'derivedLayout':
                return this.derivedLayout(descriptor);
            case 'shader':
                return folder.number('shaders', thing, () => ({
                    label: descriptor.label,
                    language: 'wgsl',
                    data: folder.text(descriptor.code),
                }));
            case 'bindGroup':
                return folder.number('bindGroups', thing, () => this.bindGroup(descriptor));
            default:
                return folder.number(`${kind}s`, thing, make);
        }
    }

    derivedLayout({ renderPipeline, computePipeline, group }) {
        if (renderPipeline) return { pipeline: this.reference(renderPipeline), group };
        return { computePipeline: this.reference(computePipeline), group };
    }

    bindGroup({ label, layout, entries }) {
        const entry = ({ binding, resource }) => {
            if (!(resource instanceof Thing)) return { binding, ...this.value(resource) };
            const value = this.reference(resource);
            if (resource.kind === 'view') return { binding, ...value };
            return { binding, [resource.kind]: value };
        };
        return {
            label,
            layout: this.reference(layout),
            entries: entries.map(entry),
        };
    }
}

/** Usage of a buffer in the folder: what the page wrote through mapped memory is written by the queue there. */
function unmapped(usage) {
    const mapped = GPUBufferUsage.MAP_READ | GPUBufferUsage.MAP_WRITE;
    return usage & mapped ? (usage & ~mapped) | GPUBufferUsage.COPY_DST : usage;
}

function textureOf(view) {
    return view.texture ?? view;
}

/** Whether a view covers all of its texture. */
function isWhole(view) {
    const { size, mipLevelCount } = textureOf(view).descriptor;
    return size[2] === 1 && mipLevelCount === 1;
}

/** Why a command or descriptor cannot be recorded: it refers to something that cannot. */
function refusedWhy(value) {
    if (value instanceof Thing) {
        if (value.refused !== undefined) return value.refused;
        // Objects never change, so the answer stays.
        const why = refusedWhy(value.descriptor) ?? (value.texture ? refusedWhy(value.texture) : null);
        value.refused = why;
        return why;
    }
    if (typeof value !== 'object' || value === null || ArrayBuffer.isView(value)) return null;
    for (const key in value) {
        if (key === 'commands') continue;
        const why = refusedWhy(value[key]);
        if (why) return why;
    }
    return null;
}
