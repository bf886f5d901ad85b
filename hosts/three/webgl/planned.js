// A material's plan of `depth-prepass`, for one text of it: its variant, the materials that draw it, and whether they may be drawn yet.

import { NeverDepth, UniformsLib } from 'three';
import { COMPARE, CULL, derived, refresh, stateOf } from './derived.js';
import { drawItem } from './frames.js';
import { SelfTest } from './selftest.js';

const FORMS = ['equal', 'biased'];
const name = (table, value) => Object.keys(table).find((key) => table[key] === value);

/** Why three.js is to draw the material as always, or null. */
export function unfit(material) {
    if (material.transmission > 0) return 'transmissive';
    if (material.transparent) return 'transparent';
    if (!material.depthTest || !material.depthWrite) return 'neither tests nor writes depth';
    if (!['less', 'less-equal'].includes(name(COMPARE, material.depthFunc))) return 'another depth function';
    if (!material.colorWrite) return 'writes no colour';
    // NormalBlending of an opaque material is none.
    if (material.blending !== 0 && material.blending !== 1) return 'blends';
    if (material.stencilWrite) return 'uses the stencil';
    if (material.polygonOffset) return 'has a polygon offset of its own';
    if (material.alphaToCoverage) return 'alphaToCoverage';
    if (material.wireframe) return 'wireframe';
    return null;
}

/**
 * Runs beside those of the plan, which hold its passes against each other: its main pass against the author's, by more than bits of rounding. A text that the driver takes otherwise than
 * preshade does not go unnoticed.
 */
const OWN = [
    {
        failure: "the plan's main pass lies in front of the author's, or covers more",
        draws: [
            { role: 'own', compare: 'less', write: true, samples: 'some' },
            { role: 'main', compare: 'less', write: false, samples: 'none', isPushed: true },
        ],
    },
    {
        failure: "the author's main pass lies in front of the plan's, or covers more",
        draws: [
            { role: 'main', compare: 'less', write: true, samples: 'some' },
            { role: 'own', compare: 'less', write: false, samples: 'none', isPushed: true },
        ],
    },
];

/** three.js has lights of its own for each render that is nested in another (a mirror), and points the author's uniforms to them. Ours are drawn in one alone. */
function lightsOf(author) {
    const kinds = ['Lambert', 'Toon', 'Phong', 'Standard'];
    if (!author.lights && !kinds.some((kind) => author[`isMesh${kind}Material`])) return {};
    return Object.fromEntries(Object.keys(UniformsLib.lights).map((name) => [name, { value: null }]));
}

/** The state that the plan is made for, as `preshade rewrite --state` takes it. */
export function stateFor(material, depthFormat) {
    return {
        primitive: { cull: name(CULL, material.side) },
        depth_format: depthFormat,
        depth_compare: name(COMPARE, material.depthFunc),
        depth_write: true,
    };
}

export class Planned {
    #host;
    #state;
    #edit;
    #forms;
    #pass = null;
    /** Whether three.js looked for the program of one of ours anew: something that programs are made of has changed. */
    #asked = false;
    #guarded = false;
    #test = null;
    #warm = 0;
    #lights = new WeakMap();
    /** Programs whose uniforms are known. */
    #known = new WeakSet();

    /** `pending`, `refused`, `failed`, `compiling`, `testing`, `ready` or `original` (the self-test left nothing to draw by). */
    state = 'pending';
    reason = null;
    remedy = null;
    code = null;
    ms = 0;
    form = null;
    /** What the self-tests found: `kept`, `unseen`, or `broken` with the form. */
    verdicts = [];
    /** The frame in which it was last in use, and an item of it. */
    used = 0;
    /** The frame in which three.js last looked for another program. */
    doubted = -1;
    item = null;

    /** `source`: a `Source` of `Programs`. `edit(text, role, stage)` may change a text before it is compiled: tests do. */
    constructor(host, author, source, state, { form = 'equal', edit = (text) => text } = {}) {
        this.#host = host;
        this.author = author;
        this.source = source;
        this.#state = state;
        this.#edit = edit;
        this.#forms = FORMS.slice(FORMS.indexOf(form));
    }

    /** Draws the depth alone. */
    get depth() {
        return this.#pass.depth;
    }

    /** Shades; null where the author's own material does. */
    get main() {
        return this.#pass.main;
    }

    get isReady() {
        return this.state === 'ready';
    }

