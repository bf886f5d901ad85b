// A server of this folder's files, for the page and its test. `npm start` prints where.

import { createServer } from 'node:http';
import { readFile } from 'node:fs/promises';
import { extname, join, normalize } from 'node:path';
import { fileURLToPath } from 'node:url';

const ROOT = fileURLToPath(new URL('.', import.meta.url));
const TYPES = {
    '.css': 'text/css',
    '.html': 'text/html; charset=utf-8',
    '.js': 'text/javascript',
    '.json': 'application/json',
    '.mjs': 'text/javascript',
    '.wasm': 'application/wasm',
};

/** Resolves to the server and its address. */
export async function serve(port = 0) {
    const server = createServer(async (request, response) => {
        const path = normalize(decodeURIComponent(new URL(request.url, 'http://localhost').pathname));
        const file = join(ROOT, path.endsWith('/') ? `${path}index.html` : path);
        try {
            const body = await readFile(file);
            response.writeHead(200, {
                'content-type': TYPES[extname(file)] ?? 'text/plain; charset=utf-8',
                'cache-control': 'no-store',
            });
            response.end(body);
        } catch {
            response.writeHead(404).end('not found');
        }
    });
    await new Promise((resolve) => server.listen(port, '127.0.0.1', resolve));
    return { server, address: `http://127.0.0.1:${server.address().port}` };
}

if (process.argv[1] === fileURLToPath(import.meta.url)) {
    const { address } = await serve(Number(process.argv[2] ?? 8080));
    console.log(`${address}/`);
}
