// The decision logic on made-up series: noise, drift, gaps, changes. No GPU.

import assert from 'node:assert/strict';
import { test } from 'node:test';
import { Choice, Load, Trial, interval, rankOf } from '../measure.js';

/** Numbers from 0 to 1 that are the same in each run (mulberry32). */
function random(seed) {
    return () => {
        seed = (seed + 0x6d2b79f5) | 0;
        let t = Math.imul(seed ^ (seed >>> 15), 1 | seed);
        t = (t + Math.imul(t ^ (t >>> 7), 61 | t)) ^ t;
        return ((t ^ (t >>> 14)) >>> 0) / 4294967296;
    };
}

/** Runs a trial on `time(changed, frame)`, whose results come `late` frames later. */
function run(trial, time, late = 3) {
    const queue = [];
    let frames = 0;
    while (!trial.isDone) {
        const frame = trial.frame();
        if (frame) queue.push([frame.ticket, time(frame.changed, frames)]);
        if (queue.length > late || !frame) trial.time(...queue.shift());
        assert.ok(++frames < 1000, 'the trial ends');
    }
    return { ...trial.result, drawn: frames };
}

test('ranks are those of the tables of the signed-rank test', () => {
    // Largest sum that is significant at 5 %, two-sided, and one more.
    const table = { 5: -1, 6: 0, 7: 2, 8: 3, 9: 5, 10: 8, 12: 13, 15: 25, 20: 52 };
    for (const [n, critical] of Object.entries(table)) assert.equal(rankOf(Number(n)), critical + 1, `n = ${n}`);
});

test('an interval covers the median as often as it says', () => {
    const next = random(7);
    let covered = 0;
    for (let i = 0; i < 2000; i++) {
        // A long-tailed distribution, symmetric about 3.
        const values = Array.from({ length: 8 }, () => 3 + Math.tan(Math.PI * (next() - 0.5)));
        const { low, high } = interval(values);
        if (low <= 3 && 3 <= high) covered++;
    }
    assert.ok(covered / 2000 > 0.945, `${covered}`);
});

test('a difference is found under noise', () => {
    const next = random(1);
    const noisy = (ms) => ms * (1 + 0.05 * (next() - 0.5));
    const { known, low, ratio, high, frames } = run(new Trial(), (changed) => noisy(changed ? 8 : 10));
    assert.ok(known && low < 0.8 && 0.8 < high && high < 0.83, `${low} ${ratio} ${high}`);
    assert.equal(frames, 32);
});

test('linear drift within a block is no difference', () => {
    const { low, ratio, high } = run(new Trial({ warmUp: 0 }), (changed, frame) => 10 + 0.2 * frame);
    assert.ok(Math.abs(ratio - 1) < 1e-9 && low <= 1 + 1e-9 && high >= 1 - 1e-9, `${low} ${ratio} ${high}`);
});

test('single delayed frames do not decide', () => {
    const next = random(3);
    const spike = () => (next() < 0.06 ? 60 : 0);
    const { high } = run(new Trial({ frames: 60 }), (changed) => (changed ? 7 : 10) + 0.3 * next() + spike());
    assert.ok(high < 1, `${high}`);
});

test('a block with a disjoint frame is drawn again', () => {
    const gap = (changed, frame) => (frame % 9 === 5 ? null : changed ? 9 : 10);
    const { known, ratio, frames, drawn } = run(new Trial(), gap);
    assert.ok(known && Math.abs(ratio - 0.9) < 1e-9);
    assert.equal(frames, 32);
    assert.ok(drawn > 45, `${drawn} frames drawn`);
});

test('where all times are lost the trial ends, and knows nothing', () => {
    const { known, frames, low, high } = run(new Trial(), () => null);
    assert.deepEqual({ known, frames, low, high }, { known: false, frames: 0, low: 0, high: Infinity });
});

test('without a difference less than 1 in 20 is taken', () => {
    let taken = 0;
    for (let seed = 0; seed < 400; seed++) {
        const next = random(seed);
        const choice = new Choice();
        choice.add('m');
        drive(choice, () => 10 * (1 + 0.1 * next()), ['m']);
        if (choice.found('m').on) taken++;
    }
    assert.ok(taken < 20, `${taken} of 400`);
});

