// What the renderer does, told to listeners: its frames, its shadow maps and each of its draws. Four methods of the renderer are wrapped, and put back by `dispose`.

/** Calls `listener` for each; listeners may leave while it runs. */
const tell = (listeners, ...given) => {
    for (const listener of [...listeners]) listener(...given);
};

export class Hooks {
    #renderer;
    #restore = [];
    /** Nested renders (reflectors, the passes of a composer): how many run. */
    depth = 0;
    /** The scene and camera whose shadow maps are being drawn, or null. */
    shadow = null;

    /** `(scene, camera)`, before and after each `renderer.render`; nested ones too. */
    beforeRender = new Set();
    afterRender = new Set();
    /** `(lights, scene, camera)`, before and after the shadow maps of a render. */
    beforeShadows = new Set();
    afterShadows = new Set();
    /**
     * `(draw)` with `{ camera, scene, geometry, material, object, group }`, before each draw. A listener may set `draw.material` to draw with another. `scene` is null in a
     * shadow map, and in full-screen passes of three.js itself.
     */
    draw = new Set();
    /** `(draw)` after it. `draw.material` is what was drawn with. */
    drawn = new Set();
    /** `(color, depth, stencil)`, which are booleans, before the target that is bound is cleared. */
    clear = new Set();
    /** `()`, when a lost context is there again. */
    restored = new Set();

    constructor(renderer) {
        this.#renderer = renderer;
        this.#wrap(renderer, 'render', (original) => (scene, camera, ...rest) => {
            tell(this.beforeRender, scene, camera);
            this.depth++;
            try {
                original.call(renderer, scene, camera, ...rest);
            } finally {
                this.depth--;
                tell(this.afterRender, scene, camera);
            }
        });
        // `clearDepth` and the like, and each frame of three.js, clear by this method.
        this.#wrap(renderer, 'clear', (original) => (color = true, depth = true, stencil = true) => {
            tell(this.clear, color, depth, stencil);
            original.call(renderer, color, depth, stencil);
        });
        this.#wrapShadows();
        // three.js's own listener is older: it has made everything anew by then.
        renderer.domElement.addEventListener('webglcontextrestored', this.#again);
        this.#wrap(renderer, 'renderBufferDirect', (original) => (camera, scene, geometry, material, object, group) => {
            const draw = { camera, scene, geometry, material, object, group };
            for (const listener of this.draw) listener(draw);
            original.call(renderer, camera, scene, geometry, draw.material, object, group);
            for (const listener of this.drawn) listener(draw);
        });
    }

    dispose() {
        this.#renderer.domElement.removeEventListener('webglcontextrestored', this.#again);
        for (const restore of this.#restore.reverse()) restore();
        this.#restore.length = 0;
        const { beforeRender, afterRender, beforeShadows, afterShadows, draw, drawn, clear, restored } = this;
        for (const of of [beforeRender, afterRender, beforeShadows, afterShadows, draw, drawn, clear, restored])
            of.clear();
    }

    #again = () => {
        this.#wrapShadows();
        tell(this.restored);
    };

    /** three.js makes another of these objects with each context. */
    #wrapShadows() {
        const { shadowMap } = this.#renderer;
        this.#wrap(shadowMap, 'render', (original) => (lights, scene, camera) => {
            const outer = this.shadow;
            this.shadow = { scene, camera, lights };
            tell(this.beforeShadows, lights, scene, camera);
            try {
                original.call(shadowMap, lights, scene, camera);
            } finally {
                this.shadow = outer;
                tell(this.afterShadows, lights, scene, camera);
            }
        });
    }

    /** Someone may wrap the method after us: then ours stays in between, and passes on. */
    #wrap(object, name, around) {
        const original = object[name];
        const wrapped = around(original);
        object[name] = wrapped;
        this.#restore.push(() => {
            if (object[name] === wrapped) object[name] = original;
        });
    }
}
