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
    #timer;

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
        return new Promise((resolve) => {
            const id = this.#next++;
            this.#waiting.set(id, { request, resolve });
            this.#post(id);
            if (this.#waiting.size === 1) this.#time();
        });
    }

    #post(id) {
        this.#worker ??= start(this.#options, {
            answered: ({ id, answer }) => this.#settle(id, answer),
            failed: (error) => this.#end(failure('worker', `the worker failed: ${error?.message ?? error}`)),
        });
        this.#worker.post({ id, request: this.#waiting.get(id).request });
    }

    /** Times the call that the worker is at: those behind it wait. */
    #time() {
        clearTimeout(this.#timer);
        const { timeout } = this.#options;
        if (timeout && this.#waiting.size) this.#timer = setTimeout(() => this.#late(), timeout);
    }

    /** Ends the worker, and gives the calls behind to another. */
    #late() {
        const [late, ...behind] = this.#waiting.keys();
        const { timeout } = this.#options;
        this.#worker?.end();
        this.#worker = null;
        const error = failure('timeout', `there was no answer within ${timeout} ms: the worker was ended`);
        this.#settle(late, { error });
        for (const id of behind) this.#post(id);
    }

    #settle(id, answer) {
        const waiting = this.#waiting.get(id);
        if (!waiting) return;
        this.#waiting.delete(id);
        this.#time();
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
