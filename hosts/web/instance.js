// The compiler's module: one call at a time, each a request in JSON. A call that traps costs its instance.

/** What this engine's stack does when it is full: `RangeError`, or Firefox's `InternalError`. */
const isOverflow = (error) => error instanceof RangeError || error?.name === 'InternalError';

/** Above so many bytes an instance is dropped after its call, because its memory never shrinks. */
const LARGE = 256 << 20;

/** Whether a request needs `preshade-full.wasm`, which can compare programs too. */
const compares = ({ command, validate }) => command === 'agree' || Boolean(validate);

/** The instances of both modules, each made when a request needs it. `open(isFull)` has the module, or a promise. */
export class Instances {
    #open;
    #made = new Map();

    constructor(open) {
        this.#open = open;
    }

    /** The instance for a request, or a promise of it. The full module answers all once it is there. */
    of(request) {
        const isFull = compares(request) || this.#made.has(true);
        if (!this.#made.has(isFull)) {
            const module = this.#open(isFull);
            const made = module instanceof WebAssembly.Module;
            this.#made.set(isFull, made ? new Instance(module) : module.then((of) => new Instance(of)));
            // The next call tries again.
            if (!made) module.catch(() => this.#made.delete(isFull));
        }
        return this.#made.get(isFull);
    }

    /** Bytes of their memory, of those that are made at once. */
    get memory() {
        return [...this.#made.values()].reduce((sum, of) => sum + (of.memory ?? 0), 0);
    }
}

export class Instance {
    #module;
    #exports = null;

    /** @param {WebAssembly.Module} module */
    constructor(module) {
        this.#module = module;
    }

    /** Bytes of its memory. */
    get memory() {
        return this.#exports?.memory.buffer.byteLength ?? 0;
    }

    /** Answers a request: the compiler's answer, or `{ error }`. It never throws. */
    call(request) {
        try {
            this.#exports ??= new WebAssembly.Instance(this.#module, {}).exports;
            const { memory, room, answer, answer_at } = this.#exports;
            const text = new TextEncoder().encode(JSON.stringify(request));
            const at = room(text.length) >>> 0;
            new Uint8Array(memory.buffer, at, text.length).set(text);
            const length = answer() >>> 0;
            const answered = this.#text(answer_at(), length);
            if (memory.buffer.byteLength > LARGE) this.#exports = null;
            return JSON.parse(answered);
        } catch (error) {
            const failure = this.#failure(error);
            this.#exports = null;
            return { error: failure };
        }
    }

    #text(at, length) {
        const bytes = new Uint8Array(this.#exports.memory.buffer, at >>> 0, length);
        // A copy: a shared view cannot be decoded in every engine.
        return new TextDecoder().decode(bytes.slice());
    }

    #failure(error) {
        if (isOverflow(error))
            return failure('too-deep', "the shader is nested so deeply that the engine's stack is full", [
                'nest blocks, `else if`s and expressions less deeply',
            ]);
        const message = String(error?.message ?? error);
        // The linker puts the stack first in memory, so its end is the start of memory.
        if (/out of bounds/.test(message)) return failure('too-deep', 'the compiler ran out of stack');
        return failure('panic', `the compiler panicked: ${message}`, [
            'this is a bug in naga or in preshade; please report it with the file',
            'the native program says where: `preshade explain FILE`',
        ]);
    }
}

/** An error as the compiler writes its own. */
export function failure(code, message, notes = []) {
    const rendered = [`error[${code}]: ${message}`, ...notes.map((note) => ` = ${note}`)].join('\n');
    return { code, message, place: null, notes, rendered };
}
