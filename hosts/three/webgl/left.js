// Materials that are left to three.js, and why. Nothing here keeps a material alive.

import { row } from '../rows.js';

export class Left {
    #pass;
    #rows = new WeakMap();
    #authors = new Set();

    constructor(pass) {
        this.#pass = pass;
    }

    set(author, state, reason, code = null) {
        const known = this.#rows.get(author);
        if (known?.reason === reason) return;
        this.#rows.set(author, { state, reason, code });
        if (known) return;
        author.addEventListener('dispose', this.#gone);
        for (const each of this.#authors) if (!each.deref()) this.#authors.delete(each);
        this.#authors.add(new WeakRef(author));
    }

    delete(author) {
        if (!this.#rows.delete(author)) return;
        author.removeEventListener('dispose', this.#gone);
        for (const each of this.#authors) if (each.deref() === author) this.#authors.delete(each);
    }

    rows() {
        return this.#all().map((author) => row(this.#pass, author, this.#rows.get(author)));
    }

    clear() {
        for (const author of this.#all()) this.delete(author);
    }

    #all() {
        return [...this.#authors].map((each) => each.deref()).filter(Boolean);
    }

    #gone = ({ target }) => this.delete(target);
}
