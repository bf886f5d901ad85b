// The worker of a browser: its first message says where the module is, the others are requests.

import { failure, Instance } from './instance.js';

let instance;

async function compiled(wasm) {
    if (wasm instanceof WebAssembly.Module) return wasm;
    if (wasm && typeof wasm !== 'string') return WebAssembly.compile(wasm);
    const response = await fetch(wasm ?? new URL('./preshade.wasm', import.meta.url));
    if (!response.ok) throw new Error(`${response.url}: ${response.status} ${response.statusText}`);
    // Compiling while loading needs the type that some servers do not send.
    const isTyped = response.headers.get('content-type')?.startsWith('application/wasm');
    return isTyped ? WebAssembly.compileStreaming(response) : WebAssembly.compile(await response.arrayBuffer());
}

addEventListener('message', async ({ data }) => {
    if (!('id' in data)) {
        instance = compiled(data.wasm).then((module) => new Instance(module));
        // Each request tells.
        instance.catch(() => {});
        return;
    }
    const { id, request } = data;
    try {
        const answer = (await instance).call(request);
        postMessage({ id, answer });
    } catch (error) {
        postMessage({ id, answer: { error: failure('worker', `the module cannot be loaded: ${error.message}`) } });
    }
});
