// The page.

import examples from 'virtual:examples';
import { Changes } from './changes.js';
import { isStopped, load } from './compiler.js';
import { code, copier, counted, download, find, h, list, marked, say, select } from './dom.js';
import { DrawPanel } from './drawpanel.js';
import { SourceEditor } from './editors.js';
import * as graphs from './graph.js';
import { fromFiles, Material, NAMES, STATE } from './material.js';
import { Tabs } from './panels.js';
import { showPasses } from './passes.js';
import { REPOSITORY } from './repository.js';
import { pack, unpack } from './share.js';
import { promise, words } from './words.js';

/** Milliseconds without typing after which the text is read. */
const PAUSE = 500;
/** Some programs cut longer links. */
const LONG = 8000;

let compiler;
let material = new Material(examples[0]);
let recipe = examples[0].recipe;
let editors = [];
/** Runs out when the visitor has stopped typing. */
let timer = null;
/** What is known of the current text: `explained`, `original`, `variant`, or `problem`. */
let held = { material };
const changes = new Changes();
const drawing = new DrawPanel();
const tabs = new Tabs(
    [
        ['changes', 'Changes'],
        ['plan', 'Plan in words'],
        ['draw', 'Draw and time'],
        ['graph', 'Dataflow graph'],
        ['files', 'Files'],
    ],
    (key, panel) => show(key, panel),
);

// ---- the text ----

function setMaterial(next, nextRecipe = recipe) {
    clearTimeout(timer);
    timer = null;
    material = next;
    recipe = nextRecipe;
    // A link that is shown is of the text before.
    find('shared').hidden = true;
    editors.forEach((editor) => editor.destroy());
    const place = find('editors');
    place.className = material.files.length > 1 ? 'two' : 'one';
    place.replaceChildren();
    editors = material.files.map((file, i) => {
        const stage = material.language === 'glsl' ? (i ? 'Fragment stage, ' : 'Vertex stage, ') : '';
        place.append(h('h3', { class: 'editor-title' }, `${stage}${file.name}`));
        return new SourceEditor(place, {
            text: file.text,
            language: material.language,
            label: `${stage}${file.name}: your shader`,
            changed: edited,
        });
    });
    find('language').value = material.language;
    showState();
    refresh({ source: true });
}

/** The text of the language that is not shown now: nothing is lost by a look at the other. */
const kept = {};

function setLanguage(language, files = kept[language]) {
    kept[material.language] = current();
    const empty = NAMES[language].map((name) => ({ name, text: '' }));
    setMaterial(new Material({ ...material, files: files ?? empty }));
}

/** The files as they are in the editors. */
const current = () => material.files.map(({ name }, i) => ({ name, text: editors[i].text }));

/** A text that was pasted is whole: it is read at once. */
function edited(isWhole) {
    find('example').value = '';
    // A link that is shown is of the text before.
    find('shared').hidden = true;
    clearTimeout(timer);
    timer = setTimeout(
        () => {
            timer = null;
            material = new Material({ ...material, files: current() });
            refresh({ source: true });
        },
        isWhole ? 0 : PAUSE,
    );
    showBusy();
}

function showState() {
    const change = (key) => (value) => {
        const state = { ...material.state, [key]: value };
        material = new Material({ ...material, state });
        refresh({ source: true });
    };
    const define = h('input', {
        type: 'text',
        id: 'define',
        value: material.define,
        placeholder: 'ALPHA COUNT=4',
        onchange: () => {
            material = new Material({ ...material, define: define.value });
            refresh({ source: true });
        },
    });
    find('state').replaceChildren(
        ...STATE.map(([key, label, values, none]) =>
            select(
                label,
                `state-${key}`,
                values.map((value) => [value, value || none]),
                material.state[key] ?? '',
                change(key),
            ),
        ),
        h('label', {}, 'Definitions of GLSL ', define),
    );
    if (material.flags.length) find('settings').open = true;
}

/** Goes to a place in the visitor's text. */
function goTo(place) {
    const index = material.files.findIndex(({ name }) => name === place.file);
    editors[Math.max(index, 0)].goTo(place);
}

// ---- the compiler ----

let isRunning = false;
let isStale = null;

