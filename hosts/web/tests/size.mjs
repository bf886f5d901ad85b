// The size of preshade.wasm, as it is and compressed. The limit is on what a browser loads: Brotli at its best.

import { readFileSync } from 'node:fs';
import { brotliCompressSync, constants, gzipSync } from 'node:zlib';

const MOST = 1_300_000;
const wasm = readFileSync(new URL('../preshade.wasm', import.meta.url));
const brotli = brotliCompressSync(wasm, {
    params: { [constants.BROTLI_PARAM_QUALITY]: 11, [constants.BROTLI_PARAM_SIZE_HINT]: wasm.length },
});
const gzip = gzipSync(wasm, { level: 9 });
const said = (n) => n.toLocaleString('en');
console.log(`preshade.wasm: ${said(wasm.length)} bytes; Brotli ${said(brotli.length)}; gzip ${said(gzip.length)}`);
if (brotli.length > MOST) {
    console.error(`error: the limit is ${said(MOST)} bytes with Brotli`);
    process.exit(1);
}
