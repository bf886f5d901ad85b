// The worker of a browser: its first message says where the modules are, the others are requests.

import { failure, Instances } from './instance.js';

let instances;

async function compiled(wasm) {
    if (wasm instanceof WebAssembly.Module) return wasm;
    if (wasm && typeof wasm !== 'string') return WebAssembly.compile(wasm);
    const response = await fetch(wasm);
    if (!response.ok) throw new Error(`${response.url}: ${response.status} ${response.statusText}`);
    // Compiling while loading needs the type that some servers do not send.
    const isTyped = response.headers.get('content-type')?.startsWith('application/wasm');
    return isTyped ? WebAssembly.compileStreaming(response) : WebAssembly.compile(await response.arrayBuffer());
}

addEventListener('message', async ({ data }) => {
    if (!('id' in data)) {
        // Bundlers look for these very words.
        const wasm = data.wasm ?? new URL('./preshade.wasm', import.meta.url).href;
        const full = data.full ?? new URL('./preshade-full.wasm', import.meta.url).href;
        instances = new Instances((isFull) => compiled(isFull ? full : wasm));
        return;
    }
    const { id, request } = data;
    try {
        const answer = (await instances.of(request)).call(request);
        postMessage({ id, answer });
    } catch (error) {
        postMessage({ id, answer: { error: failure('worker', `the module cannot be loaded: ${error.message}`) } });
    }
});
