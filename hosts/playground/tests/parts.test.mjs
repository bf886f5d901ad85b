// Parts of the page that need no browser.

import assert from 'node:assert/strict';
import { execFileSync } from 'node:child_process';
import { test } from 'node:test';
import { compare, difference, isBlank, verdict } from '../src/draw/compare.js';
import { flip, map, worstTile } from '../src/draw/flip.js';
import { meaning, normalise } from '../src/draw/names.js';
import { estimate, time, told } from '../src/draw/timing.js';
import { Material } from '../src/material.js';
import { issueAddress, onGitHub } from '../src/report.js';
import { pack, unpack } from '../src/share.js';

const picture = (texels, depth) => ({
    size: 2,
    colors: [new Uint8ClampedArray(texels.flat())],
    depth: depth && new Uint32Array(depth),
});
const GREY = [9, 9, 9, 255];
const grey = () => [GREY, GREY, GREY, GREY].map((texel) => [...texel]);

test('the error counts pixels, alpha, depths and steps', () => {
    const original = picture(grey(), [1, 1, 1, 1]);
    const texels = grey();
    texels[1] = [9, 12, 9, 255];
    texels[2] = [9, 9, 9, 254];
    const variant = picture(texels, [1, 1, 1, 4]);
    const error = compare(original, variant);
    assert.equal(error.changed_pixels, 2);
    assert.equal(error.changed_alpha, 1);
    assert.equal(error.changed_depth, 1);
    assert.equal(error.depth_max_ulp, 3);
    assert.equal(error.max_steps, 3);
    assert.equal(error.max_abs, 3 / 255);
    assert.equal(error.beyond_step, 1);
    assert.deepEqual(error.first_difference, [1, 0]);
    const shown = difference(original, variant);
    assert.deepEqual([...shown.slice(0, 4)], [0, 0, 0, 255]);
    assert.deepEqual([...shown.slice(4, 7)], [64, 64, 64]);
    assert.deepEqual([...shown.slice(8, 11)], [64, 64, 64]);
    assert.ok(isBlank(original) && !isBlank(variant));
});

test('a promise is judged as verify judges it', () => {
    const judged = (contract, error) =>
        verdict(contract, { changed_pixels: 1, changed_depth: 0, first_difference: [1, 0], ...error });
    const depth = compare(picture(grey(), [1, 1, 1, 1]), picture(grey(), [1, 2, 1, 1]));
    assert.deepEqual(verdict({ kind: 'exact' }, depth), { kind: 'broken', where: 'camera `front`, pixel 1, 0' });
    const same = compare(picture(grey()), picture(grey()));
    for (const kind of ['exact', 'rounding', 'approximate', 'budgets'])
        assert.deepEqual(verdict({ kind }, same), { kind: 'holds' });
    const budget = { kind: 'approximate', metric: 'flip_mean', budget: 0.02 };
    assert.equal(judged(budget, { flip_mean: 0.02 }).kind, 'holds');
    assert.equal(judged(budget, { flip_mean: 0.0201 }).where, 'flip_mean is 0.020100 of a budget of 0.02');
    // What is not known is no success.
    assert.equal(judged(budget, { flip_mean: undefined }).kind, 'broken');
    const both = { kind: 'budgets', budgets: [budget, { metric: 'max_abs', budget: 0.1 }] };
    assert.equal(judged(both, { flip_mean: 0.01, max_abs: 0.2 }).where, 'max_abs is 0.200000 of a budget of 0.1');
    const rounding = { kind: 'rounding', k: 8 };
    assert.equal(judged(rounding, { max_abs: 1 / 255 }).kind, 'holds');
    assert.equal(judged(rounding, { max_abs: 2 / 255 }).kind, 'broken');
    assert.equal(judged(rounding, { max_abs: 0, changed_depth: 1 }).kind, 'broken');
    const turned = { ...rounding, turned: { share: 0.25, surface: 'kept' } };
    assert.equal(judged(turned, { max_abs: 1, pixels: 8, beyond_step: 2 }).kind, 'holds');
    assert.equal(judged(turned, { max_abs: 1, pixels: 8, beyond_step: 3 }).kind, 'broken');
});

