// A material's plan, for one text of it: its variant, the materials that draw it, and whether they may be drawn yet.

import { NeverDepth, UniformsLib } from 'three';
import { compareName } from '../compare.js';
import { CULL, derived, driverError, refresh, stateOf } from './derived.js';
import { SCENE_DEPTH } from './attachments.js';
import { drawItem } from './frames.js';
import { refusal } from './recipes.js';
import { SelfTest } from './selftest.js';

/** Why three.js is to draw the material as always, or null. */
export function unfit(material) {
    if (material.transmission > 0) return 'transmissive';
    if (material.transparent) return 'transparent';
    if (!material.depthTest || !material.depthWrite) return 'neither tests nor writes depth';
    if (!['less', 'less-equal'].includes(compareName(material.depthFunc))) return 'another depth function';
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
        primitive: { cull: Object.keys(CULL).find((cull) => CULL[cull] === material.side) },
        depth_format: depthFormat,
        depth_compare: compareName(material.depthFunc),
        depth_write: true,
    };
}

export class Planned {
    #host;
    #state;
    #edit;
    #recipes;
    #attachments;
    #trust;
    #limits;
    #pass = null;
    /** Whether three.js looked for the program of one of ours anew: something that programs are made of has changed. */
    #asked = false;
    #guarded = null;
    #test = null;
    #warm = 0;
    #uniforms = new WeakMap();
    /** Programs whose uniforms are known. */
    #known = new WeakSet();

    /** `pending`, `refused`, `failed`, `compiling`, `testing`, `ready` or `original` (the self-test left nothing to draw by). */
    state = 'pending';
    reason = null;
    remedy = null;
    code = null;
    /** The lines of a text of ours that the driver refused. */
    rendered;
    ms = 0;
    /** The recipe that it is drawn by, or was last asked for. */
    recipe = null;
    /** Steps of it that do not apply. */
    skipped = [];
    /** What the self-tests found: `kept`, `unseen`, or `broken` with the recipe. */
    verdicts = [];
    /** Of recipes whose self-test failed, or whose text the driver refused, `{ recipe, failure }`. */
    failures = [];
    /** The frame in which it was last in use, and an item of it. */
    used = 0;
    /** The frame in which three.js last looked for another program. */
    doubted = -1;
    item = null;

    /**
     * `source`: a `Source` of `Programs`. `recipes`: to try, in order. `limits`: what `refusal` of recipes.js has to know. `edit(text, role, stage)` may change a text before it is compiled,
     * and `trust` leaves out the self-test: tests do.
     */
    constructor(host, author, source, state, { recipes, attachments, limits, edit = (text) => text, trust = false }) {
        this.#host = host;
        this.author = author;
        this.source = source;
        this.#state = state;
        this.#recipes = [...recipes];
        this.#attachments = attachments;
        this.#limits = limits;
        this.#edit = edit;
        this.#trust = trust;
    }

    /** Draws the depth alone; null where the plan has no such pass. */
    get depth() {
        return this.#pass?.depth ?? null;
    }

    /** Shades; null where the author's own material does. */
    get main() {
        return this.#pass?.main ?? null;
    }

    /** The depth attachment that the depth pass has for itself, or null. */
    get apart() {
        return this.#pass?.apart ?? null;
    }

