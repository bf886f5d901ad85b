// The author's material as a pass of a plan draws it: everything is read through to the author's object, so that whatever is set there later counts here as well, but for the text
// and the state that are the pass's.

import { BackSide, DoubleSide, FrontSide, GLSL3 } from 'three';
import { COMPARE } from '../compare.js';
import { named } from '../variants.js';

export const CULL = { back: FrontSide, front: BackSide, none: DoubleSide };

/** Depth, colour and blend state of a pass. */
export function stateOf(pass) {
    const { depth, primitive, targets } = pass;
    const biased = depth.bias.constant !== 0 || depth.bias.slope_scale !== 0;
    return {
        side: CULL[primitive.cull],
        depthTest: true,
        depthFunc: COMPARE[depth.compare],
        depthWrite: depth.write,
        colorWrite: targets.some((target) => target?.write_mask),
        polygonOffset: biased,
        polygonOffsetFactor: depth.bias.slope_scale,
        polygonOffsetUnits: depth.bias.constant,
    };
}

const NAME = /^#define SHADER_NAME.*\n/m;

/** A material's number is below those of three.js, and below the one by which three.js says none. */
let next = -1000;
const write = (value) => ({ value, writable: true, configurable: true, enumerable: true });

/**
 * `pass`: `{ vertex, fragment, blocks }`, a pass of `Variants`. `state`: properties that are the pass's own, as `stateOf` has them. `uniforms`: by name, those that the pass has
 * beside the author's, or in place of his. `theirs`: the author's, where they are not what three.js has of his material.
 *
 * Uniforms are the very objects of the author's material, as three.js has them for his own program: no callback of the author is called again.
 */