/** Draws frames until the choice is made; `cost(on)` is what a frame takes. Gives back how many frames it took. */
function drive(choice, cost, names, frames = 4000) {
    const late = [];
    for (let i = 0; i < frames; i++) {
        const { on, ticket } = choice.frame();
        for (const name of on) assert.ok(names.includes(name));
        if (ticket) late.push([ticket, cost(on)]);
        if (late.length > 2 || (late.length && !ticket)) choice.time(...late.shift());
        if (!choice.isMeasuring) return i;
    }
    assert.fail('no choice is made');
}

test('one that pays and one that does not', () => {
    const next = random(5);
    const names = ['wall', 'floor'];
    const cost = (on) => (10 - (on.has('wall') ? 3 : 0) + (on.has('floor') ? 0.5 : 0)) * (1 + 0.02 * next());
    const choice = new Choice();
    for (const name of names) choice.add(name);
    const frames = drive(choice, cost, names);
    assert.ok(choice.found('wall').on && !choice.found('floor').on);
    assert.ok(choice.found('wall').high < 0.75 && choice.found('floor').low > 1);
    assert.deepEqual([...choice.frame().on], ['wall']);
    assert.ok(frames <= 3 * (32 + 4 + 4), `${frames}`);
});

test('where all together are slower, one may still pay', () => {
    const next = random(6);
    const names = ['a', 'b', 'c'];
    const cost = (on) =>
        (10 - (on.has('a') ? 2 : 0) + (on.has('b') ? 3 : 0) + (on.has('c') ? 1 : 0)) * (1 + 0.02 * next());
    const choice = new Choice();
    for (const name of names) choice.add(name);
    drive(choice, cost, names);
    assert.deepEqual([...choice.frame().on], ['a']);
});

test('small gains that only their sum shows', () => {
    const next = random(8);
    const names = ['a', 'b', 'c', 'd'];
    const choice = new Choice();
    for (const name of names) choice.add(name);
    drive(choice, (on) => (100 - on.size) * (1 + 0.08 * next()), names);
    assert.equal(choice.frame().on.size, 4);
    assert.ok(names.every((name) => choice.found(name).together));
});

test('many candidates are measured together', () => {
    const names = Array.from({ length: 40 }, (_, i) => `m${i}`);
    const choice = new Choice();
    for (const name of names) choice.add(name);
    const frames = drive(choice, (on) => 10 - on.size / 20, names);
    assert.ok(frames <= 40, `${frames}`);
    assert.equal(choice.frame().on.size, 40);
});

test('what is remembered is not measured; what comes later is, beside it', () => {
    const choice = new Choice();
    choice.add('old', { on: true, ratio: 0.8, low: 0.7, high: 0.9, frames: 32 });
    assert.ok(!choice.isMeasuring);
    assert.deepEqual([...choice.frame().on], ['old']);
    choice.add('new');
    drive(choice, (on) => (assert.ok(on.has('old')), on.has('new') ? 11 : 10), ['old', 'new']);
    assert.ok(!choice.found('new').on && choice.found('old').on);
});

test('measured again, the choice turns; until then it stays', () => {
    const choice = new Choice();
    choice.add('m');
    drive(choice, (on) => (on.has('m') ? 8 : 10), ['m']);
    assert.ok(choice.found('m').on);
    choice.again();
    assert.equal(choice.found('m'), null);
    assert.ok(choice.isMeasuring);
    drive(choice, (on) => (on.has('m') ? 12 : 10), ['m']);
    assert.ok(!choice.found('m').on);
    assert.equal(choice.frame().on.size, 0);
});

/** A page at 60 frames a second, whose times come two frames later. `run(seconds, cost)` draws; it gives back in which seconds frames were timed. */
function page(choice) {
    let frame = 0;
    const late = [];
    const run = (seconds, cost) => {
        const timed = new Set();
        for (const end = frame + 60 * seconds; frame < end; frame++) {
            const { on, ticket } = choice.frame((1000 * frame) / 60);
            if (ticket) timed.add(Math.floor(frame / 60));
            if (ticket) late.push([ticket, cost(on)]);
            if (late.length > 2 || (late.length && !ticket)) choice.time(...late.shift());
        }
        return [...timed];
    };
    return { run };
}

