// Whole frames by recipes of all kinds: not one pixel differs from three.js' own.

import assert from 'node:assert/strict';
import test, { after, before } from 'node:test';
import { launch, open } from './browser.mjs';
import { serve } from './serve.mjs';
import { REMEDIES } from '../rows.js';

// One browser for all: it keeps the programs that it has linked, and most tests draw the same.
let browser, served;
before(async () => {
    [browser, served] = await Promise.all([launch(), serve()]);
});
after(async () => {
    await browser?.close();
    served?.close();
});

async function opened(context, parameters = '') {
    const found = await open(browser, `${served.address}/page/rewrite?${parameters}`);
    context.after(() => found.page.close());
    return found;
}

const part = (page, name, options) => page.evaluate(([name, options]) => part(name, options), [name, options]);
const rows = (page, name) => page.evaluate((name) => rows(name), name);
const by = (rows, material) => rows.find((row) => row.material === material && row.isCurrent !== false);

/** Settles, and then compares; gives back draws that are more than three.js'. */
async function same(page, name) {
    const settled = await page.evaluate((name) => settle(name), name);
    assert.equal(settled.off, 0, `${name}: while it was made`);
    let more;
    for (const time of [0, 1.3]) {
        await page.evaluate((time) => set(time), time);
        const found = await page.evaluate((name) => compare(name), name);
        assert.deepEqual([found.off, found.unstable], [0, 0], `${name}, at ${time}`);
        more = found.more;
    }
    return more;
}

/** By recipe: draws that it adds to a frame, materials that it is for, and what its plans have. */
const RECIPES = {
    hoist: { pass: 'hoist', more: 0, done: ['waves', 'side', 'reed'], passes: ['main'], selfTest: 'kept' },
    'early discard': {
        pass: 'early-discard:texture=float',
        more: 18,
        done: ['wobbly', 'waves', 'lit', 'phong', 'side', 'reed', 'many', 'bony', 'batch'],
        passes: ['prepass', 'main'],
        selfTest: null,
    },
    'hoist and a pre-pass': {
        pass: ['hoist', 'depth-prepass'],
        more: 21,
        done: ['wobbly', 'waves', 'lit', 'fence', 'phong', 'side', 'reed', 'many', 'bony', 'batch'],
        passes: ['prepass', 'main'],
        selfTest: 'kept',
    },
    'hoist and early discard': {
        pass: ['hoist', 'early-discard:texture=float'],
        more: 18,
        done: ['wobbly', 'waves', 'lit', 'phong', 'side', 'reed', 'many', 'bony', 'batch'],
        passes: ['prepass', 'main'],
    },
};

for (const [name, { pass, more, done, passes, selfTest }] of Object.entries(RECIPES)) {
    test(name, async (context) => {
        const { page, errors } = await opened(context);
        await part(page, name, { pass });
        assert.equal(await same(page, name), more, 'draws of depth passes');
        const all = await rows(page, name);
        assert.deepEqual(
            all.filter(({ state }) => state === 'done').map(({ material }) => material),
            done,
        );
        for (const row of all) {
            assert.equal(row.pass, 'rewrite');
            if (row.material === 'glass') assert.equal(row.reason, 'transparent');
            else if (row.state === 'refused') assert.ok(row.reason && !REMEDIES[row.code], row.material);
            else {
                assert.deepEqual(row.passes, passes, row.material);
                if (selfTest !== undefined) assert.equal(row.selfTest, selfTest, row.material);
            }
        }
        assert.deepEqual(errors, []);
    });
}

test('a step that does not apply is left out, and one that another does may fall back', async (context) => {
    const { page, errors } = await opened(context);
    await part(page, 'both', { pass: ['hoist', 'depth-prepass'] });
    await part(page, 'discard', { pass: 'early-discard:texture=float', fallback: 'depth-prepass' });
    for (const name of ['both', 'discard']) await same(page, name);
    const { recipe, skipped } = by(await rows(page, 'both'), 'fence');
    assert.equal(recipe, 'hoist + depth-prepass');
    assert.match(skipped.join(), /^hoist: no value/);
    assert.equal(by(await rows(page, 'both'), 'waves').skipped.length, 0);
    const discard = await rows(page, 'discard');
    assert.deepEqual([by(discard, 'fence').state, by(discard, 'fence').recipe], ['done', 'depth-prepass']);
    assert.equal(by(discard, 'phong').recipe, 'early-discard:texture=float');
    assert.deepEqual(errors, []);
});

