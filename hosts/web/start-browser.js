// A worker of a browser.

export function start({ wasm }, { answered, failed }) {
    const worker = new Worker(new URL('./worker.js', import.meta.url), { type: 'module', name: 'preshade' });
    worker.onmessage = ({ data }) => answered(data);
    worker.onerror = (event) => failed(event.message ? event : new Error('it cannot be loaded'));
    worker.onmessageerror = failed;
    worker.postMessage({ wasm: wasm instanceof URL ? wasm.href : wasm });
    return {
        post: (message) => worker.postMessage(message),
        idle() {},
        end: () => worker.terminate(),
    };
}
