// The files on disk that a shader may include or import, as the map that the compiler takes.

import { readdirSync, readFileSync, statSync } from 'node:fs';
import { posix } from 'node:path';

/** A file that is larger is not read: the compiler's limit on a shader with its includes is 4 MiB. */
const LARGEST = 16 << 20;
/** So many files are read at most, should someone's package be a home folder. */
const MOST = 4000;

const INCLUDE = /^[ \t]*#[ \t]*include[ \t]+(?:"([^"\n]+)"|<([^>\n]+)>)/gm;
const IMPORT = /^\s*import\s/m;

function text(path) {
    try {
        const about = statSync(path);
        return about.isFile() && about.size <= LARGEST ? readFileSync(path, 'utf8') : undefined;
    } catch {
        return undefined;
    }
}

/** The path without its first folder, then without the next. */
function* endings(path) {
    const parts = path.split('/').filter((part) => part !== '');
    for (let from = 0; from < parts.length; from++) yield parts.slice(from).join('/');
}

function includes(name, source, folders, files, home) {
    const open = [{ source, near: [home] }];
    while (open.length) {
        const { source, near } = open.pop();
        for (const [, quoted, angled] of source.matchAll(INCLUDE)) {
            const asked = [...near, home].map((folder) => posix.join(folder, quoted ?? angled));
            const below = folders.flatMap((folder) =>
                asked.flatMap((path) => [...endings(path)].map((ending) => posix.join(folder, ending))),
            );
            for (const path of new Set([...asked, ...below])) {
                if (path in files || Object.keys(files).length >= MOST) continue;
                const found = text(path);
                if (found === undefined) continue;
                files[path] = found;
                open.push({ source: found, near: [...asked.map(posix.dirname), posix.dirname(path)] });
            }
        }
    }
}

function modules(folder, files) {
    let entries = [];
    try {
        entries = readdirSync(folder, { withFileTypes: true });
    } catch {
        return;
    }
    for (const entry of entries.sort((a, b) => (a.name < b.name ? -1 : 1))) {
        const path = posix.join(folder, entry.name);
        if (Object.keys(files).length >= MOST) return;
        if (entry.isDirectory() && !/^(\.|node_modules$|target$)/.test(entry.name)) modules(path, files);
        else if (/\.(wesl|wgsl)$/.test(entry.name) && !(path in files)) {
            const found = text(path);
            if (found !== undefined) files[path] = found;
        }
    }
}

/** The nearest folder of a file that is called `src` or `shaders`, the root of its package; or its own. */
function root(folder) {
    const parts = folder.split('/');
    const at = Math.max(parts.lastIndexOf('src'), parts.lastIndexOf('shaders'));
    return at < 0 ? folder : parts.slice(0, at + 1).join('/');
}

/** What `sources` may include or import: texts by path. */
export function gather(sources, include = []) {
    const files = {};
    for (const { name, text } of sources) {
        const home = posix.dirname(name);
        includes(name, text, include, files, home);
        if (name.endsWith('.wesl') || (name.endsWith('.wgsl') && IMPORT.test(text)))
            for (const folder of [root(home), ...include]) modules(folder, files);
    }
    return files;
}
