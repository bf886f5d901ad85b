// A worker of a browser.

/** What a worker can be sent. */
const address = (wasm) => (wasm instanceof URL ? wasm.href : wasm);

export function start({ wasm, full }, { answered, failed }) {
    const worker = new Worker(new URL('./worker.js', import.meta.url), { type: 'module', name: 'preshade' });
    worker.onmessage = ({ data }) => answered(data);
    worker.onerror = (event) => failed(event.message ? event : new Error('it cannot be loaded'));
    worker.onmessageerror = failed;
    worker.postMessage({ wasm: address(wasm), full: address(full) });
    return {
        post: (message) => worker.postMessage(message),
        idle() {},
        end: () => worker.terminate(),
    };
}
