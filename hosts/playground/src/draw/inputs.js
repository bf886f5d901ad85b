// Made-up inputs: uniforms by the names of their members, textures by the names of their variables.

import { mat4, vec3 } from 'gl-matrix';
import { mesh } from './mesh.js';
import { meaning, normalise, share } from './names.js';
import { key } from './plan.js';

const EYE = [2.2, 2.6, 7];
const TARGET = [0, 0.8, 0];
const NEAR = 0.1;
const FAR = 60;

/** Values of the frame. Depth in clip space is 0 to 1, which lies within OpenGL's -1 to 1 as well. */
function frame(size, isReversed) {
    const view = mat4.lookAt(mat4.create(), EYE, TARGET, [0, 1, 0]);
    const projection = mat4.perspectiveZO(mat4.create(), (55 * Math.PI) / 180, 1, NEAR, FAR);
    if (isReversed) mat4.mul(projection, mat4.fromValues(1, 0, 0, 0, 0, 1, 0, 0, 0, 0, -1, 0, 0, 0, 1, 1), projection);
    const viewProjection = mat4.mul(mat4.create(), projection, view);
    const inverse = (matrix) => mat4.invert(mat4.create(), matrix);
    const light = vec3.normalize([], [0.5, 0.8, 0.6]);
    const lightView = mat4.lookAt(
        mat4.create(),
        light.map((n) => n * 12),
        [0, 0, 0],
        [0, 1, 0],
    );
    const lightProjection = mat4.orthoZO(mat4.create(), -9, 9, -9, 9, 0.1, 30);
    return {
        viewProjection,
        modelViewProjection: viewProjection,
        model: mat4.create(),
        normalMatrix: mat4.create(),
        view,
        projection,
        inverseView: inverse(view),
        inverseProjection: inverse(projection),
        inverseViewProjection: inverse(viewProjection),
        inverseModel: mat4.create(),
        lightViewProjection: mat4.mul(mat4.create(), lightProjection, lightView),
        cameraPosition: [...EYE, 1],
        time: [1, 1, 1, 1],
        lightDirection: [...light, 0],
        lightPosition: [3, 6, 4, 1],
        lightColor: [1, 0.96, 0.9, 1],
        resolution: [size, size, 1 / size, 1 / size],
        near: [NEAR],
        far: [FAR],
        aspect: [1],
    };
}

/** What is said of a value that a name stands for. */
const TOLD = {
    viewProjection: 'world to clip',
    modelViewProjection: 'object to clip',
    model: 'the identity',
    normalMatrix: 'the identity',
    cameraPosition: 'the eye',
    time: '1 s',
    lightDirection: 'towards the light',
};

/** Numbers of a value whose name has no meaning: plausible, and the same in every run. */
function invented({ path, scalar, rows, columns, name }) {
    const bare = normalise(
        path
            .replace(/\[\d+\]/g, '')
            .split('.')
            .at(-1),
    );
    if (columns > 1) return { numbers: null, what: 'the identity' };
    const all = (value) => Array(rows).fill(value);
    if (scalar !== 'f32' || name === 'bool')
        return { numbers: all(/count|num|octaves|steps|layers/.test(bare) ? 1 : 0) };
    if (/cutoff|threshold|alphatest|alphacut/.test(bare)) return { numbers: all(0.5) };
    if (/shin|gloss|exponent|power/.test(bare)) return { numbers: all(32) };
    if (/count/.test(bare)) return { numbers: all(1) };
    if (/dir(ection)?$/.test(bare) && rows >= 3) return { numbers: [0.45, 0.72, 0.53, 0] };
    const isColor = /colou?r|tint|albedo|base|ambient|diffuse|emissive/.test(bare) && rows >= 3;
    const range = isColor ? [0.3, 0.6] : [0.25, 0.5];
    const numbers = Array.from({ length: rows }, (_, i) => range[0] + range[1] * share(path, i));
    if (isColor && rows === 4) numbers[3] = 1;
    return { numbers };
}

/** Whether some member already takes the scene into clip space. */
const toClip = ['viewProjection', 'modelViewProjection', 'projection'];