test('FLIP is that of its authors', () => {
    const size = 96;
    let state = 7;
    const random = () => ((state = Math.imul(state, 1664525) + 1013904223) >>> 0) / 2 ** 32;
    const [a, b] = [0, 1].map(() => new Uint8ClampedArray(size * size * 4));
    for (let y = 0; y < size; y++)
        for (let x = 0; x < size; x++) {
            const i = (y * size + x) * 4;
            const texel = [x * 2.5, 128 + 100 * Math.sin((x * y) / 90), y > 40 && x > 30 ? 220 : 30];
            for (let c = 0; c < 3; c++) {
                a[i + c] = texel[c];
                b[i + c] = texel[c] + (x > 60 ? (random() - 0.5) * 90 : 0) + (y < 20 ? 12 : 0);
            }
        }
    // From the authors' own program (flip-evaluator 1.7) on these pictures.
    const EXPECTED = {
        mean: 0.122861,
        p99: 0.385777,
        pixels: [
            [70, 5, 0.374087],
            [80, 60, 0.317053],
            [3, 90, 0],
        ],
    };
    const found = map(a, b, size);
    const { mean, p99, tile } = flip(a, b, size);
    const near = (value, expected) => assert.ok(Math.abs(value - expected) < 2e-5, `${value}, not ${expected}`);
    near(mean, EXPECTED.mean);
    near(p99, EXPECTED.p99);
    assert.equal(tile, worstTile(found, size));
    const spot = new Float64Array(20 * 20);
    spot[399] = 1;
    // The last tile has 4 x 4 pixels.
    assert.equal(worstTile(spot, 20), 1 / 16);
    for (const [x, y, value] of EXPECTED.pixels) near(found[y * size + x], value);
});

test('an interval holds the median, and says what it can', () => {
    const found = estimate([2, 2.1, 1.9, 2, 2.05, 1.95, 2, 2]);
    assert.ok(found.low <= found.median && found.median <= found.high);
    assert.equal(found.median, 2);
    assert.ok(found.low >= 1.9 && found.high <= 2.1);
    assert.match(told({ median: 2, low: 1.9, high: 2.1 }), /faster: 2\.00x/);
    assert.match(told({ median: 0.5, low: 0.4, high: 0.6 }), /slower.*0\.50x/);
    assert.match(told({ median: 1.01, low: 0.9, high: 1.1 }), /No difference/);
});

/** A renderer whose frames take a known time, by a clock of 0.1 ms; it keeps the order of what it drew. */
const fake = (costs, kind = 'other') => {
    const drawn = [];
    return {
        drawn,
        clock: 'gpu-timestamps',
        adapter: { kind },
        async time(frame, repeats) {
            drawn.push([frame, repeats]);
            return Math.floor(costs[frame] * repeats * 10) / 10 / repeats;
        },
    };
};

test('a round is A B B A, and a sample has as many frames as the clock needs', async () => {
    const renderer = fake({ a: 0.02, b: 0.01 });
    const shares = [];
    const options = { seconds: 0.01, progress: (share) => shares.push(share), signal: new AbortController().signal };
    const found = await time(renderer, 'a', 'b', options);
    assert.ok(found.repeats * 0.02 >= 14 && found.repeats <= 1024, String(found.repeats));
    const timed = renderer.drawn.filter(([, repeats]) => repeats === found.repeats).map(([frame]) => frame);
    const rounds = timed.slice(-found.original.samples.length * 2).join('');
    assert.match(rounds, /^(abba){4,}$/);
    assert.ok(Math.abs(found.original.median - 0.02) < 1e-3 && Math.abs(found.variant.median - 0.01) < 1e-3);
    assert.ok(Math.abs(found.speedup.median - 2) < 0.05);
    assert.equal(shares.at(-1) <= 1, true);
    const software = await time(fake({ a: 5, b: 5 }, 'software'), 'a', 'b', options);
    assert.equal(software.repeats, 1);
    assert.equal(software.speedup.median, 1);
});

test('a clock that gives no times is an error, and a stop is heeded', async () => {
    const { signal } = new AbortController();
    const options = { seconds: 0.01, progress() {}, signal };
    await assert.rejects(time(fake({ a: NaN, b: NaN }, 'software'), 'a', 'b', options), /the clock gave no times/);
    const stopped = AbortSignal.abort();
    await assert.rejects(time(fake({ a: 1, b: 1 }), 'a', 'b', { ...options, signal: stopped }), /stopped/);
});

