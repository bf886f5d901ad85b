// The page: the same scene by each variant, what the plan promised, what the self-test found, and what it costs here.
//
// In the address: `?perturb=4e-7` pushes the pre-pass's positions by that much of their w, which no driver should: the self-test sees it, and the page falls back. With `&trust` it does
// not look, and shows what would become of the picture.

import { Vector3, WebGLRenderer } from 'three';
import { Preshade } from 'preshade-three';
import { makeScene } from './scene.js';
import { VARIANTS } from './variants.mjs';
import { difference, Views } from './views.js';

const asked = new URLSearchParams(location.search);
const element = (id) => document.getElementById(id);
const say = (text) => (element('status').textContent = text);

const renderer = new WebGLRenderer({ canvas: element('canvas'), antialias: false, depth: false });
const gl = renderer.getContext();
const views = new Views(renderer);
const preshade = await Preshade.of(renderer);
const { scene, camera, materials, at } = await makeScene();
const state = { variant: 'original', view: 'picture', split: 0.5, seconds: 0, turn: 0 };
const start = camera.position.clone();
const target = new Vector3(-0.6, 2.4, 0);

// ---- sizes and the camera -----------------------------------------------------------------------------------------------------------------------------------------------------

function fit() {
    const { clientWidth, clientHeight } = element('canvas');
    renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
    renderer.setSize(clientWidth, clientHeight, false);
    views.setSize(element('canvas').width, element('canvas').height);
    camera.aspect = clientWidth / clientHeight;
    camera.updateProjectionMatrix();
}

function pose() {
    camera.position.copy(start).applyAxisAngle(new Vector3(0, 1, 0), state.turn);
    camera.lookAt(target);
    at(state.seconds);
}

// ---- variants -------------------------------------------------------------------------------------------------------------------------------------------------------------------

/** By name, the variants that have been loaded. `part` is what preshade does for one, and null for the original. */
const loaded = new Map();

/** Moves the pre-pass off the main pass by `amount`, as a driver does that compiles the two apart. */
function perturb(amount) {
    if (!amount) return undefined;
    return (text, role, stage) => {
        if (role !== 'prepass' || stage !== 'vertex') return text;
        const end = text.lastIndexOf('}');
        const body = text.slice(0, end).replace(/return;\s*$/, '');
        return `${body}    gl_Position.z += ${amount.toExponential()} * gl_Position.w;\n}\n`;
    };
}

const edit = perturb(Number(asked.get('perturb') ?? 0));

async function load(name) {
    if (loaded.has(name)) return loaded.get(name);
    const variant = { name, part: null };
    loaded.set(name, variant);
    if (name === 'original') return variant;
    const { recipe, of, fallback } = VARIANTS.find((each) => each.name === name);
    const pass = (material) => of?.[material.name] ?? recipe;
    variant.part = preshade.rewrite(scene, { pass, fallback, edit, trust: asked.has('trust') });
    await settle(variant, () => glance(variant));
    return variant;
}

/** Draws frames by `frame` until everything of the variant is compiled and tested. */
async function settle(variant, frame) {
    let frames = 0;
    do {
        frame();
        frames += 1;
        // The answers of occlusion queries come in a later task.
        await new Promise((done) => setTimeout(done, 0));
        await preshade.settled();
    } while (frames < 4 || !variant.part.isSettled);
    return frames;
}

/** The rows of the report that are of the programs that are drawn now, by material. */
function rows({ part }) {
    if (!part) return {};
    // Only the variant that is drawn is switched on.
    const { enabled } = part;
    part.enabled = true;
    const current = part.report().filter(({ isCurrent }) => isCurrent !== false);
    part.enabled = enabled;
    return Object.fromEntries(current.map((row) => [row.material, row]));
}

// ---- pictures ---------------------------------------------------------------------------------------------------------------------------------------------------------------

/** Draws the scene's linear colours by a loaded variant. */
function render(variant, into = views.scene) {
    for (const { name, part } of loaded.values()) if (part) part.enabled = name === variant.name;
    renderer.setRenderTarget(into);
    renderer.render(scene, camera);
}

function draw() {
    const variant = loaded.get(state.variant);
    if (!variant) return;
    pose();
    if (state.view !== 'picture') {
        render(loaded.get('original'));
        views.develop(views.original);
    }
    render(variant);
    views.develop(views.variant);
    views.show({
        split: state.view === 'split' ? state.split : 0,
        gain: state.view === 'difference' ? 64 : 0,
    });
}

/** Draws a frame that nobody looks at, and waits for it. */
function glance(variant, into = views.small) {
    pose();
    render(variant, into);
    renderer.readRenderTargetPixels(into, 0, 0, 1, 1, new Uint16Array(4));
}

/** The bytes of a loaded variant's picture. */
function picture(variant) {
    pose();
    render(variant);
    views.develop(views.variant);
    return views.read(views.variant);
}