    get plan() {
        return this.#pass?.plan ?? null;
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
                const error = driverError(renderer, unknown);
                if (error) return this.#refused(error);
                this.#host.timed('uniforms', () => (program(unknown).getUniforms(), program(unknown).getAttributes()));
                return true;
            }
            this.state = 'testing';
        }
        return false;
    }

    #ask() {
        const [recipe] = this.#recipes;
        const request = { pass: recipe.pass, state: this.#state, partial: true };
        const { state, variant, reason, remedy, code, ms } = this.#host.variants.get(this.source, request);
        if (state === 'pending') return;
        Object.assign(this, { recipe, reason, remedy, code, ms: this.ms + ms, skipped: variant?.skipped ?? [] });
        const refused = state === 'ready' ? refusal(variant.plan, this.#limits) : null;
        if (refused) Object.assign(this, refused);
        if (refused || state !== 'ready') {
            // What one recipe refuses the other may do.
            if (this.#recipes.length > 1) this.#recipes.shift();
            else this.state = refused ? 'refused' : state;
            return;
        }
        this.#make(variant);
        this.state = 'compiling';
    }

    #make({ plan, passes }) {
        const of = (phase) => passes.find(({ pass }) => pass.phase === phase);
        const edited = (of) => ({
            ...of,
            vertex: this.#edit(of.vertex, of.pass.role, 'vertex'),
            fragment: this.#edit(of.fragment, of.pass.role, 'fragment'),
        });
        const main = of('opaque');
        const ahead = of('depth');
        const { compare, write } = main.pass.depth;
        const isAuthors = plan.steps.every(({ pass }) => pass === 'depth-prepass');
        const unchanged = isAuthors && compare === this.#state.depth_compare && write;
        const depth = ahead ? this.#material(edited(ahead)) : null;
        // The author's own text, which the self-tests draw. Where the main pass is the author's, his own material draws it.
        const { vertex, fragment } = this.source;
        const own = this.#material({ ...main, vertex, fragment, blocks: passes.flatMap(({ blocks }) => blocks) });
        const shaded = unchanged ? own : this.#material(edited(main));
        const attachment = ahead?.pass.depth.attachment;
        this.#pass = {
            plan,
            depth,
            main: unchanged ? null : shaded,
            apart: attachment === SCENE_DEPTH ? null : plan.attachments.find(({ name }) => name === attachment),
            all: [...new Set([depth, shaded, own])].filter(Boolean),
            tested: { ...(ahead && { [ahead.pass.role]: depth }), [main.pass.role]: shaded, own },
        };
    }

    #material(of) {
        const { pass, textures } = of;
        const uniforms = lightsOf(this.author);
        for (const { name, texture } of textures) {
            const bound = pass.bindings.find((each) => each.group === texture[0] && each.binding === texture[1]);
            if (bound?.source.from === 'attachment') uniforms[name] = this.#attachments.uniform(bound.source.name);
        }
        const material = derived(this.#host.renderer, this.author, of, {
            uniforms,
            state: { ...stateOf(pass), lights: this.author.lights === true },
        });
        this.#uniforms.set(material, uniforms);
        const key = material.customProgramCacheKey();
        material.customProgramCacheKey = () => {
            this.#asked = true;
            // The draw goes on, and then passes nowhere.
            if (this.#guarded) material.depthFunc = NeverDepth;
            return key;
        };
        return material;
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
        const { plan, main, tested } = this.#pass;
        const { self_test: test } = plan;
        const targetOf = (name) => {
            const attachment = plan.attachments.find((each) => each.name === name);
            return this.#attachments.target(this.#host.renderer, frame, attachment);
        };
        const runs = main ? OWN : [];
        if (!test || this.#trust) this.state = 'ready';
        else this.#test = new SelfTest(this.#host, this, test, runs, tested, targetOf);
        this.#test?.run(items, scene, frame);
        return true;
    }

    /** Call it before a draw with one of ours. */
    refresh(material) {
        refresh(this.#host.renderer, this.author, material, this.#uniforms.get(material));
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
        const { form, name } = this.recipe;
        this.verdicts.push(
            result.verdict === 'broken' ? `broken (${form ?? name}): ${result.failure}` : result.verdict,
        );
        if (result.verdict === 'kept') this.state = 'ready';
        if (result.verdict === 'broken') this.#next(result.failure, 'original');
    }

    #refused({ rendered, reason, code }) {
        this.rendered = rendered;
        this.#next(reason, 'failed');
        if (this.state === 'failed') Object.assign(this, { reason, code });
        return true;
    }

    /** This recipe failed: the next one is tried. */
    #next(failure, end) {
        this.failures.push({ recipe: this.recipe.name, failure });
        this.#release();
        this.#recipes.shift();
        this.state = this.#recipes.length > 0 ? 'pending' : end;
    }

    /**
     * In a frame, ahead of its draws: draws the depth of an item, where the plan has a pass for it. False where three.js would by now take another program of the author's: then nothing was
     * drawn, and nothing of the plan may be.
     */
    drawAhead(item, scene, camera) {
        const { depth, main } = this.#pass;
        if (main) this.refresh(main);
        if (!depth) return true;
        this.refresh(depth);
        this.guard(depth);
        drawItem(this.#host, scene, camera, item, depth);
        return this.unguard();
    }

    /** Until `unguard`, a draw of this material passes nowhere if three.js would take another program by now. */
    guard(material) {
        this.#asked = false;
        this.#guarded = { material, depthFunc: material.depthFunc };
    }

    /** Returns whether it drew. */
    unguard() {
        const { material, depthFunc } = this.#guarded;
        material.depthFunc = depthFunc;
        this.#guarded = null;
        return !this.#asked;
    }

    /** Tests again: the context was lost. */
    restart() {
        this.#test?.dispose();
        this.#test = null;
        this.#warm = 0;
        this.verdicts.length = this.failures.length = 0;
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
