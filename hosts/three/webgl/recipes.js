// Recipes that a page asks for, and plans that a WebGLRenderer cannot draw by.

import { DEPTH_TYPE, SCENE_DEPTH } from './attachments.js';

/**
 * @typedef {object} Recipe
 * @property {string | string[]} pass As preshade's `rewrite` takes it.
 * @property {string} name For reports.
 * @property {string} [form] Of a pre-pass.
 */

/** Recipes to try for a material, in order, or null. `pass` and `fallback` are recipes, or functions of the material. */
export function recipesOf(pass, fallback) {
    if (!pass?.length && typeof pass !== 'function')
        throw new TypeError('preshade: name a pass, as { pass: "hoist" }, or give a function of the material');
    const of = (given, material) => (typeof given === 'function' ? given(material) : given);
    const named = (pass) => ({ pass, name: [pass].flat().map(word).join(' + ') });
    return (material) => {
        const first = of(pass, material);
        if (!first?.length) return null;
        return [first, of(fallback, material)].filter((each) => each?.length).map(named);
    };
}

const word = (step) => step.pass ?? step;

/** Those of a depth pre-pass, from the form that costs least. */
export function prepassOf(form) {
    const forms = ['equal', 'biased'];
    if (!forms.includes(form)) throw new TypeError(`preshade: \`form\` is "equal" or "biased", not "${form}"`);
    const made = forms
        .slice(forms.indexOf(form))
        .map((form) => ({ pass: `depth-prepass:form=${form}`, name: `depth-prepass:form=${form}`, form }));
    return () => made;
}

/** Why a WebGLRenderer cannot draw by this plan, `{ reason, code }`, or null. `samples`: of a pixel of the target; 0 for one. `reversed`: whether depth is. */
export function refusal(plan, limits) {
    const own = plan.attachments.some(({ name }) => name !== SCENE_DEPTH);
    if (own && limits.samples > 0)
        return { reason: 'the plan has a depth texture of its own, and the target several samples', code: 'target' };
    if (own && limits.reversed)
        return { reason: 'the plan has a depth texture of its own, and depth is reversed', code: 'target' };
    const reason = unknown(plan);
    return reason && { reason, code: 'recipe' };
}

/** What of a plan a WebGLRenderer never draws. */
function unknown(plan) {
    const own = plan.attachments.filter(({ name }) => name !== SCENE_DEPTH);
    const all = [plan.self_test?.attachment ?? [], own].flat();
    if (plan.schema !== 'preshade.plan.v1') return `the plan has the schema ${plan.schema}`;
    if (plan.compute?.length) return 'the plan has compute passes, which WebGL does not have';
    // With LESS the first of two surfaces at one depth is seen, and with EQUAL the last.
    if (plan.contract?.given?.includes('no-depth-ties'))
        return 'two surfaces at one depth would be drawn the other way';
    if (plan.guard) return 'the plan has a guard: it counts for some values of uniforms only';
    if (plan.vertex_buffers?.length || plan.draw_buffers?.length || plan.frame_buffers?.length)
        return 'the plan has buffers of its own';
    for (const { format, samples } of all) {
        if (!(format in DEPTH_TYPE)) return `the plan has an attachment of the format ${format}`;
        if (samples > 1) return 'the plan has attachments with several samples';
    }
    for (const pass of plan.passes) {
        if (!['depth', 'opaque'].includes(pass.phase)) return `the plan has a pass of the phase ${pass.phase}`;
        if (!['opaque', 'all'].includes(pass.draws)) return `the plan draws ${pass.draws}`;
        if (pass.geometry) return 'the plan has other geometry';
        if (pass.stencil) return 'the plan has a stencil state';
        if (pass.depth?.read_only) return 'the plan binds the depth buffer that it tests against';
        if (pass.targets.length > 1 || pass.targets.some((target) => target?.attachment))
            return 'the plan has colour targets of its own';
        if (pass.primitive.front_face !== 'ccw' || pass.primitive.unclipped_depth)
            return 'the plan has a primitive state of its own';
    }
    const phases = plan.passes.map(({ phase }) => phase).join();
    return ['opaque', 'depth,opaque'].includes(phases) ? null : `the plan has other passes: ${phases}`;
}
