// Whether a frame folder is whole: every number refers to an object, every file exists, sizes fit.

/** The lists that commands and entries refer to, by key. */
const LISTS = {
    buffer: 'buffers',
    texture: 'textures',
    sampler: 'samplers',
    bindGroup: 'bindGroups',
    named: 'named',
    module: 'shaders',
    computePipeline: 'computePipelines',
    canvas: 'textures',
};

const ROWS = 'setPipeline';

/** Problems of a folder, one a line. */
export function check(files) {
    const problems = [];
    const text = files.get('frame.json');
    if (!text) return ['no frame.json'];
    const json = JSON.parse(text);
    if (json.schema !== 'preshade.frames.v1') problems.push(`schema ${json.schema}`);
    const used = new Set();
    const number = (list, value, where) => {
        if (!Number.isInteger(value) || !json[list][value]) problems.push(`${where}: no ${list}[${value}]`);
    };
    const data = (name, where) => {
        used.add(name);
        if (!files.has(`data/${name}.bin`)) problems.push(`${where}: no file ${name}`);
        return files.get(`data/${name}.bin`)?.length ?? 0;
    };
    const walk = (value, where, inCompute) => {
        if (Array.isArray(value)) return value.forEach((item, i) => walk(item, `${where}[${i}]`, inCompute));
        if (typeof value !== 'object' || value === null) return;
        const compute = inCompute || value.do === 'computePass';
        for (const [key, inner] of Object.entries(value)) {
            const at = `${where}.${key}`;
            if (inner === undefined) problems.push(`${at}: undefined`);
            else if (key === 'data') data(inner, at);
            else if (key === 'pipeline' && value.do === ROWS) {
                number(compute ? 'computePipelines' : 'renderPipelines', inner, at);
            } else if (key === 'pipeline') number('renderPipelines', inner, at);
            else if (key === 'bindGroups') walk(inner, at);
            else if (key === 'layout' && where.includes('ipelines')) {
                if (inner !== 'auto') number('pipelineLayouts', inner, at);
            } else if (key === 'layout' && where.startsWith('bindGroups') && typeof inner === 'number') {
                number('bindGroupLayouts', inner, at);
            } else if (LISTS[key] && typeof inner === 'number') number(LISTS[key], inner, at);
            else walk(inner, at, compute);
        }
    };
    for (const list of [...new Set(Object.values(LISTS)), 'renderPipelines', 'bindGroupLayouts', 'pipelineLayouts']) {
        if (!Array.isArray(json[list])) problems.push(`no list ${list}`);
        else walk(json[list], list);
    }
    walk(json.start, 'start');
    walk(json.unknown, 'unknown');
    json.frames.forEach((frame, i) => walk(frame, `frames[${i}]`));
    for (const { buffer, data: name } of json.start.buffers) {
        if (data(name, 'start') > json.buffers[buffer].size) problems.push(`start of buffer ${buffer} is too long`);
    }
    for (const [i, frame] of json.frames.entries()) {
        const { picture, canvas } = frame;
        const [width, height] = picture.size;
        const size = data(picture.data, 'picture');
        if (size !== width * height * 4) problems.push(`picture of frame ${i}: ${size} bytes`);
        if (`${json.textures[canvas].size.slice(0, 2)}` !== `${picture.size}`) problems.push(`canvas of frame ${i}`);
        checkCommands(json, frame.commands, problems, (name) => files.get(`data/${name}.bin`).length);
    }
    for (const name of files.keys()) {
        const [, hash] = /^data\/([0-9a-f]{32})\.bin$/.exec(name) ?? [];
        if (hash ? !used.has(hash) : name !== 'frame.json') problems.push(`nothing refers to ${name}`);
    }
    return problems;
}

function checkCommands(json, commands, problems, size) {
    for (const command of commands) {
        if (command.do === 'writeBuffer') {
            const end = command.offset + size(command.data);
            if (end > json.buffers[command.buffer].size) problems.push('writeBuffer: past the end');
        }
        if (command.do === 'renderPass' && !command.descriptor.colorAttachments) problems.push('no attachments');
        if (command.commands) checkCommands(json, command.commands, problems, size);
    }
}

/** What frames hold, for a line of a table. */
export function count(json) {
    const totals = { frames: json.frames.length, draws: 0, passes: 0, writes: 0 };
    const walk = (commands) => {
        for (const { do: name, commands: inner } of commands) {
            if (/^draw/.test(name)) totals.draws += 1;
            if (/Pass$/.test(name)) totals.passes += 1;
            if (/^write/.test(name)) totals.writes += 1;
            if (inner) walk(inner);
        }
    };
    for (const { commands } of json.frames) walk(commands);
    return totals;
}
