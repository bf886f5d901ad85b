// What WebGPU and WebGL say of the page's own mistakes: such a page shows something else than it was meant to.

/** So many different messages are kept. */
const MOST_ERRORS = 8;
const pageErrors = new Set();

function pageErred(message) {
    if (pageErrors.size < MOST_ERRORS) pageErrors.add(message);
}

/** Errors that no scope of the page catches. */
function hearDevices() {
    wrap(
        globalThis.GPUAdapter,
        'requestDevice',
        (original) =>
            function () {
                return original.apply(this, arguments).then((device) => {
                    device.addEventListener('uncapturederror', ({ error }) => pageErred(`WebGPU: ${error.message}`));
                    device.lost.then(({ reason, message }) => {
                        if (reason !== 'destroyed') pageErred(`WebGPU: the device was lost: ${message}`);
                    });
                    return device;
                });
            },
    );
}

/** On a context: errors that the recorder asked for and the page did not yet. */
const ERRORS = Symbol('preshade errors');
const ERROR_NAMES = {
    0x0500: 'INVALID_ENUM',
    0x0501: 'INVALID_VALUE',
    0x0502: 'INVALID_OPERATION',
    0x0505: 'OUT_OF_MEMORY',
    0x0506: 'INVALID_FRAMEBUFFER_OPERATION',
    0x9242: 'CONTEXT_LOST_WEBGL',
};

/** What the page did wrong so far. The recorder's own calls come later. */
function hearContext(gl, getError) {
    const kept = (gl[ERRORS] ??= []);
    // One of each kind at most.
    for (let i = 0; i < 8; i++) {
        const error = getError();
        if (!error) return;
        kept.push(error);
        pageErred(`WebGL: ${ERROR_NAMES[error] ?? error}`);
    }
}

/** The page still gets each error that it asks for. */
function giveErrors(types) {
    for (const type of types) {
        wrap(
            type,
            'getError',
            (original) =>
                function () {
                    return this[ERRORS]?.shift() ?? original.call(this);
                },
        );
    }
}
