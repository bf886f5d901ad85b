// A server of the pages of `pages/`, each bundled with the libraries it imports; `/npm/` are files of packages.

import { build } from 'esbuild';
import { existsSync } from 'node:fs';
import { readFile, readdir } from 'node:fs/promises';
import { createServer } from 'node:http';
import { extname, join, normalize } from 'node:path';
import { fileURLToPath } from 'node:url';
import { demoFile } from './demos.mjs';

const HERE = fileURLToPath(new URL('.', import.meta.url));
const TYPES = {
    '.js': 'text/javascript',
    '.mjs': 'text/javascript',
    '.html': 'text/html',
    '.css': 'text/css',
    '.json': 'application/json',
    '.wasm': 'application/wasm',
    '.png': 'image/png',
    '.jpg': 'image/jpeg',
    '.svg': 'image/svg+xml',
    '.wgsl': 'text/plain',
};

const HTML = (name, clock) => `<!doctype html><title>${name}</title><link rel="icon" href="data:,">
<style>body { margin: 0; overflow: hidden } #canvas { display: block }</style><body>
<canvas id="canvas" width="320" height="240"></canvas><script>${clock}</script>
<script type="module" src="/${name}.js"></script>`;

/** `{name, title, apis}` of each page: its first line says what it shows, its second the APIs it is drawn with. */
export async function pages() {
    const list = [];
    for (const file of (await readdir(`${HERE}pages`)).sort()) {
        const text = await readFile(`${HERE}pages/${file}`, 'utf8');
        const [, title] = /^\/\/ (.*)\n/.exec(text) ?? [];
        const [, apis] = /^.*\n\/\/ Drawn with (.*)\.\n/.exec(text) ?? [];
        if (apis) list.push({ name: file.replace('.js', ''), title, apis: apis.split(' and ') });
    }
    return list;
}

/** A page of a demo: packages come from here, and it is loaded a while after it says so. */
const DEMO = `addEventListener('load', () => setTimeout(() => (globalThis.loaded = true), 6000));`;
const demo = (html, prelude, loaded) => html.replace(/<head[^>]*>|^/i, `$&<script>${loaded}${prelude}</script>`);

/** Text with the addresses of packages here. */
const local = (text) =>
    text
        .replace(/https:\/\/cdn\.jsdelivr\.net\/npm\/((?:@[^/]+\/)?[^@/]+)@[^/]+\//g, '/npm/$1/')
        .replaceAll('./node_modules/', '/npm/');

/** Resolves to an address; a page is at `/NAME?api=webgpu`. */
export async function serve({ clock = true, demos, loaded = DEMO } = {}) {
    const prelude = clock ? await readFile(`${HERE}clock.js`, 'utf8') : '';
    const bundles = new Map();
    const bundle = async (name) => {
        const { outputFiles } = await build({
            entryPoints: [`${HERE}pages/${name}.js`],
            bundle: true,
            write: false,
            format: 'esm',
            logLevel: 'silent',
            loader: { '.wgsl': 'text', '.glsl': 'text' },
            define: { 'process.env.NODE_ENV': '"production"', global: 'globalThis' },
        });
        return outputFiles[0].contents;
    };
    const server = createServer(async (request, response) => {
        const path = decodeURIComponent(request.url.split('?')[0]);
        response.setHeader('cache-control', 'no-store');
        const type = (name) => response.setHeader('content-type', TYPES[extname(name)] ?? 'application/octet-stream');
        try {
            const [, page, script] = /^\/([a-z0-9-]+)(\.js)?$/.exec(path) ?? [];
            const [, from] = /\/demos\/(.*\/)[^/]*$/.exec(request.headers.referer?.split('?')[0]) ?? [];
            // Vite serves a page's folder `public` as the root.
            const known = /^\/(npm|demos)\/(.*)$/.exec(path);
            const [, root, file] = known ?? (from && !page ? [path, 'demos', `${from}public${path}`] : []);
            if (page && !script) {
                type('page.html');
                response.end(HTML(page, prelude));
            } else if (page) {
                if (!bundles.has(page)) bundles.set(page, bundle(page));
                const text = await bundles.get(page);
                type('page.js');
                response.end(text);
            } else if (root && !normalize(file).startsWith('..')) {
                // A package that is not published is a checkout.
                const homes = [`${HERE}node_modules`, ...(demos ? [demos] : [])].map((home) =>
                    join(home, normalize(file)),
                );
                const package_ = root === 'npm' && { file: homes.find(existsSync) ?? homes[0] };
                const found = package_ || (await demoFile(demos, normalize(file)));
                const bytes = found.text ?? (await readFile(found.file));
                type(found.text && extname(file) !== '.html' ? 'bundle.js' : file);
                if (package_ || !/\.(html|m?js)$/.test(file)) response.end(bytes);
                else if (extname(file) !== '.html') response.end(local(String(bytes)));
                else response.end(demo(local(String(bytes)), prelude, loaded));
            } else response.writeHead(404).end();
        } catch (error) {
            if (error.code === 'ENOENT') return response.writeHead(404).end();
            const text = String(error.message ?? error);
            response
                .setHeader('content-type', 'text/javascript')
                .end(`console.error(${JSON.stringify(text.slice(0, 2000))});`);
        }
    });
    await new Promise((resolve) => server.listen(0, '127.0.0.1', resolve));
    return { server, address: `http://127.0.0.1:${server.address().port}` };
}
