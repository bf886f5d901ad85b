// The recorder as preshade joins it: the same files in the same order.

import { readFileSync } from 'node:fs';
import { fileURLToPath } from 'node:url';

const SOURCE = fileURLToPath(new URL('../../crates/frames/src/', import.meta.url));
const FILES = /include_str!\("(page\/[a-z-]+\.js)"\)/g;

export function recorder() {
    const names = [...readFileSync(`${SOURCE}page.rs`, 'utf8').matchAll(FILES)].map(([, name]) => name);
    const parts = names.map((name) => readFileSync(SOURCE + name, 'utf8'));
    return `(() => {\n'use strict';\n${parts.join('')}})();\n`;
}
