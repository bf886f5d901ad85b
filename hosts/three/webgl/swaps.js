// Materials that a pass puts into objects while it renders, and takes out again. A page swaps materials too, in its own code between frames or in callbacks of objects, and those are the author's own: the
// difference is that a pass puts back what was there, by itself.

export class Swaps {
    /** Materials of the pass. */
    #own = new WeakSet();
    /** Of each object that had one of these in the last run: what its author has there. */
    #authors = new Map();
    /** What objects had while they were drawn: in the render that runs, and at the end of each render of this run. */
    #drawn = new Map();
    #kept = [];

    /** The pass begins. */
    begin() {
        for (const object of this.#authors.keys()) this.#authors.set(object, object.material);
    }

    /** An object is drawn. Returns whether it has a material of the pass. */
    draws(object, material) {
        // It has another already, if a callback ahead of the draw put it there.
        if (![object.material].flat().includes(material)) return false;
        this.#drawn.set(object, object.material);
        return this.#own.has(material);
    }

    /** A `renderer.render` of the pass is over. What changed within it was changed by a callback of the page. */
    rendered() {
        for (const drawn of this.#drawn) if (drawn[0].material === drawn[1]) this.#kept.push(drawn);
        this.#drawn.clear();
        for (const object of this.#authors.keys())
            if (![object.material].flat().some((each) => this.#own.has(each)))
                this.#authors.set(object, object.material);
    }

    /** The pass is over, and has put back what was there. */
    end() {
        const swapped = this.#kept.filter(([object, material]) => object.material !== material);
        for (const [, material] of swapped) for (const each of [material].flat()) this.#own.add(each);
        this.#authors = new Map(swapped.map(([object]) => [object, object.material]));
        this.#kept = [];
    }

    /** The material or the materials that the author has in the object, or null if that is not known yet. */
    authorOf(object) {
        return this.#authors.get(object) ?? null;
    }
}
