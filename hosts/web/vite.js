// A plugin for vite: `import lit from './lit.wgsl?preshade=depth-prepass'` is the variant, made at build time.
// Each import with other passes, targets or definitions is a module of its own.

import { existsSync, readFileSync } from 'node:fs';
import { basename, dirname, posix, relative, resolve } from 'node:path';
import { gather } from './disk.js';
import { Preshade } from './index.js';

const FRAGMENTS = [
    ['.vert', '.frag'],
    ['.vs', '.fs'],
];

/** The fragment file beside a vertex file. */
function beside(file) {
    const name = basename(file);
    for (const [vertex, fragment] of FRAGMENTS) {
        const other = resolve(dirname(file), name.replace(vertex, fragment));
        if (name.includes(vertex) && existsSync(other)) return other;
    }
}

/** What the query of an import asks for, over the plugin's own options. */
function asked(query, options) {
    const parameters = new URLSearchParams(query);
    const pass = parameters.getAll('preshade').filter(Boolean);
    const out = { ...options };
    if (pass.length) out.pass = pass;
    for (const key of ['emit', 'name', 'vertex', 'fragment', 'clip']) {
        const value = parameters.get(key);
        if (value !== null) out[key] = key === 'emit' ? value.split(',') : value;
    }
    const define = parameters.getAll('define');
    if (define.length) {
        const own = out.define && !Array.isArray(out.define) ? Object.entries(out.define) : (out.define ?? []);
        const own_texts = own.map((entry) => (Array.isArray(entry) ? entry.join('=') : entry));
        out.define = [...own_texts, ...define];
    }
    return { options: out, with: parameters.get('with') };
}

export default function preshade(options = {}) {
    const { strict = false, compiler: given = {}, ...defaults } = options;
    let compiler;
    let root = process.cwd();
    let server;
    /** The modules that a file is a part of. */
    const users = new Map();

    return {
        name: 'preshade',
        enforce: 'pre',

        /** A page that imports the compiler itself needs its worker and module as files of their own. */
        config: () => ({ optimizeDeps: { exclude: ['preshade'] } }),

        configResolved(config) {
            root = config.root;
        },

        async load(id) {
            const at = id.indexOf('?');
            if (at < 0 || !new URLSearchParams(id.slice(at + 1)).has('preshade')) return null;
            const file = id.slice(0, at);
            const { options: own, with: other } = asked(id.slice(at + 1), defaults);
            const second = other ? resolve(dirname(file), other) : beside(file);
            const paths = second && !/\.(frag|fs)\b/.test(basename(file)) ? [file, second] : [file];
            // Relative names make plans and messages the same on every machine.
            const named = (path) => relative(root, path).split('\\').join(posix.sep);
            const absolute = (name) => resolve(root, name);
            const sources = paths.map((path) => ({ name: named(path), text: readFileSync(path, 'utf8') }));
            const include = (own.include ?? []).map((folder) => resolve(root, folder));
            const absoluteSources = sources.map(({ text }, i) => ({ name: paths[i], text }));
            const files = Object.fromEntries(
                Object.entries(gather(absoluteSources, include)).map(([path, text]) => [named(path), text]),
            );
            const watch = [...paths, ...Object.keys(files).map(absolute)];
            for (const path of watch) {
                this.addWatchFile(path);
                users.set(path, (users.get(path) ?? new Set()).add(id));
            }
            compiler ??= new Preshade(given);
            let variant;
            try {
                const more = {
                    include: include.map(named),
                    files: { ...files, ...(own.files instanceof Map ? Object.fromEntries(own.files) : own.files) },
                };
                variant = await compiler.rewrite(sources, { ...own, ...more });
            } catch (error) {
                if (error.name !== 'PreshadeError') throw error;
                const { place } = error;
                const loc = place && { file: absolute(place.file), line: place.line, column: place.column - 1 };
                return this.error({ message: error.message, id: file, ...(loc && { loc }), frame: error.rendered });
            }
            const { files: written, plan, recipe, contract, refusals, notes, errors, material } = variant;
            const told = [...refusals.map((refusal) => refusal.rendered), ...errors.map((error) => error.message)];
            if (told.length && strict) return this.error({ message: told.join('\n'), id: file });
            for (const message of told) this.warn(message);
            const texts = Object.fromEntries(
                written.filter(({ name }) => !name.endsWith('.plan.json')).map(({ name, text }) => [name, text]),
            );
            const exported = { material, recipe, contract, refusals, notes, files: texts, plan };
            const code = Object.entries(exported).map(
                ([name, value]) => `export const ${name} = ${JSON.stringify(value)};`,
            );
            code.push(`export default { ${Object.keys(exported).join(', ')} };`);
            return { code: code.join('\n'), map: { mappings: '' } };
        },

        configureServer(started) {
            server = started;
        },

        /** A server without updates of modules makes the variant at the next request. */
        watchChange(file) {
            for (const { moduleGraph } of Object.values(server?.environments ?? {}))
                for (const id of users.get(file) ?? []) {
                    const module = moduleGraph.getModuleById(id);
                    if (module) moduleGraph.invalidateModule(module);
                }
        },

        /** An included file is a part of each module that was made of it. */
        handleHotUpdate({ file, modules, server }) {
            const ids = [...(users.get(file) ?? [])];
            const found = ids.map((id) => server.moduleGraph.getModuleById(id)).filter(Boolean);
            return found.length ? [...new Set([...modules, ...found])] : undefined;
        },

        closeBundle() {
            compiler?.dispose();
            compiler = undefined;
        },
    };
}
