// The compiler's module, read from disk.

import { readFileSync } from 'node:fs';

/** Compiles a module: that of a path, a `file:` URL or bytes; by default the package's. */
export function module({ wasm, full }, isFull) {
    const [given, own] = isFull ? [full, 'preshade-full.wasm'] : [wasm, 'preshade.wasm'];
    const from = given ?? new URL(own, import.meta.url);
    if (from instanceof WebAssembly.Module) return from;
    if (from instanceof ArrayBuffer || ArrayBuffer.isView(from)) return new WebAssembly.Module(from);
    const place = typeof from === 'string' && from.startsWith('file:') ? new URL(from) : from;
    return new WebAssembly.Module(readFileSync(place));
}
