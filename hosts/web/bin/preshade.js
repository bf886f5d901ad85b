#!/usr/bin/env node
// `npx preshade`: the native program's commands that need no GPU, with its flags, files and exit status.

import { existsSync, mkdirSync, readFileSync, renameSync, statSync, writeFileSync } from 'node:fs';
import { join } from 'node:path';
import { parseArgs } from 'node:util';
import { parse as parseToml } from 'smol-toml';
import { requests } from '../client.js';
import { gather } from '../disk.js';
import { Preshade } from '../index.js';
import { withThree } from '../three-prefix.js';

const VERSION = JSON.parse(readFileSync(new URL('../package.json', import.meta.url))).version;
const NATIVE = ['graph', 'verify', 'plan', 'explore', 'capture', 'adapters', 'completions', 'man'];

const HELP = `\
Writes faster variants of a material's shaders. This is the compiler as WebAssembly, without a GPU.

Usage: preshade COMMAND [OPTIONS] FILE..

Commands:
  rewrite FILE..   rewrite a shader by a recipe of passes
  explain FILE..   list the passes that apply to a shader, and why others do not
  outputs FILE..   write auxiliary pictures of a material: --write depth,normal,velocity,id
  agree FILE..     hold two programs against each other: --with FILE --as RELATION
  passes [NAME]    list the passes and their parameters

FILE is a WGSL file with both entry points, or a vertex and a fragment file; \`-\` is stdin.

Options:
  --pass NAME[:k=v,..]        a pass of the recipe, in order
  --emit TARGET,..            wgsl, glsl, glsl-vulkan, glsl-es, glsl-es-100, glsl-tess, glsl-vulkan-tess;
                              without it wgsl, of GLSL as well: for WebGL give glsl-es
  -o, --out DIR               folder to write to; without it, shaders and plan go to stdout
  --validate                  hold each variant against the original before it is written
  --format human|json         output form; \`agree\` also has markdown
  -v, --verbose               everything about every pass
  --lang wgsl|glsl            language of the input
  --three                     put three.js's declarations before the two texts of a ShaderMaterial
  --vertex, --fragment NAME   entry points, if there are several
  --name NAME                 name of the material
  --include DIR               folder to search for #include
  --define NAME[=VALUE]       a macro
  --clip zero-to-one|minus-one-to-one
  --limits SET,NAME=N,..      limits on the input
  --state FILE                pipeline state, TOML or JSON; or --depth-compare, --depth-format, --reversed-z,
                              --no-depth-write, --blend, --cull, --topology, --samples, --alpha-to-coverage
  --write OUTPUT,..           of \`outputs\`
  --with FILE[,FILE], --as RELATION, --map THEIRS=OURS, --normal NAME, --fail-on CLASS,.., --inputs N,
  --with-vertex, --with-fragment NAME, --with-define NAME[=VALUE]     of \`agree\`

The native program (\`cargo install preshade-cli\`) has these commands too: ${NATIVE.join(', ')}.
It also takes scenes, folders, SPIR-V and WGSL with imports.
Exit status: 0 fine (a refusal is fine: the original is kept), 1 a relation or contract is broken, 2 bad
usage or input, 3 a part was not evaluated.
`;

const text = { type: 'string' };
const texts = { type: 'string', multiple: true };
const flag = { type: 'boolean' };
const SHADER = {
    ...{ lang: text, vertex: text, fragment: text, name: text, include: texts, define: texts, clip: text },
    ...{ limits: text, state: text, 'depth-compare': text, 'depth-format': text, 'reversed-z': flag },
    ...{ 'no-depth-write': flag, blend: text, cull: text, topology: text, samples: text },
    ...{ 'alpha-to-coverage': flag, three: flag },
};
const COMMON = { format: text, color: text, help: { type: 'boolean', short: 'h' } };
const WRITING = { emit: texts, out: { type: 'string', short: 'o' }, output: text, validate: flag };
const OPTIONS = {
    rewrite: { ...COMMON, ...SHADER, ...WRITING, pass: texts },
    outputs: { ...COMMON, ...SHADER, ...WRITING, write: texts },
    explain: { ...COMMON, ...SHADER, pass: texts, verbose: { type: 'boolean', short: 'v' } },
    agree: {
        ...{ ...COMMON, ...SHADER, with: texts, as: text, map: texts, normal: text, 'fail-on': texts },
        ...{ inputs: text, verbose: { type: 'boolean', short: 'v' } },
        ...{ 'with-vertex': text, 'with-fragment': text, 'with-define': texts },
    },
    passes: COMMON,
};

