// What a WebGL context does not tell later: storage of textures, sources of programs, names of uniform locations.
// And what changes while a frame is recorded, so that it is asked again.

/** The recording of a context, while there is one. */
let taking = null;
/** Contexts that drew to their canvas since they were last asked for. */
const drawnContexts = new Set();

const INFO = Symbol('preshade info');
/** On a context: methods of extensions that the page called, and that the recorder does not follow. */
const UNFOLLOWED = Symbol('preshade unfollowed');
/** On a context: whether the page asked for `EXT_clip_control`. */
const CLIP_CONTROL = Symbol('preshade clip control');
/** Methods of extensions that change nothing that a frame shows, or whose objects the recorder asks the context for. */
const HARMLESS = /Query|VertexArray|[lL]oseContext|restoreContext|getTranslatedShaderSource|getSupportedProfiles|^is/;
const originals = new Map();

function ownMethods(gl) {
    const methods = {};
    for (const [name, method] of originals.get(Object.getPrototypeOf(gl))) methods[name] = method.bind(gl);
    return methods;
}

/** Replaces a method of WebGL 1 and 2, of those that there are. `after(gl, args, result)` runs after the call. */
function afterGl(names, after) {
    for (const type of glTypes) {
        for (const name of names.split(' ')) {
            wrap(
                type,
                name,
                (original) =>
                    function () {
                        const result = original.apply(this, arguments);
                        try {
                            after(this, arguments, result, name);
                        } catch (error) {
                            // It is ours, so the page does not see it.
                            if (taking !== null && taking.gl === this) taking.note(name, error.message);
                        }
                        return result;
                    },
            );
        }
    }
}

/** The same, before the call, and only while a frame of the context is recorded. */
function beforeTaken(names, before) {
    for (const type of glTypes) {
        for (const name of names.split(' ')) {
            wrap(
                type,
                name,
                (original) =>
                    function () {
                        if (taking !== null && taking.gl === this) taking.guard(() => before(taking, arguments, name));
                        return original.apply(this, arguments);
                    },
            );
        }
    }
}

function afterTaken(names, after) {
    afterGl(names, (gl, args, result, name) => {
        if (taking !== null && taking.gl === gl) taking.guard(() => after(taking, args, name));
    });
}

let glTypes = [];

const FACES = 0x8515;
function bindingTarget(target) {
    return target >= FACES && target < FACES + 6 ? TEXTURE_CUBE : target;
}

/** The texture that is bound to `target`, with what we know of it. */
function boundTexture(gl, target) {
    const kind = bindingTarget(target);
    const texture = gl.getParameter(BINDING_OF[kind]);
    return texture ? textureInfo(texture, kind) : null;
}

function textureInfo(texture, target) {
    const info = (texture[INFO] ??= {
        texture,
        target,
        levels: [],
        format: null,
        storage: 0,
        dirty: null,
        changed: null,
    });
    if (target) info.target = target;
    return info;
}

/** A level got storage. */
function define(gl, target, level, internal, width, height, depth, type) {
    const info = boundTexture(gl, target);
    if (!info || !width || !height) return;
    const old = info.levels[level];
    const format = textureFormat(internal, type);
    const same = old && old.width === width && old.height === height && old.depth === depth;
    if (!same || (level === 0 && info.format.format !== format.format)) {
        if (level === 0) {
            info.format = format;
            info.levels.length = 0;
        }
        info.levels[level] = { width, height, depth };
        info.storage += 1;
        if (taking !== null) taking.targetDirty = true;
    }
    info.format ??= format;
    dirty(info, level);
}

/** The content of a level changed. */
function dirty(info, level) {
    if (taking === null) return;
    info.changed = taking;
    (info.dirty ??= new Set()).add(level);
}

/** A part of the framebuffer was copied into a level. */
function copied(gl, target, level, to, x, y, width, height) {
    if (taking === null || taking.gl !== gl) return;
    const info = boundTexture(gl, target);
    if (!info) return;
    const face = target === info.target ? 0 : target - FACES;
    taking.guard(() => taking.copyTexels(info, level, [to[0], to[1], to[2] + face], [x, y, width, height]));
}

function sourceSize(source) {
    if (!source) return [0, 0];
    return [
        source.videoWidth || source.naturalWidth || source.displayWidth || source.width,
        source.videoHeight || source.naturalHeight || source.displayHeight || source.height,
    ];
}

