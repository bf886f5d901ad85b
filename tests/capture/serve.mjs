// A server of the pages of `pages/`, bundled with the libraries they import.

import { build } from 'esbuild';
import { createServer } from 'node:http';
import { fileURLToPath } from 'node:url';

const PAGES = fileURLToPath(new URL('pages/', import.meta.url));
const HTML = (name) => `<!doctype html><title>${name}</title><link rel="icon" href="data:,"><body style="margin:0">
<canvas id="canvas" width="320" height="240" style="display:block"></canvas>
<script src="/${name}.js"></script>`;

/** Resolves to an address; a page is at `/NAME`. */
export async function serve() {
    const server = createServer(async (request, response) => {
        const [, name, script] = /^\/([a-z0-9-]+)(\.js)?$/.exec(request.url.split('?')[0]) ?? [];
        if (!name) return response.writeHead(404).end();
        response.setHeader('cache-control', 'no-store');
        if (name === 'empty') return response.setHeader('content-type', 'text/html').end('<!doctype html>');
        if (!script) return response.setHeader('content-type', 'text/html').end(HTML(name));
        try {
            const { outputFiles } = await build({
                entryPoints: [`${PAGES}${name}.js`],
                bundle: true,
                write: false,
                format: 'iife',
                logLevel: 'silent',
                define: { 'process.env.NODE_ENV': '"production"' },
            });
            response.setHeader('content-type', 'text/javascript').end(outputFiles[0].contents);
        } catch (error) {
            response.writeHead(500).end(`document.title = ${JSON.stringify(String(error))}`);
        }
    });
    await new Promise((resolve) => server.listen(0, '127.0.0.1', resolve));
    return { server, address: `http://127.0.0.1:${server.address().port}` };
}
