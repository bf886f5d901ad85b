/** A number that a version assumes to be within bounds. */
export interface Assumed {
    name: string;
    place:
        | { from: 'uniform'; group: number; binding: number; offset: number }
        | { from: 'attribute'; location: number; component: number }
        | { from: 'texture'; group: number; binding: number; channel: number }
        | { from: 'override'; name: string };
    type: 'f32' | 'i32' | 'u32';
    low: number;
    high: number;
}

/** A specialised version of a material. */
export interface Version {
    /** The material of its plan, and prefix of its files. */
    name: string;
    guard: { values: Assumed[] };
    /** Static cost of its fragment stage. */
    operations: number;
    /** The draws of the scene that it was made for. */
    draws: number[];
}

/** `MATERIAL.versions.json`: the cheapest version first. */
export interface Versions {
    material: string;
    versions: Version[];
}

/**
 * Makes a function that chooses the cheapest version of a draw whose guard holds; `undefined` is the original. `bytes`
 * returns the content of a binding. `isKept` says whether an attribute, a texture or an override is as a guard has it;
 * without it, versions that depend on one are not chosen. Choices are remembered by the words that decide them, so a
 * draw whose values were seen before costs one look into a map.
 */
export function dispatch(
    versions: Versions,
): (
    bytes: (group: number, binding: number) => ArrayBuffer | ArrayBufferView | undefined,
    isKept?: (value: Assumed) => boolean,
) => Version | undefined;
