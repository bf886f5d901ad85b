// What of a plan this page can draw. What it cannot is told, and nothing is drawn in its place.

/** Phases that reach the picture of the camera's view. */
const SEEN = ['depth', 'classify', 'resolve', 'opaque', 'blended'];

const KINDS = {
    'storage-read': 'a storage buffer',
    'storage-read-write': 'a storage buffer that the shader writes',
    'storage-texture': 'a storage texture',
    'acceleration-structure': 'an acceleration structure',
};
const TARGETS = ['rgba8unorm', 'rgba8unorm-srgb'];
const ATTRIBUTE = /^(f32|i32|u32|vec[234]<(f32|i32|u32)>)$/;

export const key = ({ group, binding }) => `${group}.${binding}`;

/** A plan's passes that reach the picture, with their files; and why it cannot be drawn, a sentence each. */
export function drawing(plan, files, language) {
    const why = new Set();
    const notes = [];
    const text = (name) => files.find((file) => file.name === name)?.text;
    if (plan.compute?.length) why.add('it dispatches compute work, which this page does not.');
    if (plan.vertex_buffers?.length) why.add('it needs buffers of computed vertices, which this page does not make.');
    if (plan.draw_buffers?.length) why.add('it needs buffers of computed values, which this page does not make.');
    if (plan.frame_buffers?.length) why.add('it needs buffers shared by the frame, which this page does not make.');
    if (plan.attachments?.some(({ divisor }) => divisor > 1))
        why.add('it draws to textures smaller than the picture, which this page does not make.');
    const passes = [];
    for (const [i, pass] of plan.passes.entries()) {
        if (!SEEN.includes(pass.phase)) {
            notes.push(`The pass \`${pass.role}\` is not drawn: it belongs to another picture than the camera's.`);
            continue;
        }
        const { value: reason } = reasons(pass).next();
        if (reason) {
            why.add(reason);
            continue;
        }
        const found = plan.files[i];
        const stages = Object.fromEntries(
            ['vertex', 'fragment'].map((stage) => {
                const of = found[stage]?.[language];
                return [stage, of && { ...of, text: text(of.file) }];
            }),
        );
        if (!stages.vertex?.text)
            why.add(`preshade wrote no ${language === 'wgsl' ? 'WGSL' : 'GLSL ES'} for the pass \`${pass.role}\`.`);
        passes.push({ pass, ...stages });
    }
    if (!passes.length && !why.size) why.add('no pass of it draws the camera\u2019s picture.');
    const guard = plan.guard?.values ?? [];
    return { passes, attachments: plan.attachments, guard, why: [...why], notes };
}

/** The first reason for which a pass cannot be drawn. One is enough, and the rest often follows from it. */
function* reasons({ role, geometry, multisample, stencil, primitive, depth, bindings, targets, attributes, features }) {
    const of = `the pass \`${role}\``;
    if (geometry) yield `${of} draws other geometry than the mesh.`;
    if (multisample.count > 1) yield `${of} has ${multisample.count} samples a pixel; this page draws one.`;
    if (stencil) yield `${of} uses stencil.`;
    if (primitive.topology !== 'triangle-list')
        yield `${of} draws a ${primitive.topology}; the page's mesh is a list of triangles.`;
    if (depth?.read_only) yield `${of} samples the depth buffer that it tests against.`;
    const stored = bindings.find(({ kind }) => kind in KINDS);
    if (stored) yield `it reads ${KINDS[stored.kind]} (\`${stored.name}\`), whose content this page cannot make up.`;
    const foreign = bindings.find(({ source }) => !['author', 'attachment'].includes(source.from));
    if (foreign) yield `${of} reads \`${foreign.name}\`, which this page does not provide.`;
    const many = bindings.find(({ layout }) => layout.texture?.multisampled);
    if (many) yield `${of} reads a multisampled texture (\`${many.name}\`).`;
    const target = targets.find((target) => target && !TARGETS.includes(target.format));
    if (target) yield `${of} draws to ${target.format}.`;
    const odd = attributes.find(({ type }) => !ATTRIBUTE.test(type));
    if (odd) yield `the attribute \`${odd.name}\` is of the type ${odd.type}.`;
    if (features.some((feature) => feature.startsWith('wgpu-') || feature.startsWith('naga-')))
        yield `${of} needs ${features.join(', ')}, which no browser has.`;
}

/** The author's bindings of several drawings, each once, and the attributes. */
export function authored(drawings) {
    const bindings = new Map();
    const attributes = new Map();
    for (const { passes } of drawings) {
        for (const { pass } of passes) {
            for (const binding of pass.bindings) {
                if (binding.source.from !== 'author') continue;
                const { min_binding_size: size } = binding.layout.buffer ?? {};
                const old = bindings.get(key(binding));
                if (!old || (old.layout.buffer?.min_binding_size ?? 0) < (size ?? 0))
                    bindings.set(key(binding), binding);
            }
            for (const attribute of pass.attributes) attributes.set(attribute.location, attribute);
        }
    }
    return { bindings: [...bindings.values()], attributes: [...attributes.values()] };
}

/** Whether two drawings draw the same passes with the same texts and state. A comment draws nothing. */
export function isSame(a, b) {
    const bare = (stage) => stage?.text.replace(/^\/\/.*\n/gm, '').trim();
    const of = ({ passes }) =>
        JSON.stringify(passes.map(({ pass, vertex, fragment }) => [pass, bare(vertex), bare(fragment)]));
    return of(a) === of(b);
}
