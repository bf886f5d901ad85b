// Two pictures beside each other: the rungs of `preshade verify` that a page can measure.

/** The error of a variant's picture against the original's. A step is 1/255 of a colour channel. */
export function compare(original, variant) {
    const { size } = original;
    const pixels = size * size;
    const error = {
        changed_pixels: 0,
        changed_alpha: 0,
        changed_depth: 0,
        max_abs: 0,
        max_steps: 0,
        beyond_step: 0,
        pixels,
        // Of equal pictures. Of others, `drawing.js` adds it.
        flip_mean: 0,
        flip_p99: 0,
        flip_tile: 0,
        nan_pixels: 0,
        depth_max_ulp: 0,
        first_difference: null,
    };
    for (let i = 0; i < pixels; i++) {
        let steps = 0;
        let colorSteps = 0;
        for (const [t, a] of original.colors.entries()) {
            const b = variant.colors[t];
            for (let c = 0; c < 4; c++) {
                const difference = Math.abs(a[i * 4 + c] - b[i * 4 + c]);
                steps = Math.max(steps, difference);
                if (c < 3) colorSteps = Math.max(colorSteps, difference);
            }
        }
        const ulp = original.depth && variant.depth ? Math.abs(original.depth[i] - variant.depth[i]) : 0;
        if (steps) error.changed_pixels++;
        if (steps && !colorSteps) error.changed_alpha++;
        if (steps > 1) error.beyond_step++;
        if (ulp) error.changed_depth++;
        error.depth_max_ulp = Math.max(error.depth_max_ulp, ulp);
        error.max_steps = Math.max(error.max_steps, steps);
        if ((steps || ulp) && !error.first_difference) error.first_difference = [i % size, Math.floor(i / size)];
    }
    error.max_abs = error.max_steps / 255;
    return error;
}

/** What the difference picture multiplies a difference by. */
export const FACTOR = 16;

/** The difference, brighter: black where the two are the same, and never darker than a quarter where not. */
export function difference(original, variant) {
    const [a, b] = [original.colors[0], variant.colors[0]];
    const out = new Uint8ClampedArray(a.length);
    for (let i = 0; i < a.length; i += 4) {
        let any = false;
        for (const [t, of] of original.colors.entries())
            for (let c = 0; c < 4; c++) any ||= of[i + c] !== variant.colors[t][i + c];
        for (let c = 0; c < 3; c++) out[i + c] = any ? Math.max(64, Math.abs(a[i + c] - b[i + c]) * FACTOR) : 0;
        out[i + 3] = 255;
    }
    return out;
}

/** Whether a picture is of one colour: then it shows nothing of the material, and proves nothing. */
export function isBlank({ colors }) {
    return colors.every((texels) => {
        for (let i = 4; i < texels.length; i++) if (texels[i] !== texels[i - 4]) return false;
        return true;
    });
}

const METRICS = { flip_mean: 'flip_mean', flip_p99: 'flip_p99', flip_tile: 'flip_tile', max_abs: 'max_abs' };

/** How an error exceeds budgets, or `null`. */
function beyond(budgets, error) {
    const broken = budgets.filter(({ metric, budget }) => !(error[METRICS[metric]] <= budget));
    const words = ({ metric, budget }) => `${metric} is ${error[METRICS[metric]]?.toFixed(6)} of a budget of ${budget}`;
    return broken.length ? broken.map(words).join(', ') : null;
}

/** How an error exceeds roundings and the share of decisions that they may turn, or `null`: as `preshade verify`. */
function beyondRounding({ k, turned }, error) {
    // A rounding changes a stored channel by at most one step.
    const allowed = 1 / 255 + k * 2 ** -24;
    if ((!turned || turned.surface === 'kept') && error.changed_depth) return `${error.changed_depth} depths differ`;
    if (!turned) return error.max_abs > allowed + 1e-8 ? `a channel differs by ${error.max_abs.toFixed(6)}` : null;
    const most = Math.floor(turned.share * error.pixels);
    return error.beyond_step > most
        ? `${error.beyond_step} pixels are off by more than a step, where ${most} may`
        : null;
}

/** Whether the picture shows what a plan promises. */
export function verdict(contract, error) {
    if (error.changed_pixels === 0 && error.changed_depth === 0) return { kind: 'holds' };
    const where = {
        exact: () => `camera \`front\`, pixel ${error.first_difference.join(', ')}`,
        rounding: () => beyondRounding(contract, error),
        approximate: () => beyond([contract], error),
        budgets: () => beyond(contract.budgets, error),
    }[contract.kind]?.();
    return where ? { kind: 'broken', where } : { kind: 'holds' };
}
