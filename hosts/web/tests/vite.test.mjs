// The plugin in vite: a module for each variant, errors with their line, and updates.

import assert from 'node:assert/strict';
import { mkdirSync, readFileSync, writeFileSync } from 'node:fs';
import { join } from 'node:path';
import test from 'node:test';
import { pathToFileURL } from 'node:url';
import { build, createServer } from 'vite';
import { rewrite } from '../sync.js';
import preshade from '../vite.js';
import { FIXTURES, folder, read } from './support.mjs';

/** A project with these files. */
function project(context, files) {
    const root = folder(context);
    for (const [name, text] of Object.entries(files)) {
        mkdirSync(join(root, name, '..'), { recursive: true });
        writeFileSync(join(root, name), text);
    }
    return root;
}

const bundle = (root, options) =>
    build({
        root,
        logLevel: 'silent',
        plugins: [preshade(options)],
        build: { lib: { entry: 'main.js', formats: ['es'], fileName: () => 'out.mjs' }, minify: false },
    });

const LEAF = read(FIXTURES, 'agree/leaf.wgsl');

test('each variant of a shader is a module', async (context) => {
    const root = project(context, {
        'shaders/leaf.wgsl': LEAF,
        'shaders/phong.vert': read(FIXTURES, 'glsl/phong.vert'),
        'shaders/phong.frag': read(FIXTURES, 'glsl/phong.frag'),
        'main.js': `
            import prepass, { plan } from './shaders/leaf.wgsl?preshade=depth-prepass';
            import shadow from './shaders/leaf.wgsl?preshade=shadow&emit=wgsl,glsl-es';
            import phong from './shaders/phong.vert?preshade=depth-prepass&emit=glsl-es&name=lit';
            export { prepass, plan, shadow, phong };`,
    });
    await bundle(root, {});
    const made = await import(pathToFileURL(join(root, 'dist/out.mjs')));
    const leaf = [{ name: 'shaders/leaf.wgsl', text: LEAF }];
    const expected = rewrite(leaf, { pass: 'depth-prepass' });
    assert.deepEqual(made.plan, expected.plan);
    for (const { name, text } of expected.files.filter(({ name }) => name.endsWith('.wgsl')))
        assert.equal(made.prepass.files[name], text);
    assert.match(made.shadow.recipe, /^shadow/);
    assert.ok(Object.keys(made.shadow.files).some((name) => name.endsWith('.es.vert')));
    assert.equal(made.phong.material, 'lit');
    assert.match(made.phong.recipe, /^depth-prepass/);
});

test('errors have a file and a line, and refusals are errors where that is asked for', async (context) => {
    const main = `export { default } from './broken.wgsl?preshade=depth-prepass';`;
    const broken = LEAF.replace('@fragment', 'let broken = ;\n@fragment');
    const root = project(context, { 'main.js': main, 'broken.wgsl': broken });
    const error = await bundle(root, {}).then(
        () => assert.fail('it builds'),
        (error) => error,
    );
    const told = `${error.message}\n${JSON.stringify(error.errors ?? error)}`;
    assert.match(told, /broken\.wgsl/);
    const line = broken.split('\n').findIndex((text) => text.startsWith('let broken')) + 1;
    assert.match(told, new RegExp(`:${line}:|"line":${line}\\b`));
    writeFileSync(join(root, 'broken.wgsl'), LEAF);
    await assert.rejects(bundle(root, { strict: true, blend: 'alpha' }), /blended/);
    await bundle(root, { blend: 'alpha' });
    assert.match(readFileSync(join(root, 'dist/out.mjs'), 'utf8'), /blended/);
});

test('an edit of an included file makes the variant anew', async (context) => {
    const body = 'out vec4 c;\nvoid main() { c = tint(); }\n';
    const root = project(context, {
        'm.vert': '#version 300 es\nin vec3 p;\nvoid main() { gl_Position = vec4(p, 1.0); }\n',
        'm.frag': `#version 300 es\nprecision highp float;\n#include "lib/tint.glsl"\n${body}`,
        'lib/tint.glsl': 'vec4 tint() { return vec4(0.25); }\n',
    });
    const server = await createServer({
        root,
        logLevel: 'silent',
        plugins: [preshade({ emit: 'glsl-es' })],
        server: { middlewareMode: true, ws: false },
        optimizeDeps: { noDiscovery: true },
    });
    context.after(() => server.close());
    const load = async () => (await server.transformRequest('/m.vert?preshade=depth-prepass'))?.code ?? '';
    assert.match(await load(), /0\.25/);
    const changed = new Promise((resolve) => server.watcher.on('change', resolve));
    writeFileSync(join(root, 'lib/tint.glsl'), 'vec4 tint() { return vec4(0.75); }\n');
    await changed;
    for (let i = 0; i < 100 && !/0\.75/.test(await load()); i++) await new Promise((done) => setTimeout(done, 50));
    assert.match(await load(), /0\.75/);
});
