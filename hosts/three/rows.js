// The rows of `report()`, of both renderers: the same fields in the same order. What is long is not enumerable, so that `console.table` shows what is short.

const REPORT = 'report the material, with what `preshade.text(material)` gives';

/** What helps against each refusal of this package; codes that are not here are the compiler's. */
export const REMEDIES = {
    material: 'nothing has to be done: three.js draws this state of a material as always',
    scene: 'draw that material in another scene, or make it transparent',
    cleared: 'clear the depth before or after the frame, or draw what needs it in a scene of its own',
    object: 'draw it as a mesh, or leave it to three.js',
    callback: 'set what its onBeforeRender sets ahead of the frame',
    'not-asked': 'name it in the options `materials` or `pass`',
    'earlier-call': 'name it in the option `materials` of one of the two calls',
    transparent: 'set the option `transparent`, where the renderer has it',
    recipe: 'ask for another recipe, or give a `fallback`',
    target: 'draw into a target with one sample, and without a reversed depth buffer',
    override: 'set `allowOverride = false` on your materials, or draw the pass by one of the materials in OVERRIDE.md',
    renderer: 'use a WebGPURenderer with its WebGPU backend, of a version that the README names',
    version: 'use three.js r187 or later',
    'self-test': 'nothing has to be done: this driver computes other depths, and three.js draws as always',
    'no-gain': 'nothing has to be done: it would cost this device more than it saves',
    'switched-off': 'set `enabled = true` on what the function returned',
    'not-timed': 'leave out `measure`, or draw more frames without a pause',
    transmitted: 'set renderer.shadowMap.transmitted = false',
    driver: REPORT,
    link: REPORT,
    failed: REPORT,
    usage: 'give the option in a form that index.d.ts names',
    worker: 'serve preshade.wasm where the option `wasm` says, and see the console for why the worker failed',
    timeout: 'raise the option `timeout`',
};

/** States of the parts, in the words of a report. */
const WORDS = {
    asked: 'pending',
    compiling: 'pending',
    compiled: 'pending',
    testing: 'pending',
    unseen: 'waiting',
    original: 'refused',
    ready: 'done',
};

/**
 * `facts`: fields of a `Row` of index.d.ts. `measured`: what was, null while it is, and undefined where nothing is to be measured.
 */
export function row(pass, material, { measured, ...facts }) {
    const state = WORDS[facts.state] ?? facts.state;
    const told = { ...facts, ...(state === 'done' && timed(measured)) };
    const { of, mode, reason, remedy, code, ms, recipe, form, selfTest, perPixel, normals, note, isCurrent } = told;
    const short = {
        pass,
        of: of ?? null,
        material: material.name || material.type,
        state: WORDS[told.state] ?? told.state,
        reason: reason ?? null,
        remedy: remedy ?? REMEDIES[code] ?? null,
        code: code ?? null,
        ms: Math.round(ms ?? 0),
        mode: mode ?? null,
        recipe: recipe ?? null,
        form: form ?? null,
        selfTest: selfTest ?? null,
        ratio: measured ? Number(measured.ratio.toFixed(3)) : null,
        perPixel: perPixel ?? null,
        normals: normals ?? null,
        note: note ?? null,
        isCurrent: isCurrent ?? true,
        uuid: material.uuid,
    };
    const { plan = null, skipped = [], failures = [], left_out = [], method = null, rendered = null } = facts;
    const long = { measured: measured ?? null, method, plan, skipped, failures, left_out, rendered };
    for (const [name, value] of Object.entries(long)) Object.defineProperty(short, name, { value });
    return short;
}

/** The row of a part that the page switched off. */
export const switchedOff = (row) =>
    ['done', 'measuring'].includes(row.state)
        ? Object.assign(row, {
              state: 'off',
              reason: 'switched off',
              remedy: REMEDIES['switched-off'],
              code: 'switched-off',
          })
        : row;

/** What a measurement says of what could be drawn. */
function timed(measured) {
    if (measured === undefined || measured?.on) return {};
    if (measured === null) return { state: 'measuring', reason: 'frames with and without it are timed' };
    return measured.known
        ? { state: 'off', code: 'no-gain', reason: 'frames with it are not faster' }
        : { state: 'off', code: 'not-timed', reason: 'too few frames could be timed' };
}

/**
 * A plan's row: `{ state, reason, remedy, code, ms, recipe, verdicts, skipped, failures, plan }`, where `recipe` is `{ name, form }`. `verdicts`: of its self-tests, in order.
 */
export function planRow(pass, material, planned, more) {
    const { state, reason, code, ms, recipe, verdicts, skipped, failures, plan } = planned;
    const last = verdicts.at(-1);
    const isUnseen = last === 'unseen' && ['testing', 'unseen', 'compiled'].includes(state);
    return row(pass, material, {
        state: isUnseen ? 'unseen' : state,
        reason: isUnseen ? 'nothing of it was in view of the self-test yet' : (reason ?? null),
        remedy: planned.remedy,
        code,
        ms,
        ...(state === 'original' && { reason: last, code: 'self-test' }),
        recipe: recipe?.name,
        form: recipe?.form,
        selfTest: verdicts.join(', ') || null,
        skipped: skipped.map((step) => `${step.pass}: ${step.reason}`),
        failures: [...failures],
        rendered: planned.rendered,
        plan,
        ...more,
    });
}

/** What a pass that overrides materials is called: a bundle shortens the names of classes. */
export const passName = (pass, { name } = {}) => name ?? (pass.name || pass.type || pass.constructor.name);

/** Each material of a scene with the first object that has it. */
export function materialsOf(scene) {
    const found = new Map();
    scene.traverse((object) => {
        for (const material of [object.material ?? []].flat())
            if (material.isMaterial && !found.has(material)) found.set(material, object);
    });
    return found;
}

/** Rows of what velocities leave out. `isDrawn(material)`: whether its meshes have one. */
export function withoutVelocity(scene, isDrawn) {
    return [...materialsOf(scene)].flatMap(([material, object]) => {
        if (!object.isMesh)
            return [row('velocity', material, { state: 'refused', reason: 'not a mesh', code: 'object' })];
        if (isDrawn(material)) return [];
        return [row('velocity', material, { state: 'refused', reason: 'transparent', code: 'transparent' })];
    });
}
