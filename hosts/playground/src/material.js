// What the visitor works on: files, definitions and pipeline state, as the compiler takes them.

import { withThree } from 'preshade/three-prefix';

export const NAMES = { wgsl: ['material.wgsl'], glsl: ['material.vert', 'material.frag'] };

const isFragment = (name) => /\.(frag|fs)(\.glsl)?$/i.test(name);
const isVertex = (name) => /\.(vert|vs)(\.glsl)?$/i.test(name);
const isWgsl = (name) => /\.wgsl$/i.test(name);

/** The pipeline state that the page asks for: option of the compiler, label, values; the first is the default. */
export const STATE = [
    ['cull', 'Cull', ['', 'none', 'back', 'front'], 'as preshade assumes'],
    [
        'depthCompare',
        'Depth test',
        ['', 'less', 'less-equal', 'greater', 'greater-equal', 'equal', 'always'],
        'as preshade assumes',
    ],
    ['depthFormat', 'Depth format', ['', 'depth32float', 'depth24plus', 'depth16unorm'], 'depth32float'],
    ['blend', 'Blend', ['', 'alpha', 'add'], 'none'],
    ['samples', 'Samples', ['', '4'], '1'],
    ['reversedZ', 'Depth direction', ['', 'reversed'], '0 is near'],
    ['noDepthWrite', 'Depth writes', ['', 'off'], 'on'],
    ['clip', 'Clip depth', ['', 'zero-to-one', 'minus-one-to-one'], 'by the language'],
];

const BOOLEAN = ['reversedZ', 'noDepthWrite'];

/** A word of a command. A link may have been written by anyone. */
const quoted = (word) => (/^[\w.,:=+@/-]+$/.test(word) ? word : `'${word.replaceAll("'", "'\\''")}'`);

export class Material {
    constructor({ files, define = '', state = {} }) {
        this.files = files;
        this.define = define;
        this.state = Object.fromEntries(
            STATE.flatMap(([key, , values]) => (values.slice(1).includes(state[key]) ? [[key, state[key]]] : [])),
        );
    }

    get language() {
        return this.files.length > 1 || !isWgsl(this.files[0].name) ? 'glsl' : 'wgsl';
    }

    get name() {
        return this.files[0].name.replace(/\.(wgsl|vert|vs|frag|fs|glsl)(\.glsl)?$/i, '') || 'material';
    }

    /** The arguments of the compiler. */
    get asked() {
        const { language } = this;
        const files = this.files.map(({ name, text }, i) => ({
            name,
            text,
            language,
            ...(language === 'glsl' && { stage: i ? 'fragment' : 'vertex' }),
        }));
        const options = {};
        for (const [key, value] of Object.entries(this.state))
            options[key] = BOOLEAN.includes(key) ? true : key === 'samples' ? Number(value) : value;
        const define = this.define.split(/[\s,]+/).filter(Boolean);
        if (define.length) options.define = define;
        return { files, options };
    }

    /** The stage that is still to be pasted where one of two is there, or `null`. */
    awaited(error) {
        if (error.code !== 'empty' || this.files.length !== 2) return null;
        const [isVertex, isFragment] = this.files.map(({ text }) => text.trim() !== '');
        return isVertex === isFragment ? null : isVertex ? 'fragment' : 'vertex';
    }

    /** Both stages with what three.js declares for them, or `null` where it needs no more, or more than that. */
    get withThree() {
        const [vertex, fragment] = this.files.map(({ text }) => text);
        const whole = withThree({ vertex, fragment });
        if (whole.vertex === vertex) return null;
        const texts = [whole.vertex, whole.fragment];
        return new Material({ ...this, files: this.files.map((file, i) => ({ ...file, text: texts[i] })) });
    }

    /** The command that writes the same files, for a POSIX shell. */
    command(recipe) {
        // A name is no option.
        const names = this.files.map(({ name }) => (name.startsWith('-') ? `./${name}` : name));
        const steps = recipe.split(/\s+/).filter(Boolean);
        const words = [...names, ...steps.flatMap((step) => ['--pass', step]), ...this.flags];
        return ['npx preshade rewrite', ...words.map(quoted), '--emit wgsl,glsl-es -o out'].join(' ');
    }

    /** The words of the command line that say the same. */
    get flags() {
        const flag = (key) => key.replace(/[A-Z]/g, (c) => `-${c.toLowerCase()}`);
        const state = Object.entries(this.state).flatMap(([key, value]) =>
            BOOLEAN.includes(key) ? `--${flag(key)}` : [`--${flag(key)}`, String(value)],
        );
        const define = this.define.split(/[\s,]+/).filter(Boolean);
        return [...state, ...define.flatMap((text) => ['--define', text])];
    }
}

/** Files that were opened or dropped, over the material that is there. `left` names those that were not read. */
export async function fromFiles(list, now) {
    const all = [...list];
    const left = [];
    const read = async (file) => ({ name: file.name, text: (await file.text()).replace(/\r\n?/g, '\n') });
    const wgsl = all.find(({ name }) => isWgsl(name));
    const vertex = all.find(({ name }) => isVertex(name));
    const fragment = all.find(({ name }) => isFragment(name));
    const taken = wgsl ? [wgsl] : [vertex, fragment].filter(Boolean);
    for (const file of all) if (!taken.includes(file)) left.push(file.name);
    if (wgsl) return { files: [await read(wgsl)], left };
    if (!taken.length) return { files: null, left };
    const old = now.language === 'glsl' ? now.files : NAMES.glsl.map((name) => ({ name, text: '' }));
    return { files: [vertex ? await read(vertex) : old[0], fragment ? await read(fragment) : old[1]], left };
}
