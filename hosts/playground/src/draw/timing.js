// Times of two drawings: A B B A, in one page, on one device.

/** With fewer samples there is no interval. */
const FEWEST = 8;
const MOST = 200;
/** Milliseconds that one sample should take on a GPU, so that a clock of 0.1 ms is fine enough. */
const SUBMISSION = 15;
const MOST_FRAMES = 1024;

export const median = (values) => {
    const sorted = [...values].sort((a, b) => a - b);
    const half = sorted.length >> 1;
    return sorted.length % 2 ? sorted[half] : (sorted[half - 1] + sorted[half]) / 2;
};

/** Random numbers that are the same in every run. */
function random(seed) {
    let state = seed;
    return () => {
        state = (state + 0x6d2b79f5) | 0;
        let t = Math.imul(state ^ (state >>> 15), 1 | state);
        t = (t + Math.imul(t ^ (t >>> 7), 61 | t)) ^ t;
        return ((t ^ (t >>> 14)) >>> 0) / 2 ** 32;
    };
}

/** A median with its 95 % interval by bootstrap. */
export function estimate(samples, seed = 0x7072) {
    const next = random(seed);
    const medians = Array.from({ length: 1000 }, () =>
        median(Array.from(samples, () => samples[Math.floor(next() * samples.length)])),
    ).sort((a, b) => a - b);
    return { median: median(samples), low: medians[25], high: medians[974] };
}

/** How many frames make a sample long enough. A coarse clock says 0 of a few. */
async function calibrated(renderer, frame) {
    for (let repeats = 1; ;) {
        const took = (await renderer.time(frame, repeats)) * repeats;
        if (took >= SUBMISSION || repeats >= MOST_FRAMES) return repeats;
        const enough = took > 1 ? Math.ceil((repeats * SUBMISSION) / took) : repeats * 4;
        repeats = Math.min(MOST_FRAMES, Math.max(enough, repeats + 1));
    }
}

/**
 * Milliseconds a frame of `a` and of `b`, and how much faster `b` is. A round is A B B A, so that a GPU that warms up or
 * slows down does the same to both. `seconds` is the time for all of it.
 */
export async function time(renderer, a, b, { seconds, progress, signal }) {
    const began = performance.now();
    const share = () => (performance.now() - began) / (seconds * 1000);
    await renderer.time(a, 1);
    await renderer.time(b, 1);
    const repeats = renderer.adapter.kind === 'software' ? 1 : await calibrated(renderer, a);
    const samples = { a: [], b: [] };
    const ratios = [];
    while (samples.a.length < FEWEST || (share() < 1 && samples.a.length < MOST)) {
        const round = {};
        for (const [name, frame] of [
            ['a1', a],
            ['b1', b],
            ['b2', b],
            ['a2', a],
        ]) {
            if (signal.aborted) throw new DOMException('stopped', 'AbortError');
            round[name] = await renderer.time(frame, repeats);
            progress(Math.min(1, Math.max(share(), samples.a.length / FEWEST / 2)));
            // The page stays usable in between.
            await new Promise((resolve) => setTimeout(resolve));
        }
        if (!Object.values(round).every((ms) => ms > 0)) {
            if (performance.now() - began > seconds * 4000) throw new Error('the clock gave no times');
            continue;
        }
        samples.a.push(round.a1, round.a2);
        samples.b.push(round.b1, round.b2);
        ratios.push(round.a1 / round.b1, round.a2 / round.b2);
    }
    return {
        clock: renderer.clock,
        repeats,
        original: { ...estimate(samples.a), samples: samples.a },
        variant: { ...estimate(samples.b), samples: samples.b },
        speedup: estimate(ratios),
    };
}

/** What an interval of a speedup says. */
export function told({ median: ratio, low, high }) {
    const percent = (n) => `${Math.abs((n - 1) * 100).toFixed(1)} %`;
    if (low > 1) return `The variant is faster: ${ratio.toFixed(2)}x.`;
    if (high < 1) return `The variant is slower by ${percent(1 / ratio)}: ${ratio.toFixed(2)}x.`;
    return 'No difference in time can be told: the interval contains 1.';
}
