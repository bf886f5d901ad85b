// Replays the frames of a WebGPU capture in a page, and returns the pixels that differ from the page's own.

globalThis.replay = async (json, files) => {
    const adapter = await navigator.gpu.requestAdapter();
    const device = await adapter.requestDevice({ requiredFeatures: [...adapter.features] });
    const errors = [];
    device.onuncapturederror = ({ error }) => errors.push(error.message);
    const bytes = (name) => Uint8Array.from(atob(files[name]), (c) => c.charCodeAt(0));
    const text = (name) => new TextDecoder().decode(bytes(name));
    const { COPY_DST, COPY_SRC } = GPUBufferUsage;

    const buffers = json.buffers.map(({ size, usage }) => {
        const mappable = usage & (GPUBufferUsage.MAP_READ | GPUBufferUsage.MAP_WRITE);
        return device.createBuffer({ size, usage: mappable ? usage : usage | COPY_DST | COPY_SRC });
    });
    const textures = json.textures.map((texture) => {
        const copies = texture.sampleCount > 1 ? 0 : GPUTextureUsage.COPY_DST | GPUTextureUsage.COPY_SRC;
        return device.createTexture({ ...texture, usage: texture.usage | copies });
    });
    const samplers = json.samplers.map((sampler) => device.createSampler(sampler));
    const shaders = json.shaders.map(({ data }) => device.createShaderModule({ code: text(data) }));
    const groupLayouts = json.bindGroupLayouts.map((layout) => device.createBindGroupLayout(layout));
    const layouts = json.pipelineLayouts.map(({ bindGroupLayouts }) =>
        device.createPipelineLayout({
            bindGroupLayouts: bindGroupLayouts.map((layout) => (layout === null ? null : groupLayouts[layout])),
        }),
    );
    const layoutOf = (layout) => (layout === 'auto' ? layout : layouts[layout]);
    const stage = (stage) => stage && { ...stage, module: shaders[stage.module] };
    const renderPipelines = json.renderPipelines.map((pipeline) =>
        device.createRenderPipeline({
            ...pipeline,
            layout: layoutOf(pipeline.layout),
            vertex: stage(pipeline.vertex),
            fragment: stage(pipeline.fragment),
        }),
    );
    const computePipelines = json.computePipelines.map(({ layout, compute }) =>
        device.createComputePipeline({ layout: layoutOf(layout), compute: stage(compute) }),
    );
    const groupLayout = (layout) => {
        if (typeof layout === 'number') return groupLayouts[layout];
        const pipeline =
            'pipeline' in layout ? renderPipelines[layout.pipeline] : computePipelines[layout.computePipeline];
        return pipeline.getBindGroupLayout(layout.group);
    };
    const viewOf = (place) => place && textures[place.texture].createView(place.view);
    const resource = (entry) => {
        if ('buffer' in entry) return { ...entry, buffer: buffers[entry.buffer] };
        return 'sampler' in entry ? samplers[entry.sampler] : viewOf(entry);
    };
    const bindGroups = json.bindGroups.map(({ layout, entries }) =>
        device.createBindGroup({
            layout: groupLayout(layout),
            entries: entries.map((entry) => ({ binding: entry.binding, resource: resource(entry) })),
        }),
    );
    for (const { buffer, data } of json.start.buffers) device.queue.writeBuffer(buffers[buffer], 0, bytes(data));
    for (const { texture, mipLevel, aspect, data } of json.start.textures) {
        const { size, dimension, format } = json.textures[texture];
        const [width, height] = [size[0] >> mipLevel || 1, size[1] >> mipLevel || 1];
        const depth = dimension === '3d' ? size[2] >> mipLevel || 1 : size[2];
        const content = bytes(data);
        if (/^(bc|astc|etc|eac)|depth32/.test(format)) continue;
        const bytesPerRow = content.length / height / depth;
        const layout = { bytesPerRow, rowsPerImage: height };
        device.queue.writeTexture({ texture: textures[texture], mipLevel, aspect }, content, layout, [
            width,
            height,
            depth,
        ]);
    }

    const draws = {
        setPipeline: (pass, c, compute) => pass.setPipeline((compute ? computePipelines : renderPipelines)[c.pipeline]),
        setBindGroup: (pass, c) => pass.setBindGroup(c.index, bindGroups[c.bindGroup] ?? null, c.dynamicOffsets),
        setVertexBuffer: (pass, c) => pass.setVertexBuffer(c.slot, buffers[c.buffer], c.offset, c.size),
        setIndexBuffer: (pass, c) => pass.setIndexBuffer(buffers[c.buffer], c.indexFormat, c.offset, c.size),
        draw: (pass, c) => pass.draw(c.vertexCount, c.instanceCount, c.firstVertex, c.firstInstance),
        drawIndexed: (pass, c) =>
            pass.drawIndexed(c.indexCount, c.instanceCount, c.firstIndex, c.baseVertex, c.firstInstance),
        drawIndirect: (pass, c) => pass.drawIndirect(buffers[c.buffer], c.offset),
        drawIndexedIndirect: (pass, c) => pass.drawIndexedIndirect(buffers[c.buffer], c.offset),
        setViewport: (pass, c) => pass.setViewport(c.x, c.y, c.width, c.height, c.minDepth, c.maxDepth),
        setScissorRect: (pass, c) => pass.setScissorRect(c.x, c.y, c.width, c.height),
        setBlendConstant: (pass, c) => pass.setBlendConstant(c.color),
        setStencilReference: (pass, c) => pass.setStencilReference(c.reference),
        dispatchWorkgroups: (pass, c) => pass.dispatchWorkgroups(c.x, c.y, c.z),
        dispatchWorkgroupsIndirect: (pass, c) => pass.dispatchWorkgroupsIndirect(buffers[c.buffer], c.offset),
    };
    const side = (place) =>
        'texture' in place
            ? { ...place, texture: textures[place.texture] }
            : { ...place, buffer: buffers[place.buffer] };
    const commands = {
        writeBuffer: (_, c) => device.queue.writeBuffer(buffers[c.buffer], c.offset, bytes(c.data)),
        writeTexture: (_, c) => device.queue.writeTexture(side(c.destination), bytes(c.data), c.layout, c.size),
        copyBufferToBuffer: (e, c) =>
            e.copyBufferToBuffer(
                buffers[c.source],
                c.sourceOffset,
                buffers[c.destination],
                c.destinationOffset,
                c.size,
            ),
        copyBufferToTexture: (e, c) => e.copyBufferToTexture(side(c.source), side(c.destination), c.size),
        copyTextureToBuffer: (e, c) => e.copyTextureToBuffer(side(c.source), side(c.destination), c.size),
        copyTextureToTexture: (e, c) => e.copyTextureToTexture(side(c.source), side(c.destination), c.size),
        clearBuffer: (e, c) => e.clearBuffer(buffers[c.buffer], c.offset, c.size),
        renderPass: (e, { descriptor, commands }) => {
            const { colorAttachments, depthStencilAttachment: depth } = descriptor;
            const pass = e.beginRenderPass({
                colorAttachments: colorAttachments.map(
                    (a) => a && { ...a, view: viewOf(a.view), resolveTarget: viewOf(a.resolveTarget) },
                ),
                depthStencilAttachment: depth && { ...depth, view: viewOf(depth.view) },
            });
            for (const command of commands) draws[command.do](pass, command, false);
            pass.end();
        },
        computePass: (e, { commands }) => {
            const pass = e.beginComputePass();
            for (const command of commands) draws[command.do](pass, command, true);
            pass.end();
        },
    };

    const results = [];
    for (const { commands: list, picture, canvas } of json.frames) {
        for (const command of list) {
            const encoder = device.createCommandEncoder();
            commands[command.do](encoder, command);
            device.queue.submit([encoder.finish()]);
        }
        const [width, height] = picture.size;
        const bytesPerRow = Math.ceil((width * 4) / 256) * 256;
        const target = device.createBuffer({ size: bytesPerRow * height, usage: COPY_DST | GPUBufferUsage.MAP_READ });
        const encoder = device.createCommandEncoder();
        encoder.copyTextureToBuffer({ texture: textures[canvas] }, { buffer: target, bytesPerRow }, [width, height]);
        device.queue.submit([encoder.finish()]);
        await target.mapAsync(GPUMapMode.READ);
        const drawn = new Uint8Array(target.getMappedRange());
        const shown = bytes(picture.data);
        let different = 0;
        for (let y = 0; y < height; y++) {
            for (let x = 0; x < width * 4; x += 4) {
                const [a, b] = [y * bytesPerRow + x, y * width * 4 + x];
                if ([0, 1, 2, 3].some((c) => drawn[a + c] !== shown[b + c])) different += 1;
            }
        }
        results.push(different);
    }
    return { different: results, errors };
};
