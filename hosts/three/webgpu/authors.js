// Authors' materials, and what is made of each for a pass. It goes when the author disposes of the material, and is
// made anew when the material changes.

export class Authors {
    #known = new Map();

    /**
     * What `make` returned for `author` the last time, unless `stamp` is another now. Its `materials` are disposed of
     * with it: three.js then releases what it made of them.
     */
    of(author, stamp, make) {
        const known = this.#known.get(author);
        if (known?.stamp === stamp) return known;
        known?.release();
        const made = make();
        made.stamp = stamp;
        made.release = () => {
            author.removeEventListener('dispose', made.release);
            for (const material of made.materials ?? []) material.dispatchEvent({ type: 'dispose' });
            if (this.#known.get(author) === made) this.#known.delete(author);
        };
        author.addEventListener('dispose', made.release);
        this.#known.set(author, made);
        return made;
    }

    [Symbol.iterator]() {
        return this.#known.entries();
    }

    release() {
        for (const { release } of [...this.#known.values()]) release();
    }
}

const DISCARD = /\bdiscard\b/;

/** Whether the programs that three.js made of authors' materials for the camera discard. */
export class Discards {
    /** By program. */
    #texts = new WeakMap();
    /** By material: of the version that was drawn last. */
    #seen = new WeakMap();

    saw({ material, pipeline: { fragmentProgram: program }, _sourceMaterial: source }) {
        if (source !== null) return;
        const { version } = material;
        const seen = this.#seen.get(material);
        if (seen?.version === version && seen.program.deref() === program) return;
        if (!this.#texts.has(program)) this.#texts.set(program, DISCARD.test(program.code));
        const discards = this.#texts.get(program) || (seen?.version === version && seen.discards);
        this.#seen.set(material, { version, program: new WeakRef(program), discards });
    }

    /** `null` if none was seen yet of the material as it is now. */
    of(material) {
        const seen = this.#seen.get(material);
        return seen?.version === material.version ? seen.discards : null;
    }
}

/** Nodes that neither move vertices nor discard. */
const HARMLESS = [
    'castShadowPositionNode',
    'receivedShadowPositionNode',
    'castShadowNode',
    'receivedShadowNode',
    'maskShadowNode',
    'lightsNode',
    'contextNode',
];
/** What three.js' shadow material and its override materials have of the author's. */
const SHADOW = new Set([...HARMLESS, 'positionNode', 'colorNode', 'depthNode', 'maskNode', 'map']);
const OVERRIDE = new Set([...HARMLESS, 'positionNode']);

/** What `Authors.of` holds of a material that no draw has shown to be doubtful, until its version is another. */
export const untold = (material) => ({
    state: 'same',
    reason: null,
    nodes: Object.keys(material).filter((key) => !key.startsWith('_') && material[key]?.isNode),
});

/**
 * Whether positions, holes or depths of the author's whole program may differ from what three.js draws in a pass with a
 * material of its own. `nodes`: of `untold`. `discards`: see `Discards`. It is asked at each draw of a material that was
 * the same so far: an opacity needs no new version, and objects that share a material may have colours of their own.
 */
export function isDoubtful(material, nodes, object, discards, { isShadow }) {
    const carried = isShadow ? SHADOW : OVERRIDE;
    if (nodes.some((key) => ['vertexNode', 'geometryNode'].includes(key))) return true;
    if (nodes.includes('depthNode') && !carried.has('depthNode')) return true;
    if (discards === false) return false;
    if (material.alphaHash) return true;
    const isTested = material.alphaTest > 0 || nodes.includes('alphaTestNode');
    const hasAlpha = material.opacity < 1 || material.vertexColors || object.instanceColor || object._colorsTexture;
    if (isTested && (hasAlpha || (material.map && !carried.has('map')))) return true;
    return nodes.some((key) => !carried.has(key));
}
