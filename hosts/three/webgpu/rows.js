// The rows of a report: those of `WebGLHost`.

/** States of the parts here, in the words of a report. */
const WORDS = {
    asked: 'pending',
    compiling: 'pending',
    compiled: 'pending',
    testing: 'pending',
    ready: 'done',
};

export function row(pass, material, { state, reason = null, remedy = null, code = null, ms = 0, ...more }) {
    return {
        pass,
        material: material.name || material.type,
        uuid: material.uuid,
        state: WORDS[state] ?? state,
        reason,
        remedy,
        code,
        ms,
        ...more,
    };
}
