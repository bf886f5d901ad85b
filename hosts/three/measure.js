// Which materials a pre-pass pays for: decided from frame times, and from nothing else. No GPU and no page here.
//
// Two ways to draw are compared in blocks of four frames, A B B A. A drift of the clock or of the machine that is linear
// over a block cancels in the block's ratio. The interval of the ratio is that of Wilcoxon's signed ranks: it assumes no
// distribution, so a frame that something else delayed moves it little.

/** How many blocks at least: fewer cannot exclude "no difference" with 95 %. */
const LEAST_BLOCKS = 6;
const ORDER = [false, true, true, false];

/**
 * The rank `k` for which the `k`-th smallest and the `k`-th largest mean of two values bound the median with at least
 * `confidence`, from 1; 0 where `n` values are too few.
 */
export function rankOf(n, confidence = 0.95) {
    // How many of the 2^n assignments of signs have each sum of positive ranks.
    let ways = [1];
    for (let rank = 1; rank <= n; rank++) {
        const next = new Array(ways.length + rank).fill(0);
        for (let sum = 0; sum < ways.length; sum++) {
            next[sum] += ways[sum];
            next[sum + rank] += ways[sum];
        }
        ways = next;
    }
    const tail = ((1 - confidence) / 2) * 2 ** n;
    let below = 0;
    let k = 0;
    while (k < ways.length && below + ways[k] <= tail) below += ways[k++];
    return k;
}

/** The median of the values and its interval, by the means of all pairs of values (Hodges and Lehmann). */
export function interval(values, confidence = 0.95) {
    const means = [];
    for (let i = 0; i < values.length; i++)
        for (let j = i; j < values.length; j++) means.push((values[i] + values[j]) / 2);
    means.sort((a, b) => a - b);
    const middle = (means[(means.length - 1) >> 1] + means[means.length >> 1]) / 2;
    const k = rankOf(values.length, confidence);
    if (k === 0) return { middle, low: -Infinity, high: Infinity };
    return { middle, low: means[k - 1], high: means[means.length - k] };
}

/** One comparison. `frame()` says how the next frame is to be drawn; `time` takes what that frame took. */
export class Trial {
    #blocks;
    #left;
    #warmUp;
    #open = null;
    #slot = 0;
    #pending = new Set();
    #ratios = [];

    /**
     * @param {{ frames?: number, warmUp?: number, patience?: number }} options `frames` is rounded up to whole blocks. A
     * block with a lost frame is drawn again, until there were `patience` times as many blocks as asked for.
     */
    constructor({ frames = 30, warmUp = 4, patience = 4 } = {}) {
        this.#blocks = Math.max(LEAST_BLOCKS, Math.ceil(frames / ORDER.length));
        this.#left = this.#blocks * patience;
        this.#warmUp = warmUp;
    }

