/** The texts of a three.js `ShaderMaterial`, as its author wrote them. */
export interface Stages {
    vertex: string;
    fragment: string;
}

/**
 * Whether the texts read what three.js declares (`position`, `modelViewMatrix`, ..) without a declaration. Not for
 * texts with a chunk (`#include <common>`): `preshade.text(material)` of the package preshade-three has those whole.
 */
export declare function isOfThree(stages: Stages): boolean;

/**
 * The texts with the declarations of three.js r187, in GLSL ES 3.00. Texts that `isOfThree` denies are given back as
 * they are. Definitions such as `USE_COLOR`, `USE_TANGENT` and `USE_INSTANCING` declare the attributes of these.
 */
export declare function withThree(stages: Stages): Stages;
