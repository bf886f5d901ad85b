// Materials that are left to three.js, and why. Nothing here keeps a material alive.

export class Left {
    #pass;
    #rows = new WeakMap();
    #authors = new Set();

    constructor(pass) {
        this.#pass = pass;
    }

    set(author, state, reason) {
        const known = this.#rows.get(author);
        if (known?.reason === reason) return;
        const row = { pass: this.#pass, material: author.name || author.type, uuid: author.uuid, mode: null };
        this.#rows.set(author, { ...row, state, reason, remedy: null, code: null, ms: 0 });
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
        return this.#all().map((author) => this.#rows.get(author));
    }

    clear() {
        for (const author of this.#all()) this.delete(author);
    }

    #all() {
        return [...this.#authors].map((each) => each.deref()).filter(Boolean);
    }

    #gone = ({ target }) => this.delete(target);
}
