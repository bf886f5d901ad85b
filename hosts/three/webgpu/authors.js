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
    #seen = new WeakMap();

    saw({ material, pipeline, _sourceMaterial: source }) {
        if (source !== null || this.#seen.get(material)?.program.deref() === pipeline.fragmentProgram) return;
        const program = pipeline.fragmentProgram;
        this.#seen.set(material, { program: new WeakRef(program), discards: DISCARD.test(program.code) });
    }

    /** `null` if none was seen yet. */
    of(material) {
        return this.#seen.get(material)?.discards ?? null;
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

/**
 * Whether positions, holes or depths of the author's whole program may differ from what three.js draws in a pass with a
 * material of its own. `discards`: see `Discards`.
 */
export function isDoubtful(material, object, discards, { isShadow }) {
    const carried = isShadow ? SHADOW : OVERRIDE;
    const nodes = Object.keys(material).filter((key) => !key.startsWith('_') && material[key]?.isNode);
    if (nodes.some((key) => ['vertexNode', 'geometryNode'].includes(key))) return true;
    if (nodes.includes('depthNode') && !carried.has('depthNode')) return true;
    if (discards === false) return false;
    if (material.alphaHash) return true;
    const isTested = material.alphaTest > 0 || nodes.includes('alphaTestNode');
    const hasAlpha = material.opacity < 1 || material.vertexColors || object.instanceColor || object._colorsTexture;
    if (isTested && (hasAlpha || (material.map && !carried.has('map')))) return true;
    return nodes.some((key) => !carried.has(key));
}