/** Bad usage or input. */
class Failure extends Error {}

const camel = (name) => name.replace(/-(.)/g, (_, letter) => letter.toUpperCase());
const commas = (values) => values?.flatMap((value) => value.split(','));

/** The file as text, with the system's errors as the native program words them. */
function read(path) {
    if (path === '-') return readFileSync(0, 'utf8');
    try {
        if (statSync(path).isDirectory())
            throw new Failure(`error: ${path} is a folder: the native program rewrites whole folders`);
        const bytes = readFileSync(path);
        if (bytes.readUInt32LE && bytes.length >= 4 && [0x07230203, 0x03022307].includes(bytes.readUInt32LE(0)))
            throw new Failure(`error: ${path}: this is SPIR-V, which the native program reads`);
        const [first, second] = bytes;
        if (first === 0xff && second === 0xfe) return new TextDecoder('utf-16le').decode(bytes);
        if (first === 0xfe && second === 0xff) return new TextDecoder('utf-16be').decode(bytes);
        return new TextDecoder('utf-8', { fatal: true, ignoreBOM: true }).decode(bytes);
    } catch (error) {
        if (error instanceof Failure) throw error;
        if (error.code === 'ENOENT') throw new Failure(`error: ${path}: No such file or directory (os error 2)`);
        if (error.code === 'ERR_ENCODING_INVALID_ENCODED_DATA') throw new Failure(`error: ${path}: not UTF-8 text`);
        throw new Failure(`error: ${path}: ${error.message}`);
    }
}

/** What a file of pipeline state says, in JSON or TOML. */
function content(path) {
    const text = read(path);
    try {
        return path.endsWith('.json') ? JSON.parse(text) : parseToml(text);
    } catch (error) {
        throw new Failure(`error: ${path}: ${error.message}`);
    }
}

/** The vertex and the fragment file of a `ShaderMaterial`, with what three.js declares before them. */
function completed(files) {
    const isFragment = ({ name, stage }) => stage === 'fragment' || /\.(frag|fs)(\.glsl)?$/.test(name);
    const fragment = files.find(isFragment);
    const vertex = files.find((file) => file !== fragment);
    if (files.length !== 2 || !fragment) throw new Failure('error: --three needs a vertex and a fragment file');
    const whole = withThree({ vertex: vertex.text, fragment: fragment.text });
    if (whole.vertex === vertex.text)
        throw new Failure(
            'error: --three is for the texts of a ShaderMaterial: these have a #version or a chunk of three.js, or ' +
                'read nothing that three.js declares. `preshade.text(material)` of preshade-three has the whole texts',
        );
    return files.map((file) => {
        const text = file === fragment ? whole.fragment : whole.vertex;
        ahead.set(file.name, text.split('\n').length - file.text.split('\n').length);
        return { ...file, text };
    });
}

/** How many lines `--three` put ahead of a file's own, by its name. */
const ahead = new Map();

/** A message, or what a report holds, with the lines of files as they are on disk. */
function asOnDisk(told) {
    if (!ahead.size) return told;
    if (typeof told === 'string') return [...ahead].reduce(linesOnDisk, told);
    if (told === null || typeof told !== 'object') return told;
    if (Array.isArray(told)) return told.map(asOnDisk);
    const before = typeof told.line === 'number' ? (ahead.get(told.file) ?? 0) : 0;
    const own = before < told.line ? { line: told.line - before } : {};
    return { ...Object.fromEntries(Object.entries(told).map(([name, value]) => [name, asOnDisk(value)])), ...own };
}

