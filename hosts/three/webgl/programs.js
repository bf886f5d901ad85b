// The GLSL that three.js made of a material for an object. It is known from the draws: whatever program three.js chose for an object is the object's.

import { named } from '../variants.js';

/** What of an object makes three.js take another program of the same material, as a number. */
export function kind(object) {
    const { attributes, morphAttributes: morphs } = object.geometry;
    let bits = 0;
    if (object.isInstancedMesh) bits |= 1 | (object.instanceColor ? 2 : 0) | (object.morphTexture ? 4 : 0);
    if (object.isBatchedMesh) bits |= 8 | (object._colorsTexture ? 16 : 0);
    if (object.isSkinnedMesh) bits |= 32;
    if (object.isPoints) bits |= 64 | (attributes.uv ? 128 : 0);
    if (attributes.position) bits |= 256;
    if (attributes.normal) bits |= 512;
    if (attributes.tangent) bits |= 1024;
    if (attributes.color?.itemSize === 4) bits |= 2048;
    if (morphs.normal) bits |= 4096;
    if (morphs.color) bits |= 8192;
    return ((morphs.position ?? morphs.normal ?? morphs.color)?.length ?? 0) * 16384 + bits;
}

/** A program of three.js: its texts, and a name for both. Texts are read when somebody asks, and are empty once three.js has released the program. */
export class Source {
    #renderer;
    #key = null;

    constructor(renderer, program) {
        this.#renderer = renderer;
        this.program = program;
    }

    get vertex() {
        return this.#text('vertexShader');
    }

    get fragment() {
        return this.#text('fragmentShader');
    }

    /** For `Variants.get`, which does not hash a text that has a name. */
    get key() {
        if (this.#key) return this.#key;
        const { vertex, fragment } = this;
        return vertex && (this.#key = named(`${vertex}\0${fragment}`));
    }

    /** To ask WebGL which shader is which would wait for the driver; three.js knows. */
    #text(stage) {
        const gl = this.#renderer.getContext();
        const { program } = this.program;
        const attached = (program && gl.getAttachedShaders(program)) ?? [];
        const shader = attached.find((each) => each === this.program[stage]);
        return (shader && gl.getShaderSource(shader)) ?? '';
    }
}

export class Programs {
    #renderer;
    #hooks;
    /** Of each material: programs and uniforms by kind of object. */
    #materials = new WeakMap();
    /** Sources by program of three.js. */
    #sources = new WeakMap();
    #paused = 0;

    constructor(renderer, hooks) {
        this.#renderer = renderer;
        this.#hooks = hooks;
        hooks.drawn.add(this.#drawn);
        hooks.restored.add(this.#restored);
    }

    /** The program that three.js last drew such an object with in that material, or null. Always the same `Source` for the same program. */
    of(object, material) {
        return this.#materials.get(material)?.get(kind(object))?.source ?? null;
    }

    /**
     * `{ source, uniforms, version }` of the last draw of an object of that `kind` in that material. Some packages have three.js keep several uniforms for one material, and tell
     * which when they draw. `version` is the material's count of changes (`needsUpdate`) then.
     */
    last(which, material) {
        return this.#materials.get(material)?.get(which) ?? null;
    }

    /** The program of a material: the last one, or that for such an object. Null before it is drawn. */
    text(material, object) {
        return object ? this.of(object, material) : this.source(material);
    }

    /** Runs `draw`, whose draws are not the author's. */
    unseen(draw) {
        this.#paused++;
        try {
            return draw();
        } finally {
            this.#paused--;
        }
    }

    /**
     * Has three.js make the program of a material for an object, without a draw. three.js puts the text together, which may take some milliseconds; the driver goes on by itself.
     */
    link(object, material, scene, camera) {
        const alone = Object.create(object, {
            material: { value: material },
            traverse: { value: (callback) => callback(alone) },
            traverseVisible: { value: () => {} },
        });
        this.#renderer.compile(alone, camera, scene);
    }

    /** The same for the author's own material of an object that three.js did not draw yet, because it is outside of the picture. */
    compile(object, material, scene, camera) {
        this.link(object, material, scene, camera);
        this.#saw(object, material);
    }

    /** The program that three.js drew `material` with just now. */
    source(material) {
        const program = this.#renderer.properties.get(material).currentProgram;
        if (!program) return null;
        let source = this.#sources.get(program);
        if (!source) this.#sources.set(program, (source = new Source(this.#renderer, program)));
        return source;
    }

    dispose() {
        this.#hooks.drawn.delete(this.#drawn);
        this.#hooks.restored.delete(this.#restored);
    }

    /** The context is another, and so are all programs. */
    #restored = () => {
        this.#materials = new WeakMap();
        this.#sources = new WeakMap();
    };

    #drawn = ({ scene, material, object }) => {
        // Not shadow maps and full-screen passes of three.js itself, nor what somebody else draws an object with.
        if (scene === null || this.#paused || material === scene.overrideMaterial) return;
        const own = object.material;
        if (own !== material && !(Array.isArray(own) && own.includes(material))) return;
        this.#saw(object, material);
    };

    #saw(object, material) {
        const source = this.source(material);
        if (!source) return;
        let kinds = this.#materials.get(material);
        if (!kinds) this.#materials.set(material, (kinds = new Map()));
        const { uniforms } = this.#renderer.properties.get(material);
        const { version } = material;
        const which = kind(object);
        const known = kinds.get(which);
        if (known?.source !== source || known.uniforms !== uniforms || known.version !== version)
            kinds.set(which, { source, uniforms, version });
    }
}
