// Members of uniform blocks. plan.json has the bindings, but not their members, so WebGL 2 is asked for them: it links
// the original as GLSL ES, and lists names, types and offsets.

import { key } from './plan.js';

/** Types of members, by WebGL's number: scalar, rows, columns. */
const TYPES = {};
const add = (name, number, scalar, rows, columns = 1) => (TYPES[number] = { name, scalar, rows, columns });
add('f32', 0x1406, 'f32', 1);
add('i32', 0x1404, 'i32', 1);
add('u32', 0x1405, 'u32', 1);
add('bool', 0x8b56, 'u32', 1);
for (const [i, n] of [2, 3, 4].entries()) {
    add(`vec${n}<f32>`, 0x8b50 + i, 'f32', n);
    add(`vec${n}<i32>`, 0x8b53 + i, 'i32', n);
    add(`vec${n}<u32>`, 0x8dc6 + i, 'u32', n);
    add(`mat${n}x${n}<f32>`, 0x8b5a + i, 'f32', n, n);
}
const OTHER = ['mat2x3', 'mat2x4', 'mat3x2', 'mat3x4', 'mat4x2', 'mat4x3'];
for (const [i, name] of OTHER.entries()) add(`${name}<f32>`, 0x8b65 + i, 'f32', Number(name[5]), Number(name[3]));

/** A linked program, or an error with what the driver says. */
export function link(gl, { vertex, fragment }, attributes = []) {
    const program = gl.createProgram();
    const shaders = [];
    for (const [type, text] of [
        [gl.VERTEX_SHADER, vertex.text],
        [gl.FRAGMENT_SHADER, fragment?.text ?? '#version 300 es\nvoid main() {}\n'],
    ]) {
        const shader = gl.createShader(type);
        gl.shaderSource(shader, text);
        gl.compileShader(shader);
        gl.attachShader(program, shader);
        shaders.push(shader);
    }
    for (const { name, location, explicit } of attributes)
        if (!explicit) gl.bindAttribLocation(program, location, name);
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS)) {
        const logs = [...shaders.map((shader) => gl.getShaderInfoLog(shader)), gl.getProgramInfoLog(program)];
        throw new Error(`the driver does not take the GLSL: ${logs.filter(Boolean).join(' ').trim()}`);
    }
    for (const shader of shaders) gl.deleteShader(shader);
    return program;
}

/** The members of each uniform binding of a drawing in GLSL ES: path, type, offset, length, strides. */
export function members(gl, { passes }) {
    const found = new Map();
    const put = (of, member) => {
        const all = found.get(of) ?? found.set(of, new Map()).get(of);
        all.set(member.offset, member);
    };
    for (const { pass, vertex, fragment } of passes) {
        const program = link(gl, { vertex, fragment }, vertex.attributes);
        const variable = (of) => pass.bindings.find((binding) => key(binding) === of)?.name ?? '';
        for (const { block, binding } of [...(vertex.blocks ?? []), ...(fragment?.blocks ?? [])]) {
            const of = binding.join('.');
            const index = gl.getUniformBlockIndex(program, block);
            if (index === gl.INVALID_INDEX) continue;
            const indices = gl.getActiveUniformBlockParameter(program, index, gl.UNIFORM_BLOCK_ACTIVE_UNIFORM_INDICES);
            const ask = (what) => gl.getActiveUniforms(program, indices, gl[what]);
            const [offsets, strides, columns] = ['UNIFORM_OFFSET', 'UNIFORM_ARRAY_STRIDE', 'UNIFORM_MATRIX_STRIDE'].map(
                ask,
            );
            for (const [i, uniform] of [...indices].entries()) {
                const { name, type, size } = gl.getActiveUniform(program, uniform);
                const { [type]: known } = TYPES;
                if (!known) throw new Error(`the uniform ${name} has a type that this page does not know`);
                // The block's name stands ahead of its members; the variable's is what the author reads.
                const path = name.startsWith(`${block}.`) ? `${variable(of)}.${name.slice(block.length + 1)}` : name;
                put(of, {
                    path: path.replace(/\[0\]$/, ''),
                    ...known,
                    offset: offsets[i],
                    length: size,
                    stride: strides[i],
                    columnStride: columns[i],
                });
            }
        }
        for (const { name, binding, offset } of [...(vertex.uniforms ?? []), ...(fragment?.uniforms ?? [])])
            loose(gl, program, name).forEach((member) =>
                put(binding.join('.'), { ...member, offset: offset + member.offset }),
            );
        gl.deleteProgram(program);
    }
    return new Map([...found].map(([of, all]) => [of, [...all.values()]]));
}

/** A uniform outside of blocks. Its place in the plan's buffer follows WGSL's rules for uniforms. */
function loose(gl, program, asked) {
    const count = gl.getProgramParameter(program, gl.ACTIVE_UNIFORMS);
    const out = [];
    for (let i = 0; i < count; i++) {
        const { name, type, size } = gl.getActiveUniform(program, i);
        const bare = name.replace(/\[0\]$/, '');
        if (bare !== asked) continue;
        const { [type]: known } = TYPES;
        if (!known) continue;
        const columnStride = known.rows === 2 ? 8 : 16;
        const own = known.columns > 1 ? columnStride * known.columns : 16;
        out.push({ path: bare, ...known, offset: 0, length: size, stride: size > 1 ? own : 0, columnStride });
    }
    return out;
}
