// Passes that override materials: what the override material writes, where the author's own program draws. three.js
// gives an override material the author's `positionNode`, `alphaTest`, `alphaMap` and `displacementMap`; whatever else
// moves vertices, discards, writes depth or bends normals is not in it.
//
// The nodes of the author's material are all there in WebGPURenderer, so the override's value is put in place of the
// author's output, and three.js makes the program. No text is derived.

import { SRGBColorSpace, TSL } from 'three/webgpu';
import { passName, row } from '../rows.js';
import { Authors, isDoubtful, untold } from './authors.js';
import { derivedMaterial, plainLight } from './casting.js';

/** What an override material writes, as a node; `null` for those that are not known. */
function valueOf(override) {
    const { vec4, normalView, packNormalToRGB, colorSpaceToWorking, reference } = TSL;
    const of = (name, type) => reference(name, type, override);
    if (override.isMeshNormalMaterial || override.isMeshNormalNodeMaterial)
        return colorSpaceToWorking(vec4(packNormalToRGB(normalView), of('opacity', 'float')), SRGBColorSpace);
    if (override.isNodeMaterial) {
        const { fragmentNode, outputNode, colorNode } = override;
        if (fragmentNode ?? outputNode) return vec4(fragmentNode ?? outputNode);
        if (override.isMeshBasicNodeMaterial && colorNode) return vec4(colorNode);
    }
    if (override.isMeshBasicMaterial || override.isMeshBasicNodeMaterial)
        return override.map ? null : vec4(of('color', 'color'), of('opacity', 'float'));
    return null;
}

/** State of the pass: that of the override material. */
const STATE = ['side', 'transparent', 'blending', 'depthTest', 'depthWrite', 'depthFunc', 'colorWrite', 'wireframe'];

function overridden(author, override, value) {
    const { Fn, vec4 } = TSL;
    // The author's output is evaluated for what it discards.
    const after = (node) => Fn(() => (vec4(node).toVar().toStack(), value))();
    const output = (node) => (node ? after(node) : value);
    return derivedMaterial(author, {
        name: `override ${override.uuid} ${override.version}`,
        ...Object.fromEntries(STATE.map((key) => [key, override[key]])),
        fragmentNode: author.fragmentNode ? output(author.fragmentNode) : null,
        outputNode: author.fragmentNode ? null : output(author.outputNode),
        mrtNode: override.mrtNode ?? null,
        fog: false,
    });
}

/** Whether an override writes normals, and the author has others; three.js' normal material has no alpha test at all. */
const bends = (author, override) =>
    Boolean(override.isMeshNormalMaterial || override.isMeshNormalNodeMaterial) &&
    Boolean(author.normalNode || author.alphaTest > 0);

export class Override {
    #host;
    /** By scene: the name of the pass, and what is made for it by override material. */
    #scenes = new WeakMap();
    /** All that is made. */
    #made = new Set();

    constructor(host) {
        this.#host = host;
    }

    /** `pass` is a scene, or has one: a `PassNode`. `options`: false undoes it. */
    use(pass, options) {
        const scene = pass.isObject3D ? pass : pass.scene;
        if (!scene?.isObject3D) throw new TypeError('preshade: `override` takes a scene here, or a pass that has one');
        const known = this.#scenes.get(scene);
        if (options === false) {
            for (const { release } of [...(known?.made.values() ?? [])]) release();
            this.#scenes.delete(scene);
            return;
        }
        if (options?.normals)
            throw new TypeError('preshade: `normals` needs a WebGLRenderer; here, normals are those of `normalNode`');
        this.#scenes.set(scene, Object.assign(known ?? { made: new Map() }, { name: passName(pass, options) }));
    }

    /** Draws one object of a pass that overrides materials; answers false where three.js is to draw it. */
    draw(call, draw) {
        const { renderer } = this.#host;
        const { object, material: override, scene } = call;
        const author = renderer._currentSourceMaterial;
        if (author === null || override !== scene.overrideMaterial || !this.#scenes.has(scene)) return false;
        const { material } = this.#author(author, override, object, this.#scenes.get(scene));
        if (!material) return false;
        for (const key of STATE) material[key] = override[key];
        renderer._currentSourceMaterial = null;
        try {
            draw({ ...call, material, lightsNode: plainLight() });
        } finally {
            renderer._currentSourceMaterial = author;
        }
        return true;
    }

    /** What is made for a pass with an override material, until either goes. */
    #authors(pass, override) {
        const known = pass.made.get(override);
        if (known) return known.authors;
        const authors = new Authors();
        const release = () => {
            override.removeEventListener('dispose', release);
            authors.release();
            pass.made.delete(override);
            this.#made.delete(made);
        };
        const made = { pass, override, authors, release };
        override.addEventListener('dispose', release);
        pass.made.set(override, made);
        this.#made.add(made);
        return authors;
    }

    #author(author, override, object, pass) {
        const authors = this.#authors(pass, override);
        const discards = this.#host.discards.of(author);
        const stamp = `${author.version} ${override.version} ${discards === false}`;
        const known = authors.of(author, stamp, () => untold(author));
        const isSame = () =>
            !bends(author, override) && !isDoubtful(author, known.nodes, object, discards, { isShadow: false });
        if (known.state !== 'same' || isSame()) return known;
        const value = valueOf(override);
        const reason = `what "${override.name || override.type}" writes is not known`;
        if (!value) return Object.assign(known, { state: 'refused', reason, code: 'override' });
        const material = overridden(author, override, value);
        return Object.assign(known, { state: 'done', material, materials: [material] });
    }

    report() {
        return [...this.#made].flatMap(({ pass, override, authors }) =>
            [...authors].map(([material, { state, reason, code }]) =>
                row('override', material, {
                    of: pass.name,
                    state,
                    reason,
                    code,
                    mode: override.name || override.type,
                }),
            ),
        );
    }

    dispose() {
        this.#scenes = new WeakMap();
        for (const { release } of [...this.#made]) release();
    }
}