export function derived(
    renderer,
    author,
    { vertex, fragment, blocks = [] },
    { state = {}, uniforms = {}, theirs } = {},
) {
    // three.js writes the version itself, and the material's name: in the author's text it is that of whichever material the program was made for.
    const [vertexShader, fragmentShader] = [numbered(renderer, vertex), fragment].map((text) =>
        text.replace(/^#version .*\n/, '').replace(NAME, ''),
    );
    // Authors with the same text share a program.
    const key = `preshade ${named(`${vertexShader}\0${fragmentShader}`)}`;
    const own = {
        // Listeners are not to be shared: three.js hangs the release of the programs on them.
        _listeners: undefined,
        isRawShaderMaterial: true,
        isNodeMaterial: false,
        glslVersion: GLSL3,
        defines: {},
        // three.js does not look for lights of a material that has none in its text.
        lights: false,
        // Uniforms of clipping planes are ours.
        clipping: false,
        allowOverride: false,
        vertexShader,
        fragmentShader,
        ...state,
        onBeforeCompile(parameters) {
            parameters.vertexShader = vertexShader;
            parameters.fragmentShader = fragmentShader;
            parameters.uniforms = merged(
                theirs ?? renderer.properties.get(author).uniforms ?? author.uniforms ?? {},
                uniforms,
            );
        },
        customProgramCacheKey: () => key,
    };
    const properties = Object.fromEntries(Object.entries(own).map(([name, value]) => [name, write(value)]));
    // three.js binds each group to a block of the program: one of this pass has to be there.
    properties.uniformsGroups = {
        get: () => (author.uniformsGroups ?? []).filter(({ name }) => blocks.some(({ block }) => block === name)),
        configurable: true,
        enumerable: true,
    };
    for (const name of accessors(author)) properties[name] ??= through(author, name);
    // three.js resets it after the draw, and the author's own draw still has to see it.
    properties.uniformsNeedUpdate = { get: () => author.uniformsNeedUpdate, set() {}, configurable: true };
    const material = Object.create(author, properties);
    // A number of its own: three.js tells by it whether the uniforms are set anew.
    Object.defineProperty(material, 'id', { value: next-- });
    return material;
}

/**
 * A `BatchedMesh` has its number of the draw from an extension, or, where the driver lacks it, from a uniform. three.js writes both under `#ifdef`, and preshade does not know the
 * extension.
 */
function numbered(renderer, vertex) {
    const uniform = /^uniform int _gl_DrawID;$/m;
    if (!uniform.test(vertex) || !renderer.extensions.has('WEBGL_multi_draw')) return vertex;
    const text = vertex.replace(uniform, '#define _gl_DrawID gl_DrawID');
    return text.replace(/^(#version .*\n)?/, '$1#extension GL_ANGLE_multi_draw : require\n');
}

/** Properties that the author's classes compute, maybe from private fields, which an object that inherits does not have. */
function accessors(author) {
    const names = new Set();
    for (let of = Object.getPrototypeOf(author); of && of !== Object.prototype; of = Object.getPrototypeOf(of))
        for (const [name, { get }] of Object.entries(Object.getOwnPropertyDescriptors(of))) if (get) names.add(name);
    for (const [name, { get }] of Object.entries(Object.getOwnPropertyDescriptors(author))) if (get) names.add(name);
    return names;
}

const through = (author, name) => ({
    get: () => author[name],
    set(value) {
        Object.defineProperty(this, name, write(value));
    },
    configurable: true,
    enumerable: true,
});

/** The author's uniforms under ours. Read through, because a page may put another object in one's place. */
function merged(theirs, uniforms) {
    const all = Object.assign(Object.create(theirs), uniforms);
    Object.defineProperty(all, OF, { value: theirs });
    return all;
}

const OF = Symbol('the author’s');

/**
 * Call it before a draw: three.js has other uniform objects of the author's material whenever it made another program of it. `theirs`: those that his material was last drawn with,
 * where the caller knows.
 */
export function refresh(renderer, author, material, uniforms = {}, theirs = renderer.properties.get(author).uniforms) {
    const own = renderer.properties.get(material);
    if (!own.uniforms || !theirs || own.uniforms[OF] === theirs) return;
    own.uniforms = merged(theirs, uniforms);
    own.uniformsList = null;
}

/** Lines above and below one that the driver names. */
const AROUND = 3;

/**
 * What the driver has against a derived material, or null: for `report`, `rendered` has the lines that it names, as they are numbered there. Ask for it when the program is ready.
 */
export function driverError(renderer, material) {
    const gl = renderer.getContext();
    const made = renderer.properties.get(material).currentProgram;
    if (!made?.program || gl.isContextLost() || gl.getProgramParameter(made.program, gl.LINK_STATUS)) return null;
    const { program, vertexShader, fragmentShader } = made;
    const stages = { vertex: vertexShader, fragment: fragmentShader };
    const errors = Object.entries(stages).flatMap(([stage, shader]) => errorsOf(gl, stage, shader));
    if (errors.length === 0) {
        const message = gl.getProgramInfoLog(program)?.trim() || 'it does not link';
        errors.push({ message, rendered: message });
    }
    return {
        code: 'link',
        reason: `preshade wrote a text that this driver refuses: ${errors[0].message}. Please report it to preshade, with \`rendered\``,
        rendered: errors.map(({ rendered }) => rendered).join('\n\n'),
    };
}

/** The first error of each line of a stage. */
function errorsOf(gl, stage, shader) {
    const lines = gl.getShaderSource(shader)?.split('\n') ?? [];
    const found = new Map();
    for (const [, number, message] of (gl.getShaderInfoLog(shader) ?? '').matchAll(/^ERROR: \d+:(\d+): (.*)$/gm))
        if (!found.has(number)) found.set(number, message.trim());
    return [...found].map(([number, message]) => {
        const first = Math.max(0, number - 1 - AROUND);
        const shown = lines.slice(first, Number(number) + AROUND).map((line, i) => {
            const at = first + i + 1;
            return `${at === Number(number) ? '>' : ' '} ${String(at).padStart(5)} | ${line}`;
        });
        return { message, rendered: [`${stage} shader, line ${number}: ${message}`, ...shown].join('\n') };
    });
}
