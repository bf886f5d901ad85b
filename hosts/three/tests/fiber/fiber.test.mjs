// The component in a page of React, in Chromium. `npm ci` in this folder first.

import assert from 'node:assert/strict';
import test from 'node:test';
import { fileURLToPath } from 'node:url';
import { build } from 'esbuild';
import { launch, open } from '../browser.mjs';
import { serve } from '../serve.mjs';

const here = (name) => fileURLToPath(new URL(name, import.meta.url));

test('shadows, pre-pass and velocities by one component; taken away, nothing is left', async (context) => {
    await build({
        entryPoints: [here('page.js')],
        outfile: here('../pages/fiber-bundle.js'),
        bundle: true,
        format: 'esm',
        // The canvas is WebGL's.
        external: ['three', 'preshade', '*/webgpu/host.js'],
        define: { 'process.env.NODE_ENV': '"development"' },
        nodePaths: [here('node_modules')],
        logLevel: 'error',
    });
    const { address, close } = await serve();
    context.after(close);
    const browser = await launch();
    context.after(() => browser.close());
    const { page, errors } = await open(browser, `${address}/page/fiber-bundle`);

    const state = (pass, material) =>
        page.waitForFunction(
            ([pass, material]) =>
                found.reports
                    .at(-1)
                    ?.some((row) => row.pass === pass && row.material === material && row.state === 'done'),
            [pass, material],
        );
    await state('prepass', 'waves');
    await state('prepass', 'wall');
    await state('velocity', 'waves');
    await state('shadow', 'waves');
    // The sphere moves, and the wall behind it does not.
    const [middle, corner] = await page.evaluate(async () => {
        const quad = new THREE.Mesh(
            new THREE.PlaneGeometry(2, 2),
            new THREE.RawShaderMaterial({
                glslVersion: THREE.GLSL3,
                uniforms: { velocity: { value: made.velocity.texture } },
                vertexShader: 'in vec3 position; void main() { gl_Position = vec4(position, 1.0); }',
                fragmentShader:
                    'precision highp float; uniform highp sampler2D velocity; out vec4 color; void main() { color = texelFetch(velocity, ivec2(gl_FragCoord.xy), 0); }',
            }),
        );
        quad.frustumCulled = false;
        const { width, height } = made.velocity.texture.image;
        const target = new THREE.WebGLRenderTarget(width, height, { type: THREE.FloatType });
        const at = (x, y) =>
            renderer.readRenderTargetPixels(target, x, y, 1, 1, values) ?? Math.hypot(values[0], values[1]);
        const values = new Float32Array(4);
        let most = [0, 0];
        for (let i = 0; i < 8; i++) {
            await new Promise((resolve) => requestAnimationFrame(resolve));
            renderer.setRenderTarget(target);
            renderer.render(quad, new THREE.OrthographicCamera());
            renderer.setRenderTarget(null);
            most = [
                Math.max(most[0], at(Math.floor(width * 0.62), Math.floor(height * 0.42))),
                Math.max(most[1], at(2, 2)),
            ];
        }
        return most;
    });
    assert.ok(middle > 1e-4, `${middle}`);
    assert.equal(corner, 0);

    // Other parts: the component begins anew, and not when it is rendered again with the same.
    const begun = await page.evaluate(() => found.ready);
    await page.evaluate(() => {
        const waves = scene.children.find(({ isMesh, material }) => isMesh && material.name === 'waves').material;
        const normals = new THREE.MeshNormalMaterial();
        const pass = {
            name: 'normals',
            render() {
                scene.overrideMaterial = normals;
                renderer.render(scene, camera);
                scene.overrideMaterial = null;
            },
        };
        const own = { name: 'own', render: pass.render };
        globalThis.passes = [pass, own];
        const of = () => ({
            override: [pass, [own, { name: 'of programs', normals: 'program' }]],
            prepass: { materials: [waves] },
            rewrite: { pass: ({ name }) => (name === 'wall' ? 'depth-prepass' : null) },
            velocity: { camera },
            options: { cache: false, wasm: new URL('/web/preshade.wasm', location.href) },
        });
        set({ of });
    });
    await page.waitForFunction((begun) => found.ready > begun, begun);
    assert.deepEqual(await page.evaluate(() => Object.keys(made)), ['preshade', 'prepass', 'rewrite', 'velocity']);
    await page.evaluate(() => passes.forEach((pass) => pass.render()));
    await state('rewrite', 'wall');
    const rows = await page.waitForFunction(() => {
        for (const pass of passes) pass.render();
        const rows = found.reports.at(-1).filter((row) => row.pass === 'override' && row.material === 'waves');
        return rows.length >= 2 && rows.every(({ state }) => state === 'done' || state === 'refused') && rows;
    });
    // Its text has no normal, and the options of the second pass ask for that of the program.
    assert.deepEqual(
        Object.fromEntries((await rows.jsonValue()).map(({ of, state, normals }) => [of, [state, normals]])),
        { normals: ['done', 'of faces'], 'of programs': ['refused', null] },
    );
    const [ready, renders] = await page.evaluate(() => [found.ready, found.renders]);
    for (let i = 1; i <= 3; i++) {
        await page.evaluate(() => again());
        await page.waitForFunction((renders) => found.renders >= renders, renders + i);
    }
    const drawn = await page.evaluate(() => found.frames);
    await page.waitForFunction((drawn) => found.frames > drawn + 3, drawn);
    assert.equal(await page.evaluate(() => found.ready), ready);

    // Fewer parts.
    const before = await page.evaluate(() => found.ready);
    await page.evaluate(() => set({ of: () => ({ prepass: true }) }));
    await page.waitForFunction((before) => found.ready > before, before);
    assert.deepEqual(await page.evaluate(() => Object.keys(made)), ['preshade', 'prepass']);

    await page.evaluate(() => show(false));
    await page.waitForFunction(
        () => !globalThis.renderer.info.programs.some(({ cacheKey }) => cacheKey.includes('preshade ')),
    );
    // The page goes on.
    const frames = await page.evaluate(() => found.frames);
    await page.waitForFunction((frames) => found.frames > frames + 3, frames);
    assert.deepEqual(await page.evaluate(() => found.errors), []);
    // @react-three/fiber's own.
    assert.deepEqual(
        errors.filter((error) => !error.includes('THREE.Clock')),
        [],
    );
});
