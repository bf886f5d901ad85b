// Writes version.js: a hash of what makes variants in this package. Who keeps variants keeps it with them.

import { createHash } from 'node:crypto';
import { existsSync, readFileSync, writeFileSync } from 'node:fs';

const at = (name) => new URL(name, import.meta.url);
const hash = createHash('sha256');
for (const name of ['preshade.wasm', 'preshade-full.wasm', 'client.js']) hash.update(readFileSync(at(name)));
const text = `export const version = '${hash.digest('hex').slice(0, 16)}';\n`;
if (!existsSync(at('version.js')) || readFileSync(at('version.js'), 'utf8') !== text)
    writeFileSync(at('version.js'), text);