/** The bytes of each uniform binding, and what is in them. */
function uniforms(bindings, members, values, guard) {
    const buffers = new Map();
    const told = [];
    const all = bindings.filter(({ kind }) => kind === 'uniform').flatMap((binding) => members.get(key(binding)) ?? []);
    const isPlaced = all.some(({ path, columns }) => columns === 4 && toClip.includes(meaning(path)));
    let isTaken = isPlaced;
    for (const binding of bindings.filter(({ kind }) => kind === 'uniform')) {
        const size = Math.ceil(binding.layout.buffer.min_binding_size / 16) * 16;
        const bytes = new DataView(new ArrayBuffer(size));
        for (const member of members.get(key(binding)) ?? []) {
            const { path, rows, columns, scalar, offset, length, stride, columnStride } = member;
            let found = meaning(path);
            // `camera` is an eye, or the only matrix there is.
            const isMatrix = columns === 4 && rows === 4;
            if (isMatrix && !isTaken && (!found || !isMatrixValue(values[found]))) {
                found = 'viewProjection';
                isTaken = true;
            }
            const known = found && isMatrixValue(values[found]) === columns > 1 ? values[found] : null;
            const made = known
                ? { numbers: [...known], what: TOLD[found] ?? `by its name: ${found}` }
                : invented(member);
            for (let i = 0; i < length; i++) {
                for (let c = 0; c < columns; c++) {
                    for (let r = 0; r < rows; r++) {
                        const at = offset + i * stride + c * columnStride + r * 4;
                        if (at + 4 > size) continue;
                        const number =
                            columns > 1
                                ? made.numbers
                                    ? made.numbers[c * 4 + r]
                                    : Number(c === r)
                                : (made.numbers[r] ?? 0);
                        if (scalar === 'f32') bytes.setFloat32(at, number, true);
                        else bytes.setInt32(at, number, true);
                    }
                }
            }
            const numbers = made.numbers?.slice(0, rows * columns).map((n) => +n.toFixed(3)) ?? [];
            const guess = known
                ? { guess: 'uniform-by-name', value: `$${found.toLowerCase()}` }
                : { guess: 'uniform-made-up', numbers };
            told.push({ name: path, what: made.what ?? `made up: ${numbers.join(', ')}`, guess });
        }
        // A variant that was made for certain values is drawn with them, and so is the original.
        for (const { place, type, low, name } of guard) {
            if (place.from !== 'uniform' || place.group !== binding.group || place.binding !== binding.binding)
                continue;
            if (place.offset + 4 > size) continue;
            if (type === 'f32') bytes.setFloat32(place.offset, low, true);
            else bytes.setInt32(place.offset, low, true);
            told.push({
                name,
                what: `${low}, which the variant was made for`,
                guess: { guess: 'uniform-made-up', numbers: [low] },
            });
        }
        buffers.set(key(binding), new Uint8Array(bytes.buffer));
    }
    return { buffers, told };
}

const isMatrixValue = (value) => value?.length === 16;

const SIDE = 128;

/** The texels of one texture: levels of RGBA, 8 bits a channel. */
function picture(name) {
    const bare = normalise(name);
    const texel = { normal: bumps, noise: grain }[kindOf(bare)] ?? checker;
    let level = new Uint8Array(SIDE * SIDE * 4);
    for (let y = 0; y < SIDE; y++) for (let x = 0; x < SIDE; x++) level.set(texel(x, y), (y * SIDE + x) * 4);
    const levels = [level];
    for (let side = SIDE / 2; side >= 1; side /= 2) {
        const next = new Uint8Array(side * side * 4);
        for (let y = 0; y < side; y++)
            for (let x = 0; x < side; x++)
                for (let c = 0; c < 4; c++) {
                    const at = (dx, dy) => level[((y * 2 + dy) * side * 2 + x * 2 + dx) * 4 + c];
                    next[(y * side + x) * 4 + c] = (at(0, 0) + at(1, 0) + at(0, 1) + at(1, 1) + 2) >> 2;
                }
        levels.push(next);
        level = next;
    }
    return levels;
}

function kindOf(bare) {
    if (/normal|bump/.test(bare)) return 'normal';
    if (/rough|metal|noise|height|dissolve|occlusion/.test(bare)) return 'noise';
    return 'checker';
}

/** A checker, whose alpha has round holes. */
function checker(x, y) {
    const isLight = ((x >> 4) + (y >> 4)) % 2 === 0;
    const hole = Math.hypot((x % 32) - 15.5, (y % 32) - 15.5);
    const alpha = Math.max(0, Math.min(255, (hole - 8) * 64 + 128));
    return isLight ? [236, 226, 200, alpha] : [92, 122, 86, alpha];
}

function bumps(x, y) {
    const [dx, dy] = [Math.sin((x / SIDE) * 16 * Math.PI), Math.sin((y / SIDE) * 16 * Math.PI)].map((n) => n * 0.25);
    const length = Math.hypot(dx, dy, 1);
    return [dx, dy, 1].map((n) => Math.round((n / length) * 127.5 + 127.5)).concat(255);
}

function grain(x, y) {
    const value = Math.round(64 + 128 * share(`${x >> 2},${y >> 2}`));
    return [value, value, value, 255];
}

/** What is said of a texture. */
const PICTURES = {
    normal: 'a made-up normal map',
    noise: 'made-up noise',
    checker: 'a checker with round holes in its alpha',
};

/** Everything that both drawings read, and what is said of each. */
export function inputs({ bindings, attributes }, { members, guard, size, order, isReversed }) {
    const values = frame(size, isReversed);
    const { buffers, told } = uniforms(bindings, members, values, guard);
    const made = mesh(attributes, order);
    const textures = new Map();
    const why = [];
    for (const binding of bindings) {
        const { texture } = binding.layout;
        if (!texture) continue;
        const { sample_type: sample, view_dimension: dimension } = texture;
        const isKnown = ['2d', '2d-array', 'cube', '3d'].includes(dimension);
        if (!isKnown || (sample === 'depth' && dimension === '3d'))
            why.push(`\`${binding.name}\` is a texture of ${dimension}.`);
        if (!['float', 'unfilterable-float', 'depth'].includes(sample))
            why.push(`\`${binding.name}\` is a texture of ${sample}, which this page does not make up.`);
        const isDepth = sample === 'depth';
        textures.set(key(binding), { dimension, isDepth, side: SIDE, levels: isDepth ? null : picture(binding.name) });
        told.push({
            name: binding.name,
            what: isDepth ? 'a depth texture, cleared to 1' : PICTURES[kindOf(normalise(binding.name))],
            guess: { guess: isDepth ? 'texture-cleared' : 'texture-generated' },
        });
    }
    const samplers = new Map(
        bindings
            .filter(({ layout }) => layout.sampler)
            .map((binding) => [key(binding), { type: binding.layout.sampler.type }]),
    );
    return { mesh: made, buffers, textures, samplers, told: [...(made.told ?? []), ...told], why };
}