const jsonOnDisk = (text) => text && `${JSON.stringify(asOnDisk(JSON.parse(text)), null, 2)}\n`;

/** The lines of one file: after its name, and ahead of what is quoted of it. Those of three.js's declarations stay. */
function linesOnDisk(message, [file, before]) {
    const own = (line) => (line > before ? String(line - before) : line);
    const name = file.replace(/[^\w/]/g, '\\$&');
    const place = new RegExp(`(?<![\\w./-])(${name}:)(\\d+)`, 'g');
    let isQuoted = false;
    const lines = message.split('\n').map((text) => {
        const now = text.replace(place, (_, name, line) => name + own(line));
        if (text.includes('┌─ ')) isQuoted = now !== text;
        if (!isQuoted) return now;
        return now.replace(/^(\s*)(\d+)(?= │)/, (_, space, line) => space + own(line).padStart(line.length));
    });
    return lines.join('\n');
}

function sources(paths, { lang: language, three }) {
    if (!paths.length) throw new Failure('error: no file is given; see `npx preshade --help`');
    const scene = paths.find((path) => /\.(toml|glb|gltf)$/.test(path));
    if (scene) throw new Failure(`error: ${scene} is a scene, which the native program reads`);
    if (paths.filter((path) => path === '-').length > 1)
        throw new Failure('error: `-` is given twice: stdin can be read only once');
    const files = paths.map((path, index) => {
        const source = { name: path === '-' ? '<stdin>' : path, text: read(path), ...(language && { language }) };
        if (path !== '-') return source;
        if (!language)
            throw new Failure(
                'error: stdin has no file name to tell its language from: give --lang wgsl or --lang glsl',
            );
        // Without an ending, the first of two files is the vertex stage.
        return paths.length === 2 ? { ...source, stage: index ? 'fragment' : 'vertex' } : source;
    });
    return three ? completed(files) : files;
}

/** The compiler's options about a shader, from flags. */
function options(values, of) {
    const { state, samples, include = [], ...rest } = values;
    const out = { include, files: gather(of, include) };
    for (const name of Object.keys(SHADER))
        if (!['lang', 'three'].includes(name) && rest[name] !== undefined) out[camel(name)] = rest[name];
    if (state !== undefined) out.state = { file: [state, content(state)] };
    if (samples !== undefined) out.samples = Number(samples);
    return out;
}

/** Layout files of the pass `outputs`. */
function layouts(passes, files) {
    for (const pass of passes) {
        const [, file] = /[:,]layout=([^,]+)/.exec(pass) ?? [];
        if (file && existsSync(file)) files[file] = read(file);
    }
}

const COMMANDS = {
    rewrite({ pass = [], emit, out, output, validate, format, ...values }, files) {
        const of = sources(files, values);
        const more = options(values, of);
        layouts(pass, more.files);
        const folder = out ?? output;
        return requests.rewrite(of, { ...more, pass, emit: commas(emit), validate, out: folder, format });
    },
    outputs({ write, ...values }, files) {
        if (!write) throw new Failure('error: --write names the outputs: depth, normal, velocity, id, ..');
        const pass = `outputs:write=${commas(write).join('+')}`;
        return COMMANDS.rewrite({ ...values, pass: [pass] }, files);
    },
    explain({ pass, verbose, format, ...values }, files) {
        const of = sources(files, values);
        return requests.explain(of, { ...options(values, of), pass, verbose, format });
    },
    agree(values, files) {
        const { with: theirs, as, map, normal, inputs, verbose, format, ...own } = values;
        let [ours, others] = [files, commas(theirs)];
        if (!others && files.length === 2) [ours, others] = [[files[0]], [files[1]]];
        if (!others) throw new Failure('error: agree needs two programs: FIRST --with SECOND, or two files');
        if ([...ours, ...others].includes('-')) throw new Failure('error: agree reads files, not stdin');
        if (!as) throw new Failure('error: --as says what the two should have in common');
        const [first, second] = [sources(ours, own), sources(others, own)];
        const { 'with-vertex': vertex, 'with-fragment': fragment, 'with-define': define, 'fail-on': failOn } = values;
        const more = options(own, first);
        const other = { ...options(own, second), vertex, fragment, name: undefined, ...(define && { define }) };
        const asked = { as, map, normal, failOn: commas(failOn), verbose, format };
        if (inputs !== undefined) asked.inputs = Number(inputs);
        return requests.agree(first, second, { ...more, ...asked, with: other });
    },
    passes: ({ format }, [name]) => requests.passes({ ...(name && { name }), format }),
};

