// Programs: what they declare, and values of uniforms.

/** `{attributes, uniforms, samplers, blocks}` of a program. Values follow the page's calls from then on. */
function programInfo(take, program) {
    const info = (program[INFO] ??= { sources: sourcesOf(take.own, program) });
    if (info.taking !== take) {
        info.taking = take;
        info.attributes = activeAttributes(take.own, program);
        info.blocks = take.two ? activeBlocks(take.own, program) : [];
        askUniforms(take, program, info);
    } else if (!info.uniforms) askUniforms(take, program, info);
    return info;
}

/** A program that was linked before the recorder came: its shaders are asked now. */
function sourcesOf(o, program) {
    const sources = {};
    for (const shader of o.getAttachedShaders(program) ?? []) {
        const stage = o.getShaderParameter(shader, GL.SHADER_TYPE) === GL.VERTEX_SHADER ? 'vertex' : 'fragment';
        sources[stage] = o.getShaderSource(shader);
    }
    return sources;
}

function activeAttributes(o, program) {
    const list = [];
    const count = o.getProgramParameter(program, GL.ACTIVE_ATTRIBUTES);
    for (let i = 0; i < count; i++) {
        const { name, type } = o.getActiveAttrib(program, i);
        const location = o.getAttribLocation(program, name);
        if (location < 0) continue;
        const columns = COLUMNS[type];
        for (let column = 0; column < (columns ?? 1); column++) {
            list.push({
                name,
                location: location + column,
                type,
                ...(columns ? { column } : {}),
            });
        }
    }
    return list.sort((a, b) => a.location - b.location);
}

function activeBlocks(o, program) {
    const list = [];
    const count = o.getProgramParameter(program, GL.ACTIVE_UNIFORM_BLOCKS);
    for (let i = 0; i < count; i++) list.push({ index: i, name: o.getActiveUniformBlockName(program, i) });
    return list;
}

function askUniforms(take, program, info) {
    const { own: o } = take;
    info.uniforms = new Map();
    info.samplers = [];
    const count = o.getProgramParameter(program, GL.ACTIVE_UNIFORMS);
    const indices = Array.from({ length: count }, (_, i) => i);
    const inBlock = take.two && count ? o.getActiveUniforms(program, indices, GL.UNIFORM_BLOCK_INDEX) : [];
    for (const i of indices) {
        if (take.two && inBlock[i] >= 0) continue;
        const { name, type, size } = o.getActiveUniform(program, i);
        const values = [];
        const base = name.replace(/\[0\]$/, '');
        for (let element = 0; element < size; element++) {
            const location = o.getUniformLocation(program, size > 1 ? `${base}[${element}]` : name);
            const value = location === null ? 0 : o.getUniform(program, location);
            if (typeof value === 'object' && value !== null) values.push(...Array.from(value, Number));
            else values.push(Number(value));
        }
        const uniform = { name, type, values, components: SIZES[type] ?? 1 };
        info.uniforms.set(name, uniform);
        if (SAMPLER_TARGETS[type]) info.samplers.push(uniform);
    }
}

/** The page set a uniform: `name` is the method. */
function setUniform(take, args, name) {
    const [location] = args;
    if (!location) return;
    const known = location[INFO];
    const program = known?.program ?? take.own.getParameter(GL.CURRENT_PROGRAM);
    const info = program?.[INFO];
    if (!info?.uniforms || info.taking !== take) return;
    const matrix = name.startsWith('uniformMatrix');
    const found = known && findUniform(info.uniforms, known.name);
    // Without the name, or where GL transposes, all values are asked again.
    if (!found || (matrix && args[1])) {
        info.uniforms = null;
        return;
    }
    const [uniform, element] = found;
    let data;
    if (name.endsWith('v')) {
        const at = matrix ? 2 : 1;
        const begin = args[at + 1] ?? 0;
        data = args[at];
        if (begin || args[at + 2])
            data = Array.from(data).slice(begin, args[at + 2] ? begin + args[at + 2] : undefined);
    } else data = Array.prototype.slice.call(args, 1);
    const { values } = uniform;
    const first = element * uniform.components;
    // `uniform1ui` has an f too.
    const float = /f(v)?$/.test(name);
    for (let i = 0; i < data.length && first + i < values.length; i++) {
        values[first + i] = float ? Math.fround(data[i]) : Number(data[i]);
    }
    info.version = (info.version ?? 0) + 1;
}

/** The active uniform that a location's name means, and the element of its array. */
function findUniform(uniforms, name) {
    const exact = uniforms.get(name) ?? uniforms.get(`${name}[0]`);
    if (exact) return [exact, 0];
    const [, base, element] = /^(.*)\[(\d+)\]$/.exec(name) ?? [];
    const array = uniforms.get(`${base}[0]`);
    return array ? [array, Number(element)] : null;
}
