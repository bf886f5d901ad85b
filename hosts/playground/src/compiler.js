// The compiler: its module is loaded here, so that the page can show how far it is, and runs in a worker.

import { Preshade } from 'preshade';
import url from 'preshade/preshade.wasm?url';

const BYTES = __MODULE_BYTES__;

/** Loads the module. `progress` gets the loaded share, 0 to 1. */
export async function load(progress) {
    const response = await fetch(url);
    if (!response.ok) throw new Error(`${response.status} ${response.statusText}`);
    const bytes = new Uint8Array(BYTES);
    let at = 0;
    const reader = response.body.getReader();
    for (;;) {
        const { done, value } = await reader.read();
        if (done) break;
        if (at + value.length > BYTES) throw new Error('the module on the server is not the one of this page');
        bytes.set(value, at);
        at += value.length;
        progress(at / BYTES);
    }
    return new Compiler(await WebAssembly.compile(bytes.subarray(0, at)));
}

/** A call that was given up, by the visitor or for a newer text. */
export const isStopped = (error) => error?.code === 'disposed';

export class Compiler {
    #preshade;

    constructor(module) {
        this.#preshade = new Preshade({ wasm: module });
    }

    explain({ files, options }) {
        return this.#preshade.explain(files, options);
    }

    /** The variant. With an empty recipe, the material as its author wrote it. */
    rewrite({ files, options }, recipe) {
        return this.#preshade.rewrite(files, { ...options, pass: recipe, emit: ['wgsl', 'glsl-es'] });
    }

    passes() {
        return this.#preshade.passes();
    }

    /** The dataflow graph (`preshade.graph.v1`), or `null` where the module has no such command. */
    async graph({ files, options }) {
        const { define, name, clip, ...flags } = options;
        const shader = {
            sources: files,
            flags,
            ...(define && { define }),
            ...(name && { name }),
            ...(clip && { clip }),
        };
        const answer = await this.#preshade.request({ command: 'graph', shader });
        if (answer.error?.code === 'usage') return null;
        if (answer.error) throw Object.assign(new Error(answer.error.message), answer.error);
        return answer.report;
    }

    /** Ends the call that is running. The next one starts a new worker. */
    stop() {
        this.#preshade.dispose();
    }
}
