// What frame.json holds: objects get their number when a command first refers to them.

const SCHEMA = 'preshade.frames.v1';
const WRITER = 'preshade capture, page recorder 1';

/** An object of the page: its kind names its list in frame.json. `json` makes its entry. */
class Thing {
    constructor(kind, object, descriptor) {
        this.kind = kind;
        this.object = object;
        this.descriptor = descriptor;
    }
}

const LISTS = [
    'buffers',
    'textures',
    'samplers',
    'shaders',
    'bindGroupLayouts',
    'pipelineLayouts',
    'bindGroups',
    'renderPipelines',
    'computePipelines',
    'named',
];

class Folder {
    constructor(sink, source) {
        this.tar = new Tar(sink);
        this.known = new Set();
        this.numbers = new Map();
        this.equals = {};
        this.texts = new Map();
        this.entries = {};
        for (const list of LISTS) this.entries[list] = [];
        this.source = source;
        this.start = { buffers: [], textures: [] };
        this.unknown = [];
        this.refusals = new Map();
        this.frames = [];
    }

    /** The name of the file that holds `bytes`. */
    data(bytes) {
        const name = hash(bytes);
        if (!this.known.has(name)) {
            this.known.add(name);
            this.tar.file(`data/${name}.bin`, bytes);
        }
        return name;
    }

    text(text) {
        return this.data(new TextEncoder().encode(text));
    }

    /** The number of `key` in `list`; `make` makes its entry once. */
    number(list, key, make) {
        let number = this.numbers.get(key);
        if (number === undefined) {
            // An entry may refer to others of its own list, so it is made before it has a number.
            const entry = make();
            number = this.entries[list].push(entry) - 1;
            this.numbers.set(key, number);
        }
        return number;
    }

    /** The number of an entry that equals `entry`. Its text is long, so it is a key as it is. */
    equal(list, entry) {
        const known = (this.equals[list] ??= new Map());
        const key = JSON.stringify(entry);
        let number = known.get(key);
        if (number === undefined) {
            number = this.entries[list].push(entry) - 1;
            known.set(key, number);
        }
        return number;
    }

    refuse(what, why, count = 1) {
        const key = `${what}: ${why}`;
        const refusal = this.refusals.get(key);
        if (refusal) refusal.count += count;
        else this.refusals.set(key, { what, why, count });
    }

    json() {
        return {
            schema: SCHEMA,
            source: this.source,
            ...this.entries,
            start: this.start,
            unknown: this.unknown,
            refused: [...this.refusals.values()],
            frames: this.frames,
        };
    }

    /** frame.json as it is so far: whoever unpacks the stream keeps the last one. */
    write() {
        this.tar.file('frame.json', new TextEncoder().encode(JSON.stringify(this.json())));
    }
}