/** Each variant's picture against the original's, all of this moment. */
async function compare(names) {
    const original = await load('original');
    const found = {};
    for (const name of names) await load(name);
    const before = picture(original);
    for (const name of names) found[name] = difference(before, picture(loaded.get(name)));
    return found;
}

/** Like `compare`, of each frame from now on until the variant has followed what was done to the scene. */
async function follow(name) {
    const variant = await load(name);
    const pictures = [];
    const frames = await settle(variant, () => {
        const one = picture(variant);
        if (!pictures.length || difference(pictures.at(-1), one).most > 0) pictures.push(one);
    });
    const original = picture(await load('original'));
    const all = pictures.map((one) => difference(original, one));
    const [off, most] = ['off', 'most'].map((key) => Math.max(...all.map((of) => of[key])));
    return { off, most, frames, pixels: all[0].pixels };
}

/** How much of a variant's picture a material is seen in. */
async function seen(name, id) {
    const variant = await load(name);
    const before = picture(variant);
    materials[id].visible = false;
    const without = picture(variant);
    materials[id].visible = true;
    return difference(before, without).off;
}

// ---- time -----------------------------------------------------------------------------------------------------------------------------------------------------------------

const timer = gl.getExtension('EXT_disjoint_timer_query_webgl2');

/** Milliseconds of one frame of a loaded variant: the GPU's own clock, or else the CPU's from the first call until the picture can be read. */
async function time(variant) {
    if (timer) {
        const query = gl.createQuery();
        gl.beginQuery(timer.TIME_ELAPSED_EXT, query);
        render(variant);
        gl.endQuery(timer.TIME_ELAPSED_EXT);
        gl.flush();
        while (!gl.getQueryParameter(query, gl.QUERY_RESULT_AVAILABLE))
            await new Promise((done) => setTimeout(done, 1));
        const nanoseconds = gl.getQueryParameter(query, gl.QUERY_RESULT);
        gl.deleteQuery(query);
        return gl.getParameter(timer.GPU_DISJOINT_EXT) ? null : nanoseconds / 1e6;
    }
    const before = performance.now();
    glance(variant, views.scene);
    return performance.now() - before;
}

/** The median of `rounds` frames of each variant, in turn, so that what else the machine does falls on all alike. */
async function measure(rounds = 9, names = choices.map(({ name }) => name)) {
    const variants = [];
    for (const name of names) variants.push(await load(name));
    pose();
    const times = new Map(variants.map((variant) => [variant.name, []]));
    for (let round = -1; round < rounds; round++) {
        say(`Measuring: round ${Math.max(round + 1, 1)} of ${rounds}`);
        for (const variant of round % 2 ? variants : [...variants].reverse()) {
            const took = await time(variant);
            if (round >= 0 && took > 0) times.get(variant.name).push(took);
        }
        await new Promise((done) => setTimeout(done, 0));
    }
    const median = (all) => [...all].sort((a, b) => a - b)[all.length >> 1] ?? null;
    return new Map([...times].map(([name, all]) => [name, median(all)]));
}

// ---- controls ---------------------------------------------------------------------------------------------------------------------------------------------------------------

const choices = [{ name: 'original', label: 'As its authors wrote it' }, ...VARIANTS];

function row(name) {
    return element('results').querySelector(`tr[data-variant="${name}"]`);
}

function fill(name, cells) {
    for (const [key, value] of Object.entries(cells))
        row(name).querySelector(`[data-cell="${key}"]`).textContent = value;
}

function node(tag, text, attributes = {}) {
    const made = Object.assign(document.createElement(tag), attributes);
    made.textContent = text;
    return made;
}

function promise({ contract, forms }) {
    const of = forms?.['glsl-es']?.contract ?? contract;
    const given = of.given?.length ? `, given ${of.given.join(', ')}` : '';
    const budget = of.kind === 'approximate' ? ` within ${of.budget} (${of.metric})` : '';
    return `${of.kind}${budget}${given}`;
}

function described({ role, depth: { compare, write, bias, attachment } }) {
    const pushed =
        bias.constant || bias.slope_scale ? `, pushed by ${bias.constant} and ${bias.slope_scale} times the slope` : '';
    return `${role}: ${compare} in ${attachment}${write ? ', writes depth' : ''}${pushed}`;
}

function taken({ state, selfTest, recipe, failures }) {
    if (!selfTest) return 'none asked for';
    if (failures.length === 0)
        return selfTest === 'kept' ? 'passed: the driver keeps the promise' : 'nothing of it was in view';
    const said = failures.map(({ failure }) => failure).join('; ');
    return `failed: ${said}. Drawn by ${state === 'done' ? recipe : 'the original'}`;
}