/** Reads the text anew, or only makes another variant of it. The newest request wins. */
async function refresh(asked) {
    isStale = { source: Boolean(isStale?.source || asked.source) };
    showBusy();
    if (isRunning || !compiler) return;
    isRunning = true;
    const waiting = setTimeout(() => showWaiting(true), 700);
    while (isStale) {
        const { source } = isStale;
        isStale = null;
        await compile(source || !held.explained);
    }
    clearTimeout(waiting);
    showWaiting(false);
    isRunning = false;
    showBusy();
}

/** Whether what is shown is not of the current text. */
function showBusy() {
    const isBusy = timer !== null || isRunning || isStale !== null;
    for (const id of ['result', 'pass-list']) find(id).setAttribute('aria-busy', isBusy);
}

async function compile(isNew) {
    const now = material;
    const tried = recipe;
    const next = { material: now };
    try {
        if (isNew) {
            next.explained = await compiler.explain(now.asked);
            next.original = await compiler.rewrite(now.asked, []);
        } else Object.assign(next, { explained: held.explained, original: held.original, graph: held.graph });
    } catch (error) {
        if (isStale) return;
        held = { material: now, problem: error };
        showProblem(error);
        showResult();
        return;
    }
    if (isStale?.source) return;
    let failure = null;
    try {
        next.variant = tried ? await compiler.rewrite(now.asked, tried.split(/\s+/)) : next.original;
    } catch (error) {
        failure = error;
    }
    if (isStale) {
        // The passes are of this text all the same.
        if (isNew && !isStale.source) held = next;
        return;
    }
    held = { ...next, failure };
    showProblem(null);
    if (isNew) showPasses(next.explained, tried, choose);
    showMarks();
    drawing.forget();
    showResult();
}

function choose(next) {
    recipe = next;
    refresh({ source: false });
}

function showWaiting(isWaiting) {
    find('loading').hidden = !isWaiting;
    if (!isWaiting) return;
    find('load-words').textContent = 'The compiler is reading the shader';
    find('load-progress').removeAttribute('value');
    const stop = h('button', { type: 'button', id: 'stop', onclick: () => compiler.stop() }, 'Stop');
    find('stop')?.remove();
    find('loading').append(stop);
}

// ---- what was found ----

const placeLink = (place) =>
    place &&
    h('button', { type: 'button', class: 'link', onclick: () => goTo(place) }, `${place.file}, line ${place.line}`);

function showProblem(error) {
    const box = find('problem');
    box.hidden = !error;
    if (!error) return;
    editors.forEach((editor) => editor.mark([]));
    if (isStopped(error)) {
        box.replaceChildren(h('strong', {}, 'Stopped. '), 'Change the text, and it is read again.');
        say('Stopped.');
        return;
    }
    const awaited = material.awaited(error);
    if (awaited) {
        box.replaceChildren(h('strong', {}, `Paste the ${awaited} stage too. `), 'You may also open its file.');
        find('pass-list').replaceChildren(h('p', { class: 'hint' }, 'Passes are listed once both stages are there.'));
        say(`Paste the ${awaited} stage too.`);
        return;
    }
    box.replaceChildren(
        h('strong', {}, error.code === 'empty' ? 'There is no shader yet. ' : 'The shader has an error. '),
        placeLink(error.place) ?? '',
        h('pre', { tabindex: '0', role: 'region', 'aria-label': 'The error' }, error.rendered ?? error.message),
        list(error.notes ?? []) ?? '',
        otherLanguage() ?? '',
        ofThree(error) ?? '',
    );
    if (error.place) {
        const index = material.files.findIndex(({ name }) => name === error.place.file);
        editors[index]?.mark([{ place: error.place, severity: 'error', message: error.message, source: error.code }]);
    }
    find('pass-list').replaceChildren(h('p', { class: 'hint' }, 'Passes are listed once the shader can be read.'));
    say(`Error${error.place ? ` in line ${error.place.line}` : ''}: ${error.message}`);
}

