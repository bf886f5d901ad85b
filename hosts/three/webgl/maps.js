// Shadow maps that a page draws on demand (`autoUpdate = false`, of a light or of all): each is drawn again when it can be drawn better. Others are drawn in each frame anyway.

/** Has the map of a light drawn in the next frame. */
function demand({ shadow }, shadowMap) {
    if (!shadow.autoUpdate) shadow.needsUpdate = true;
    if (!shadowMap.autoUpdate) shadowMap.needsUpdate = true;
}

export class Maps {
    #host;
    #scene;
    /** By light: how many variants were there when its map was drawn without another one. -1: draw it again at once. Infinity: it lacks none. */
    #drawn = new WeakMap();
    #count = 0;
    /** Lights whose maps have something of ours. */
    #ours = new WeakSet();
    /** By light: authors' materials that had changed when its map was drawn, and that three.js had not drawn since. */
    #changed = new WeakMap();
    /** The camera that draws to a map, and the lights whose map that is. */
    #camera = null;
    #lights = [];

    constructor(host, scene) {
        this.#host = host;
        this.#scene = scene;
        host.hooks.beforeShadows.add(this.#before);
    }

    /** A variant is there. */
    ready = () => {
        this.#count++;
    };

    /** All are to be drawn again. */
    again() {
        this.#drawn = new WeakMap();
    }

    /** An object is drawn to the map of that camera. `lacks`: as of `Derivations`. `isOurs`: whether preshade draws it. */
    draws(camera, author, lacks, isOurs) {
        if (camera !== this.#camera) this.#aim(camera);
        if (isOurs) for (const light of this.#lights) this.#ours.add(light);
        if (!lacks || (lacks === 'variant' && isOurs)) return;
        if (lacks === 'program') {
            for (const light of this.#lights)
                this.#changed.get(light)?.add(author) ?? this.#changed.set(light, new Set([author]));
            return;
        }
        const count = lacks === 'variant' ? this.#count : -1;
        for (const light of this.#lights) this.#drawn.set(light, Math.min(count, this.#drawn.get(light) ?? Infinity));
    }

    /** What preshade drew is drawn again without it. */
    dispose() {
        this.#host.hooks.beforeShadows.delete(this.#before);
        this.#scene.traverse((light) => {
            if (this.#ours.has(light)) demand(light, this.#host.renderer.shadowMap);
        });
    }

    #before = (lights, scene) => {
        const { hooks, renderer } = this.#host;
        const { shadowMap } = renderer;
        this.#camera = null;
        // A render within another, as a mirror's, switches maps off for itself.
        if (scene !== this.#scene || hooks.depth > 1 || !shadowMap.enabled) return;
        for (const light of lights) {
            const { shadow } = light;
            if (!shadow) continue;
            // A map that was drawn before preshade came is drawn again, and none ahead of its time.
            const isDrawn = (author) => renderer.properties.get(author).__version === author.version;
            const isOld = [...(this.#changed.get(light) ?? [])].some(isDrawn);
            if (isOld || (this.#drawn.get(light) ?? (shadow.map ? -1 : Infinity)) < this.#count)
                demand(light, shadowMap);
            if (!(shadowMap.autoUpdate || shadowMap.needsUpdate) || !(shadow.autoUpdate || shadow.needsUpdate))
                continue;
            this.#drawn.set(light, Infinity);
            this.#changed.delete(light);
            this.#ours.delete(light);
        }
    };

    /** Some lights have several cameras. */
    #aim(camera) {
        const { lights } = this.#host.hooks.shadow;
        const own = lights.filter(({ shadow }) => shadow?.camera === camera);
        this.#camera = camera;
        this.#lights = own.length ? own : lights;
    }
}
