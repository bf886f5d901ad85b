// The native program, the fixtures, and folders that are gone after a test.

import { execFile } from 'node:child_process';
import { existsSync, mkdtempSync, readdirSync, readFileSync, rmSync } from 'node:fs';
import { tmpdir } from 'node:os';
import { join, relative } from 'node:path';
import { fileURLToPath } from 'node:url';

export const PACKAGE = fileURLToPath(new URL('..', import.meta.url));
export const ROOT = fileURLToPath(new URL('../../..', import.meta.url));
export const FIXTURES = join(ROOT, 'fixtures');
export const BIN = join(PACKAGE, 'bin/preshade.js');

const target = process.env.CARGO_TARGET_DIR ?? join(ROOT, 'target');
export const NATIVE = process.env.PRESHADE ?? join(target, 'debug/preshade');
if (!existsSync(NATIVE)) throw new Error(`${NATIVE} is not built: cargo build, or name the program by PRESHADE`);

/** Runs a program: its exit status and what it printed. */
export function run(program, args, { cwd = ROOT, input } = {}) {
    return new Promise((resolve, reject) => {
        const options = {
            cwd,
            maxBuffer: 1 << 28,
            env: { ...process.env, NO_COLOR: '1', PRESHADE_ADAPTER: undefined },
        };
        const child = execFile(program, args, options, (error, stdout, stderr) => {
            if (error && typeof error.code !== 'number') reject(error);
            else resolve({ status: error?.code ?? 0, stdout, stderr });
        });
        child.stdin.on('error', () => {});
        child.stdin.end(input);
    });
}

export const native = (args, options) => run(NATIVE, args, options);
export const bin = (args, options) => run(process.execPath, [BIN, ...args], options);

/** The files below a folder, relative to it. */
export function below(folder) {
    const all = readdirSync(folder, { recursive: true, withFileTypes: true });
    const files = all.filter((entry) => entry.isFile());
    return files.map((entry) => relative(folder, join(entry.parentPath ?? entry.path, entry.name))).sort();
}

/** The shaders of the fixtures, as materials: one file, or the two stages of one name. */
export function materials() {
    const found = new Map();
    for (const file of below(FIXTURES)) {
        if (!/\.(wgsl|glsl|vert|frag|vs|fs)$/.test(file)) continue;
        const stage = /\.(vert|frag|vs|fs)(?=\.|$)/;
        const name = stage.test(file) ? file.replace(stage, '.stage') : file;
        found.set(name, [...(found.get(name) ?? []), file]);
    }
    const isFragment = (file) => /\.(frag|fs)/.test(file);
    return [...found.values()].map((files) => files.sort((a, b) => isFragment(a) - isFragment(b)));
}

/** A folder for a test's files. */
export function folder(context) {
    const path = mkdtempSync(join(tmpdir(), 'preshade-web-'));
    context.after(() => rmSync(path, { recursive: true, force: true }));
    return path;
}

export const read = (...path) => readFileSync(join(...path), 'utf8');
