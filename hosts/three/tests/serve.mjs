// A server of this package and of `preshade`, for pages in a browser. Each page is a module in tests/pages, or a text given to `serve`, under an import map.

import { createServer } from 'node:http';
import { readFile } from 'node:fs/promises';
import { extname, join, normalize } from 'node:path';
import { fileURLToPath } from 'node:url';

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

/** What pages may import. `#start` is preshade's own. */
const IMPORTS = {
    three: '/three/node_modules/three/build/three.module.js',
    'three/webgpu': '/three/node_modules/three/build/three.webgpu.js',
    'three/tsl': '/three/node_modules/three/build/three.tsl.js',
    'three/addons/': '/three/node_modules/three/examples/jsm/',
    'three/examples/jsm/': '/three/node_modules/three/examples/jsm/',
    preshade: '/web/index.js',
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

/** Resolves to the server and its address. `ADDRESS/page/NAME` is the page of tests/pages/NAME.js. `imports` are added to the import map. */
export async function serve({ port = 0, imports = {} } = {}) {
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
            const body = await readFile(join(HOSTS, path));
            const type = TYPES[extname(path)] ?? 'application/octet-stream';
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
