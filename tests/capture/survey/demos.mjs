// Demos of other people as they are, from checkouts in one folder:
//
//     git clone --depth 1 https://github.com/webgpu/webgpu-samples DEMOS/webgpu-samples
//     git clone --depth 1 https://github.com/playcanvas/engine DEMOS/engine
//     git clone --depth 1 https://github.com/N8python/n8ao DEMOS/n8ao

import { build } from 'esbuild';
import { existsSync } from 'node:fs';
import { fileURLToPath } from 'node:url';
import { join } from 'node:path';

const PACKAGES = fileURLToPath(new URL('node_modules', import.meta.url));

const SAMPLES = `a-buffer animometer bitonicSort blending cameras computeBoids cornell cubemap deferredRendering fractalCube
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
                rows.push({ id: `playcanvas-${name}-${api.toLowerCase()}`, title: `PlayCanvas: example ${name}`, path });
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
    if (sample) return { text: await bundled(join(demos, 'webgpu-samples', sample, 'main.ts')) };
    const [, example] = /^engine\/examples\/([a-z]+\/[a-z0-9-]+)\.html$/.exec(path) ?? [];
    if (example) return { text: playcanvas(example) };
    if (path.startsWith('webgpu-samples/assets/')) return { file: join(demos, path.replace('assets/', 'public/assets/')) };
    if (path.startsWith('engine/examples/scripts/')) return { file: join(demos, path.replace('examples/', '')) };
    return { file: join(demos, path) };
}

async function bundled(entry) {
    const { outputFiles } = await build({
        entryPoints: [entry],
        bundle: true,
        write: false,
        format: 'esm',
        target: 'es2022',
        logLevel: 'silent',
        nodePaths: [PACKAGES],
        loader: { '.wgsl': 'text' },
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
