// Creates the pipelines of plans with Dawn, from plan.json alone: explicit bind group layouts, attributes, targets and state.
//
// Paths of plan.json files come on stdin, one a line. The last line of stdout is one JSON array: [{"path": .., "pipelines": N, "errors": [..]}].
// A pass that needs what Dawn's null adapter lacks has no pipeline; `lacking` names it.
import { readFileSync } from 'node:fs';
import { dirname, join } from 'node:path';
import { create, globals } from 'webgpu';

Object.assign(globalThis, globals);

const gpu = create(['backend=null', 'enable-dawn-features=allow_unsafe_apis']);
const adapter = await gpu.requestAdapter();
if (!adapter) throw new Error('Dawn has no null adapter');
const requiredLimits = {};
for (const name in adapter.limits) {
    if (typeof adapter.limits[name] === 'number') requiredLimits[name] = adapter.limits[name];
}
const device = await adapter.requestDevice({ requiredFeatures: [...adapter.features], requiredLimits });
device.addEventListener('uncapturederror', (event) => event.preventDefault());

/** Keys as WebGPU spells them. */
const camel = (value) => {
    if (Array.isArray(value)) return value.map(camel);
    if (value === null || typeof value !== 'object') return value;
    return Object.fromEntries(
        Object.entries(value).map(([key, inner]) => [key.replace(/_./g, (m) => m[1].toUpperCase()), camel(inner)]),
    );
};

const STAGES = { vertex: GPUShaderStage.VERTEX, fragment: GPUShaderStage.FRAGMENT, compute: GPUShaderStage.COMPUTE };

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
    const bindGroupLayouts = Array.from(groups, (entries) => device.createBindGroupLayout({ entries: entries ?? [] }));
    return device.createPipelineLayout({ bindGroupLayouts });
}

const modules = new Map();
function stage(folder, files) {
    const { file, entry_point: entryPoint } = files.wgsl;
    const path = join(folder, file);
    if (!modules.has(path)) modules.set(path, device.createShaderModule({ code: readFileSync(path, 'utf8') }));
    return { module: modules.get(path), entryPoint };
}

/** A format of the attribute's type: four bytes a component. */
function format(type) {
    const [, count, scalar] = /^(?:vec([234])<)?([a-z0-9]+)>?$/.exec(type);
    const kind = { f32: 'float32', f16: 'float16', u32: 'uint32', i32: 'sint32' }[scalar];
    return count ? `${kind}x${count}` : kind;
}

function render(plan, pass, files, folder) {
    const { primitive, depth, stencil, multisample } = pass;
    const attachment = (name) => plan.attachments.find((a) => a.name === name);
    const descriptor = {
        layout: layout(pass.bindings),
        vertex: {
            ...stage(folder, files.vertex),
            buffers: [
                {
                    arrayStride: 16 * pass.attributes.length,
                    attributes: pass.attributes.map(({ location, type }, i) => ({
                        shaderLocation: location,
                        offset: 16 * i,
                        format: format(type),
                    })),
                },
            ],
        },
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
                        ...(t.blend && { blend: { color: component(t.blend.color), alpha: component(t.blend.alpha) } }),
                    },
            ),
        };
    }
    return device.createRenderPipeline(descriptor);
}

const compute = (pass, files, folder) =>
    device.createComputePipeline({ layout: layout(pass.bindings), compute: stage(folder, files) });

/** What the adapter lacks of what a pass needs. */
function lacks({ features = [], limits = {} }) {
    const missing = features.filter((name) => !device.features.has(name));
    const more = Object.entries(limits).filter(([name, least]) => device.limits[name] < least);
    return [...missing, ...more.map(([name]) => name)];
}

async function judged(path) {
    const folder = dirname(path);
    const plan = JSON.parse(readFileSync(path, 'utf8'));
    const result = { path, pipelines: 0, lacking: [], errors: [] };
    const passes = plan.passes.map((pass, i) => [pass, () => render(plan, pass, plan.files[i], folder)]);
    for (const [i, pass] of (plan.compute ?? []).entries())
        passes.push([pass, () => compute(pass, plan.compute_files[i], folder)]);
    const original = plan.original;
    if (original)
        for (const [i, pass] of original.passes.entries())
            passes.push([pass, () => render({ ...plan, ...original }, pass, original.files[i], folder)]);
    for (const [pass, make] of passes) {
        const missing = lacks(pass);
        if (missing.length > 0) {
            result.lacking.push(...missing);
            continue;
        }
        device.pushErrorScope('validation');
        let thrown;
        try {
            make();
        } catch (error) {
            thrown = `${error}`;
        }
        const error = await device.popErrorScope();
        const what = `pass ${pass.program}`;
        if (thrown) result.errors.push(`${what}: ${thrown}`);
        else if (error) result.errors.push(`${what}: ${error.message}`);
        else result.pipelines += 1;
    }
    return result;
}

const paths = readFileSync(0, 'utf8').split('\n').filter((path) => path !== '');
const results = [];
for (const path of paths) results.push(await judged(path));
// Dawn's threads keep node alive; leave once the pipe has taken everything.
process.stdout.write(`\n${JSON.stringify(results)}`, () => process.exit(0));