const say = (message) => process.stderr.write(`${message.trimEnd()}\n`);

/** Writes the files whose content changes, each in one step. */
function write(folder, files, tells) {
    mkdirSync(folder, { recursive: true });
    let written = 0;
    for (const { name, text } of files) {
        const path = join(folder, name);
        const bytes = Buffer.from(text);
        if (existsSync(path) && readFileSync(path).equals(bytes)) continue;
        const part = `${path}.${process.pid}.part`;
        writeFileSync(part, bytes);
        renameSync(part, path);
        written += 1;
        if (tells) say(`wrote ${path}`);
    }
    if (tells && !written) say(`${folder} is up to date`);
    return written;
}

function failed(message, format, isOfMaterial = false) {
    const report = isOfMaterial
        ? { schema: 'preshade.rewrite.v1', materials: [], errors: [message] }
        : { errors: [message], schema: 'preshade.error.v1' };
    if (format === 'json') process.stdout.write(`${JSON.stringify(report, null, 2)}\n`);
    say(message);
    return 2;
}

async function run(words) {
    const [command, ...rest] = words;
    if (!command || ['help', '--help', '-h'].includes(command)) {
        process[command ? 'stdout' : 'stderr'].write(HELP);
        return command ? 0 : 2;
    }
    if (['--version', '-V'].includes(command)) {
        process.stdout.write(`preshade ${VERSION}\n`);
        return 0;
    }
    if (NATIVE.includes(command) || command === '--explain')
        return failed(`error: \`${command}\` needs the native program: cargo install preshade-cli`);
    if (!(command in COMMANDS))
        return failed(`error: there is no command \`${command}\`; there are: ${Object.keys(COMMANDS).join(', ')}`);
    let format = 'human';
    const compiler = new Preshade();
    try {
        const { values, positionals } = parseArgs({ args: rest, options: OPTIONS[command], allowPositionals: true });
        format = values.format ?? format;
        if (values.help) {
            process.stdout.write(HELP);
            return 0;
        }
        const request = COMMANDS[command]({ ...values, format }, positionals);
        const answer = await compiler.request(request);
        if (answer.error) return failed(asOnDisk(answer.error.rendered), format);
        const { status, report } = answer;
        const [messages, after, errors] = [answer.messages, answer.after, answer.errors].map(asOnDisk);
        const stdout = format === 'json' && ahead.size ? jsonOnDisk(answer.stdout) : asOnDisk(answer.stdout);
        messages.forEach(say);
        // The files of a material are written all or none.
        if (request.out && report.written.length) write(request.out, report.written, format === 'human');
        if (stdout) process.stdout.write(stdout);
        if (format === 'human') after.forEach(say);
        errors.forEach(say);
        return status;
    } catch (error) {
        const isOfAuthor = error instanceof Failure || error.name === 'PreshadeError';
        if (isOfAuthor || error.code?.startsWith('ERR_PARSE_ARGS')) {
            const message = asOnDisk(error.rendered ?? error.message);
            const told = message.startsWith('error') ? message : `error: ${message}`;
            return failed(told, format, error instanceof Failure && ['rewrite', 'outputs'].includes(command));
        }
        if (error.syscall) return failed(`error: ${error.message}`, format);
        throw error;
    } finally {
        compiler.dispose();
    }
}

process.exitCode = await run(process.argv.slice(2));
