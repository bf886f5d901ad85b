// Builds the page. What it shows of the repository is read here, at build time: the examples are the fixtures, the
// words of a contract's assumptions are those of the reference.

import { execFileSync } from 'node:child_process';
import { readFileSync, statSync } from 'node:fs';
import { fileURLToPath } from 'node:url';
import { defineConfig } from 'vite';
import { onGitHub } from './src/report.js';

const root = new URL('../../', import.meta.url);
const read = (path) => readFileSync(new URL(path, root), 'utf8');

/** Examples: their files, the pass to begin with, and what they show. */
const EXAMPLES = [
    ['A leaf with an alpha test', 'depth-prepass', ['pages/leaf.wgsl']],
    ['A rock without one', 'depth-prepass', ['pages/rock.wgsl']],
    ['An alpha test behind expensive work', 'early-alpha', ['shaders/late-alpha.wgsl']],
    ['Strata: work that changes slowly', 'hoist:budget=0.02', ['shaders/strata.wgsl']],
    ['Noise: a loop of many octaves', 'trim-loop:budget=0.02', ['shaders/noise.wgsl']],
    ['Toon, where two passes are refused', 'early-alpha', ['shaders/toon.wgsl']],
    ['Parquet that writes depth', 'early-discard', ['shaders/parquet.wgsl']],
    ['A probe that stores: nothing applies', 'depth-prepass', ['shaders/heat-probe.wgsl']],
    ['GLSL: a cut-out', 'depth-prepass', ['glsl/cutout.vert', 'glsl/cutout.frag']],
    ['GLSL: Phong', 'early-discard', ['glsl/phong.vert', 'glsl/phong.frag']],
];

function examples() {
    return EXAMPLES.map(([title, recipe, files]) => ({
        title,
        recipe,
        files: files.map((path) => ({ name: path.split('/').at(-1), text: read(`fixtures/${path}`) })),
    }));
}

/** The table of assumptions in the reference: name and sentence. */
function assumptions() {
    const [, table] = read('docs/reference/plan-json.md').split('\n## Assumptions\n');
    const rows = table.matchAll(/^\| `([a-z-]+)` \| (.+) \|$/gm);
    const plain = (text) => text.replace(/\[([^\]]+)\]\([^)]+\)/g, '$1').replaceAll('`', '');
    const found = Object.fromEntries([...rows].map(([, name, text]) => [name, plain(text)]));
    if (!Object.keys(found).length) throw new Error('docs/reference/plan-json.md has no table of assumptions');
    return found;
}

const MODULES = {
    'virtual:examples': () => `export default ${JSON.stringify(examples())};`,
    'virtual:assumptions': () => `export default ${JSON.stringify(assumptions())};`,
};

const repository = {
    name: 'repository',
    resolveId: (id) => (id in MODULES ? `\0${id}` : undefined),
    load: (id) => MODULES[id.slice(1)]?.(),
};

/** What the clone that is built was cloned from, or nothing. */
function origin() {
    try {
        const options = { cwd: fileURLToPath(root), encoding: 'utf8', stdio: ['ignore', 'pipe', 'ignore'] };
        return onGitHub(execFileSync('git', ['remote', 'get-url', 'origin'], options));
    } catch {
        return '';
    }
}

/** Where issues are opened: `owner/name`, as the build or GitHub's own builds are told, or as the clone has it. */
const issues = process.env.PRESHADE_REPOSITORY ?? process.env.GITHUB_REPOSITORY ?? origin();

export default defineConfig({
    // Relative, so that the site works below any path.
    base: './',
    plugins: [repository],
    define: {
        __MODULE_BYTES__: statSync(new URL('hosts/web/preshade.wasm', root)).size,
        __REPOSITORY__: JSON.stringify(issues),
    },
    build: { target: 'es2022', chunkSizeWarningLimit: 900, assetsInlineLimit: 0, license: { fileName: 'licenses.md' } },
    worker: { format: 'es' },
    optimizeDeps: { exclude: ['preshade'] },
    server: { fs: { allow: [fileURLToPath(root)] } },
});
