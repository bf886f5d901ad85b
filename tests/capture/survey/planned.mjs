// What the plans of a pass gain, from the decision that `plan --budget` prints.

import { readFile } from 'node:fs/promises';

/** The frames of frames.json. */
export const { frames } = JSON.parse(await readFile(new URL('frames.json', import.meta.url), 'utf8'));

/** Passes for which WebGL lacks compute shaders, or viewports with fractions of a pixel. */
const NOT_IN_WEBGL = /\b(half-rate|preamble)\b/;

/** The least gain for which `plan` leaves what the author wrote. */
const WORTHWHILE = 1.01;

/**
 * What a plan gains: the fastest with an exact contract, another order of the draws and a pre-pass of some of them
 * included, and the one that is chosen within the budget. A gain counts if the lower end of its interval does. What a host
 * cannot draw with WebGL is no plan of a frame of WebGL: then the fastest of the others counts.
 */
export function planned({ scene, plans, views: [{ plan, sorted, ahead, overdraw }] }) {
    const isWebgl = frames.find(({ id }) => id === scene)?.api.startsWith('WebGL');
    const one = ({ name, by_view, error, verdict, contract }, index) => ({
        index,
        contract: contract.kind,
        plan: short(name),
        speedup: by_view[0].speedup,
        predicted: rounded(plans[0].by_view[0].predicted_ms / by_view[0].predicted_ms),
        pixels: error?.changed_pixels ?? 0,
        alpha: error?.changed_alpha ?? 0,
        depth: error?.changed_depth ?? 0,
        flip: error?.flip_mean ?? 0,
        holds: verdict.kind === 'holds',
    });
    const found = { ms: plans[0].by_view[0].time_ms?.median, overdraw: rounded(overdraw) };
    const gains = ({ speedup, holds }) => holds && speedup?.low > WORTHWHILE;
    const faster = (a, b) => b.speedup.median - a.speedup.median;
    const isDrawn = (of) => !(isWebgl && NOT_IN_WEBGL.test(of.plan));
    const all = plans.map(one).slice(1).filter(isDrawn);
    const isSame = ({ pixels, alpha, depth }) => pixels === 0 && alpha === 0 && depth === 0;
    const kept = all.filter((p) => gains(p) && isSame(p) && p.contract === 'exact');
    const isOffered = (of) => of && of.changed_pixels === 0 && of.changed_depth === 0 && gains({ ...of, holds: true });
    if (isOffered(sorted)) {
        const plan = `sorted: ${sorted.moved.length} of ${sorted.draws.length} draws move`;
        kept.push({ plan, speedup: sorted.speedup, pixels: 0, flip: 0, holds: true });
    }
    if (isOffered(ahead)) {
        const plan = `${ahead.recipe}: ${ahead.draws.length} of ${ahead.of} draws ahead`;
        kept.push({ plan, recipes: [ahead.recipe], speedup: ahead.speedup, pixels: 0, flip: 0, holds: true });
    }
    found.same = kept.sort(faster)[0];
    // Without a promise of it.
    const unchanged = all.filter((p) => gains(p) && isSame(p)).sort(faster)[0];
    if (unchanged?.speedup.median > (found.same?.speedup.median ?? 1)) found.unchanged = unchanged;
    const best = plan > 0 && (all.find(({ index }) => index === plan) ?? all.filter(gains).sort(faster)[0]);
    if (best && gains(best) && !(best.speedup.median <= (found.same?.speedup.median ?? 1))) found.within = best;
    return found;
}

/** The recipes of what {@link planned} finds, each once; a pre-pass of some draws counts as one of all. */
export function chosen(decision) {
    const { same, within } = planned(decision);
    const of = (plan) => plan?.recipes ?? Object.values(decision.plans[plan?.index]?.recipes ?? {});
    return [...new Set([same, within].flatMap(of))];
}

/** A plan without the keys of what it hoists. */
export function short(plan) {
    return plan.replaceAll(/,(carry|vertices-per-fragment|metric)=[^,:;) ]*/g, '');
}

export function rounded(number) {
    return Math.round(number * 1000) / 1000;
}
