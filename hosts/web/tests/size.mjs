// The sizes of the modules, as they are and compressed. The limit is on what a browser loads for a rewrite: Brotli at
// its best.

import { readFileSync } from 'node:fs';
import { brotliCompressSync, constants, gzipSync } from 'node:zlib';

const MOST = { 'preshade.wasm': 1_400_000 };
const said = (n) => n.toLocaleString('en');
for (const name of ['preshade.wasm', 'preshade-full.wasm']) {
    const wasm = readFileSync(new URL(`../${name}`, import.meta.url));
    const { BROTLI_PARAM_QUALITY, BROTLI_PARAM_LGWIN, BROTLI_PARAM_SIZE_HINT, BROTLI_MAX_WINDOW_BITS } = constants;
    const params = {
        ...{ [BROTLI_PARAM_QUALITY]: 11, [BROTLI_PARAM_LGWIN]: BROTLI_MAX_WINDOW_BITS },
        [BROTLI_PARAM_SIZE_HINT]: wasm.length,
    };
    const brotli = brotliCompressSync(wasm, { params }).length;
    const gzip = gzipSync(wasm, { level: 9 }).length;
    console.log(`${name}: ${said(wasm.length)} bytes; Brotli ${said(brotli)}; gzip ${said(gzip)}`);
    if (brotli > (MOST[name] ?? Infinity)) {
        console.error(`error: the limit is ${said(MOST[name])} bytes with Brotli`);
        process.exitCode = 1;
    }
}
