// What three.js's own depth material draws as the author's material does, told without the compiler.

import { Material } from 'three';

/** Types whose position three.js's depth material shares: displacement, morphs, bones, instances and batches are in both. */
const STOCK = new Set([
    'MeshBasicMaterial',
    'MeshLambertMaterial',
    'MeshPhongMaterial',
    'MeshToonMaterial',
    'MeshStandardMaterial',
    'MeshPhysicalMaterial',
    'MeshMatcapMaterial',
    'MeshNormalMaterial',
    'MeshDepthMaterial',
    'MeshDistanceMaterial',
    'ShadowMaterial',
    'LineBasicMaterial',
    'PointsMaterial',
    'SpriteMaterial',
]);

/** Whether nobody changed the text of the material's program. */
export function isStock(material) {
    return STOCK.has(material.type) && material.onBeforeCompile === Material.prototype.onBeforeCompile;
}

/** Whether every fragment's alpha before the test is that of the maps, as three.js's depth material takes it to be. */
function hasPlainAlpha({ opacity, vertexColors }, { geometry, isBatchedMesh, _colorsTexture }) {
    if (opacity !== 1) return false;
    if (vertexColors && geometry.attributes.color?.itemSize === 4) return false;
    return !(isBatchedMesh && _colorsTexture);
}

const NODES = ['refused', 'a WebGLRenderer gives the nodes of this material the viewer’s camera only', 'renderer'];
/** preshade's programs have points of one pixel, as WebGPU has. */
export const POINTS = ['refused', 'points have a size in your program, and preshade drops it', 'object'];
const SAME = ['same', 'the depth material of three.js does the same'];

/** Why three.js's own depth and distance materials draw an object: `[state, reason, code]`, or null where they do not. */
export function left(material, object) {
    if (material.isNodeMaterial) return NODES;
    if (object.isPoints) return POINTS;
    if (!isStock(material) || material.alphaHash) return null;
    // three.js itself approximates alpha to coverage by a test.
    const isCovered = material.alphaTest === 0 || material.alphaToCoverage || hasPlainAlpha(material, object);
    return isCovered ? SAME : null;
}

/** Whether the override draws an object with a stock material as that would be: without holes, displacement, planes, and with the same sides. */
export function isCoveredByOverride(material, override, hasNormals) {
    if (!isStock(material)) return false;
    if (material.alphaTest > 0 || material.alphaHash || material.alphaToCoverage) return false;
    if (material.displacementMap || material.clippingPlanes?.length) return false;
    if (hasNormals && material.flatShading) return false;
    return material.side === override.side && Boolean(material.wireframe) === Boolean(override.wireframe);
}
