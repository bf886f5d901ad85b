// The compiler's module, read from disk.

import { readFileSync } from 'node:fs';

/** Compiles the module: that of a path, a `file:` URL or bytes; by default the package's. */
export function module(wasm = new URL('./preshade.wasm', import.meta.url)) {
    if (wasm instanceof WebAssembly.Module) return wasm;
    if (wasm instanceof ArrayBuffer || ArrayBuffer.isView(wasm)) return new WebAssembly.Module(wasm);
    const place = typeof wasm === 'string' && wasm.startsWith('file:') ? new URL(wasm) : wasm;
    return new WebAssembly.Module(readFileSync(place));
}
