// Requests from arguments, and results from answers: what the asynchronous and the synchronous functions share.

/** An error in a shader or in a request. */
export class PreshadeError extends Error {
    constructor({ code, message, place, notes, rendered }) {
        super(place ? `${place.file}:${place.line}:${place.column}: ${message}` : message);
        this.name = 'PreshadeError';
        this.code = code;
        this.place = place ?? null;
        this.notes = notes ?? [];
        this.rendered = rendered ?? this.message;
    }
}

const wrong = (message) =>
    new PreshadeError({ code: 'usage', message, place: null, notes: [], rendered: `error: ${message}` });

const SHADER = ['name', 'vertex', 'fragment', 'include', 'define', 'clip', 'limits', 'state', 'files'];
const FLAGS = [
    ...['depthCompare', 'depthFormat', 'reversedZ', 'noDepthWrite', 'blend', 'cull', 'topology', 'samples'],
    'alphaToCoverage',
];

/** The files of a shader: a text, texts by name, a `vertex` and a `fragment` text, or a list of files. */
function listed(sources, { name = 'material', language }) {
    const file = (name, text, more = {}) => {
        if (typeof text !== 'string') throw wrong(`the text of \`${name}\` is no string`);
        return { name, text, ...(language && { language }), ...more };
    };
    if (typeof sources === 'string') return [file(language === 'glsl' ? name : `${name}.wgsl`, sources)];
    if (Array.isArray(sources))
        return sources.map(({ name, text, ...more }) => {
            if (typeof name !== 'string') throw wrong('a source has no name');
            return file(name, text, more);
        });
    if (!sources || typeof sources !== 'object') throw wrong('there are no sources: give a text, or texts by name');
    const stages = Object.entries(sources).map(([key, text]) => {
        if (key === 'vertex') return file(`${name}.vert`, text, { language: 'glsl', stage: 'vertex' });
        if (key === 'fragment') return file(`${name}.frag`, text, { language: 'glsl', stage: 'fragment' });
        return file(key, text);
    });
    return stages;
}

const list = (value) => (value === undefined || value === null ? [] : Array.isArray(value) ? value : [value]);

function defined(define) {
    if (!define || Array.isArray(define)) return list(define);
    return Object.entries(define)
        .filter(([, value]) => value !== undefined)
        .map(([name, value]) => `${name}=${value}`);
}

/** A shader, and the options that are not about it. */
function shader(sources, options) {
    const out = { sources: listed(sources, options), flags: {} };
    const rest = {};
    for (const [key, value] of Object.entries(options)) {
        if (value === undefined || key === 'language') continue;
        if (key === 'define') out.define = defined(value);
        else if (key === 'include') out.include = list(value);
        else if (key === 'state') out.state = value && 'file' in value ? value : { whole: value };
        else if (key === 'files') out.files = value instanceof Map ? Object.fromEntries(value) : value;
        else if (SHADER.includes(key)) out[key] = value;
        else if (FLAGS.includes(key)) out.flags[key] = value;
        else rest[key] = value;
    }
    return { shader: out, rest };
}

/** Passes, or a recipe; the steps of a plan say more than those of a recipe. */
const recipe = (pass) =>
    list(pass).map((step) =>
        typeof step === 'string' ? step : { pass: step.pass, params: step.params, site: step.site },
    );

export const requests = {
    rewrite(sources, options = {}) {
        const { shader: of, rest } = shader(sources, options);
        const { pass, emit, ...more } = rest;
        return { command: 'rewrite', shader: of, passes: recipe(pass), emit: list(emit), ...more };
    },
    explain(sources, options = {}) {
        const { shader: of, rest } = shader(sources, options);
        const { pass, ...more } = rest;
        return { command: 'explain', shader: of, passes: recipe(pass), ...more };
    },
    outputs(sources, { write, parameters = {}, pass, ...options } = {}) {
        if (pass !== undefined) throw wrong('`outputs` is a pass itself: `rewrite` takes several');
        const outputs = list(write);
        if (!outputs.length) throw wrong('`write` names the outputs: depth, normal, velocity, id, ..');
        const params = { write: outputs.join('+'), ...parameters };
        return requests.rewrite(sources, { ...options, pass: [{ pass: 'outputs', params }] });
    },
    agree(first, second, options = {}) {
        const { with: other = {}, ...own } = options;
        const { shader: of, rest } = shader(first, own);
        const inherited = Object.fromEntries(
            Object.entries(own).filter(([key]) => !['vertex', 'fragment', 'name'].includes(key) && !(key in rest)),
        );
        const { shader: theirs, rest: unknown } = shader(second, { ...inherited, ...other });
        for (const key of Object.keys(unknown)) throw wrong(`\`with.${key}\` is no option of a shader`);
        const { map, failOn, ...more } = rest;
        const maps = map && !Array.isArray(map) ? Object.entries(map).map(([a, b]) => `${a}=${b}`) : list(map);
        const request = { command: 'agree', shader: of, with: theirs, map: maps, ...more };
        return failOn === undefined ? request : { ...request, failOn: list(failOn) };
    },
    graph(sources, options = {}) {
        const { shader: of, rest } = shader(sources, options);
        return { command: 'graph', shader: of, ...rest };
    },
    passes(options = {}) {
        return { command: 'passes', ...options };
    },
};

const placed = ({ location, ...refusal }, rendered) => ({ ...refusal, place: location ?? null, rendered });

export const results = {
    rewrite({ report, messages, after, read }) {
        const { files, refusals, ...material } = report.materials[0];
        const plan = files.find((file) => file.name.endsWith('.plan.json'));
        return {
            ...material,
            refusals: refusals.map((refusal, i) => placed(refusal, report.rendered[i])),
            files,
            plan: plan ? JSON.parse(plan.text) : null,
            errors: report.failed,
            messages: [...messages, ...after],
            read,
        };
    },
    explain({ report, read }) {
        const { passes, ...material } = report.materials[0];
        return {
            ...material,
            passes: passes.map((pass) => ({ ...pass, refusals: pass.refusals.map((r) => placed(r, undefined)) })),
            read,
        };
    },
    agree({ status, report, read }) {
        return { agrees: status === 0, isPartial: status === 3, ...report.pairs[0], read };
    },
    graph: ({ report, read }) => ({ ...report, read }),
    passes: ({ report }) => report.passes,
};
results.outputs = results.rewrite;

/** The result of an answer. */
export function result(command, answer) {
    if (answer.error) throw new PreshadeError(answer.error);
    return results[command](answer);
}

/** The commands as methods. Subclasses have `ask(command, ...given)`. */
export class Commands {
    rewrite(sources, options) {
        return this.ask('rewrite', sources, options);
    }

    explain(sources, options) {
        return this.ask('explain', sources, options);
    }

    outputs(sources, options) {
        return this.ask('outputs', sources, options);
    }

    agree(first, second, options) {
        return this.ask('agree', first, second, options);
    }

    graph(sources, options) {
        return this.ask('graph', sources, options);
    }

    passes(options) {
        return this.ask('passes', options);
    }
}
