// A worker of node. It keeps no process alive that waits for nothing else.

import { Worker } from 'node:worker_threads';

/** The engine's stack, in MiB: enough for what naga's own bounds on nesting allow. */
const STACK = 64;

/** What a worker can be sent. */
const address = (wasm) => (wasm instanceof URL ? wasm.href : wasm);

export function start({ wasm, full }, { answered, failed }) {
    const worker = new Worker(new URL('./worker-node.js', import.meta.url), {
        name: 'preshade',
        workerData: { wasm: address(wasm), full: address(full) },
        resourceLimits: { stackSizeMb: STACK },
    });
    worker.on('message', answered);
    worker.on('error', failed);
    worker.unref();
    return {
        post(message) {
            worker.ref();
            worker.postMessage(message);
        },
        idle: () => worker.unref(),
        end: () => void worker.terminate(),
    };
}
