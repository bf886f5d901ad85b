// A server of this package and of `preshade`, for pages in a browser. Each page is a module in tests/pages, or a text given to `serve`, under an import map.

import { createServer } from 'node:http';
import { readFile } from 'node:fs/promises';
import { extname, join, normalize } from 'node:path';
import { fileURLToPath } from 'node:url';
// The module may have been built, or put there, a moment ago.
import '../../web/version.mjs';

export const PACKAGE = fileURLToPath(new URL('..', import.meta.url));
const HOSTS = join(PACKAGE, '..');
const TYPES = {
    '.css': 'text/css',
    '.html': 'text/html; charset=utf-8',
    '.js': 'text/javascript',
    '.json': 'application/json',
    '.mjs': 'text/javascript',
    '.wasm': 'application/wasm',
};

/** What pages import of three.js. `folder`: of node_modules, where a version of it is. */
export const threeOf = (folder) => ({
    three: `/three/node_modules/${folder}/build/three.module.js`,
    'three/webgpu': `/three/node_modules/${folder}/build/three.webgpu.js`,
    'three/tsl': `/three/node_modules/${folder}/build/three.tsl.js`,
    'three/addons/': `/three/node_modules/${folder}/examples/jsm/`,
    'three/examples/jsm/': `/three/node_modules/${folder}/examples/jsm/`,
});

/** What pages may import. `THREE` names the folder of another version, as `three-oldest`. `#start` is preshade's own. */
const IMPORTS = {
    ...threeOf(process.env.THREE ?? 'three'),
    preshade: '/web/index.js',
    'preshade/version': '/web/version.js',
    '#start': '/web/start-browser.js',
    'preshade-three': '/three/index.js',
    'preshade-three/fiber': '/three/fiber.js',
};

const page = (
    script,
    imports,
) => `<!doctype html><meta charset="utf-8" /><title>preshade</title><link rel="icon" href="data:," />
<style>body { margin: 0; background: #222 }</style>
<script type="importmap">${JSON.stringify({ imports: { ...IMPORTS, ...imports } })}</script>
<script type="module" src="${script}"></script>`;

/** Resolves to the server and its address. `ADDRESS/page/NAME` is the page of tests/pages/NAME.js. `imports` are added to the import map. `root`: the folder of all else. */
export async function serve({ port = 0, imports = {}, root = HOSTS } = {}) {
    const server = createServer(async (request, response) => {
        const path = normalize(decodeURIComponent(new URL(request.url, 'http://localhost').pathname));
        const headers = { 'cache-control': 'no-store' };
        const name = /^\/page\/([\w/-]+)$/.exec(path)?.[1];
        if (name) {
            response.writeHead(200, { ...headers, 'content-type': TYPES['.html'] });
            response.end(page(`/three/tests/pages/${name}.js`, imports));
            return;
        }
        try {
            const file = join(root, path.endsWith('/') ? `${path}index.html` : path);
            const body = await readFile(file);
            const type = TYPES[extname(file)] ?? 'application/octet-stream';
            response.writeHead(200, { ...headers, 'content-type': type }).end(body);
        } catch {
            response.writeHead(404).end('not found');
        }
    });
    await new Promise((resolve) => server.listen(port, '127.0.0.1', resolve));
    return { server, address: `http://127.0.0.1:${server.address().port}`, close: () => server.close() };
}

if (process.argv[1] === fileURLToPath(import.meta.url)) {
    const { address } = await serve({ port: Number(process.argv[2] ?? 8080) });
    console.log(`${address}/page/NAME`);
}
