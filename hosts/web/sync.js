// The compiler on the caller's thread, for build tools and scripts of node.

import { requests, result } from './client.js';
import { Instance } from './instance.js';
import { module } from './module-node.js';

export { PreshadeError } from './client.js';

export class PreshadeSync {
    #instance = null;
    #options;

    constructor(options = {}) {
        this.#options = options;
    }

    /** Bytes of the compiler's memory. */
    get memory() {
        return this.#instance?.memory ?? 0;
    }

    /** Answers a request as it is. */
    request(request) {
        this.#instance ??= new Instance(module(this.#options.wasm));
        return this.#instance.call(request);
    }

    #ask(command, ...given) {
        return result(command, this.request(requests[command](...given)));
    }

    rewrite(sources, options) {
        return this.#ask('rewrite', sources, options);
    }

    explain(sources, options) {
        return this.#ask('explain', sources, options);
    }

    outputs(sources, options) {
        return this.#ask('outputs', sources, options);
    }

    agree(first, second, options) {
        return this.#ask('agree', first, second, options);
    }

    passes(options) {
        return this.#ask('passes', options);
    }
}

const shared = new PreshadeSync();

export const rewrite = (sources, options) => shared.rewrite(sources, options);
export const explain = (sources, options) => shared.explain(sources, options);
export const outputs = (sources, options) => shared.outputs(sources, options);
export const agree = (first, second, options) => shared.agree(first, second, options);
export const passes = (options) => shared.passes(options);