function trackTextures() {
    afterGl('texImage2D', (gl, args) => {
        const [target, level, internal] = args;
        if (args.length >= 8) define(gl, target, level, internal, args[3], args[4], 1, args[7]);
        else define(gl, target, level, internal, ...sourceSize(args[5]), 1, args[4]);
        if (taking !== null && globalThis.HTMLVideoElement && args[args.length - 1] instanceof HTMLVideoElement) {
            taking.note('video texture', 'its picture is as captured');
        }
    });
    afterGl('texImage3D', (gl, [target, level, internal, width, height, depth, , , type]) =>
        define(gl, target, level, internal, width, height, depth, type),
    );
    afterGl('compressedTexImage2D copyTexImage2D', (gl, args, _, name) => {
        const [target, level, internal] = args;
        const [width, height] = name.startsWith('copy') ? [args[5], args[6]] : [args[3], args[4]];
        define(gl, target, level, internal, width, height, 1, GL.UNSIGNED_BYTE);
        if (name.startsWith('copy')) copied(gl, target, level, [0, 0, 0], args[3], args[4], width, height);
    });
    afterGl('copyTexSubImage2D', (gl, [target, level, x, y, ...rest]) => copied(gl, target, level, [x, y, 0], ...rest));
    afterGl('copyTexSubImage3D', (gl, [target, level, x, y, z, ...rest]) =>
        copied(gl, target, level, [x, y, z], ...rest),
    );
    afterGl('compressedTexImage3D', (gl, [target, level, internal, width, height, depth]) =>
        define(gl, target, level, internal, width, height, depth),
    );
    const storage = (gl, target, levels, internal, width, height, depth) => {
        // WebGL drops the fraction that three.js gives.
        for (let i = 0; i < Math.trunc(levels); i++) {
            const deep = target === 0x806f ? Math.max(1, depth >> i) : depth;
            define(gl, target, i, internal, Math.max(1, width >> i), Math.max(1, height >> i), deep);
        }
    };
    afterGl('texStorage2D', (gl, [target, levels, internal, width, height]) =>
        storage(gl, target, levels, internal, width, height, 1),
    );
    afterGl('texStorage3D', (gl, [target, levels, internal, width, height, depth]) =>
        storage(gl, target, levels, internal, width, height, depth),
    );
    afterGl('generateMipmap', (gl, [target]) => {
        const info = boundTexture(gl, target);
        if (!info?.levels[0]) return;
        const { width, height, depth } = info.levels[0];
        const deep = target === 0x806f ? depth : 1;
        const count = Math.floor(Math.log2(Math.max(width, height, deep))) + 1;
        if (info.levels.length < count) info.storage += 1;
        for (let i = 1; i < count; i++) {
            info.levels[i] ??= {
                width: Math.max(1, width >> i),
                height: Math.max(1, height >> i),
                depth: target === 0x806f ? Math.max(1, depth >> i) : depth,
            };
            dirty(info, i);
        }
        if (taking !== null && taking.gl === gl) taking.mipmaps(info);
    });
    afterGl('texSubImage2D texSubImage3D compressedTexSubImage2D compressedTexSubImage3D', (gl, [target, level]) => {
        if (taking === null) return;
        const info = boundTexture(gl, target);
        if (info) dirty(info, level);
    });
    afterGl('texParameteri texParameterf', (gl, [target]) => {
        const info = boundTexture(gl, target);
        if (info) info.parameters = null;
    });
    afterGl('samplerParameteri samplerParameterf', (gl, [sampler]) => {
        sampler[INFO] = null;
    });
}

function bufferInfo(buffer) {
    return (buffer[INFO] ??= {
        size: 0,
        storage: 0,
        dirty: null,
        changed: null,
        shadow: null,
    });
}

/** WebGL 1 reads no buffers, so there a copy is kept. */
function trackBuffers() {
    afterGl('bufferData', (gl, args) => {
        const buffer = gl.getParameter(bufferBinding(args[0]));
        if (!buffer) return;
        const info = bufferInfo(buffer);
        let data = args[1];
        if (ArrayBuffer.isView(data) && args.length > 3) {
            const begin = args[3];
            data = data.subarray(begin, args[4] ? begin + args[4] : undefined);
        }
        const size = typeof data === 'number' ? data : (data?.byteLength ?? 0);
        if (size !== info.size) info.storage += 1;
        info.size = size;
        if (!isTwo(gl)) info.shadow = typeof data === 'number' ? new Uint8Array(size) : bytesOf(data).slice();
        dirtyBuffer(info, 0, size);
    });
    afterGl('bufferSubData', (gl, args) => {
        if (isTwo(gl) && taking === null) return;
        const buffer = gl.getParameter(bufferBinding(args[0]));
        if (!buffer) return;
        const info = bufferInfo(buffer);
        const [, offset, data, begin = 0, length = 0] = args;
        const unit = data.BYTES_PER_ELEMENT ?? 1;
        const size = length ? length * unit : data.byteLength - begin * unit;
        info.shadow?.set(bytesOf(data), offset);
        dirtyBuffer(info, offset, offset + size);
    });
    afterTaken('readPixels', (take) => {
        const buffer = take.two && take.own.getParameter(0x88ed);
        if (buffer) dirtyBuffer(bufferInfo(buffer), 0, bufferInfo(buffer).size);
    });
    afterTaken('copyBufferSubData', (take, [, target, , offset, size]) => {
        const buffer = take.gl.getParameter(bufferBinding(target));
        if (buffer) dirtyBuffer(bufferInfo(buffer), offset, offset + size);
    });
}