test('names mean what the reference says', () => {
    const NAMES = {
        'camera.view_proj': 'viewProjection',
        u_viewProj: 'viewProjection',
        'frame.camera_position': 'cameraPosition',
        'camera.position': 'cameraPosition',
        'object.model': 'model',
        'model.normal': 'normalMatrix',
        uTime: 'time',
        'light.direction': 'lightDirection',
        cameraViewProjMat: 'viewProjection',
        'lights[1].position': null,
        fog: null,
    };
    for (const [name, expected] of Object.entries(NAMES)) assert.equal(meaning(name), expected, name);
    assert.equal(normalise('a_Position'), 'position');
    assert.equal(normalise('aPosition'), 'position');
    assert.equal(normalise('inPosition'), 'position');
});

test('a link holds what was put into it, and no other kind of text', async () => {
    const held = {
        files: [
            { name: 'a.vert', text: '\u{1f33f}\n'.repeat(500) },
            { name: 'a.frag', text: '' },
        ],
        recipe: 'hoist:budget=0.02',
        state: { cull: 'none' },
        define: 'A B=2',
    };
    const fragment = await pack({ v: 1, ...held });
    assert.match(fragment, /^s=[\w-]+$/);
    assert.ok(fragment.length < 300);
    assert.deepEqual(await unpack(`#${fragment}`), held);
    assert.equal(await unpack('#result'), null);
    assert.equal(await unpack(''), null);
    await assert.rejects(unpack('#s=AAAA'));
    await assert.rejects(unpack(`#${await pack({ v: 2, ...held })}`), /another version/);
    await assert.rejects(unpack(`#${await pack({ v: 1, ...held, files: [] })}`), /no shader/);
    await assert.rejects(unpack(`#${await pack({ v: 1, ...held, files: [{ name: 1, text: '' }] })}`), /no shader/);
});

test('a link that would unpack to gigabytes is given up', async () => {
    const text = 'a'.repeat(9 << 20);
    const fragment = await pack({ v: 1, files: [{ name: 'a.wgsl', text }], recipe: '' }).catch((error) => error);
    // Packing has the same limit.
    assert.match(String(fragment.message ?? fragment), /8 MB|^s=/);
    if (typeof fragment === 'string') await assert.rejects(unpack(`#${fragment}`), /8 MB/);
});

test('an issue is opened in the repository, if it is known', () => {
    const what = { adapter: 'Acme 9000', material: 'leaf', recipe: 'depth-prepass' };
    const address = new URL(issueAddress('owner/name', what));
    assert.equal(address.origin + address.pathname, 'https://github.com/owner/name/issues/new');
    assert.equal(address.searchParams.get('title'), 'Measurement: depth-prepass of leaf on Acme 9000');
    assert.match(address.searchParams.get('body'), /```json/);
    assert.equal(issueAddress('', what), null);
    // Of a clone, its origin.
    for (const origin of [
        'https://github.com/owner/na.me.git\n',
        'git@github.com:owner/na.me',
        'https://t@github.com/owner/na.me/',
    ])
        assert.equal(onGitHub(origin), 'owner/na.me', origin);
    for (const origin of ['https://example.com/github.com/owner/name', 'https://notgithub.com/owner/name', '/srv/name'])
        assert.equal(onGitHub(origin), '', origin);
});

test('a shell reads the command as it is meant, whatever a link has in it', () => {
    const names = ["it's $(id).vert", '-o;`id`.frag'];
    const material = new Material({
        files: names.map((name) => ({ name, text: '' })),
        define: 'A=$HOME B=2',
        state: { cull: 'none', reversedZ: 'reversed', samples: '4' },
    });
    const command = material.command('hoist:budget=0.02 x;id>out "y');
    const shell = 'npx() { printf "%s\\n" "$@"; }';
    const read = execFileSync('sh', ['-c', `${shell}; ${command}`], { encoding: 'utf8' });
    assert.deepEqual(read.trimEnd().split('\n'), [
        ...['preshade', 'rewrite', names[0], `./${names[1]}`],
        ...['--pass', 'hoist:budget=0.02', '--pass', 'x;id>out', '--pass', '"y'],
        ...['--cull', 'none', '--samples', '4', '--reversed-z', '--define', 'A=$HOME', '--define', 'B=2'],
        ...['--emit', 'wgsl,glsl-es', '-o', 'out'],
    ]);
    assert.match(new Material({ files: [{ name: 'lit.wgsl', text: '' }] }).command('hoist'), /lit\.wgsl --pass hoist /);
});
