// Demos of other people as they are, from checkouts in one folder:
//
//     git clone --depth 1 https://github.com/webgpu/webgpu-samples DEMOS/webgpu-samples
//     git clone --depth 1 https://github.com/playcanvas/engine DEMOS/engine
//     git clone --depth 1 https://github.com/N8python/n8ao DEMOS/n8ao

import { build } from 'esbuild';
import { existsSync } from 'node:fs';
import { readFile } from 'node:fs/promises';
import { fileURLToPath } from 'node:url';
import { dirname, join } from 'node:path';

const PACKAGES = fileURLToPath(new URL('node_modules', import.meta.url));

const SAMPLES =
    `a-buffer animometer bitonicSort blending cameras computeBoids cornell cubemap deferredRendering fractalCube
    gameOfLife generateMipmap helloTriangleMSAA imageBlur instancedCube normalMap occlusionQuery particles points
    primitivePicking renderBundles reversedZ rotatingCube samplerParameters shadowMapping skinnedMesh stencilMask
    textRenderingMsdf texturedCube transparentCanvas twoCubes volumeRenderingTexture3D wireframe`.split(/\s+/);
const PLAYCANVAS = `graphics/area-lights graphics/clustered-lighting graphics/hierarchy graphics/instancing-basic
    graphics/lights graphics/mesh-morph graphics/model-asset graphics/multi-render-targets graphics/particles-spark
    graphics/reflection-planar graphics/shadow-cascades graphics/sky`.split(/\s+/);

export function list(demos) {
    const rows = [];
    if (existsSync(join(demos, 'webgpu-samples'))) {
        for (const name of SAMPLES) {
            const path = `/demos/webgpu-samples/sample/${name}/index.html`;
            rows.push({ id: `samples-${name}`, title: `webgpu-samples: ${name}`, path });
        }
    }
    if (existsSync(join(demos, 'engine'))) {
        for (const example of PLAYCANVAS) {
            const name = example.split('/')[1];
            for (const api of ['WebGL', 'WebGPU']) {
                const path = `/demos/engine/examples/${example}.html?api=${api}`;
                rows.push({
                    id: `playcanvas-${name}-${api.toLowerCase()}`,
                    title: `PlayCanvas: example ${name}`,
                    path,
                });
            }
        }
    }
    if (existsSync(join(demos, 'n8ao'))) {
        rows.push({ id: 'n8ao-demo', title: 'n8ao: its demo', path: '/demos/n8ao/example/index.html' });
    }
    return rows;
}

/** Where a file of a demo is, or its text. */
export async function demoFile(demos, path) {
    const [, sample] = /^webgpu-samples\/(sample\/.*)\/main\.js$/.exec(path) ?? [];
    if (sample) return { text: await bundled(demos, join(demos, 'webgpu-samples', sample, 'main.ts')) };
    const [, example] = /^engine\/examples\/([a-z]+\/[a-z0-9-]+)\.html$/.exec(path) ?? [];
    if (example) return { text: playcanvas(example) };
    if (path.startsWith('webgpu-samples/assets/'))
        return { file: join(demos, path.replace('assets/', 'public/assets/')) };
    if (/^(luma\.gl|threejs-procedural-planets)\/.*\.html$/.test(path)) return { text: await vite(demos, path) };
    if (path.endsWith('.bundle.js'))
        return { text: await bundled(demos, join(demos, path.replace(/\.bundle\.js$/, '.js'))) };
    if (path.startsWith('engine/examples/scripts/')) return { file: join(demos, path.replace('examples/', '')) };
    return { file: join(demos, path) };
}

/** Packages that a repository holds come from its sources. */
const sources = (demos) => ({
    name: 'sources',
    setup(build) {
        const { resolve } = build;
        build.onResolve({ filter: /^@luma\.gl\// }, ({ path, kind }) => {
            const [, module, ...rest] = path.split('/');
            return resolve(`./${[module, 'src', ...rest].join('/')}`, {
                kind,
                resolveDir: join(demos, 'luma.gl/modules'),
            });
        });
        build.onResolve({ filter: /^three\/.*\.module$/ }, ({ path, kind, resolveDir }) =>
            resolve(`${path}.js`, { kind, resolveDir }),
        );
    },
});

/** A page for Vite: each script of its own is bundled. */
async function vite(demos, path) {
    const file = join(demos, path);
    const html = await readFile(file, 'utf8');
    const named = html.replace(/(<script type="module" src=")[./]*([^":]*\.)js"/g, '$1./$2bundle.js"');
    const [whole, script] = /<script type="module">(.*?)<\/script>/s.exec(named) ?? [];
    if (!whole) return named;
    const text = await bundled(demos, { stdin: { contents: script, resolveDir: dirname(file) } });
    return named.replace(whole, () => `<script type="module">${text.replaceAll('</script', '<\\/script')}</script>`);
}

/** The bundle of a file, or of what esbuild's options name. */
async function bundled(demos, entry) {
    const { outputFiles } = await build({
        ...(typeof entry === 'string' ? { entryPoints: [entry] } : entry),
        bundle: true,
        write: false,
        format: 'esm',
        target: 'es2022',
        logLevel: 'silent',
        nodePaths: [PACKAGES],
        loader: { '.wgsl': 'text' },
        plugins: [sources(demos)],
    });
    return outputFiles[0].text;
}

/** What the examples' own page does, without its editor. */
function playcanvas(example) {
    return `<!doctype html><html><head><base href="/demos/engine/examples/"><title>${example}</title>
<style>body { margin: 0; overflow: hidden }</style>
<script type="importmap">{"imports": {
    "playcanvas": "/npm/playcanvas/build/playcanvas.mjs",
    "playcanvas/scripts/": "./scripts/",
    "@playcanvas/observer": "/npm/@playcanvas/observer/dist/index.mjs",
    "examples/assets/": "./assets/",
    "examples/context": "data:text/javascript,${encodeURIComponent(`import { Observer } from '@playcanvas/observer';
export const data = new Observer({});
export const deviceType = new URLSearchParams(location.search).get('api') === 'WebGPU' ? 'webgpu' : 'webgl2';`)}"
}}</script></head><body><canvas id="application-canvas"></canvas>
<script type="module">import * as pc from 'playcanvas'; globalThis.pc = pc;</script>
<script type="module" src="./src/examples/${example}.example.mjs"></script></body></html>`;
}