test('what is on is looked at again, each time after twice as long', () => {
    const choice = new Choice();
    for (const name of ['a', 'b', 'off']) choice.add(name);
    const { run } = page(choice);
    const cost = (on) => 10 - (on.has('a') ? 2 : 0) - (on.has('b') ? 1 : 0) + (on.has('off') ? 1 : 0);
    run(5, cost);
    const found = ['a', 'b', 'off'].map((name) => choice.found(name));
    assert.deepEqual(
        found.map(({ on }) => on),
        [true, true, false],
    );
    // Measured for 2 s, then looks of less than a second each.
    const timed = run(200, cost);
    const begins = timed.filter((second) => !timed.includes(second - 1));
    assert.equal(begins.length, 4, begins.join());
    const pauses = begins.slice(1).map((second, i) => second - begins[i]);
    [20, 40, 80].forEach((pause, i) => assert.ok(Math.abs(pauses[i] - pause) <= 2, pauses.join()));
    assert.ok(!choice.isMeasuring);
    found.forEach((each, i) => assert.equal(choice.found(['a', 'b', 'off'][i]), each, 'what was found stays'));
    // Up to ten minutes.
    run(3600, cost);
    const late = run(1300, cost);
    assert.equal(late.filter((second) => !late.includes(second - 1)).length, 2);
});

test('what no longer pays is found in a look, and measured anew', () => {
    const choice = new Choice();
    for (const name of ['a', 'b']) choice.add(name);
    const { run } = page(choice);
    run(5, (on) => 10 - on.size);
    assert.equal(choice.frame(5000).on.size, 2);
    // The page does something else by now: the one costs more than the other gains.
    run(20, (on) => 10 - (on.has('a') ? 1 : 0) + (on.has('b') ? 2 : 0));
    assert.deepEqual([choice.found('a').on, choice.found('b').on, choice.isMeasuring], [true, false, false]);
    // Nothing is left to look at.
    run(60, (on) => 10 + on.size);
    assert.deepEqual([choice.found('a').on, run(2000, (on) => 10 + on.size).length], [false, 0]);
});

test('a look of which nothing is known changes nothing, and so does one that is broken off', () => {
    const choice = new Choice({ again: 5 });
    for (const name of ['a', 'b']) choice.add(name);
    const { run } = page(choice);
    run(5, (on) => 10 - on.size);
    run(30, () => null);
    assert.ok(choice.found('a').on && choice.found('b').on && !choice.isMeasuring);
    while (!choice.isTiming) run(1 / 60, () => 10);
    assert.ok(!choice.isMeasuring);
    choice.remove('a');
    assert.ok(!choice.isTiming && !choice.isMeasuring && choice.found('b').on);
    assert.deepEqual([...choice.frame().on], ['b']);
    const never = new Choice({ again: Infinity });
    never.add('a', { on: true });
    assert.deepEqual(
        page(never).run(2000, () => 10),
        [],
    );
});

test('a material that goes away during its trial', () => {
    const choice = new Choice();
    choice.add('a');
    choice.add('b');
    for (let i = 0; i < 10; i++) {
        const { ticket } = choice.frame();
        if (ticket) choice.time(ticket, 10);
    }
    choice.remove('a');
    drive(choice, (on) => (on.has('b') ? 5 : 10), ['b']);
    assert.equal(choice.found('a'), null);
    assert.ok(choice.found('b').on);
});

test('a resize in the middle of a block compares nothing across it', () => {
    const choice = new Choice();
    choice.add('m');
    let size = 1;
    const cost = (on) => size * (on.has('m') ? 9 : 10);
    for (let i = 0; i < 15; i++) {
        const { on, ticket } = choice.frame();
        if (ticket) choice.time(ticket, cost(on));
    }
    size = 4;
    choice.interrupt();
    drive(choice, cost, ['m']);
    const { ratio, low, high } = choice.found('m');
    for (const value of [ratio, low, high]) assert.ok(Math.abs(value - 0.9) < 1e-9, `${value}`);
});

test('load: measured again where it changed, not where it wavers', () => {
    const load = new Load();
    assert.equal(load.see(2), false);
    const wavering = [2.5, 2.7, 2.5, 2.7, 2.5, 1.5, 2, 2.65, 2.5];
    assert.ok(wavering.every((value) => !load.see(value)));
    assert.equal(load.see(3), false);
    assert.equal(load.see(3.1), true);
    load.settle(3.1);
    assert.equal(load.see(3.3), false);
    assert.equal(load.see(2), false);
    assert.equal(load.see(2), true);
    // An empty view, and one with a sliver of the object.
    load.settle(0);
    assert.ok([0.01, 0.09, 0.05].every((value) => !load.see(value)));
    assert.equal(load.see(1), false);
    assert.equal(load.see(1), true);
});