function bufferBinding(target) {
    return {
        0x8892: 0x8894,
        0x8893: 0x8895,
        0x8f36: 0x8f36,
        0x8f37: 0x8f37,
        0x88eb: 0x88ed,
        0x88ec: 0x88ef,
        0x8c8e: 0x8c8f,
        0x8a11: 0x8a28,
    }[target];
}

function dirtyBuffer(info, begin, end) {
    if (taking === null) return;
    info.changed = taking;
    if (!info.dirty) info.dirty = [begin, end];
    else info.dirty = [Math.min(info.dirty[0], begin), Math.max(info.dirty[1], end)];
}

function trackPrograms() {
    afterGl('linkProgram', (gl, [program]) => {
        if (!program) return;
        const sources = {};
        for (const shader of gl.getAttachedShaders(program) ?? []) {
            const stage = gl.getShaderParameter(shader, GL.SHADER_TYPE) === GL.VERTEX_SHADER ? 'vertex' : 'fragment';
            sources[stage] = gl.getShaderSource(shader);
        }
        program[INFO] = { sources };
    });
    afterGl('getUniformLocation', (gl, [program, name], location) => {
        if (location) location[INFO] = { program, name: String(name) };
    });
    const setters = [];
    for (const n of [1, 2, 3, 4]) for (const t of ['f', 'i', 'ui']) setters.push(`uniform${n}${t}`, `uniform${n}${t}v`);
    for (const n of ['2', '3', '4', '2x3', '3x2', '2x4', '4x2', '3x4', '4x3']) setters.push(`uniformMatrix${n}fv`);
    afterTaken(setters.join(' '), (take, args, name) => take.uniformSet(args, name));
    afterTaken('uniformBlockBinding', (take) => (take.blocksDirty = true));
    afterTaken('bindBufferBase bindBufferRange', (take) => (take.blocksDirty = true));
}

function trackState() {
    afterTaken(
        `enable disable blendColor blendEquation blendEquationSeparate blendFunc blendFuncSeparate colorMask cullFace
        depthFunc depthMask depthRange frontFace polygonOffset sampleCoverage scissor stencilFunc stencilFuncSeparate
        stencilMask stencilMaskSeparate stencilOp stencilOpSeparate viewport`.replace(/\s+/g, ' '),
        (take) => (take.stateDirty = true),
    );
    afterTaken('bindFramebuffer drawBuffers', (take) => {
        take.stateDirty = true;
        take.targetDirty = true;
    });
    afterTaken(
        'framebufferTexture2D framebufferTextureLayer framebufferRenderbuffer renderbufferStorage renderbufferStorageMultisample',
        (take) => (take.targetDirty = true),
    );
    afterTaken('vertexAttribPointer vertexAttribIPointer vertexAttribDivisor', (take, args, name) =>
        take.pointerSet(name, args),
    );
    afterTaken('useProgram', (take) => (take.programDirty = true));
    afterTaken('linkProgram', (take) => (take.programDirty = true));
}

/** A renderbuffer's storage, which the next framebuffer asks for. */
function trackRenderbuffers() {
    afterGl('renderbufferStorage renderbufferStorageMultisample', (gl, args) => {
        const renderbuffer = gl.getParameter(GL.RENDERBUFFER_BINDING);
        if (!renderbuffer) return;
        const [internal, width, height] = [...args].slice(-3);
        const samples = args.length > 4 ? args[1] : 0;
        const storage = (renderbuffer[INFO]?.storage ?? 0) + 1;
        renderbuffer[INFO] = { samples, internal, width, height, storage };
    });
}

function trackDraws() {
    const draws = 'drawArrays drawElements drawArraysInstanced drawElementsInstanced drawRangeElements';
    beforeTaken(draws, (take, args, name) => take.draw(name, args));
    beforeTaken('clear', (take, [mask]) => take.clear(mask));
    beforeTaken('clearBufferfv clearBufferiv clearBufferuiv clearBufferfi', (take, args, name) =>
        take.clearBuffer(name, args),
    );
    afterTaken('blitFramebuffer', (take, args) => take.blit(args));
    afterTaken('beginTransformFeedback endTransformFeedback', (take, _, name) => {
        take.feedback = name[0] === 'b';
        if (!take.feedback) take.fedBack();
    });
    afterGl(`${draws} clear blitFramebuffer`, (gl) => {
        if (phase !== IDLE && gl.getParameter(GL.FRAMEBUFFER_BINDING) === null) {
            drawnContexts.add(gl);
            if (taking !== null && taking.gl === gl) taking.showsLater();
        }
    });
}