test('a light and a fog more: no object is missing in any frame', async (context) => {
    const { page, errors } = await opened(context);
    await page.evaluate(() => {
        // Lit, with work that is the same for all fragments.
        const { lit } = materials;
        lit.fragmentShader = lit.fragmentShader
            .replace('uniform vec3 color;', 'uniform vec3 color; uniform float turn;')
            .replace('color * sum', 'color * fract(sin(turn) * cos(turn * 2.0) + exp(sin(turn * 3.0))) * sum');
        lit.uniforms.turn = { value: 1.3 };
        part('hoist', { pass: 'hoist' });
        part('discard', { pass: 'early-discard:texture=float' });
    });
    for (const name of ['hoist', 'discard']) await same(page, name);
    assert.equal(by(await rows(page, 'hoist'), 'lit').state, 'done');
    const count = (await rows(page, 'hoist')).length;
    for (const name of ['hoist', 'discard']) {
        const off = await page.evaluate((name) => {
            const lamp = new THREE.PointLight('#ff8844', 6);
            lamp.position.set(-1, 1, 2);
            scene.add(lamp);
            // The first frame is drawn by the part, before three.js alone had to look for its programs.
            return first(name);
        }, name);
        assert.equal(off, 0, `${name}: the first frame after the change`);
        await same(page, name);
    }
    const after = await rows(page, 'hoist');
    assert.ok(after.length > count, 'another variant of another program');
    assert.equal(by(after, 'lit').state, 'done');
    assert.deepEqual(errors, []);
});

test('of two calls for one material the first draws it', async (context) => {
    const { page, errors } = await opened(context);
    await part(page, 'hoist', { pass: 'hoist' });
    await part(page, 'both', { pass: 'depth-prepass:form=equal' });
    await page.evaluate(() => {
        // Both are on and off together.
        const [hoist, both] = [parts.get('hoist'), parts.get('both')];
        parts.delete('hoist');
        Object.defineProperty(both, 'enabled', {
            get: () => hoist.enabled,
            set: (value) => (hoist.enabled = value),
        });
        Object.defineProperty(both, 'isSettled', { get: () => hoist.isSettled });
        globalThis.hoist = hoist;
    });
    assert.equal(await same(page, 'both'), 0);
    await page.evaluate(() => (hoist.enabled = true));
    const reason = by(await rows(page, 'both'), 'waves').reason;
    assert.match(reason, /^an earlier call/);
    assert.equal(by(await rows(page, 'both'), 'waves').code, 'earlier-call');
    assert.equal(await page.evaluate(() => hoist.report().find(({ material }) => material === 'waves').state), 'done');
    assert.deepEqual(errors, []);
});

test('what a renderer of WebGL cannot draw by is refused, with the reason', async (context) => {
    const { page, errors } = await opened(context);
    const cases = {
        shadow: [{ pass: 'shadow' }, /phase shadow/],
        packed: [{ pass: 'early-discard:texture=packed' }, /format rgba8unorm/],
    };
    for (const [name, [options, reason]] of Object.entries(cases)) {
        await part(page, name, options);
        assert.equal(await same(page, name), 0, name);
        const { state, code, reason: why } = by(await rows(page, name), 'phong');
        assert.deepEqual([state, code], ['refused', 'recipe'], `${name}: ${why}`);
        assert.match(why, reason);
    }
    await page.evaluate(() => part('some', { pass: ({ name }) => (name === 'waves' ? 'hoist' : null) }));
    assert.equal(await same(page, 'some'), 0);
    const some = await rows(page, 'some');
    assert.equal(by(some, 'waves').state, 'done');
    assert.deepEqual([by(some, 'phong').state, by(some, 'phong').reason], ['refused', 'not asked for']);
    const without = await page.evaluate(() =>
        Promise.resolve()
            .then(() => part('none', {}))
            .catch(String),
    );
    assert.match(without, /name a pass/);
    assert.deepEqual(errors, []);
});

for (const parameters of ['antialias', 'reversed']) {
    test(`with ${parameters}`, async (context) => {
        const { page, errors } = await opened(context, parameters);
        await part(page, 'discard', { pass: 'early-discard:texture=float' });
        assert.equal(await same(page, 'discard'), 0);
        assert.match(by(await rows(page, 'discard'), 'phong').reason, /several samples|depth is reversed/);
        await part(page, 'both', { pass: ['hoist', 'depth-prepass'] });
        assert.equal(await same(page, 'both'), 21);
        assert.deepEqual(errors, []);
    });
}

test('dispose leaves nothing', async (context) => {
    const { page } = await opened(context);
    const [before, after] = await page.evaluate(async () => {
        const count = () => ({ ...renderer.info.memory, programs: renderer.info.programs.length });
        renderer.render(scene, camera);
        const before = count();
        part('discard', { pass: ['hoist', 'early-discard:texture=float'] });
        await settle('discard');
        const during = count();
        if (during.programs === before.programs) throw new Error('nothing was made');
        parts.get('discard').dispose();
        renderer.render(scene, camera);
        return [before, count()];
    });
    assert.deepEqual(after, before);
});
