// Pipelines of plans, from plan.json and the texts that it names.
import { readFileSync } from 'node:fs';
import { join } from 'node:path';

/** Keys as WebGPU spells them. */
const camel = (value) => {
    if (Array.isArray(value)) return value.map(camel);
    if (value === null || typeof value !== 'object') return value;
    return Object.fromEntries(
        Object.entries(value).map(([key, inner]) => [key.replace(/_./g, (m) => m[1].toUpperCase()), camel(inner)]),
    );
};

/** A format of the attribute's type: four bytes a component. */
function format(type) {
    const [, count, scalar] = /^(?:vec([234])<)?([a-z0-9]+)>?$/.exec(type);
    const kind = { f32: 'float32', f16: 'float16', u32: 'uint32', i32: 'sint32' }[scalar];
    return count ? `${kind}x${count}` : kind;
}

/** All attributes in one buffer, 16 bytes each. */
const interleaved = (attributes) => [
    {
        arrayStride: 16 * attributes.length,
        attributes: attributes.map(({ location, type }, i) => ({
            shaderLocation: location,
            offset: 16 * i,
            format: format(type),
        })),
    },
];

/** Makes pipelines on a device; it compiles each text once. */
export function pipelines(device) {
    const STAGES = {
        vertex: GPUShaderStage.VERTEX,
        fragment: GPUShaderStage.FRAGMENT,
        compute: GPUShaderStage.COMPUTE,
    };

    function layout(bindings) {
        const groups = [];
        for (const { group, binding, visibility, layout, name } of bindings) {
            if (!layout) throw new Error(`\`${name}\` has no layout`);
            const stages = Object.entries(STAGES).filter(([stage]) => visibility[stage]);
            const [[kind, rest]] = Object.entries(camel(layout));
            const entry = { binding, visibility: stages.reduce((all, [, bit]) => all | bit, 0) };
            entry[kind === 'storage-texture' ? 'storageTexture' : kind] = rest;
            (groups[group] ??= []).push(entry);
        }
        const bindGroupLayouts = Array.from(groups, (entries) =>
            device.createBindGroupLayout({ entries: entries ?? [] }),
        );
        return device.createPipelineLayout({ bindGroupLayouts });
    }

    const modules = new Map();
    function stage(folder, files) {
        const { file, entry_point: entryPoint } = files.wgsl;
        const path = join(folder, file);
        if (!modules.has(path)) modules.set(path, device.createShaderModule({ code: readFileSync(path, 'utf8') }));
        return { module: modules.get(path), entryPoint };
    }

    function render(plan, pass, files, folder, buffers = interleaved(pass.attributes)) {
        const { primitive, depth, stencil, multisample } = pass;
        const attachment = (name) => plan.attachments.find((a) => a.name === name);
        const descriptor = {
            layout: layout(pass.bindings),
            vertex: { ...stage(folder, files.vertex), buffers },
            primitive: {
                topology: primitive.topology,
                cullMode: primitive.cull,
                frontFace: primitive.front_face,
                unclippedDepth: primitive.unclipped_depth,
            },
            multisample: {
                count: multisample.count,
                mask: multisample.mask,
                alphaToCoverageEnabled: multisample.alpha_to_coverage,
            },
        };
        if (primitive.topology.endsWith('strip')) descriptor.primitive.stripIndexFormat = 'uint32';
        if (depth) {
            const { format } = attachment(depth.attachment);
            const face = (f) => f && { compare: f.compare, failOp: f.fail, depthFailOp: f.depth_fail, passOp: f.pass };
            descriptor.depthStencil = {
                format,
                depthCompare: depth.compare,
                depthWriteEnabled: depth.write,
                depthBias: depth.bias.constant,
                depthBiasSlopeScale: depth.bias.slope_scale,
                depthBiasClamp: depth.bias.clamp,
                ...(stencil && {
                    stencilFront: face(stencil.front),
                    stencilBack: face(stencil.back),
                    stencilReadMask: stencil.read_mask,
                    stencilWriteMask: stencil.write_mask,
                }),
            };
        }
        if (files.fragment) {
            const component = ({ src, dst, operation }) => ({ srcFactor: src, dstFactor: dst, operation });
            descriptor.fragment = {
                ...stage(folder, files.fragment),
                targets: pass.targets.map(
                    (t) =>
                        t && {
                            format: t.format,
                            writeMask: t.write_mask,
                            ...(t.blend && {
                                blend: { color: component(t.blend.color), alpha: component(t.blend.alpha) },
                            }),
                        },
                ),
            };
        }
        return device.createRenderPipeline(descriptor);
    }

    const compute = (pass, files, folder) =>
        device.createComputePipeline({ layout: layout(pass.bindings), compute: stage(folder, files) });

    /** The features and limits that a pass needs and the adapter lacks. */
    function lacks({ features = [], limits = {} }) {
        const missing = features.filter((name) => !device.features.has(name));
        const more = Object.entries(limits).filter(([name, least]) => device.limits[name] < least);
        return [...missing, ...more.map(([name]) => name)];
    }

    return { render, compute, lacks };
}

/** Dawn's instances so far: one that is collected takes its devices with it. */
const instances = [];

/** A device of one of Dawn's back ends, with all that its adapter has. */
export async function dawn(create, backend) {
    const gpu = create([`backend=${backend}`, 'enable-dawn-features=allow_unsafe_apis']);
    instances.push(gpu);
    const adapter = await gpu.requestAdapter();
    if (!adapter) throw new Error(`Dawn has no adapter for ${backend}`);
    const requiredLimits = {};
    for (const name in adapter.limits) {
        if (typeof adapter.limits[name] === 'number') requiredLimits[name] = adapter.limits[name];
    }
    const device = await adapter.requestDevice({ requiredFeatures: [...adapter.features], requiredLimits });
    device.addEventListener('uncapturederror', (event) => event.preventDefault());
    return { device, name: adapter.info.description || adapter.info.device };
}