/** GLSL in the editor of WGSL is moved to its stage by a button. */
function otherLanguage() {
    const [{ text }] = material.files;
    if (material.language !== 'wgsl' || !/^[ \t]*#version\b|\bvoid[ \t]+main[ \t]*\(/m.test(text)) return null;
    const stage = /\bgl_Position\b/.test(text) ? 0 : 1;
    const move = () => {
        const files = (kept.glsl ?? NAMES.glsl.map((name) => ({ name, text: '' }))).map((file, i) =>
            i === stage ? { ...file, text } : file,
        );
        setLanguage('glsl', files);
    };
    const button = h('button', { type: 'button', id: 'as-glsl', onclick: move }, 'Read it as GLSL');
    return h('p', {}, `This looks like a ${stage ? 'fragment' : 'vertex'} stage in GLSL. `, button);
}

/** The text of a `ShaderMaterial` is completed by a button, and of chunks it is said who has them. */
function ofThree({ code: of, message }) {
    if (material.language !== 'glsl' || of !== 'foreign' || !message.includes('three.js')) return null;
    const whole = material.withThree;
    if (whole) {
        const button = h(
            'button',
            { type: 'button', id: 'as-three', onclick: () => setMaterial(whole) },
            'Add three.js\u2019s declarations',
        );
        return h('p', {}, 'three.js declares attributes and matrices for a ShaderMaterial. ', button);
    }
    const guide = 'the guide to three.js';
    return h(
        'p',
        {},
        'three.js puts text before this one when it draws. ',
        code('preshade.text(material)'),
        ' of the package preshade-three gives the whole text to paste here: see ',
        REPOSITORY
            ? h('a', { href: `https://github.com/${REPOSITORY}/blob/HEAD/docs/guides/three-js.md` }, guide)
            : guide,
        '.',
    );
}

/** Marks refusals at their lines: those of the chosen recipe as warnings, the others as remarks. */
function showMarks() {
    const chosen = held.variant?.refusals ?? held.failure?.refusals ?? [];
    const others = held.explained.passes.flatMap(({ refusals }) => refusals);
    const keyOf = ({ pass, code: of }) => `${pass}/${of}`;
    const isChosen = new Set(chosen.map(keyOf));
    const all = [
        ...chosen.map((refusal) => ({ refusal, severity: 'warning' })),
        ...others.filter((refusal) => !isChosen.has(keyOf(refusal))).map((refusal) => ({ refusal, severity: 'info' })),
    ];
    for (const [i, { name }] of material.files.entries()) {
        const here = all.filter(({ refusal }) => refusal.place?.file === name);
        editors[i].mark(
            here.map(({ refusal: { pass, code: of, reason, place }, severity }) => ({
                place,
                severity,
                message: `${pass} does not apply: ${reason}`,
                source: of,
            })),
        );
    }
}

/** What a pass left as it is, and why. */
const unchanged = ({ name, reason, location }) =>
    h(
        'span',
        {},
        code(name),
        location ? [' (', placeLink(location), ')'] : '',
        ' is unchanged. ',
        marked(`${reason[0].toUpperCase()}${reason.slice(1)}.`),
    );

function refusalBox({ pass, code: of, reason, remedy, place }) {
    return h(
        'div',
        { class: 'refusal', 'data-code': of },
        h('p', {}, h('strong', {}, `${pass} does not apply`), ` (${of}): ${reason}. `, placeLink(place) ?? ''),
        // The loops and other places that it names are listed below.
        remedy && !remedy.startsWith('`preshade explain`') ? h('p', {}, `To make it legal: ${remedy}.`) : '',
    );
}

/** A note of the compiler, whose flags are the page's fields. */
const plainly = (text) =>
    text
        .trim()
        .replace(/^note: /, '')
        .replace('(--state FILE or its flags say otherwise)', '(“Pipeline state and definitions” changes it)');

function showResult() {
    const { variant, problem, failure, explained } = held;
    find('result-title').textContent = recipe ? `Result: ${recipe}` : 'Result: as written';
    const place = find('verdict');
    if (problem) {
        place.replaceChildren(h('p', {}, 'There is no result: the shader could not be read.'));
    } else if (failure) {
        place.replaceChildren(
            h(
                'div',
                { class: 'problem' },
                h('strong', {}, 'This recipe cannot be read. '),
                h('pre', {}, failure.rendered ?? failure.message),
            ),
        );
        say(`This recipe cannot be read: ${failure.message}`);
    } else {
        const about = explained.passes.find(({ pass }) => pass === recipe.split(':')[0]);
        const changed = variant.recipe;
        const sites = about?.sites.map(({ what }) => what) ?? [];
        // A recipe that names a pass twice repeats its refusals.
        const refusals = [...new Map(variant.refusals.map((each) => [each.rendered, each])).values()];
        // Refusals, notes and sites are shown by themselves; the messages repeat them.
        const shown = [...refusals.map(({ rendered }) => rendered?.split('\n')[0]), ...variant.notes, ...sites];
        const isNews = (text) => !shown.some((part) => part && text.includes(part));
        place.replaceChildren(
            changed
                ? h(
                      'p',
                      {},
                      h('strong', { class: 'good' }, 'Applied. '),
                      code(changed),
                      `. ${promise(variant.contract)}`,
                  )
                : h(
                      'p',
                      {},
                      h('strong', { class: 'warn' }, 'Nothing was applied. '),
                      'The files are those of the original.',
                  ),
            ...refusals.map(refusalBox),
            list(sites) ?? '',
            list((about?.left ?? []).map(unchanged)) ?? '',
            about ? h('p', { class: 'hint' }, `It hurts ${about.hurts}. Source: ${about.source}.`) : '',
            list([...new Set([...variant.notes, ...variant.messages.filter(isNews)].map(plainly))].map(marked)) ?? '',
            ...variant.errors.map(({ code: of, message }) => h('div', { class: 'refusal' }, `${of}: ${message}`)),
        );
        const refused = refusals.map(({ pass, reason }) => `${pass} does not apply: ${reason}`);
        const files = `${counted(variant.files.length, 'file')} written.`;
        say([changed ? `${changed} applied. ${files}` : 'Nothing was applied.', ...refused].join(' '));
    }
    show(tabs.current, tabs.panel(tabs.current));
}

// ---- the views ----

function nothing(panel) {
    changes.clear();
    panel.replaceChildren(h('p', { class: 'hint' }, 'There is no result to show.'));
}

function show(key, panel) {
    if (!held.explained || held.failure) return nothing(panel);
    if (key === 'changes') changes.show(panel, held);
    if (key === 'plan')
        panel.replaceChildren(...(held.variant.plan ? words(held.variant.plan) : [h('p', {}, 'There is no plan.')]));
    if (key === 'draw') drawing.show(panel, held);
    if (key === 'graph') showGraph(panel);
    if (key === 'files') showFiles(panel);
}

async function showGraph(panel) {
    const now = held;
    if (!now.graph) {
        panel.replaceChildren(h('p', {}, 'Reading the graph.'));
        try {
            const answer = await compiler.graph(now.material.asked);
            now.graph = answer ? graphs.fromCompiler(answer) : graphs.fromPlan(now.explained, now.original.plan);
        } catch (error) {
            panel.replaceChildren(h('p', { class: 'warn' }, `There is no graph: ${error.message}.`));
            return;
        }
    }
    if (now !== held) return;
    const about = now.graph.isCoarse
        ? 'Inputs, stages and outputs of the original. This build of the compiler does not tell the values in between; the command “preshade graph” does.'
        : 'Values of the original and what they are made of. Dotted lines go through a variable; “Branches” adds dashed lines from what decides whether the other runs. A click on a node leads to its line.';
    panel.replaceChildren(h('p', {}, about), ...graphs.draw(now.graph, goTo));
}

function showFiles(panel) {
    const { variant } = held;
    const command = material.command(recipe);
    panel.replaceChildren(
        h('p', {}, 'The same files, by the command line:'),
        h('pre', { tabindex: '0', role: 'region', 'aria-label': 'Command' }, command),
        h('div', { class: 'bar' }, copier('Copy the command', command)),
        ...variant.files.map(({ name, text }) =>
            h(
                'details',
                { class: 'written' },
                h('summary', {}, code(name), ` (${counted(text.length, 'character')})`),
                h(
                    'div',
                    { class: 'bar' },
                    copier(`Copy ${name}`, text),
                    h('button', { type: 'button', onclick: () => download(name, text) }, `Save ${name}`),
                ),
                h('pre', { class: 'scroll', tabindex: '0', role: 'region', 'aria-label': name }, text),
            ),
        ),
    );
}

// ---- the bar ----

function start() {
    const options = examples.map(({ title }, i) => h('option', { value: i }, title));
    find('example').append(h('option', { value: '' }, 'your own text'), ...options);
    find('example').value = '0';
    find('example').addEventListener('change', ({ target }) => {
        if (target.value === '') return;
        const example = examples[target.value];
        setMaterial(new Material(example), example.recipe);
    });
    find('language').addEventListener('change', ({ target }) => {
        find('example').value = '';
        setLanguage(target.value);
        say(target.value === 'glsl' ? 'Two editors: vertex stage and fragment stage.' : 'One editor.');
    });
    find('open').addEventListener('change', async ({ target }) => {
        await take(target.files);
        target.value = '';
    });
    // Anywhere in the page: a browser would leave it for a file that is dropped beside the editor.
    addEventListener('dragover', (event) => {
        if (!event.dataTransfer.types.includes('Files')) return;
        event.preventDefault();
        find('shader').classList.add('dropping');
    });
    for (const name of ['dragleave', 'drop'])
        addEventListener(name, () => find('shader').classList.remove('dropping'), true);
    // Ahead of the editors, which would paste the text of a file where it is dropped.
    addEventListener(
        'drop',
        (event) => {
            if (!event.dataTransfer.files.length) return;
            event.preventDefault();
            event.stopPropagation();
            take(event.dataTransfer.files);
        },
        true,
    );
    find('share').addEventListener('click', share);
    addEventListener('hashchange', fromAddress);
    if (REPOSITORY)
        find('source-link').replaceChildren(
            h('a', { href: `https://github.com/${REPOSITORY}` }, 'preshade on GitHub'),
            '.',
        );
}

async function take(list) {
    const { files, left } = await fromFiles(list, material);
    const notRead = left.length ? `Not read: ${left.join(', ')}. Give a .wgsl file, or a .vert and a .frag file.` : '';
    if (files) {
        find('example').value = '';
        setMaterial(new Material({ ...material, files }));
    }
    const box = find('shared');
    box.hidden = !notRead;
    box.replaceChildren(notRead);
    say(notRead || `Opened ${files.map(({ name }) => name).join(' and ')}.`);
}

/** The last fragment that the page itself wrote: it is no news to it. */
let written = '';

async function share() {
    const { state, define } = material;
    const fragment = await pack({ v: 1, files: current(), state, define, recipe });
    written = `#${fragment}`;
    history.replaceState(null, '', written);
    const address = location.href;
    const field = h('input', { type: 'text', readonly: true, id: 'link', value: address, 'aria-label': 'Link' });
    find('shared').hidden = false;
    find('shared').replaceChildren(
        h(
            'p',
            {},
            `The link holds your text, the recipe and the state: ${counted(address.length, 'character')}. Whoever has it can read them.`,
        ),
        address.length > LONG ? h('p', { class: 'warn' }, 'Some programs cut links of this length.') : '',
        field,
        copier('Copy the link', address),
    );
    field.focus();
    field.select();
    say(`A link of ${counted(address.length, 'character')} is ready.`);
}

/** Takes what the address holds. */
async function fromAddress() {
    const { hash } = location;
    if (hash === written) return false;
    try {
        const found = await unpack(hash);
        if (!found) return false;
        written = hash;
        find('example').value = '';
        setMaterial(new Material(found), found.recipe);
        return true;
    } catch (error) {
        find('shared').hidden = false;
        find('shared').replaceChildren(`The link cannot be read: ${error.message}.`);
        say(`The link cannot be read: ${error.message}.`);
        return false;
    }
}

async function loadCompiler() {
    const bar = find('load-progress');
    try {
        let last = -1;
        compiler = await load((share) => {
            const percent = Math.floor(share * 100);
            if (percent === last) return;
            last = percent;
            bar.value = share;
            find('load-words').textContent = `Loading the compiler: ${percent} %`;
        });
        find('loading').hidden = true;
    } catch (error) {
        const again = h('button', { type: 'button', onclick: () => location.reload() }, 'Try again');
        find('loading').replaceChildren(
            h('p', { class: 'bad' }, `The compiler cannot be loaded: ${error.message}. `),
            again,
        );
        say(`The compiler cannot be loaded: ${error.message}`);
    }
}

start();
setMaterial(material);
tabs.open('changes');
fromAddress();
await loadCompiler();
if (compiler) {
    document.documentElement.dataset.ready = '';
    refresh({ source: true });
}
