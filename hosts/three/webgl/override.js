// Passes that override materials, drawn with the real geometry: each object by a slice of its own program, with the values that the pass's material would write.

import { Derivations } from './derivations.js';
import { Left } from './left.js';
import { isCoveredByOverride, POINTS } from './stock.js';
import { colour, depth, mask, normal } from './values.js';

/** State that is the pass's material's and not the author's. Sides are the author's. */
const STATE = [
    'blending',
    'transparent',
    'premultipliedAlpha',
    'depthTest',
    'depthWrite',
    'depthFunc',
    'colorWrite',
    'wireframe',
];
const FIXED = { alphaToCoverage: false, stencilWrite: false, polygonOffset: false };

/** Whether a MeshBasicMaterial writes its colour and nothing else. */
function isPlain({ map, alphaMap, envMap, aoMap, lightMap, vertexColors, transparent, fog }, scene) {
    return !map && !alphaMap && !envMap && !aoMap && !lightMap && !vertexColors && !transparent && !(fog && scene?.fog);
}

/** What a material of a pass writes, or null if it is not known. `key` tells texts apart. */
function valueOf(material, scene) {
    const isBare = !material.normalMap && !material.bumpMap && !material.transparent;
    if (material.isMeshNormalMaterial && isBare) return normal;
    if (material.isMeshDepthMaterial) return depth(material.depthPacking);
    if (material.isMeshBasicMaterial && isPlain(material, scene)) return colour;
    if (mask.is(material)) return mask;
    return null;
}

export class Override {
    #host;
    #pass;
    #own;
    #render;
    #derivations;
    #active = 0;
    #left = new Left('override');

    constructor(host, pass) {
        if (typeof pass.render !== 'function')
            throw new TypeError('preshade: `override` takes a pass, which has a method `render`');
        this.#host = host;
        this.#pass = pass;
        this.#derivations = new Derivations(host, {
            pass: 'override',
            steps: (source, mode, author, { value }) => value.steps(source, author),
            build: (variant, step, { source, extra }) => {
                const made = extra.value.build(variant.passes[0], source, step, extra.material);
                return { ...variant.passes[0], ...made, state: { ...FIXED, side: undefined } };
            },
        });
        // A pass's own method, or that of its class.
        this.#own = Object.hasOwn(pass, 'render') ? pass.render : null;
        const { render } = pass;
        this.#render = (...given) => {
            this.#active++;
            try {
                return render.apply(pass, given);
            } finally {
                this.#active--;
            }
        };
        pass.render = this.#render;
        host.hooks.draw.add(this.#draw);
    }

    report() {
        const rows = [...this.#derivations.rows(), ...this.#left.rows()];
        return rows.map((row) => ({ ...row, of: this.#pass.constructor.name }));
    }

    settled() {
        return this.#derivations.settled();
    }

    dispose() {
        this.#host.hooks.draw.delete(this.#draw);
        if (this.#pass.render === this.#render) {
            if (this.#own) this.#pass.render = this.#own;
            else delete this.#pass.render;
        }
        this.#derivations.dispose();
        this.#left.clear();
    }

    #draw = (draw) => {
        const { scene, object, material, group, camera } = draw;
        // Shadow maps, and full-screen passes, whose scene is a mesh.
        if (!this.#active || !scene?.isScene) return;
        const isOverride = material === scene.overrideMaterial;
        const all = isOverride ? object.material : this.#host.programs.authorOf(object);
        const author = Array.isArray(all) ? all[group?.materialIndex] : all;
        if (!author || author === material) return;
        if (author.isNodeMaterial) {
            this.#left.set(author, 'refused', 'materials of nodes are supported in a WebGPURenderer only');
            return;
        }
        if (object.isPoints) {
            this.#left.set(author, ...POINTS);
            return;
        }
        const value = valueOf(material, scene);
        if (!value) {
            this.#left.set(author, 'refused', `it is not known what ${material.type} writes`);
            return;
        }
        if (isCoveredByOverride(author, material, value === normal)) {
            this.#left.set(author, 'same', 'the material of the pass does the same');
            return;
        }
        if (value === colour && this.#host.renderer.getRenderTarget() === null) return;
        this.#left.delete(author);
        const own = this.#derivations.pick(author, object, value.key, { value, material }, scene, camera);
        if (!own) return;
        own.side = author.side;
        for (const name of STATE) own[name] = material[name];
        // three.js sends a material's uniforms once, until it draws by another.
        if (value.update?.(own.preshade.uniforms, material)) this.#host.renderer.state.useProgram(null);
        draw.material = own;
    };
}
