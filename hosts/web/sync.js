// The compiler on the caller's thread, for build tools and scripts of node.

import { Commands, requests, result } from './client.js';
import { Instances } from './instance.js';
import { module } from './module-node.js';

export { PreshadeError } from './client.js';

export class PreshadeSync extends Commands {
    #instances;

    constructor(options = {}) {
        super();
        this.#instances = new Instances((isFull) => module(options, isFull));
    }

    /** Bytes of the compiler's memory. */
    get memory() {
        return this.#instances.memory;
    }

    /** Answers a request as it is. */
    request(request) {
        return this.#instances.of(request).call(request);
    }

    ask(command, ...given) {
        return result(command, this.request(requests[command](...given)));
    }
}

const shared = new PreshadeSync();

export const rewrite = (sources, options) => shared.rewrite(sources, options);
export const explain = (sources, options) => shared.explain(sources, options);
export const outputs = (sources, options) => shared.outputs(sources, options);
export const agree = (first, second, options) => shared.agree(first, second, options);
export const graph = (sources, options) => shared.graph(sources, options);
export const passes = (options) => shared.passes(options);
