// What was measured on this device earlier, in localStorage: by adapter, by call and by name.

import { named } from '../variants.js';
import { adapter } from './timer.js';

const KEY = 'preshade-three prepass';
const LIMIT = 300;

export class Remembered {
    #prefix;
    #all = read();

    /** `place`: how many calls of the page came before. The same text may pay in the scene of one and not in that of another. */
    constructor(renderer, place) {
        this.#prefix = `${named(adapter(renderer.getContext()))} ${place}`;
    }

    get(name) {
        return this.#all.get(`${this.#prefix} ${name}`) ?? null;
    }

    set(name, value) {
        const key = `${this.#prefix} ${name}`;
        // Others have written since: another call of this page, or another tab.
        this.#all = new Map([...this.#all, ...read()]);
        // The oldest are first.
        this.#all.delete(key);
        this.#all.set(key, value);
        for (const old of this.#all.keys()) {
            if (this.#all.size <= LIMIT) break;
            this.#all.delete(old);
        }
        try {
            localStorage.setItem(KEY, JSON.stringify(Object.fromEntries(this.#all)));
        } catch {
            // No storage, or no room in it: measured again next time.
        }
    }
}

function read() {
    try {
        return new Map(Object.entries(JSON.parse(localStorage.getItem(KEY) ?? '{}')));
    } catch {
        return new Map();
    }
}
