// The compiler in a worker. It starts with the first call.

import { start } from '#start';
import { Commands, PreshadeError, requests, result } from './client.js';
import { failure } from './instance.js';

export { PreshadeError };

/** A compiler with a worker of its own. */
export class Preshade extends Commands {
    #options;
    #worker = null;
    #waiting = new Map();
    #next = 0;

    constructor(options = {}) {
        super();
        this.#options = options;
    }

    /** Starts the worker and compiles the module, so that the first call need not wait for it. */
    async ready() {
        await this.ask('passes', { name: 'depth-prepass' });
    }

    /** Ends the worker. Calls without an answer fail. Another call starts a new one. */
    dispose() {
        this.#end(failure('disposed', 'the compiler was disposed of'));
    }

    async ask(command, ...given) {
        const request = requests[command](...given);
        return result(command, await this.request(request));
    }

    /** Sends a request as it is, and resolves to the answer. The command line uses it. */
    request(request) {
        this.#worker ??= start(this.#options, {
            answered: ({ id, answer }) => this.#settle(id, answer),
            failed: (error) => this.#end(failure('worker', `the worker failed: ${error?.message ?? error}`)),
        });
        const { timeout } = this.#options;
        return new Promise((resolve) => {
            const id = this.#next++;
            const late = () =>
                this.#end(failure('timeout', `there was no answer within ${timeout} ms: the worker was ended`));
            const timer = timeout ? setTimeout(late, timeout) : undefined;
            this.#waiting.set(id, { resolve, timer });
            this.#worker.post({ id, request });
        });
    }

    #settle(id, answer) {
        const waiting = this.#waiting.get(id);
        if (!waiting) return;
        this.#waiting.delete(id);
        clearTimeout(waiting.timer);
        if (!this.#waiting.size) this.#worker?.idle();
        waiting.resolve(answer);
    }

    #end(error) {
        this.#worker?.end();
        this.#worker = null;
        for (const id of [...this.#waiting.keys()]) this.#settle(id, { error });
    }
}

const shared = new Preshade();

export const rewrite = (sources, options) => shared.rewrite(sources, options);
export const explain = (sources, options) => shared.explain(sources, options);
export const outputs = (sources, options) => shared.outputs(sources, options);
export const agree = (first, second, options) => shared.agree(first, second, options);
export const graph = (sources, options) => shared.graph(sources, options);
export const passes = (options) => shared.passes(options);
