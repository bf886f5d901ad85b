// Writes THIRD-PARTY.txt: the crates that are linked into preshade.wasm, with the texts of their licences.

import { execFileSync } from 'node:child_process';
import { readFileSync, readdirSync, writeFileSync } from 'node:fs';
import { dirname, join } from 'node:path';
import { fileURLToPath } from 'node:url';

const here = fileURLToPath(new URL('.', import.meta.url));
const said = execFileSync(
    'cargo',
    [
        ...['metadata', '--format-version', '1', '--locked', '--filter-platform', 'wasm32-unknown-unknown'],
        ...['--manifest-path', join(here, 'compiler/Cargo.toml')],
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
for (const { name, manifest_path } of others) {
    const folder = dirname(manifest_path);
    for (const file of readdirSync(folder).filter((file) => /^(licen[cs]e|copying|notice|unlicense)/i.test(file))) {
        const text = readFileSync(join(folder, file), 'utf8').trim().replaceAll('\r', '');
        texts.set(text, [...(texts.get(text) ?? []), name]);
    }
}
const parts = [
    'preshade.wasm contains these libraries, and the standard library of Rust (MIT OR Apache-2.0, rust-lang.org).',
    others.map(({ name, version, license, repository }) => `${name} ${version}: ${license}, ${repository}`).join('\n'),
    ...[...texts].map(([text, names]) => `Of ${[...new Set(names)].join(', ')}:\n\n${text}`),
];
writeFileSync(join(here, 'THIRD-PARTY.txt'), parts.join(`\n\n${'-'.repeat(80)}\n\n`) + '\n');
console.log(`THIRD-PARTY.txt: ${others.length} libraries`);
