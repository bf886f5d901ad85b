// Writes the crates that are linked into a program, with the texts of their licences:
//
//     node licenses.mjs PROGRAM MANIFEST TARGET OUT

import { execFileSync } from 'node:child_process';
import { existsSync, readFileSync, readdirSync, writeFileSync } from 'node:fs';
import { dirname, join } from 'node:path';

const [program, manifest, target, out] = process.argv.slice(2);
if (!out) {
    console.error('usage: node licenses.mjs PROGRAM MANIFEST TARGET OUT');
    process.exit(2);
}
const said = execFileSync(
    'cargo',
    [
        ...['metadata', '--format-version', '1', '--locked'],
        ...['--filter-platform', target, '--manifest-path', manifest],
    ],
    { maxBuffer: 1 << 28, stdio: ['ignore', 'pipe', 'ignore'] },
);
const { packages, resolve } = JSON.parse(said);
const packageOf = new Map(packages.map((of) => [of.id, of]));
const nodeOf = new Map(resolve.nodes.map((of) => [of.id, of]));
const isMacro = (id) => packageOf.get(id).targets.some(({ kind }) => kind.includes('proc-macro'));

/** What is linked: ordinary dependencies, and not what runs while something is compiled. */
const linked = new Set();
const visit = (id) => {
    if (linked.has(id) || isMacro(id)) return;
    linked.add(id);
    for (const { pkg, dep_kinds } of nodeOf.get(id).deps) if (dep_kinds.some(({ kind }) => kind === null)) visit(pkg);
};
visit(resolve.root);

const others = [...linked].map((id) => packageOf.get(id)).filter(({ source }) => source);
others.sort((a, b) => a.name.localeCompare(b.name));
/** Each text once, with the libraries that have it. */
const texts = new Map();
const add = (name, text) => {
    const clean = text.trim().replaceAll('\r', '');
    texts.set(clean, [...(texts.get(clean) ?? []), name]);
};
for (const { name, manifest_path } of others) {
    const folder = dirname(manifest_path);
    for (const file of readdirSync(folder).filter((file) => /^(licen[cs]e|copying|notice|unlicense)/i.test(file)))
        add(name, readFileSync(join(folder, file), 'utf8'));
    // Code in C++ that a crate carries along has its licence at the top of a file.
    const carried = join(folder, 'extern');
    const files = existsSync(carried) ? readdirSync(carried, { recursive: true }) : [];
    for (const file of files.filter((file) => file.endsWith('.h'))) {
        const [comment] = readFileSync(join(carried, file), 'utf8').match(/^\s*\/\*[^]*?\*\//) ?? [''];
        if (/copyright/i.test(comment)) add(name, comment);
    }
}
const parts = [
    `${program} contains these libraries, and the standard library of Rust (MIT OR Apache-2.0, rust-lang.org).`,
    others.map(({ name, version, license, repository }) => `${name} ${version}: ${license}, ${repository}`).join('\n'),
    ...[...texts].map(([text, names]) => `Of ${[...new Set(names)].join(', ')}:\n\n${text}`),
];
writeFileSync(out, parts.join(`\n\n${'-'.repeat(80)}\n\n`) + '\n');
console.log(`${out}: ${others.length} libraries`);
