// The files on disk that a shader may include, as the map that the compiler takes.

import { readFileSync, statSync } from 'node:fs';
import { posix } from 'node:path';

/** A file that is larger is not read: the compiler's limit on a shader with its includes is 4 MiB. */
const LARGEST = 16 << 20;
/** So many files are read at most. */
const MOST = 4000;

const INCLUDE = /^[ \t]*#[ \t]*include[ \t]+(?:"([^"\n]+)"|<([^>\n]+)>)/gm;

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

function includes(source, folders, files, home) {
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

/** What `sources` may include: texts by path. */
export function gather(sources, include = []) {
    const files = {};
    for (const { name, text } of sources) {
        includes(text, include, files, posix.dirname(name));
    }
    return files;
}