function about(variant) {
    const section = element('about');
    section.replaceChildren();
    if (variant.name === 'original')
        section.append(node('p', 'The scene as three.js draws it.', { className: 'faint' }));
    for (const [id, row] of Object.entries(rows(variant))) {
        section.append(node('h2', id));
        const { plan, state, reason, selfTest, skipped, ms } = row;
        if (state !== 'done' && !selfTest) {
            section.append(node('p', `${state}: ${reason}`, { className: 'faint' }));
            continue;
        }
        const list = document.createElement('dl');
        if (plan)
            list.append(
                node('dt', 'Promise'),
                node('dd', promise(plan)),
                node('dt', 'Passes'),
                node('dd', plan.passes.map(described).join('; ')),
            );
        if (skipped.length) list.append(node('dt', 'Left out'), node('dd', skipped.join('; ')));
        list.append(
            node('dt', 'Self-test'),
            node('dd', taken(row), { className: row.failures.length ? 'wrong' : '' }),
            node('dt', 'Compiled in'),
            node('dd', ms ? `${ms.toFixed(0)} ms` : 'none: it was in the cache'),
        );
        section.append(list);
    }
}

async function choose(name) {
    say('Loading…');
    const variant = await load(name);
    state.variant = name;
    element('variants').querySelector(`[value="${name}"]`).checked = true;
    draw();
    about(variant);
    say('');
}

function controls() {
    for (const { name, label } of choices) {
        const input = Object.assign(document.createElement('input'), { type: 'radio', name: 'variant', value: name });
        input.checked = name === 'original';
        const line = document.createElement('label');
        line.append(input, ` ${label}`);
        element('variants').append(line);
        const results = document.createElement('tr');
        results.dataset.variant = name;
        results.append(Object.assign(node('th', label), { scope: 'row' }));
        for (const cell of ['ms', 'off', 'most']) {
            const of = node('td', '–');
            of.dataset.cell = cell;
            results.append(of);
        }
        element('results').append(results);
    }
    element('controls').addEventListener('submit', (event) => event.preventDefault());
    element('controls').addEventListener('change', ({ target: { name, value } }) => {
        if (name === 'variant') choose(value);
        if (name === 'view') {
            state.view = value;
            element('split').disabled = value !== 'split';
            draw();
        }
    });
    element('split').addEventListener('input', ({ target: { value } }) => {
        state.split = Number(value);
        draw();
    });
    element('canvas').addEventListener('keydown', (event) => {
        const step = { ArrowLeft: 0.06, ArrowRight: -0.06 }[event.key];
        if (!step) return;
        event.preventDefault();
        state.turn += step;
        draw();
    });
    let dragged = null;
    element('canvas').addEventListener('pointerdown', (event) => {
        dragged = event.clientX;
        element('canvas').setPointerCapture(event.pointerId);
    });
    element('canvas').addEventListener('pointerup', () => (dragged = null));
    element('canvas').addEventListener('pointermove', ({ clientX }) => {
        if (dragged === null) return;
        state.turn += (dragged - clientX) * 0.006;
        dragged = clientX;
        draw();
    });
    let last = null;
    const move = (now) => {
        if (!element('move').checked) return;
        const passed = last === null ? 0 : Math.min(now - last, 100) / 1000;
        last = now;
        state.seconds += passed;
        state.turn += passed * 0.08;
        draw();
        requestAnimationFrame(move);
    };
    element('move').addEventListener('change', () => {
        last = null;
        requestAnimationFrame(move);
    });
    element('measure').addEventListener('click', async () => {
        element('measure').disabled = true;
        for (const [name, ms] of await measure()) {
            const { off, most } = (await compare([name]))[name];
            fill(name, {
                ms: ms === null ? 'no clock' : ms.toFixed(1),
                off: name === 'original' ? '' : off,
                most: name === 'original' ? '' : most,
            });
        }
        say('');
        draw();
        element('measure').disabled = false;
    });
    const info = gl.getExtension('WEBGL_debug_renderer_info');
    element('adapter').textContent = info
        ? gl.getParameter(info.UNMASKED_RENDERER_WEBGL)
        : gl.getParameter(gl.RENDERER);
    element('clock').textContent = timer
        ? 'GPU milliseconds a frame, median of 9'
        : 'CPU milliseconds a frame until the picture can be read, median of 9: no GPU clock here';
    new ResizeObserver(() => {
        fit();
        draw();
    }).observe(element('canvas'));
}

fit();
/** For the test. */
window.page = {
    compare,
    follow,
    seen,
    measure: async (rounds, names) => Object.fromEntries(await measure(rounds, names)),
    rows: async (name) => {
        const all = Object.entries(rows(await load(name)));
        return Object.fromEntries(all.map(([material, row]) => [material, { ...row, failures: row.failures }]));
    },
    /** How many programs of all materials a variant has been made for. */
    programs: async (name) => (await load(name)).part.report().length,
    choose,
    materials,
    renderer,
    scene,
    camera,
};
controls();
await choose('original');
element('canvas').dataset.ready = 'yes';