    /** `{ changed, ticket }`: how to draw the next frame, and what to hand to `time`; null while results are awaited. */
    frame() {
        if (this.#warmUp > 0) return { changed: this.#warmUp-- % 2 === 0, ticket: null };
        if (this.#open === null) {
            // No more blocks than can still be needed.
            if (this.#ratios.length + this.#pending.size >= this.#blocks || this.#left === 0) return null;
            this.#left--;
            this.#open = { times: [], due: ORDER.length, lost: false };
            this.#pending.add(this.#open);
            this.#slot = 0;
        }
        const block = this.#open;
        const slot = this.#slot++;
        if (this.#slot === ORDER.length) this.#open = null;
        return { changed: ORDER[slot], ticket: { block, slot } };
    }

    /** What the frame of this ticket took; not a positive number, or null, where it is not known. */
    time(ticket, milliseconds) {
        if (ticket === null || !this.#pending.has(ticket.block)) return;
        const { block, slot } = ticket;
        block.times[slot] = milliseconds;
        if (!(milliseconds > 0)) block.lost = true;
        if (--block.due > 0) return;
        this.#pending.delete(block);
        if (block.lost) return;
        const [a1, b1, b2, a2] = block.times;
        this.#ratios.push(Math.log((b1 + b2) / (a1 + a2)));
    }

    /** Forgets blocks that are not whole: something else happened to the page, and nothing before and after it compares. */
    interrupt() {
        this.#left += this.#pending.size;
        this.#pending.clear();
        this.#open = null;
        this.#warmUp = Math.max(this.#warmUp, 2);
    }

    get isDone() {
        return this.#ratios.length >= this.#blocks || (this.#left === 0 && this.#pending.size === 0);
    }

    /** Time of the changed way, as a part of the other's. `known` is false where too many frames were lost. */
    get result() {
        const { middle, low, high } = interval(this.#ratios);
        return {
            known: this.#ratios.length >= LEAST_BLOCKS,
            ratio: Math.exp(middle),
            low: Math.exp(low),
            high: Math.exp(high),
            frames: this.#ratios.length * ORDER.length,
        };
    }
}

const inverse = ({ known, ratio, low, high, frames }) => ({
    known,
    ratio: 1 / ratio,
    low: 1 / high,
    high: 1 / low,
    frames,
});
const isFaster = ({ known, high }) => known && high < 1;
/** The longest time between two looks at what is on, in milliseconds. */
const LONGEST = 600_000;

/**
 * Which candidates are on. New candidates are off. First all of them are tried together; if there are at most `each`, then
 * one after the other, since one may pay and another not. Candidates are names, in the order in which they came.
 *
 * What is on is looked at again, all of it against none, after `again` seconds, and then after twice as many each time, up
 * to ten minutes. If it is more likely to be slower than faster, it is measured as if it were new.
 */
export class Choice {
    #options;
    #each;
    #on = new Set();
    #waiting = new Set();
    /** By name: `{ on, ratio, low, high, frames, together }`. */
    #found = new Map();
    #steps = null;
    #step = null;
    /** Whether the steps only look at what is on. */
    #looks = false;
    #first;
    /** Milliseconds until the next look, and when it is due; null: not while something else is measured. */
    #pause;
    #due = null;

    constructor({ each = 6, again = 10, ...options } = {}) {
        this.#options = options;
        this.#each = each;
        this.#first = this.#pause = 1000 * again;
    }

    /** A candidate. `earlier` is what was found of it in an earlier visit: it counts as measured. */
    add(name, earlier = null) {
        if (this.has(name)) return;
        if (earlier === null) this.#waiting.add(name);
        else this.#decide(name, earlier);
    }

    remove(name) {
        this.#waiting.delete(name);
        this.#found.delete(name);
        this.#on.delete(name);
        if (this.#looks) this.#stop();
        else if (this.#isTried(name)) this.#again(this.#step.tried.filter((other) => other !== name));
    }

    /** Measures these anew; they stay as they are until then. */
    again(names = [...this.#found.keys()]) {
        this.#pause = this.#first;
        this.#again([...(this.#looks ? [] : (this.#step?.tried ?? [])), ...names]);
    }

    #again(names) {
        for (const name of names) {
            this.#found.delete(name);
            this.#waiting.add(name);
        }
        this.#stop();
    }

    #stop() {
        this.#steps = this.#step = this.#due = null;
        this.#looks = false;
    }

    /** What happened to the page makes frames before and after it incomparable: another size, a hidden tab. */
    interrupt() {
        this.#step?.trial.interrupt();
    }

    /** Whether it is a candidate. */
    has(name) {
        return this.#found.has(name) || this.#waiting.has(name) || this.#isTried(name);
    }

    /** Whether a candidate is not decided yet. */
    get isMeasuring() {
        return (this.#steps !== null && !this.#looks) || this.#waiting.size > 0;
    }

    /** Whether frames are timed, be it for a look at what is decided. */
    get isTiming() {
        return this.#step !== null;
    }

    /** What was found of a candidate, or null. */
    found(name) {
        return this.#found.get(name) ?? null;
    }

    /** `{ on, ticket }`: which are on in the next frame, and what to hand to `time` (null: nobody asks for its time). `now` is in milliseconds. */
    frame(now = performance.now()) {
        this.#advance(now);
        if (this.#step === null) return { on: this.#on, ticket: null };
        const { trial, from, to } = this.#step;
        const frame = trial.frame();
        if (frame === null) return { on: this.#on, ticket: null };
        const ticket = frame.ticket === null ? null : { trial, ticket: frame.ticket };
        return { on: frame.changed ? to : from, ticket };
    }

    time(ticket, milliseconds) {
        ticket.trial.time(ticket.ticket, milliseconds);
    }

    #isTried(name) {
        return this.#step?.tried.includes(name) ?? false;
    }

    #decide(name, found) {
        this.#found.set(name, found);
        if (found.on) this.#on.add(name);
        else this.#on.delete(name);
    }

    #advance(now) {
        for (;;) {
            if (this.#step !== null) {
                if (!this.#step.trial.isDone) return;
                this.#step = this.#steps.next(this.#step.trial.result).value ?? null;
            } else if (this.#waiting.size > 0) {
                this.#steps = this.#try([...this.#waiting]);
                this.#waiting.clear();
                this.#step = this.#steps.next().value;
            } else if (this.#isDue(now)) {
                this.#steps = this.#look([...this.#on]);
                this.#looks = true;
                this.#step = this.#steps.next().value;
            } else return;
            if (this.#step === null) this.#stop();
        }
    }

    #isDue(now) {
        if (this.#on.size === 0) return false;
        this.#due ??= now + this.#pause;
        return now >= this.#due;
    }

    /** Those that are on against none. Where no frame could be timed, nothing is known, and it stays as it is. */
    *#look(names) {
        const { known, ratio } = yield {
            trial: new Trial(this.#options),
            from: new Set(),
            to: new Set(names),
            tried: names,
        };
        this.#pause = Math.min(2 * this.#pause, Math.max(LONGEST, this.#first));
        if (known && ratio >= 1) this.#again(names);
    }

    *#try(names) {
        const compare = (from, to) => ({ trial: new Trial(this.#options), from, to, tried: names });
        const without = (set, name) => new Set([...set].filter((other) => other !== name));
        const base = new Set([...this.#on].filter((name) => !names.includes(name)));
        const all = new Set([...base, ...names]);
        const whole = yield compare(base, all);
        const together = { ...whole, together: true };
        if (names.length === 1) return void this.#decide(names[0], { ...whole, on: isFaster(whole), together: false });
        if (names.length > this.#each) {
            for (const name of names) this.#decide(name, { ...together, on: isFaster(whole) });
            return;
        }
        // Each one's own part: of a faster whole by leaving it out, else by adding it.
        const leave = isFaster(whole);
        let set = leave ? all : base;
        const found = new Map();
        for (const name of names) {
            const other = leave ? without(set, name) : new Set([...set, name]);
            const result = yield compare(set, other);
            const gain = leave ? inverse(result) : result;
            const on = isFaster(gain);
            found.set(name, { ...gain, on, together: false });
            if (on !== leave) set = other;
        }
        // Small gains that only their sum shows.
        const sum = leave && ![...found.values()].some(({ on }) => on);
        for (const name of names) this.#decide(name, sum ? { ...together, on: true } : found.get(name));
    }
}

/**
 * How often a pixel is shaded, and whether that changed so much that what was measured then says nothing now. The bounds
 * are apart, and it has to be outside of them twice in a row: a value that wavers about a bound measures nothing anew.
 */
export class Load {
    #factor;
    #since = null;
    #outside = 0;

    constructor({ factor = 1.3 } = {}) {
        this.#factor = factor;
    }

    /** The value that holds from now on: that of the next `see`, or the given one. */
    settle(value = null) {
        this.#since = value;
        this.#outside = 0;
    }

    get settled() {
        return this.#since;
    }

    /** Whether it is time to measure again. */
    see(value) {
        if (this.#since === null) {
            this.#since = value;
            return false;
        }
        // Below a tenth of a fragment a pixel nothing depends on it.
        const [low, high] = [Math.min(value, this.#since), Math.max(value, this.#since)].map((v) => Math.max(v, 0.1));
        this.#outside = high / low > this.#factor ? this.#outside + 1 : 0;
        return this.#outside >= 2;
    }
}
