/**
 * Depth functions by the names of a plan. The numbers are three.js's constants, which are in its files of scenes too. They are not imported: one renderer has them from `three` and the
 * other from `three/webgpu`, and no page should bundle both.
 */
export const COMPARE = {
    never: 0,
    always: 1,
    less: 2,
    'less-equal': 3,
    equal: 4,
    'greater-equal': 5,
    greater: 6,
    'not-equal': 7,
};

/** The name of one of three.js's depth functions. */
export const compareName = (depthFunc) => Object.keys(COMPARE).find((name) => COMPARE[name] === depthFunc);
