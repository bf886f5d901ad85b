// Replays the frames of a WebGL capture by WebGL 2, from the folder alone, and returns the pixels that differ.

globalThis.replay = async (json, files) => {
    const canvas = document.createElement('canvas');
    const gl = canvas.getContext('webgl2', { antialias: false });
    gl.getExtension('EXT_color_buffer_float');
    gl.getExtension('OES_texture_float_linear');
    gl.getExtension('EXT_texture_filter_anisotropic');
    const errors = [];
    const check = (what) => {
        const error = gl.getError();
        if (error) errors.push(`${what}: error ${error}`);
    };
    const bytes = (name) => Uint8Array.from(atob(files[name]), (c) => c.charCodeAt(0));
    const text = (name) => new TextDecoder().decode(bytes(name));
    gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);

    const COMPARE = ['never', 'less', 'equal', 'less-equal', 'greater', 'not-equal', 'greater-equal', 'always'];
    const FORMATS = {
        r8unorm: ['R8', 'RED', 'UNSIGNED_BYTE'],
        rg8unorm: ['RG8', 'RG', 'UNSIGNED_BYTE'],
        rgba8unorm: ['RGBA8', 'RGBA', 'UNSIGNED_BYTE'],
        'rgba8unorm-srgb': ['SRGB8_ALPHA8', 'RGBA', 'UNSIGNED_BYTE'],
        r16float: ['R16F', 'RED', 'HALF_FLOAT'],
        rg16float: ['RG16F', 'RG', 'HALF_FLOAT'],
        rgba16float: ['RGBA16F', 'RGBA', 'HALF_FLOAT'],
        r32float: ['R32F', 'RED', 'FLOAT'],
        rg32float: ['RG32F', 'RG', 'FLOAT'],
        rgba32float: ['RGBA32F', 'RGBA', 'FLOAT'],
        rg11b10ufloat: ['R11F_G11F_B10F', 'RGB', 'UNSIGNED_INT_10F_11F_11F_REV'],
        rgb10a2unorm: ['RGB10_A2', 'RGBA', 'UNSIGNED_INT_2_10_10_10_REV'],
        rgba32uint: ['RGBA32UI', 'RGBA_INTEGER', 'UNSIGNED_INT'],
        rgba32sint: ['RGBA32I', 'RGBA_INTEGER', 'INT'],
        r32uint: ['R32UI', 'RED_INTEGER', 'UNSIGNED_INT'],
        r8uint: ['R8UI', 'RED_INTEGER', 'UNSIGNED_BYTE'],
        rgba8uint: ['RGBA8UI', 'RGBA_INTEGER', 'UNSIGNED_BYTE'],
        depth16unorm: ['DEPTH_COMPONENT16', 'DEPTH_COMPONENT', 'UNSIGNED_SHORT'],
        depth24plus: ['DEPTH_COMPONENT24', 'DEPTH_COMPONENT', 'UNSIGNED_INT'],
        'depth24plus-stencil8': ['DEPTH24_STENCIL8', 'DEPTH_STENCIL', 'UNSIGNED_INT_24_8'],
        depth32float: ['DEPTH_COMPONENT32F', 'DEPTH_COMPONENT', 'FLOAT'],
        stencil8: ['STENCIL_INDEX8', 'STENCIL', 'UNSIGNED_BYTE'],
    };
    const cubes = new Set();
    for (const { textures } of json.named) {
        for (const { texture, view } of Object.values(textures).flat())
            if (view.dimension === 'cube') cubes.add(texture);
    }
    const arrays = new Set();
    for (const { textures } of json.named) {
        for (const { texture, view } of Object.values(textures).flat())
            if (view.dimension === '2d-array') arrays.add(texture);
    }
    const target = (i) => {
        if (json.textures[i].dimension === '3d') return gl.TEXTURE_3D;
        if (cubes.has(i)) return gl.TEXTURE_CUBE_MAP;
        return arrays.has(i) || json.textures[i].size[2] > 1 ? gl.TEXTURE_2D_ARRAY : gl.TEXTURE_2D;
    };
    const textures = json.textures.map(({ size, format, mipLevelCount, sampleCount }, i) => {
        const internal = gl[FORMATS[format][0]];
        const [width, height, layers] = size;
        if (sampleCount > 1 || format === 'stencil8') {
            const made = gl.createRenderbuffer();
            gl.bindRenderbuffer(gl.RENDERBUFFER, made);
            gl.renderbufferStorageMultisample(
                gl.RENDERBUFFER,
                sampleCount > 1 ? sampleCount : 0,
                internal,
                width,
                height,
            );
            return made;
        }
        const made = gl.createTexture();
        gl.bindTexture(target(i), made);
        if (target(i) === gl.TEXTURE_3D || target(i) === gl.TEXTURE_2D_ARRAY) {
            gl.texStorage3D(target(i), mipLevelCount, internal, width, height, layers);
        } else gl.texStorage2D(target(i), mipLevelCount, internal, width, height);
        check(`texture ${i} ${format}`);
        return made;
    });
    const typed = (type, content, format) => {
        if (format.startsWith('depth24')) {
            const depths = new Float32Array(content.buffer);
            // The highest 24 of 32 bits, or of a depth with a stencil.
            const [most, shift] = format.includes('stencil') ? [0xffffff, 256] : [0xffffffff, 1];
            return Uint32Array.from(depths, (depth) => Math.round(depth * most) * shift);
        }
        if (type === gl.FLOAT) return new Float32Array(content.buffer);
        if (type === gl.HALF_FLOAT || type === gl.UNSIGNED_SHORT) return new Uint16Array(content.buffer);
        if (type === gl.INT) return new Int32Array(content.buffer);
        return type === gl.UNSIGNED_BYTE ? content : new Uint32Array(content.buffer);
    };
    const upload = (i, level, content) => {
        const { size, format } = json.textures[i];
        const [, order, kind] = FORMATS[format].map((name) => gl[name]);
        const [width, height] = [size[0] >> level || 1, size[1] >> level || 1];
        const to = target(i);
        const layers = to === gl.TEXTURE_3D ? size[2] >> level || 1 : size[2];
        gl.activeTexture(gl.TEXTURE0);
        gl.bindTexture(to, textures[i]);
        if (to === gl.TEXTURE_2D) {
            gl.texSubImage2D(to, level, 0, 0, width, height, order, kind, typed(kind, content, format));
        } else if (to === gl.TEXTURE_CUBE_MAP) {
            const part = content.length / 6;
            for (let face = 0; face < 6; face++) {
                const texels = typed(kind, content.slice(face * part, (face + 1) * part), format);
                gl.texSubImage2D(
                    gl.TEXTURE_CUBE_MAP_POSITIVE_X + face,
                    level,
                    0,
                    0,
                    width,
                    height,
                    order,
                    kind,
                    texels,
                );
            }
        } else {
            gl.texSubImage3D(to, level, 0, 0, 0, width, height, layers, order, kind, typed(kind, content, format));
        }
        check(`upload of texture ${i} ${format}`);
    };
    for (const { texture, mipLevel, data } of json.start.textures) upload(texture, mipLevel, bytes(data));

    // WebGL lets a buffer be of indices or of everything else.
    const indexBuffers = new Set();
    for (const { commands } of json.frames) {
        for (const pass of commands) {
            for (const c of pass.commands ?? []) if (c.do === 'setIndexBuffer') indexBuffers.add(c.buffer);
        }
    }
    const bufferTarget = (i) => (indexBuffers.has(i) ? gl.ELEMENT_ARRAY_BUFFER : gl.ARRAY_BUFFER);
    const buffers = json.buffers.map(({ size }, i) => {
        const made = gl.createBuffer();
        gl.bindBuffer(bufferTarget(i), made);
        gl.bufferData(bufferTarget(i), size, gl.STATIC_DRAW);
        return made;
    });
    const writeBuffer = (i, offset, content) => {
        gl.bindBuffer(bufferTarget(i), buffers[i]);
        gl.bufferSubData(bufferTarget(i), offset, content);
    };
    for (const { buffer, data } of json.start.buffers) writeBuffer(buffer, 0, bytes(data));

    const samplers = json.samplers.map((sampler) => {
        const made = gl.createSampler();
        const set = (name, value) => gl.samplerParameteri(made, gl[name], value);
        const wrap = { repeat: gl.REPEAT, 'mirror-repeat': gl.MIRRORED_REPEAT };
        set('TEXTURE_WRAP_S', wrap[sampler.addressModeU] ?? gl.CLAMP_TO_EDGE);
        set('TEXTURE_WRAP_T', wrap[sampler.addressModeV] ?? gl.CLAMP_TO_EDGE);
        set('TEXTURE_WRAP_R', wrap[sampler.addressModeW] ?? gl.CLAMP_TO_EDGE);
        set('TEXTURE_MAG_FILTER', sampler.magFilter === 'linear' ? gl.LINEAR : gl.NEAREST);
        const base = sampler.minFilter === 'linear' ? 'LINEAR' : 'NEAREST';
        const mips = sampler.mipmapFilter === 'linear' ? 'LINEAR' : 'NEAREST';
        set('TEXTURE_MIN_FILTER', sampler.lodMaxClamp === 0.25 ? gl[base] : gl[`${base}_MIPMAP_${mips}`]);
        if (sampler.compare) {
            set('TEXTURE_COMPARE_MODE', gl.COMPARE_REF_TO_TEXTURE);
            set('TEXTURE_COMPARE_FUNC', gl.NEVER + COMPARE.indexOf(sampler.compare));
        }
        if (sampler.maxAnisotropy) gl.samplerParameterf(made, 0x84fe, sampler.maxAnisotropy);
        return made;
    });

    const FACTORS = {
        zero: 0,
        one: 1,
        src: 0x300,
        'one-minus-src': 0x301,
        'src-alpha': 0x302,
        'one-minus-src-alpha': 0x303,
        'dst-alpha': 0x304,
        'one-minus-dst-alpha': 0x305,
        dst: 0x306,
        'one-minus-dst': 0x307,
        'src-alpha-saturated': 0x308,
        constant: 0x8001,
        'one-minus-constant': 0x8002,
    };
    const OPERATIONS = { add: 0x8006, subtract: 0x800a, 'reverse-subtract': 0x800b, min: 0x8007, max: 0x8008 };
    const STENCIL = {
        keep: 0x1e00,
        zero: 0,
        replace: 0x1e01,
        'increment-clamp': 0x1e02,
        'decrement-clamp': 0x1e03,
        invert: 0x150a,
        'increment-wrap': 0x8507,
        'decrement-wrap': 0x8508,
    };
    const MODES = {
        'point-list': 0,
        'line-list': 1,
        'line-loop': 2,
        'line-strip': 3,
        'triangle-list': 4,
        'triangle-strip': 5,
        'triangle-fan': 6,
    };
    const programs = new Map();
    const program = ({ vertex, fragment }) => {
        const key = `${vertex.module} ${fragment.module}`;
        if (!programs.has(key)) {
            const made = gl.createProgram();
            for (const [type, { module }] of [
                [gl.VERTEX_SHADER, vertex],
                [gl.FRAGMENT_SHADER, fragment],
            ]) {
                const shader = gl.createShader(type);
                gl.shaderSource(shader, text(json.shaders[module].data));
                gl.compileShader(shader);
                gl.attachShader(made, shader);
            }
            gl.linkProgram(made);
            if (!gl.getProgramParameter(made, gl.LINK_STATUS)) errors.push(gl.getProgramInfoLog(made));
            programs.set(key, made);
        }
        return programs.get(key);
    };
    const enable = (name, on) => (on ? gl.enable(gl[name]) : gl.disable(gl[name]));

    const attach = (binding, point, { texture, view }, slice) => {
        const { sampleCount, format } = json.textures[texture];
        if (sampleCount > 1 || format === 'stencil8') {
            gl.framebufferRenderbuffer(binding, point, gl.RENDERBUFFER, textures[texture]);
            return;
        }
        const level = view.baseMipLevel ?? 0;
        const layer = slice ?? view.baseArrayLayer ?? 0;
        const to = target(texture);
        if (to === gl.TEXTURE_2D) gl.framebufferTexture2D(binding, point, to, textures[texture], level);
        else if (to === gl.TEXTURE_CUBE_MAP) {
            gl.framebufferTexture2D(binding, point, gl.TEXTURE_CUBE_MAP_POSITIVE_X + layer, textures[texture], level);
        } else gl.framebufferTextureLayer(binding, point, textures[texture], level, layer);
    };
    const depthPoint = (format) => {
        if (!format.includes('stencil')) return gl.DEPTH_ATTACHMENT;
        return format === 'stencil8' ? gl.STENCIL_ATTACHMENT : gl.DEPTH_STENCIL_ATTACHMENT;
    };

    const renderPass = ({ descriptor, commands }) => {
        const { colorAttachments, depthStencilAttachment: depth } = descriptor;
        const framebuffer = gl.createFramebuffer();
        gl.bindFramebuffer(gl.FRAMEBUFFER, framebuffer);
        colorAttachments.forEach((a, i) => a && attach(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0 + i, a.view, a.depthSlice));
        if (depth) attach(gl.FRAMEBUFFER, depthPoint(json.textures[depth.view.texture].format), depth.view);
        gl.drawBuffers(colorAttachments.map((a, i) => (a ? gl.COLOR_ATTACHMENT0 + i : gl.NONE)));
        if (gl.checkFramebufferStatus(gl.FRAMEBUFFER) !== gl.FRAMEBUFFER_COMPLETE)
            errors.push('incomplete framebuffer');
        gl.disable(gl.SCISSOR_TEST);
        gl.colorMask(true, true, true, true);
        gl.depthMask(true);
        gl.stencilMask(0xff);
        colorAttachments.forEach((a, i) => {
            if (a?.loadOp === 'clear') gl.clearBufferfv(gl.COLOR, i, a.clearValue);
        });
        if (depth?.depthLoadOp === 'clear') gl.clearBufferfv(gl.DEPTH, 0, [depth.depthClearValue]);
        if (depth?.stencilLoadOp === 'clear') gl.clearBufferiv(gl.STENCIL, 0, [depth.stencilClearValue]);
        check('pass');
        const state = { vertex: [], reference: 0 };
        for (const command of commands) passCommand(command, state);
        colorAttachments.forEach((a, i) => {
            if (!a?.resolveTarget) return;
            const resolved = gl.createFramebuffer();
            gl.bindFramebuffer(gl.READ_FRAMEBUFFER, framebuffer);
            gl.readBuffer(gl.COLOR_ATTACHMENT0 + i);
            gl.bindFramebuffer(gl.DRAW_FRAMEBUFFER, resolved);
            attach(gl.DRAW_FRAMEBUFFER, gl.COLOR_ATTACHMENT0, a.resolveTarget);
            const [width, height] = json.textures[a.view.texture].size;
            gl.disable(gl.SCISSOR_TEST);
            gl.blitFramebuffer(0, 0, width, height, 0, 0, width, height, gl.COLOR_BUFFER_BIT, gl.NEAREST);
            check('resolve');
        });
    };

    const passCommand = (command, state) => {
        switch (command.do) {
            case 'setPipeline':
                state.pipeline = json.renderPipelines[command.pipeline];
                return;
            case 'setNamed':
                state.named = json.named[command.named];
                return;
            case 'setVertexBuffer':
                state.vertex[command.slot] = command;
                return;
            case 'setIndexBuffer':
                state.index = command;
                return;
            case 'setViewport':
                gl.viewport(command.x, command.y, command.width, command.height);
                gl.depthRange(command.minDepth, command.maxDepth);
                return;
            case 'setScissorRect':
                gl.enable(gl.SCISSOR_TEST);
                gl.scissor(command.x, command.y, command.width, command.height);
                return;
            case 'setBlendConstant':
                gl.blendColor(...command.color);
                return;
            case 'setStencilReference':
                state.reference = command.reference;
                return;
            case 'clear':
                clear(command);
                return;
            default:
                draw(command, state);
                check(command.do);
        }
    };

    const clear = ({ color, depth, stencil, mask, scissor }) => {
        enable('SCISSOR_TEST', scissor);
        if (scissor) gl.scissor(...scissor);
        gl.colorMask(...[1, 2, 4, 8].map((bit) => Boolean(mask.color & bit)));
        gl.stencilMask(mask.stencil);
        gl.depthMask(true);
        let bits = 0;
        if (color) {
            gl.clearColor(...color);
            bits |= gl.COLOR_BUFFER_BIT;
        }
        if (depth !== undefined) {
            gl.clearDepth(depth);
            bits |= gl.DEPTH_BUFFER_BIT;
        }
        if (stencil !== undefined) {
            gl.clearStencil(stencil);
            bits |= gl.STENCIL_BUFFER_BIT;
        }
        gl.clear(bits);
    };

    const draw = (command, state) => {
        const { pipeline, named } = state;
        const made = program(pipeline);
        gl.useProgram(made);
        fixed(pipeline, state.reference);
        gl.bindVertexArray(gl.createVertexArray());
        pipeline.vertex.buffers.forEach(({ arrayStride, stepMode, divisor, attributes }, slot) => {
            const { buffer, offset } = state.vertex[slot];
            gl.bindBuffer(gl.ARRAY_BUFFER, buffers[buffer]);
            for (const { name, format, column = 0, offset: at } of attributes) {
                const location = gl.getAttribLocation(made, name) + column;
                const [, kind, bits, size = 1] = /^([a-z]+)(8|16|32)(?:x(\d))?$/.exec(format);
                const signed = /^[sf]/.test(kind);
                const type = {
                    8: signed ? gl.BYTE : gl.UNSIGNED_BYTE,
                    16: kind === 'float' ? gl.HALF_FLOAT : signed ? gl.SHORT : gl.UNSIGNED_SHORT,
                    32: kind === 'float' ? gl.FLOAT : signed ? gl.INT : gl.UNSIGNED_INT,
                }[bits];
                gl.enableVertexAttribArray(location);
                if (kind.endsWith('int'))
                    gl.vertexAttribIPointer(location, Number(size), type, arrayStride, offset + at);
                else
                    gl.vertexAttribPointer(
                        location,
                        Number(size),
                        type,
                        kind.endsWith('norm'),
                        arrayStride,
                        offset + at,
                    );
                gl.vertexAttribDivisor(location, divisor ?? (stepMode === 'instance' ? 1 : 0));
            }
        });
        for (const [name, value] of Object.entries(named.constants)) {
            gl.vertexAttrib4f(gl.getAttribLocation(made, name), ...value);
        }
        uniforms(made, named);
        const mode = MODES[pipeline.primitive.topology];
        if (command.do === 'draw') {
            gl.drawArraysInstanced(mode, command.firstVertex, command.vertexCount, command.instanceCount);
            return;
        }
        const { buffer, indexFormat } = state.index;
        gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, buffers[buffer]);
        const [type, size] = {
            uint8: [gl.UNSIGNED_BYTE, 1],
            uint16: [gl.UNSIGNED_SHORT, 2],
            uint32: [gl.UNSIGNED_INT, 4],
        }[indexFormat];
        gl.drawElementsInstanced(mode, command.indexCount, type, command.firstIndex * size, command.instanceCount);
    };

    const fixed = ({ primitive, depthStencil: depth, multisample, fragment }, reference) => {
        enable('CULL_FACE', primitive.cullMode);
        if (primitive.cullMode) gl.cullFace(primitive.cullMode === 'back' ? gl.BACK : gl.FRONT);
        gl.frontFace(primitive.frontFace === 'cw' ? gl.CW : gl.CCW);
        enable('DEPTH_TEST', depth);
        if (depth) {
            gl.depthFunc(gl.NEVER + COMPARE.indexOf(depth.depthCompare));
            gl.depthMask(depth.depthWriteEnabled);
        }
        enable('STENCIL_TEST', depth?.stencilFront);
        if (depth?.stencilFront) {
            gl.stencilMask(depth.stencilWriteMask);
            for (const [side, face] of [
                [gl.FRONT, depth.stencilFront],
                [gl.BACK, depth.stencilBack],
            ]) {
                gl.stencilFuncSeparate(
                    side,
                    gl.NEVER + COMPARE.indexOf(face.compare),
                    reference,
                    depth.stencilReadMask,
                );
                gl.stencilOpSeparate(side, STENCIL[face.failOp], STENCIL[face.depthFailOp], STENCIL[face.passOp]);
            }
        }
        enable('POLYGON_OFFSET_FILL', depth?.depthBias !== undefined);
        if (depth?.depthBias !== undefined)
            gl.polygonOffset(depth.depthBiasSlopeScale, depth.depthBiasUnits ?? depth.depthBias);
        enable('SAMPLE_ALPHA_TO_COVERAGE', multisample?.alphaToCoverageEnabled);
        const { blend, writeMask = 15 } = fragment.targets.find(Boolean) ?? {};
        gl.colorMask(...[1, 2, 4, 8].map((bit) => Boolean(writeMask & bit)));
        enable('BLEND', blend);
        if (!blend) return;
        const { color, alpha } = blend;
        gl.blendEquationSeparate(OPERATIONS[color.operation], OPERATIONS[alpha.operation]);
        gl.blendFuncSeparate(
            FACTORS[color.srcFactor],
            FACTORS[color.dstFactor],
            FACTORS[alpha.srcFactor],
            FACTORS[alpha.dstFactor],
        );
    };

    const SETTERS = {
        0x1406: '1f',
        0x8b50: '2f',
        0x8b51: '3f',
        0x8b52: '4f',
        0x1404: '1i',
        0x8b53: '2i',
        0x8b54: '3i',
        0x8b55: '4i',
        0x8b56: '1i',
        0x8b57: '2i',
        0x8b58: '3i',
        0x8b59: '4i',
        0x1405: '1ui',
        0x8dc6: '2ui',
        0x8dc7: '3ui',
        0x8dc8: '4ui',
        0x8b5a: 'Matrix2f',
        0x8b5b: 'Matrix3f',
        0x8b5c: 'Matrix4f',
        0x8b65: 'Matrix2x3f',
        0x8b66: 'Matrix2x4f',
        0x8b67: 'Matrix3x2f',
        0x8b68: 'Matrix3x4f',
        0x8b69: 'Matrix4x2f',
        0x8b6a: 'Matrix4x3f',
    };
    const uniforms = (made, named) => {
        const count = gl.getProgramParameter(made, gl.ACTIVE_UNIFORMS);
        let unit = 0;
        for (let i = 0; i < count; i++) {
            const { name, type } = gl.getActiveUniform(made, i);
            const location = gl.getUniformLocation(made, name);
            if (!location) continue;
            const setter = SETTERS[type];
            if (setter) {
                const values = named.uniforms[name];
                if (!values) errors.push(`no value of ${name}`);
                else if (setter[0] === 'M') gl[`uniform${setter}v`](location, false, values);
                else gl[`uniform${setter}v`](location, values);
                continue;
            }
            const units = [];
            for (const { texture, view, sampler } of [named.textures[name]].flat()) {
                gl.activeTexture(gl.TEXTURE0 + unit);
                gl.bindTexture(target(texture), textures[texture]);
                const base = view.baseMipLevel ?? 0;
                gl.texParameteri(target(texture), gl.TEXTURE_BASE_LEVEL, base);
                const last = view.mipLevelCount ? base + view.mipLevelCount - 1 : 1000;
                gl.texParameteri(target(texture), gl.TEXTURE_MAX_LEVEL, last);
                gl.bindSampler(unit, samplers[sampler]);
                units.push(unit++);
            }
            gl.uniform1iv(location, units);
        }
        const blocks = gl.getProgramParameter(made, gl.ACTIVE_UNIFORM_BLOCKS);
        for (let i = 0; i < blocks; i++) {
            const { buffer, offset, size } = named.blocks[gl.getActiveUniformBlockName(made, i)];
            gl.uniformBlockBinding(made, i, i);
            gl.bindBufferRange(gl.UNIFORM_BUFFER, i, buffers[buffer], offset, size);
        }
    };

    const copy = ({ source, destination, size }) => {
        const [from, to] = [gl.createFramebuffer(), gl.createFramebuffer()];
        const depth = json.textures[source.texture].format.startsWith('depth');
        const point = depth ? depthPoint(json.textures[source.texture].format) : gl.COLOR_ATTACHMENT0;
        const view = (place) => ({
            texture: place.texture,
            view: { baseMipLevel: place.mipLevel, baseArrayLayer: place.origin[2] },
        });
        gl.bindFramebuffer(gl.READ_FRAMEBUFFER, from);
        attach(gl.READ_FRAMEBUFFER, point, view(source));
        gl.bindFramebuffer(gl.DRAW_FRAMEBUFFER, to);
        attach(gl.DRAW_FRAMEBUFFER, point, view(destination));
        const [x, y] = source.origin;
        const [X, Y] = destination.origin;
        const [width, height] = size;
        gl.disable(gl.SCISSOR_TEST);
        const bits = depth ? gl.DEPTH_BUFFER_BIT : gl.COLOR_BUFFER_BIT;
        gl.blitFramebuffer(x, y, x + width, y + height, X, Y, X + width, Y + height, bits, gl.NEAREST);
        check('copy');
    };

    const results = [];
    for (const { commands, picture, canvas: shownTexture } of json.frames) {
        for (const command of commands) {
            if (command.do === 'renderPass') renderPass(command);
            else if (command.do === 'writeBuffer') writeBuffer(command.buffer, command.offset, bytes(command.data));
            else if (command.do === 'writeTexture') {
                upload(command.destination.texture, command.destination.mipLevel, bytes(command.data));
            } else if (['copyTextureToTexture', 'copyDepth'].includes(command.do)) copy(command);
            else errors.push(`command ${command.do}`);
        }
        const [width, height] = picture.size;
        const framebuffer = gl.createFramebuffer();
        gl.bindFramebuffer(gl.FRAMEBUFFER, framebuffer);
        attach(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, { texture: shownTexture, view: {} });
        const drawn = new Uint8Array(width * height * 4);
        gl.readPixels(0, 0, width, height, gl.RGBA, gl.UNSIGNED_BYTE, drawn);
        const shown = bytes(picture.data);
        let different = 0;
        let largest = 0;
        for (let y = 0; y < height; y++) {
            for (let x = 0; x < width * 4; x += 4) {
                const [a, b] = [(height - 1 - y) * width * 4 + x, y * width * 4 + x];
                const steps = [0, 1, 2, 3].map((c) => Math.abs(drawn[a + c] - shown[b + c]));
                if (steps.some(Boolean)) different += 1;
                largest = Math.max(largest, ...steps);
            }
        }
        results.push(different);
        if (largest) errors.push(`pixels differ by up to ${largest}`);
    }
    return { different: results, errors: [...new Set(errors)] };
};
