// plan.json in words.

import assumptions from 'virtual:assumptions';
import { code, counted, h, list, marked } from './dom.js';

const PHASES = {
    depth: 'before every opaque pass of the frame',
    classify: 'after the depth passes',
    resolve: 'once the depth passes are drawn',
    opaque: 'with the opaque materials',
    blended: 'last, with the blended materials',
    shadow: 'under a light\u2019s view',
    outputs: 'when you need its pictures',
};
const COMPARE = {
    less: 'nearer than what is there (less)',
    'less-equal': 'at most as far as what is there (less-equal)',
    greater: 'farther in depth value (greater, as for reversed Z)',
    'greater-equal': 'at least as large as what is there (greater-equal)',
    equal: 'exactly at the depth that is there (equal)',
    always: 'always',
    never: 'never',
    'not-equal': 'not at the depth that is there (not-equal)',
};
const DRAWS = { opaque: 'your opaque draws', all: 'your draws', once: 'nothing of yours: one draw for the frame' };

function depth({ attachment, compare, write, bias, read_only: readOnly }) {
    const words = [
        `Depth: tests against `,
        code(attachment),
        `, passes ${COMPARE[compare] ?? compare}, and ${write ? 'writes it' : 'does not write it'}`,
    ];
    if (bias.constant || bias.slope_scale)
        words.push(`, with a bias of ${bias.constant} and a slope scale of ${bias.slope_scale}`);
    if (readOnly) words.push('; bind it read-only, because the pass also samples it');
    return [...words, '.'];
}

function targets(all) {
    const there = all.filter(Boolean);
    if (!there.length) return 'Colour: none.';
    const of = there.map(({ format, blend }) => `${format}${blend ? ', blended' : ''}`);
    return `Colour: ${of.join('; ')}.`;
}

function pass(pass, files) {
    const names = Object.values(files).flatMap((stage) => [stage?.wgsl?.file, stage?.['glsl-es']?.file]);
    const shaders = [...new Set(names.filter(Boolean))];
    const bindings = pass.bindings.map(({ name, kind, source }) => [
        code(name),
        ` (${kind}${source.from === 'attachment' ? `, the attachment ${source.name}` : ''})`,
    ]);
    const joined = (all) => all.flatMap((words, i) => (i ? [', ', words] : [words])).flat();
    const attributes = pass.attributes.map(({ name }) => code(name));
    return [
        h('strong', {}, pass.role),
        `: draw ${DRAWS[pass.draws] ?? pass.draws} ${PHASES[pass.phase] ?? `in the phase ${pass.phase}`}.`,
        list(
            [
                pass.depth ? h('span', {}, depth(pass.depth)) : 'Depth: no test.',
                targets(pass.targets),
                `Faces: ${pass.primitive.cull === 'none' ? 'both sides are drawn' : `${pass.primitive.cull} faces are culled`}.`,
                bindings.length ? h('span', {}, 'Bindings: ', joined(bindings), '.') : 'Bindings: none.',
                attributes.length
                    ? h('span', {}, 'Attributes: ', joined(attributes.map((a) => [a])), '.')
                    : 'Attributes: none.',
                pass.features.length ? `Features that the device must have: ${pass.features.join(', ')}.` : null,
                pass.geometry ? 'Geometry: not yours as it is; plan.json says which buffers and draw call.' : null,
                shaders.length ? h('span', {}, 'Shaders: ', joined(shaders.map((name) => [code(name)])), '.') : null,
            ].filter(Boolean),
        ),
    ];
}

const METRICS = {
    flip_mean: 'a mean FLIP',
    flip_p99: 'a 99th percentile of FLIP',
    flip_tile: 'a mean FLIP of the worst tile',
    max_abs: 'a largest difference of a channel',
};
const budgeted = ({ metric, budget }) => `${METRICS[metric] ?? metric} of at most ${budget}`;

/** What a contract promises, in a sentence. */
export function promise(contract) {
    const { kind } = contract;
    if (kind === 'exact') return 'Exact: every bit of the picture is the original\u2019s.';
    if (kind === 'rounding')
        return `Rounding: the same function of real numbers; up to ${counted(contract.k, 'rounding')} may differ.`;
    if (kind === 'approximate') return `Approximate: ${budgeted(contract)}.`;
    if (kind === 'budgets') return `Approximate: ${contract.budgets.map(budgeted).join(', and ')}.`;
    return kind;
}

/** The plan as elements. */
export function words(plan) {
    const given = plan.contract.given ?? [];
    const steps = (plan.steps ?? []).map(({ pass, params }) => {
        const values = Object.entries(params ?? {}).map(([name, value]) => `${name}=${value}`);
        return h('span', {}, code(values.length ? `${pass}:${values.join(',')}` : pass));
    });
    const attachments = plan.attachments.map(({ name, format, sampled, clear }) =>
        h('span', {}, code(name), `: ${format}, cleared to ${clear}${sampled ? ', and sampled by a later pass' : ''}.`),
    );
    const guard = plan.guard?.values ?? [];
    const run = (each) =>
        each.draws.map(({ role, samples }) => `${role} must show ${samples === 'none' ? 'no sample' : 'some samples'}`);
    return [
        h('h3', {}, `Draw ${counted(plan.passes.length, 'pass', 'passes')}, in this order`),
        list(
            plan.passes.map((each, i) => pass(each, plan.files[i] ?? {})).map((words) => h('div', {}, words)),
            'ol',
        ),
        h('h3', {}, 'Attachments'),
        list(attachments) ?? h('p', {}, 'None.'),
        h('h3', {}, 'Promise'),
        h('p', {}, promise(plan.contract)),
        given.length ? h('p', {}, 'It holds under these conditions:') : null,
        list(given.map((name) => h('span', {}, code(name), assumptions[name] ? `: ${assumptions[name]}.` : ''))),
        h('h3', {}, 'Check of the driver'),
        plan.self_test
            ? h(
                  'div',
                  {},
                  h('p', {}, 'Run this once after loading. If it fails, draw the fallback.'),
                  list(plan.self_test.runs.map((each) => `${run(each).join('; ')}. A failure means: ${each.failure}.`)),
              )
            : h('p', {}, 'None: nothing depends on the driver, or only the original\u2019s picture could show it.'),
        h(
            'p',
            {},
            'Fallback: ',
            code(typeof plan.fallback === 'string' ? plan.fallback : JSON.stringify(plan.fallback ?? 'original')),
            '.',
        ),
        guard.length ? h('h3', {}, 'Values it was made for') : null,
        list(
            guard.map(({ name, low, high }) =>
                h('span', {}, code(name), low === high ? ` = ${low}` : ` from ${low} to ${high}`),
            ),
        ),
        steps.length ? h('h3', {}, 'Steps') : null,
        list(steps, 'ol'),
        plan.notes?.length ? h('h3', {}, 'Notes') : null,
        list([...new Set(plan.notes ?? [])].map(marked)),
    ].filter(Boolean);
}
