// Everything that a capture of WebGPU must hold, small: a texture with mip levels from an image, bind groups with
// explicit and derived layouts, dynamic offsets, a bundle, instancing, indices, indirect draws, compute, depth and
// multisampling, writes of each kind within the frame.

const SHADER = /* wgsl */ `
struct Frame { turn: vec4f, tint: vec4f }
@group(0) @binding(0) var<uniform> frame: Frame;
@group(1) @binding(0) var image: texture_2d<f32>;
@group(1) @binding(1) var smp: sampler;
struct Out { @builtin(position) position: vec4f, @location(0) uv: vec2f }
@vertex fn vs(@location(0) at: vec2f, @location(1) offset: vec3f) -> Out {
    let c = frame.turn.x;
    let s = frame.turn.y;
    let p = vec2f(at.x * c - at.y * s, at.x * s + at.y * c) * frame.turn.z + offset.xy;
    return Out(vec4f(p, offset.z, 1), at * 2);
}
@fragment fn fs(in: Out) -> @location(0) vec4f {
    return textureSample(image, smp, in.uv) * frame.tint;
}
@fragment fn flat(in: Out) -> @location(0) vec4f { return frame.tint; }
`;

const COMPUTE = /* wgsl */ `
@group(0) @binding(0) var<storage, read_write> offsets: array<f32>;
@group(0) @binding(1) var<uniform> time: vec4f;
@compute @workgroup_size(4) fn main(@builtin(global_invocation_id) id: vec3u) {
    offsets[id.x * 3] = f32(id.x) * 0.45 - 0.7 + 0.05 * sin(time.x);
    offsets[id.x * 3 + 1] = 0.1 * f32(id.x);
    offsets[id.x * 3 + 2] = 0.2 * f32(id.x);
}
`;

const { VERTEX, FRAGMENT } = GPUShaderStage;

