// What was measured on this device earlier, in localStorage: by adapter and by name.

import { named } from '../variants.js';
import { adapter } from './timer.js';

const KEY = 'preshade-three prepass';
const LIMIT = 300;

export class Kept {
    #adapter;
    #all;

    constructor(renderer) {
        this.#adapter = named(adapter(renderer.getContext()));
        try {
            this.#all = new Map(Object.entries(JSON.parse(localStorage.getItem(KEY) ?? '{}')));
        } catch {
            this.#all = new Map();
        }
    }

    get(name) {
        return this.#all.get(`${this.#adapter} ${name}`) ?? null;
    }

    set(name, value) {
        const key = `${this.#adapter} ${name}`;
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
