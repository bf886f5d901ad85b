// What three.js's passes write by preshade are the values of the authors' whole programs: not one differs.

import assert from 'node:assert/strict';
import test from 'node:test';
import { launch, open } from './browser.mjs';
import { serve } from './serve.mjs';

const ON = { moved: true, rows: 1 };
const OFF = { isOwn: true, rows: 0, differ: 0 };
/** What the scenarios of pages find. */
const expected = {
    'a page that swaps a material'({ differ, rows, drawn }) {
        assert.deepEqual({ differ, rows }, { differ: 0, rows: 0 });
        assert.ok(drawn);
    },
    'a page that swaps a material in onBeforeRender'({ differ, rows, drawn }) {
        assert.deepEqual({ differ, rows }, { differ: 0, rows: 0 });
        assert.ok(drawn);
    },
    'a pass that swaps materials, and a page that swaps them too'({ differ, checks, moved, states }) {
        assert.equal(differ, 0);
        assert.equal(checks, 3);
        assert.ok(moved > 0);
        assert.deepEqual(states, ['done']);
    },
    'one overriding material, whose colour changes from object to object'({ differ, states }) {
        assert.equal(differ, 0);
        assert.deepEqual(states, ['done']);
    },
    'overriding materials that are transparent or in a fog'({ differ, reasons }) {
        assert.deepEqual(differ, [0, 0, 0, 0]);
        for (const [reason, ...more] of reasons) {
            assert.match(reason, /^it is not known what Mesh(Normal|Basic)Material writes/);
            assert.equal(more.length, 0);
        }
    },
    'back faces of a program that does not turn its normal'({ state, most, pixels }) {
        assert.equal(state, 'done');
        assert.ok(pixels > 1000, `${pixels}`);
        // As three.js turns it; a normal that is not turned is off by up to 1.
        assert.ok(most < 1e-3, `${most}`);
    },
    'where normals come from'({ found, asked }) {
        assert.equal(asked, 1);
        const row = (state, normals) => ({ state, normals });
        const program = row('done', 'of the program, in view axes');
        assert.deepEqual(
            found.map(({ state, normals }) => row(state, normals)),
            [program, ...[1, 2, 3].map(() => row('done', 'of faces')), row('refused', null), program],
        );
        const [moved, faces, asFunction, byDefault, refused, named] = found;
        for (const { note } of [moved, named]) assert.match(note, /moves vertices and leaves their normals/);
        for (const { note } of [faces, asFunction, byDefault, refused]) assert.equal(note, null);
        for (const { differ } of [moved, refused, named]) assert.equal(differ, 0);
        // A normal of a face is a difference of two positions, and the two ways to those round differently.
        for (const { most } of [faces, asFunction]) assert.ok(most < 0.01, `${most}`);
        assert.ok(byDefault.most > 0.1, 'faces look like the vertices’ normals');
        assert.equal(refused.code, 'no-normal');
    },
    'a pass that is disposed of, or let go'({ on, off, disposed, disposedAfter }) {
        assert.deepEqual(
            on.map(({ moved, rows }) => ({ moved: moved > 0, rows })),
            [ON, ON, ON, ON],
        );
        assert.deepEqual(off, [OFF, OFF, OFF]);
        assert.deepEqual([disposed, disposedAfter], [1, 1]);
    },
};

test('passes that override materials', async (context) => {
    const { address, close } = await serve();
    context.after(close);
    const browser = await launch();
    context.after(() => browser.close());
    const { page, errors } = await open(browser, `${address}/page/override`);
    for (const name of await page.evaluate(() => globalThis.names)) {
        await context.test(name, async (context) => {
            const found = await page.evaluate((name) => globalThis.runPass(name), name);
            const { same, renders, differ, depth, moved, restored, report } = found;
            context.diagnostic(`${differ} values differ in ${renders} renders; three.js's own differ in ${moved}`);
            assert.ok(same && renders > 0);
            assert.ok([...differ, ...depth].every((count) => count === 0));
            assert.ok(
                moved.every((count) => count > 0),
                'three.js draws it right by itself',
            );
            assert.ok(restored.every((count) => count === 0));
            assert.ok(
                report.every(({ state }) => ['done', 'same'].includes(state)),
                JSON.stringify(report),
            );
            // Those that push vertices, and not those that cut holes or bend their normals too.
            if (name === 'GTAOPass') assert.equal(report.filter(({ note }) => note).length, 2);
            assert.deepEqual(errors.splice(0), []);
        });
    }
    for (const [name, words] of [
        ['world', 'of the program, in world axes'],
        ['object', 'of the program, in object axes'],
        ['none', 'of faces'],
    ]) {
        await context.test(`normals: ${words}`, async (context) => {
            const found = await page.evaluate((name) => globalThis.runAxes(name), name);
            const { state, normals, called, most, differ, moved } = found;
            assert.equal(called, 'occlusion MeshNormalMaterial');
            context.diagnostic(`${differ} values differ, by ${most} at most; three.js's own differ in ${moved}`);
            assert.equal(state, 'done');
            assert.equal(normals, words);
            assert.ok(moved > 0);
            // A normal of a face is a difference of two positions, and the two ways to those round differently.
            if (name === 'none') assert.ok(most < 0.01);
            else assert.equal(differ, 0);
            assert.deepEqual(errors.splice(0), []);
        });
    }
    for (const [name, check] of Object.entries(expected)) {
        await context.test(name, async () => {
            check(await page.evaluate((name) => globalThis.runScenario(name), name));
            assert.deepEqual(errors.splice(0), []);
        });
    }
});
