// Passes that override materials, drawn with the real geometry: each object by a slice of its own program, with the values that the pass's material would write.

import { passName } from '../rows.js';
import { Derivations } from './derivations.js';
import { Left } from './left.js';
import { isCoveredByOverride, POINTS } from './stock.js';
import { Swaps } from './swaps.js';
import { colour, depth, mask, normals } from './values.js';

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

/** What a material of a pass writes, or null if it is not known. `key` tells texts apart. `from`: where normals come from. */
function valueOf(material, scene, from) {
    const isBare = !material.normalMap && !material.bumpMap && !material.transparent;
    if (material.isMeshNormalMaterial && isBare) return normals(from);
    if (material.isMeshDepthMaterial) return depth(material.depthPacking);
    if (material.isMeshBasicMaterial && isPlain(material, scene)) return colour;
    if (mask.is(material)) return mask;
    return null;
}

export class Override {
    #host;
    #pass;
    #name;
    #gone;
    /** Where normals come from: for all, or a function that is asked once for each material. */
    #normals;
    #asked = new WeakMap();
    #restore = [];
    #derivations;
    #swaps = new Swaps();
    #active = 0;
    /** Of renders around the pass. */
    #depth = 0;
    #left = new Left('override');

    /** `name`: of the pass in reports. `normals`: as of `normals` in values.js, or a function of the material. `gone()` is called when the pass is disposed of. */
    constructor(host, pass, { name, normals: from = null } = {}, gone) {
        if (typeof pass.render !== 'function')
            throw new TypeError('preshade: `override` takes a pass, which has a method `render`');
        if (from !== null && typeof from !== 'string' && typeof from !== 'function')
            throw new TypeError('preshade: `normals` is "faces", "program", a name, or a function of the material');
        this.#host = host;
        this.#pass = pass;
        this.#name = passName(pass, { name });
        this.#normals = from;
        this.#gone = gone;
        this.#derivations = new Derivations(host, {
            pass: 'override',
            steps: (source, mode, author, { value }) => value.steps(source, author),
            build: (variant, step, { source, extra }) => {
                const made = extra.value.build(variant.passes[0], source, step, extra.material);
                return { ...variant.passes[0], ...made, state: { ...FIXED, side: undefined } };
            },
        });
        this.#wrap('render', (render, given) => this.#run(() => render.apply(pass, given)));
        this.#wrap('dispose', (dispose, given) => {
            this.#gone();
            return dispose.apply(pass, given);
        });
        host.hooks.draw.add(this.#draw);
        host.hooks.afterRender.add(this.#rendered);
    }

    report() {
        const rows = [...this.#derivations.rows(), ...this.#left.rows()];
        for (const row of rows) row.of = this.#name;
        return rows;
    }

    settled() {
        return this.#derivations.settled();
    }

    dispose() {
        this.#host.hooks.draw.delete(this.#draw);
        this.#host.hooks.afterRender.delete(this.#rendered);
        for (const restore of this.#restore.splice(0)) restore();
        this.#derivations.dispose();
        this.#left.clear();
    }

    /** Someone may wrap the method after us: then ours stays in between, and passes on. */
    #wrap(name, around) {
        const pass = this.#pass;
        const method = pass[name];
        if (typeof method !== 'function') return;
        // A pass's own method, or that of its class.
        const isOwn = Object.hasOwn(pass, name);
        const wrapped = (...given) => around(method, given);
        pass[name] = wrapped;
        this.#restore.push(() => {
            if (pass[name] !== wrapped) return;
            if (isOwn) pass[name] = method;
            else delete pass[name];
        });
    }

    #run(render) {
        if (this.#active++ === 0) {
            this.#depth = this.#host.hooks.depth;
            this.#swaps.begin();
        }
        try {
            return render();
        } finally {
            if (--this.#active === 0) this.#swaps.end();
        }
    }

    #rendered = () => {
        if (this.#active && this.#host.hooks.depth === this.#depth) this.#swaps.rendered();
    };

    #from(author) {
        if (typeof this.#normals !== 'function') return this.#normals;
        if (!this.#asked.has(author)) this.#asked.set(author, this.#normals(author) ?? null);
        return this.#asked.get(author);
    }

    #draw = (draw) => {
        const { scene, object, material, group, camera } = draw;
        // Shadow maps, and full-screen passes, whose scene is a mesh.
        if (!this.#active || !scene?.isScene) return;
        const isOverride = material === scene.overrideMaterial;
        if (!isOverride && !this.#swaps.draws(object, material)) return;
        const all = isOverride ? object.material : this.#swaps.authorOf(object);
        const author = Array.isArray(all) ? all[group?.materialIndex] : all;
        if (!author || author === material) return;
        if (author.isNodeMaterial) {
            this.#left.set(author, 'refused', 'materials of nodes are supported in a WebGPURenderer only', 'renderer');
            return;
        }
        if (object.isPoints) {
            this.#left.set(author, ...POINTS);
            return;
        }
        const from = this.#from(author);
        const value = valueOf(material, scene, from);
        if (!value) {
            this.#left.set(author, 'refused', `it is not known what ${material.type} writes`, 'override');
            return;
        }
        const isAsked = value.isNormal && from && from !== 'program';
        if (!isAsked && isCoveredByOverride(author, material, value.isNormal)) {
            this.#left.set(author, 'same', 'the material of the pass does the same');
            return;
        }
        if (value === colour && this.#host.renderer.getRenderTarget() === null) {
            this.#left.set(author, 'refused', 'its colour is known in a render target only', 'override');
            return;
        }
        this.#left.delete(author);
        const own = this.#derivations.pick(
            author,
            object,
            value.key,
            { value, material, mode: material.name || material.type },
            scene,
            camera,
        );
        if (!own) return;
        own.side = author.side;
        for (const name of STATE) own[name] = material[name];
        // three.js sends a material's uniforms once, until it draws by another.
        if (value.update?.(own.preshade.uniforms, material)) this.#host.renderer.state.useProgram(null);
        draw.material = own;
    };
}
