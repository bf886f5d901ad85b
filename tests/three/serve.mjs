// A server of this folder's files, for the page and its test. `npm start` prints where.

import { fileURLToPath } from 'node:url';
import { serve as serveFolder } from '../../hosts/three/tests/serve.mjs';

/** Resolves to the server and its address. */
export const serve = (port = 0) => serveFolder({ port, root: fileURLToPath(new URL('.', import.meta.url)) });

if (process.argv[1] === fileURLToPath(import.meta.url)) {
    const { address } = await serve(Number(process.argv[2] ?? 8080));
    console.log(`${address}/`);
}