/** Methods of extensions go to the same places as those of WebGL 2. */
function trackExtensions() {
    const names = {
        drawArraysInstancedANGLE: 'drawArraysInstanced',
        drawElementsInstancedANGLE: 'drawElementsInstanced',
    };
    afterGl('getExtension', (gl, _, extension) => {
        if (!extension || extension[INFO]) return;
        extension[INFO] = gl;
        for (const [theirs, ours] of Object.entries(names)) {
            const original = extension[theirs];
            if (!original) continue;
            extension[theirs] = function () {
                if (taking !== null && taking.gl === gl) taking.guard(() => taking.draw(ours, arguments));
                const result = original.apply(extension, arguments);
                if (phase !== IDLE) drawnContexts.add(gl);
                if (taking !== null && taking.gl === gl) taking.showsLater();
                return result;
            };
        }
        replaceMultiDraw(gl, extension);
        noteUnfollowed(gl, extension);
        const { vertexAttribDivisorANGLE } = extension;
        if (vertexAttribDivisorANGLE) {
            extension.vertexAttribDivisorANGLE = function () {
                vertexAttribDivisorANGLE.apply(extension, arguments);
                if (taking !== null && taking.gl === gl) taking.pointerSet('vertexAttribDivisor', arguments);
            };
        }
        const { clipControlEXT } = extension;
        if (clipControlEXT) {
            gl[CLIP_CONTROL] = true;
            extension.clipControlEXT = function () {
                clipControlEXT.apply(extension, arguments);
                if (taking !== null && taking.gl === gl) taking.stateDirty = true;
            };
        }
        const { drawBuffersWEBGL } = extension;
        if (drawBuffersWEBGL) {
            extension.drawBuffersWEBGL = function () {
                const result = drawBuffersWEBGL.apply(extension, arguments);
                if (taking !== null && taking.gl === gl) taking.targetDirty = taking.stateDirty = true;
                return result;
            };
        }
    });
}

const FOLLOWED = new Set([
    'drawArraysInstancedANGLE',
    'drawElementsInstancedANGLE',
    'vertexAttribDivisorANGLE',
    'drawBuffersWEBGL',
    'clipControlEXT',
    'multiDrawArraysWEBGL',
    'multiDrawElementsWEBGL',
    'multiDrawArraysInstancedWEBGL',
    'multiDrawElementsInstancedWEBGL',
]);

/** Methods of an extension that the recorder does not follow: a frame that depends on one says so. */
function noteUnfollowed(gl, extension) {
    for (const name of Object.getOwnPropertyNames(Object.getPrototypeOf(extension))) {
        const original = extension[name];
        if (typeof original !== 'function' || name === 'constructor' || FOLLOWED.has(name) || HARMLESS.test(name)) continue;
        extension[name] = function () {
            (gl[UNFOLLOWED] ??= new Set()).add(name);
            if (taking !== null && taking.gl === gl) taking.note(name, 'the recorder does not follow this extension');
            return original.apply(extension, arguments);
        };
    }
}

function replaceMultiDraw(gl, extension) {
    for (const name of [
        'multiDrawArraysWEBGL',
        'multiDrawElementsWEBGL',
        'multiDrawArraysInstancedWEBGL',
        'multiDrawElementsInstancedWEBGL',
    ]) {
        const original = extension[name];
        if (!original) continue;
        extension[name] = function () {
            if (taking !== null && taking.gl === gl) taking.guard(() => taking.multiDraw(name, arguments));
            const result = original.apply(extension, arguments);
            if (phase !== IDLE) drawnContexts.add(gl);
            if (taking !== null && taking.gl === gl) taking.showsLater();
            return result;
        };
    }
}

function installWebgl() {
    glTypes = [globalThis.WebGLRenderingContext, globalThis.WebGL2RenderingContext].filter(Boolean);
    if (glTypes.length < 2) return;
    for (const type of glTypes) {
        const methods = [];
        for (const name of Object.getOwnPropertyNames(type.prototype)) {
            const { value } = Object.getOwnPropertyDescriptor(type.prototype, name);
            if (typeof value === 'function' && name !== 'constructor') methods.push([name, value]);
        }
        originals.set(type.prototype, methods);
    }
    installFormats();
    giveErrors(glTypes);
    wrap(
        globalThis.OffscreenCanvas,
        'transferToImageBitmap',
        (original) =>
            function () {
                webglRecorder.given(this);
                return original.call(this);
            },
    );
    trackTextures();
    trackBuffers();
    trackPrograms();
    trackState();
    trackRenderbuffers();
    trackDraws();
    trackExtensions();
    sources.push(webglRecorder);
}
