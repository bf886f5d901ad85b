// The made-up mesh: a floor, a wall and nine spheres, or what a shader without a place in space draws.

import { normalise, share } from './names.js';

/** A patch of `u` by `v` steps, each corner made by `corner(s, t)`. */
function patch(steps, corner, color) {
    const vertices = [];
    const indices = [];
    for (let i = 0; i <= steps[0]; i++)
        for (let j = 0; j <= steps[1]; j++)
            vertices.push({ ...corner(i / steps[0], j / steps[1]), uv: [i / steps[0], 1 - j / steps[1]], color });
    for (let i = 0; i < steps[0]; i++) {
        for (let j = 0; j < steps[1]; j++) {
            const a = i * (steps[1] + 1) + j;
            const b = a + steps[1] + 1;
            indices.push(a, b, b + 1, a, b + 1, a + 1);
        }
    }
    return { vertices, indices };
}

function sphere([x, y, z], radius, color) {
    const corner = (s, t) => {
        const around = s * 2 * Math.PI;
        const up = (t - 0.5) * Math.PI;
        const normal = [Math.sin(around) * Math.cos(up), Math.sin(up), Math.cos(around) * Math.cos(up)];
        const position = [x + normal[0] * radius, y + normal[1] * radius, z + normal[2] * radius];
        return { position, normal, tangent: [Math.cos(around), 0, -Math.sin(around), 1] };
    };
    return patch([24, 16], corner, color);
}

const floor = patch(
    [12, 12],
    (s, t) => ({ position: [s * 14 - 7, 0, 5 - t * 12], normal: [0, 1, 0], tangent: [1, 0, 0, 1] }),
    [0.8, 0.8, 0.75, 1],
);
const wall = patch(
    [12, 6],
    (s, t) => ({ position: [s * 14 - 7, t * 6, -5], normal: [0, 0, 1], tangent: [1, 0, 0, 1] }),
    [0.6, 0.7, 0.85, 1],
);

/** Nine spheres in three rows, the farthest first. */
function spheres() {
    const all = [];
    for (const [row, z] of [-3, -0.6, 1.8].entries())
        for (const x of [-2.2, 0, 2.2])
            all.push(sphere([x + row * 0.5, 0.95, z], 0.9, [0.9 - 0.2 * row, 0.5 + 0.1 * x, 0.4 + 0.15 * row, 1]));
    return all;
}

/** A mesh for these attributes: its vertices as the attributes have them, and where each attribute is in a vertex. */
export function mesh(attributes, order) {
    const place = attributes.find(({ name }) => ['position', 'pos'].includes(normalise(name)));
    if (!attributes.length) return { kind: 'three', count: 3, indices: null, layout: new Map(), stride: 0 };
    const isFlat = place?.type === 'vec2<f32>';
    const corner = (s, t) => ({ position: [s * 2 - 1, t * 2 - 1, 0], normal: [0, 0, 1], tangent: [1, 0, 0, 1] });
    let objects = isFlat ? [patch([8, 8], corner, [0.8, 0.7, 0.6, 1])] : [wall, floor, ...spheres()];
    if (order === 'front-to-back') objects = objects.reverse();
    const vertices = objects.flatMap((object) => object.vertices);
    const indices = [];
    let first = 0;
    for (const object of objects) {
        for (const index of object.indices) indices.push(first + index);
        first += object.vertices.length;
    }
    const layout = new Map();
    let stride = 0;
    for (const { location, type } of attributes) {
        const [, size = '1', scalar] = /^(?:vec(\d)<)?(\w+?)>?$/.exec(type);
        layout.set(location, { offset: stride, size: Number(size), scalar });
        stride += Number(size) * 4;
    }
    const bytes = new DataView(new ArrayBuffer(stride * vertices.length));
    const told = [];
    for (const { location, name } of attributes) {
        const { offset, size, scalar } = layout.get(location);
        const { value, what } = stream(name, size);
        // An attribute that the mesh has is no guess.
        told.push({ name, what, guess: what.startsWith('the mesh') ? null : { guess: 'attribute-synthesised' } });
        const write = { f32: 'setFloat32', i32: 'setInt32', u32: 'setUint32' }[scalar];
        for (const [i, vertex] of vertices.entries()) {
            const numbers = value(vertex);
            for (let c = 0; c < size; c++)
                bytes[write](i * stride + offset + c * 4, numbers[c] ?? (c === 3 ? 1 : 0), true);
        }
    }
    return {
        kind: isFlat ? 'square' : 'room',
        count: indices.length,
        indices: new Uint32Array(indices),
        vertices: new Uint8Array(bytes.buffer),
        layout,
        stride,
        told,
    };
}

const IDENTITY = [
    [1, 0, 0, 0],
    [0, 1, 0, 0],
    [0, 0, 1, 0],
    [0, 0, 0, 1],
];

/** The content of an attribute by its name, and what is said of it. */
function stream(name, size) {
    const bare = normalise(name);
    const constant = (value, what) => ({ value: () => value, what });
    if (['position', 'pos'].includes(bare)) return { value: (v) => v.position, what: 'the mesh\u2019s positions' };
    if (/^normal/.test(bare)) return { value: (v) => v.normal, what: 'the mesh\u2019s normals' };
    if (/^tangent/.test(bare)) return { value: (v) => v.tangent, what: 'the mesh\u2019s tangents' };
    if (/^(uv|texcoord|texturecoordinate)/.test(bare))
        return { value: (v) => v.uv, what: 'the mesh\u2019s texture coordinates' };
    if (/^instancecolou?r/.test(bare)) return constant([0.8, 0.7, 0.5, 1], 'one colour');
    if (/colou?r/.test(bare)) return { value: (v) => v.color, what: 'a colour for each object' };
    const row = /^(?:model|instancetransform|instancematrix|transform)([0-3])$/.exec(bare);
    if (row) return constant(IDENTITY[row[1]], 'a column of the identity');
    if (/^instance(offset|place|position)/.test(bare)) return constant([0, 0, 0, 1], 'no offset');
    if (/^(joint|boneind|skinind)/.test(bare)) return constant([0, 0, 0, 0], 'the first joint');
    if (/weight/.test(bare)) return constant([1, 0, 0, 0], 'the first joint alone');
    if (/^morph/.test(bare)) return constant([0, 0, 0, 0], 'no morph');
    const numbers = Array.from({ length: size }, (_, i) => 0.25 + share(name, i) / 2);
    return constant(numbers, `made up: ${numbers.map((n) => n.toFixed(2)).join(', ')}`);
}