    /** Ahead of a frame: goes on with what takes no drawing. Returns whether something was compiled, which may take milliseconds. */
    prepare(item, scene, camera) {
        if (this.state === 'pending') this.#ask();
        if (this.state === 'compiling') {
            const { programs, renderer } = this.#host;
            const next = this.#pass.all.find((material) => !renderer.properties.get(material).currentProgram);
            if (next) {
                this.#host.timed('link', () => programs.link(item.object, next, scene, camera));
                return true;
            }
            const program = (material) => renderer.properties.get(material).currentProgram;
            if (!this.#pass.all.every((material) => program(material).isReady())) return false;
            // Asks the driver for uniforms and attributes, which the first draw would do: one program in a frame.
            const unknown = this.#pass.all.find((material) => !this.#known.has(program(material)));
            if (unknown) {
                this.#known.add(program(unknown));
                this.#host.timed('uniforms', () => (program(unknown).getUniforms(), program(unknown).getAttributes()));
                return true;
            }
            this.state = 'testing';
        }
        return false;
    }

    #ask() {
        const [form] = this.#forms;
        const request = { pass: `depth-prepass:form=${form}`, state: this.#state };
        const { state, variant, reason, remedy, code, ms } = this.#host.variants.get(this.source, request);
        if (state === 'pending') return;
        Object.assign(this, { form, reason, remedy, code, ms: this.ms + ms });
        if (state !== 'ready') {
            // What one form refuses the other may do.
            if (this.#forms.length > 1) this.#forms.shift();
            else this.state = state;
            return;
        }
        this.#make(variant);
        this.state = 'compiling';
    }

    #make({ plan, passes }) {
        const { renderer } = this.#host;
        const of = (phase) => passes.find(({ pass }) => pass.phase === phase);
        const edited = (of, role) => ({
            ...of,
            vertex: this.#edit(of.vertex, role, 'vertex'),
            fragment: this.#edit(of.fragment, role, 'fragment'),
        });
        const make = (pass) => {
            const uniforms = lightsOf(this.author);
            const material = derived(renderer, this.author, edited(pass, pass.pass.role), {
                uniforms,
                state: { ...stateOf(pass.pass), lights: this.author.lights === true },
            });
            this.#lights.set(material, uniforms);
            const key = material.customProgramCacheKey();
            material.customProgramCacheKey = () => {
                this.#asked = true;
                // The draw goes on, and then passes nowhere.
                if (this.#guarded) material.depthFunc = NeverDepth;
                return key;
            };
            return material;
        };
        const main = of('opaque');
        const unchanged = main.pass.depth.compare === this.#state.depth_compare && main.pass.depth.write;
        const depth = make(of('depth'));
        // The author's own text, which the self-tests draw. Where the main pass is the author's, his own material draws it.
        const own = make({
            ...main,
            pass: { ...main.pass, role: 'own' },
            vertex: this.source.vertex,
            fragment: this.source.fragment,
        });
        const shaded = unchanged ? own : make(main);
        this.#pass = {
            plan,
            depth,
            main: unchanged ? null : shaded,
            shaded,
            own,
            all: [...new Set([depth, shaded, own])],
        };
    }

    /**
     * In a frame, with items of this text in view: draws nothing that is seen, but has three.js set up all programs, and then the self-test. Returns whether it drew.
     */
    warm(items, scene, frame) {
        if (this.state !== 'testing') return false;
        if (this.#test) {
            this.#judge(this.#test.result());
            return false;
        }
        this.#asked = false;
        for (const item of items)
            for (const material of this.#pass.all) this.#nowhere(item, scene, frame.camera, material);
        if (this.#asked && this.#warm++ < 8) return true;
        // A test for each view in which it may be seen, but not in each frame.
        if (this.verdicts.at(-1) === 'unseen' && frame.number % 30 !== 0) return true;
        const { plan, depth, shaded, main, own } = this.#pass;
        const { self_test: test } = plan;
        const runs = main && test ? OWN : [];
        if (!test) this.state = 'ready';
        else this.#test = new SelfTest(this.#host, this, test, runs, { prepass: depth, main: shaded, own });
        this.#test?.run(items, scene, frame);
        return true;
    }

    /** Call it before a draw with one of ours. */
    refresh(material) {
        refresh(this.#host.renderer, this.author, material, this.#lights.get(material));
    }

    #nowhere(item, scene, camera, material) {
        const { depthFunc } = material;
        this.refresh(material);
        material.depthFunc = NeverDepth;
        drawItem(this.#host, scene, camera, item, material);
        material.depthFunc = depthFunc;
    }

    #judge(result) {
        if (result === null) return;
        this.#test.dispose();
        this.#test = null;
        if (this.verdicts.at(-1) === 'unseen') this.verdicts.pop();
        this.verdicts.push(result.verdict === 'broken' ? `broken (${this.form}): ${result.failure}` : result.verdict);
        if (result.verdict === 'kept') this.state = 'ready';
        if (result.verdict !== 'broken') return;
        this.#release();
        this.#forms.shift();
        this.state = this.#forms.length > 0 ? 'pending' : 'original';
    }

    /** In a frame: draws the depth of an item. False where three.js would by now take another program of the author's: then nothing was drawn, and nothing of the plan may be. */
    drawDepth(item, scene, camera) {
        const { depth, main } = this.#pass;
        this.refresh(depth);
        if (main) this.refresh(main);
        this.#asked = false;
        this.#guarded = true;
        const { depthFunc } = depth;
        drawItem(this.#host, scene, camera, item, depth);
        depth.depthFunc = depthFunc;
        this.#guarded = false;
        return !this.#asked;
    }

    /** Tests again: the context was lost. */
    restart() {
        this.#test?.dispose();
        this.#test = null;
        this.#warm = 0;
        this.verdicts.length = 0;
        if (this.state === 'ready' || this.state === 'testing') this.state = 'compiling';
    }

    #release() {
        for (const material of this.#pass?.all ?? []) material.dispose();
        this.#pass = null;
    }

    dispose() {
        this.#test?.dispose();
        this.#release();
    }
}
