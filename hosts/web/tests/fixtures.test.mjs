// The same bytes, the same refusals and the same errors as the native program, for every fixture.

import assert from 'node:assert/strict';
import { dirname, join } from 'node:path';
import test from 'node:test';
import { PreshadeSync } from '../sync.js';
import { below, FIXTURES, folder, materials, native, read } from './support.mjs';

const RECIPES = [
    ['depth-prepass'],
    ['early-discard:texture=float'],
    ['shadow'],
    ['hoist:budget=0.05'],
    ['outputs:write=depth+normal'],
    ['visibility-buffer'],
    ['early-alpha', 'depth-prepass:form=equal'],
];
const EMIT = ['wgsl', 'glsl-es'];

/** The order of keys does not count. */
const plain = (value) => JSON.parse(JSON.stringify(value));

for (const pass of RECIPES) {
    test(`every fixture, ${pass.join(' + ')}`, async (context) => {
        const out = folder(context);
        const passes = pass.flatMap((p) => ['--pass', p]);
        const options = ['--emit', EMIT.join(','), '--out-dir', out, '--format', 'json'];
        const run = await native(['rewrite', '.', ...passes, ...options], { cwd: FIXTURES });
        assert.ok([0, 2].includes(run.status), run.stderr);
        const report = JSON.parse(run.stdout);
        const written = new Set(below(out));
        const compiler = new PreshadeSync();
        const count = { same: 0, files: 0, rewritten: 0, refused: 0, failed: 0 };
        for (const paths of materials()) {
            const sources = paths.map((path) => ({ name: `./${path}`, text: read(FIXTURES, path) }));
            let variant;
            try {
                variant = compiler.rewrite(sources, { pass, emit: EMIT });
            } catch (error) {
                assert.notEqual(error.code, 'panic', error.message);
                const isSaid = report.errors.some((said) => said.includes(error.rendered));
                // The native program has more front ends.
                const isOthers = error.rendered.includes('which this build cannot read');
                assert.ok(isSaid || isOthers || error.code === 'no-entry-point', `${paths}: ${error.rendered}`);
                count.failed += 1;
                continue;
            }
            for (const { name, text } of variant.files) {
                const path = join(dirname(paths[0]), name);
                assert.ok(written.delete(path), `the native program writes no ${path}`);
                assert.equal(text, read(out, path), path);
                count.files += 1;
            }
            const isIt = ({ material, files }) =>
                material === variant.material &&
                files.every(({ path }) => dirname(path) === join(out, dirname(paths[0])));
            const own = report.materials.find((m) => m.files.length && isIt(m)) ?? report.materials.find(isIt);
            assert.equal(variant.recipe, own.recipe, `${paths}`);
            assert.deepEqual(plain(variant.contract), own.contract, `${paths}`);
            const refusals = variant.refusals.map(({ place, rendered, ...refusal }) => ({
                ...refusal,
                location: place,
            }));
            assert.deepEqual(plain(refusals), own.refusals, `${paths}`);
            count.same += 1;
            count.rewritten += variant.recipe !== '';
            count.refused += refusals.length;
        }
        assert.deepEqual([...written], [], 'files that the native program writes alone');
        assert.ok(count.same > 100 && count.rewritten > 0, JSON.stringify(count));
        context.diagnostic(JSON.stringify(count));
    });
}