async function main() {
    const canvas = document.getElementById('canvas');
    const adapter = await navigator.gpu.requestAdapter();
    const device = await adapter.requestDevice();
    device.onuncapturederror = ({ error }) => console.error(error.message);
    const context = canvas.getContext('webgpu');
    const format = navigator.gpu.getPreferredCanvasFormat();
    context.configure({ device, format });

    const buffer = (usage, data) => {
        const made = device.createBuffer({ size: data.byteLength, usage, mappedAtCreation: true });
        new data.constructor(made.getMappedRange()).set(data);
        made.unmap();
        return made;
    };
    const vertices = buffer(GPUBufferUsage.VERTEX, new Float32Array([-0.4, -0.4, 0.4, -0.4, 0.4, 0.4, -0.4, 0.4]));
    const indices = buffer(GPUBufferUsage.INDEX, new Uint16Array([0, 1, 2, 0, 2, 3]));
    const offsets = device.createBuffer({ size: 48, usage: GPUBufferUsage.VERTEX | GPUBufferUsage.STORAGE });
    const indirect = buffer(GPUBufferUsage.INDIRECT, new Uint32Array([6, 2, 0, 0, 0]));
    const uniforms = device.createBuffer({ size: 1024, usage: GPUBufferUsage.UNIFORM | GPUBufferUsage.COPY_DST });
    const clock = device.createBuffer({ size: 16, usage: GPUBufferUsage.UNIFORM | GPUBufferUsage.COPY_DST });

    const { COPY_DST, RENDER_ATTACHMENT, TEXTURE_BINDING } = GPUTextureUsage;
    const usage = COPY_DST | RENDER_ATTACHMENT | TEXTURE_BINDING;
    const image = device.createTexture({ size: [64, 64], mipLevelCount: 2, format: 'rgba8unorm', usage });
    const drawing = new OffscreenCanvas(64, 64);
    const paint = drawing.getContext('2d');
    const picture = (step) => {
        paint.fillStyle = '#fc8';
        paint.fillRect(0, 0, 64, 64);
        paint.fillStyle = '#26a';
        paint.fillRect(8 + (step % 8), 8, 24, 40);
        device.queue.copyExternalImageToTexture({ source: drawing }, { texture: image }, [64, 64]);
    };
    picture(0);
    const small = new Uint8Array(32 * 32 * 4).fill(200);
    device.queue.writeTexture({ texture: image, mipLevel: 1 }, small, { bytesPerRow: 128 }, [32, 32]);

    const module = device.createShaderModule({ code: SHADER });
    const layout = device.createBindGroupLayout({
        entries: [
            { binding: 0, visibility: VERTEX | FRAGMENT, buffer: { hasDynamicOffset: true, minBindingSize: 32 } },
        ],
    });
    const textures = device.createBindGroupLayout({
        entries: [
            { binding: 0, visibility: FRAGMENT, texture: {} },
            { binding: 1, visibility: FRAGMENT, sampler: {} },
        ],
    });
    const describe = (entryPoint, bindGroupLayouts) => ({
        layout: device.createPipelineLayout({ bindGroupLayouts }),
        vertex: {
            module,
            buffers: [
                { arrayStride: 8, attributes: [{ shaderLocation: 0, offset: 0, format: 'float32x2' }] },
                {
                    arrayStride: 12,
                    stepMode: 'instance',
                    attributes: [{ shaderLocation: 1, offset: 0, format: 'float32x3' }],
                },
            ],
        },
        fragment: { module, entryPoint, targets: [{ format }] },
        depthStencil: { format: 'depth24plus', depthWriteEnabled: true, depthCompare: 'less' },
        multisample: { count: 4 },
    });
    const textured = await device.createRenderPipelineAsync(describe('fs', [layout, textures]));
    const flat = device.createRenderPipeline(describe('flat', [layout]));
    const compute = device.createComputePipeline({
        layout: 'auto',
        compute: { module: device.createShaderModule({ code: COMPUTE }) },
    });
    const group = device.createBindGroup({
        layout,
        entries: [{ binding: 0, resource: { buffer: uniforms, size: 32 } }],
    });
    const sampler = device.createSampler({ magFilter: 'linear', minFilter: 'linear', addressModeU: 'repeat' });
    const textureGroup = device.createBindGroup({
        layout: textures,
        entries: [
            { binding: 0, resource: image.createView() },
            { binding: 1, resource: sampler },
        ],
    });
    const computeGroup = device.createBindGroup({
        layout: compute.getBindGroupLayout(0),
        entries: [
            { binding: 0, resource: { buffer: offsets } },
            { binding: 1, resource: { buffer: clock } },
        ],
    });

    const bundler = device.createRenderBundleEncoder({
        colorFormats: [format],
        depthStencilFormat: 'depth24plus',
        sampleCount: 4,
    });
    bundler.setPipeline(flat);
    bundler.setBindGroup(0, group, new Uint32Array([0, 256]), 1, 1);
    bundler.setVertexBuffer(0, vertices);
    bundler.setVertexBuffer(1, offsets);
    bundler.setIndexBuffer(indices, 'uint16');
    bundler.drawIndexedIndirect(indirect, 0);
    const bundle = bundler.finish();

    const target = (format) =>
        device.createTexture({ size: [320, 240], sampleCount: 4, format, usage: RENDER_ATTACHMENT });
    const colors = target(format);
    const depths = target('depth24plus');

    const uniform = new Float32Array(128);
    let step = 0;
    const frame = () => {
        step += 1;
        const angle = step * 0.05;
        uniform.set([Math.cos(angle), Math.sin(angle), 0.8, 0, 1, 1, 1, 1], 0);
        uniform.set([1, 0, 0.5, 0, 0.2, 0.8, 0.4, 1], 64);
        device.queue.writeBuffer(uniforms, 0, uniform, 0, 72);
        device.queue.writeBuffer(clock, 0, new Float32Array([angle, 0, 0, 0]).buffer);
        if (step % 2) picture(step);
        const encoder = device.createCommandEncoder();
        const dispatch = encoder.beginComputePass();
        dispatch.setPipeline(compute);
        dispatch.setBindGroup(0, computeGroup);
        dispatch.dispatchWorkgroups(1);
        dispatch.end();
        const pass = encoder.beginRenderPass({
            colorAttachments: [
                {
                    view: colors.createView(),
                    resolveTarget: context.getCurrentTexture().createView(),
                    loadOp: 'clear',
                    clearValue: { r: 0.1, g: 0.1, b: 0.2, a: 1 },
                    storeOp: 'discard',
                },
            ],
            depthStencilAttachment: {
                view: depths.createView(),
                depthClearValue: 1,
                depthLoadOp: 'clear',
                depthStoreOp: 'discard',
            },
        });
        pass.executeBundles([bundle]);
        pass.setPipeline(textured);
        pass.setBindGroup(0, group, [0]);
        pass.setBindGroup(1, textureGroup);
        pass.setVertexBuffer(0, vertices);
        pass.setVertexBuffer(1, offsets);
        pass.setIndexBuffer(indices, 'uint16');
        pass.setViewport(0, 0, 320, 240, 0, 1);
        pass.setScissorRect(20, 20, 280, 200);
        pass.drawIndexed(6, 4);
        pass.end();
        device.queue.submit([encoder.finish()]);
        requestAnimationFrame(frame);
        globalThis.ready = true;
    };
    frame();
}

main();
