// What preshade writes, drawn by three.js: takes a material's GLSL as WebGL gets it, loads the plan that `preshade rewrite --emit glsl-es` makes of it, and draws a scene by such plans.
//
//     const frame = new PlannedFrame( renderer );
//     frame.use( material, await loadVariant( 'stone/stone.plan.json' ), { fallback, text } );
//     await frame.selfTest( scene, camera );
//     frame.render( scene, camera );              // in place of renderer.render
//
// A plan is made of one text. Where three.js would make another of the author's material now (a map, a light more, fog, another kind of target), the material is drawn as its author has it
// from that frame on, and the console says so: `frame.outdated` has it.
//
// Every decision about passes, depth and colour state, order and attachments is read from the plan. Not read: shadow passes, compute passes, subdivided geometry and guards; `loadVariant`
// throws where a plan needs them. Not supported of three.js: WebXR, array cameras, and transmissive materials beside `form=equal` (they draw the opaque objects once more, elsewhere).

import {
    AlwaysDepth,
    BackSide,
    DepthTexture,
    DoubleSide,
    EqualDepth,
    FloatType,
    FrontSide,
    GLSL3,
    GreaterDepth,
    GreaterEqualDepth,
    HalfFloatType,
    LessDepth,
    LessEqualDepth,
    Material,
    NearestFilter,
    NeverDepth,
    NotEqualDepth,
    UnsignedByteType,
    UnsignedIntType,
    UnsignedShortType,
    Vector2,
    Vector4,
    WebGLRenderTarget,
} from 'three';

const COMPARE = {
    never: NeverDepth,
    less: LessDepth,
    equal: EqualDepth,
    'less-equal': LessEqualDepth,
    greater: GreaterDepth,
    'not-equal': NotEqualDepth,
    'greater-equal': GreaterEqualDepth,
    always: AlwaysDepth,
};
const CULL = { back: FrontSide, front: BackSide, none: DoubleSide };
const DEPTH_TYPE = { depth16unorm: UnsignedShortType, depth24plus: UnsignedIntType, depth32float: FloatType };
const COLOR_TYPE = { rgba8unorm: UnsignedByteType, rgba16float: HalfFloatType };

/** The name a plan gives the depth buffer of what is drawn to. */
const SCENE_DEPTH = 'scene-depth';

// ---- the author's side: what preshade is given ----------------------------------------------------------------------------------------------------------------------------------

/** The GLSL that WebGL has for `material`. */
function texts(renderer, material) {
    const gl = renderer.getContext();
    const program = renderer.properties.get(material).currentProgram?.program;
    if (!program) throw new Error(`"${material.name}" has not been compiled yet`);
    const text = (type) => {
        const of = (shader) => gl.getShaderParameter(shader, gl.SHADER_TYPE) === type;
        return gl.getShaderSource(gl.getAttachedShaders(program).find(of));
    };
    return { vertex: text(gl.VERTEX_SHADER), fragment: text(gl.FRAGMENT_SHADER) };
}

/** A short name for both texts, by which another is told: FNV-1a of 32 bits. */
function named({ vertex, fragment }) {
    let hash = 0x811c9dc5;
    for (const text of [vertex, '\0', fragment]) {
        for (let i = 0; i < text.length; i++) hash = Math.imul(hash ^ text.charCodeAt(i), 0x01000193);
    }
    return (hash >>> 0).toString(16).padStart(8, '0');
}

/**
 * The GLSL that WebGL has for `material`, three.js's own part included, and the state that it is drawn with, for `preshade rewrite --state`. The material must have been drawn (or
 * compiled by `renderer.compile`) into the kind of target it is meant for: tone mapping and colour space are in the text. `text` names both texts, for `PlannedFrame.use`.
 *
 * @returns {{ vertex: string, fragment: string, state: object, text: string }}
 */
export function capture(renderer, material, { depthFormat = 'depth24plus' } = {}) {
    const { vertex, fragment } = texts(renderer, material);
    const name = (table, value) => Object.keys(table).find((key) => table[key] === value);
    const state = {
        primitive: { cull: name(CULL, material.side) },
        depth_format: depthFormat,
        depth_compare: material.depthTest ? name(COMPARE, material.depthFunc) : 'always',
        depth_write: material.depthTest && material.depthWrite,
    };
    return { vertex, fragment, state, text: named({ vertex, fragment }) };
}

// ---- what preshade wrote ------------------------------------------------------------------------------------------------------------------------------------------------------

/**
 * A plan with its shaders. `edit` may change a stage's text before it is compiled, given the pass's role and `vertex` or `fragment`.
 *
 * @returns {Promise<{ plan: object, passes: { pass: object, vertex: string, fragment: string, textures: object[], blocks: object[] }[] }>}
 */
export async function loadVariant(url, { edit = (text) => text } = {}) {
    const plan = await (await fetched(url)).json();
    refuse(plan);
    const read = async (role, stage, of) => {
        const text = await (await fetched(new URL(of.file, new URL(url, document.baseURI)))).text();
        // three.js writes the version itself.
        return edit(text.replace(/^#version .*\n/, ''), role, stage);
    };
    const passes = await Promise.all(
        plan.passes.map(async (pass, i) => {
            const vertex = plan.files[i].vertex['glsl-es'];
            const fragment = plan.files[i].fragment['glsl-es'];
            return {
                pass,
                vertex: await read(pass.role, 'vertex', vertex),
                fragment: await read(pass.role, 'fragment', fragment),
                textures: [...(vertex.textures ?? []), ...(fragment.textures ?? [])],
                blocks: [...(vertex.blocks ?? []), ...(fragment.blocks ?? [])],
            };
        }),
    );
    return { plan, passes };
}

async function fetched(url) {
    const response = await fetch(url);
    if (!response.ok) throw new Error(`${url}: ${response.status}`);
    return response;
}

/** What this module does not do is an error, not another picture. */
function refuse(plan) {
    const cannot = (what) => {
        throw new Error(`${plan.material}: the plan asks for ${what}, which preshade-three.js does not do`);
    };
    if (plan.schema !== 'preshade.plan.v1') cannot(`the schema ${plan.schema}`);
    if (plan.compute?.length) cannot('compute passes');
    if (plan.guard) cannot('a guard');
    for (const { name, format, samples } of [...plan.attachments, plan.self_test?.attachment].filter(Boolean)) {
        if (name === SCENE_DEPTH) continue;
        if (!(format in DEPTH_TYPE) && !(format in COLOR_TYPE)) cannot(`an attachment of the format ${format}`);
        if (samples > 1) cannot('attachments with several samples');
    }
    for (const pass of plan.passes) {
        if (!['depth', 'opaque', 'blended'].includes(pass.phase)) cannot(`the phase ${pass.phase}`);
        if (!['opaque', 'all'].includes(pass.draws)) cannot(`draws "${pass.draws}"`);
        if (pass.geometry) cannot('other geometry');
        if (pass.depth?.read_only) cannot('a read-only depth attachment');
        if (pass.stencil) cannot('a stencil state');
        if (pass.primitive.front_face !== 'ccw' || pass.primitive.unclipped_depth)
            cannot('a primitive state of its own');
    }
}

// ---- materials ----------------------------------------------------------------------------------------------------------------------------------------------------------------

/**
 * The author's material as one pass of a plan draws it: everything is read through to the author's object, so that whatever is set there later counts here as well, but for the text and
 * the state that are the plan's. `isRawShaderMaterial` has three.js take the text as it is; uniforms stay those of the material's own kind. `asked` is called whenever three.js looks for
 * a program anew: it has seen something change that programs are made of.
 */
function passMaterial(author, { pass, vertex, fragment, textures, blocks }, attachments, asked) {
    const depth = pass.depth;
    const biased = depth.bias.constant !== 0 || depth.bias.slope_scale !== 0;
    const own = {
        // Listeners are not to be shared: three.js hangs the release of the programs on them.
        _listeners: undefined,
        isRawShaderMaterial: true,
        glslVersion: GLSL3,
        defines: {},
        // Uniforms of clipping planes, which three.js sets only where a raw material asks for them.
        clipping: true,
        side: CULL[pass.primitive.cull],
        depthTest: true,
        depthFunc: COMPARE[depth.compare],
        depthWrite: depth.write,
        colorWrite: pass.targets.some((target) => target?.write_mask),
        polygonOffset: biased,
        polygonOffsetFactor: depth.bias.slope_scale,
        polygonOffsetUnits: depth.bias.constant,
        onBeforeCompile(parameters, renderer) {
            author.onBeforeCompile(parameters, renderer);
            parameters.vertexShader = vertex;
            parameters.fragmentShader = fragment;
            parameters.uniforms = { ...parameters.uniforms, ...bound(pass, textures, attachments) };
        },
        customProgramCacheKey() {
            asked();
            return `${vertex}\n${fragment}`;
        },
    };
    const descriptor = (value) => ({ value, writable: true, configurable: true, enumerable: true });
    const properties = Object.fromEntries(Object.entries(own).map(([key, value]) => [key, descriptor(value)]));
    // three.js binds each group to a block of the program: one of this pass has to be there. Only its shader materials have groups at all, and before r173 it asks every raw material for them.
    properties.uniformsGroups = {
        get: () => (author.uniformsGroups ?? []).filter(({ name }) => blocks.some(({ block }) => block === name)),
        configurable: true,
        enumerable: true,
    };
    return Object.create(author, properties);
}

/** Uniforms for what a pass reads of other passes; `attachments` fills in the textures whenever it makes them. */
function bound(pass, textures, attachments) {
    const uniforms = {};
    for (const { name, texture } of textures) {
        const binding = pass.bindings.find((b) => b.group === texture[0] && b.binding === texture[1]);
        if (binding?.source.from === 'attachment') uniforms[name] = attachments.uniform(binding.source.name);
    }
    return uniforms;
}

/** Not drawn by three.js, nor does it hide the children of the object that has it. */
const HIDDEN = new Material();
HIDDEN.visible = false;

/** Runs `draw` while each object has `pick(material)` in place of its own. */
function withMaterials(scene, pick, draw) {
    const swapped = [];
    scene.traverseVisible((object) => {
        const material = object.material;
        if (!material) return;
        swapped.push([object, material]);
        object.material = Array.isArray(material) ? material.map(pick) : pick(material);
    });
    try {
        draw();
    } finally {
        for (const [object, material] of swapped) object.material = material;
    }
}

/** Runs `draw` with `values` set on `object`. */
function withValues(object, values, draw) {
    const old = Object.fromEntries(Object.keys(values).map((key) => [key, object[key]]));
    Object.assign(object, values);
    try {
        draw();
    } finally {
        Object.assign(object, old);
    }
}

// ---- attachments ----------------------------------------------------------------------------------------------------------------------------------------------------------------

/** The textures that passes share by name, as large as what is drawn to. Those of one name are one for all materials. */
class Attachments {
    #targets = new Map();
    #uniforms = new Map();

    /** The uniform that holds the texture of that name; one object, whatever the texture becomes. */
    uniform(name) {
        if (!this.#uniforms.has(name)) this.#uniforms.set(name, { value: null });
        return this.#uniforms.get(name);
    }

    /** What to draw to for this depth attachment; `color` is its colour's, with a name where that is an attachment too. */
    target(depth, color, size, viewport) {
        let target = this.#targets.get(depth.name);
        if (!target) {
            target = new WebGLRenderTarget(size.x, size.y, {
                type: color.type,
                minFilter: NearestFilter,
                magFilter: NearestFilter,
                depthTexture: new DepthTexture(size.x, size.y, DEPTH_TYPE[depth.format]),
            });
            this.#targets.set(depth.name, target);
            this.uniform(depth.name).value = target.depthTexture;
            if (color.name) this.uniform(color.name).value = target.texture;
        }
        target.setSize(size.x, size.y);
        target.viewport.copy(viewport);
        return target;
    }

    dispose() {
        for (const target of this.#targets.values()) {
            target.depthTexture.dispose();
            target.dispose();
        }
        this.#targets.clear();
    }
}

// ---- frames -------------------------------------------------------------------------------------------------------------------------------------------------------------------

/** Draws a scene some of whose materials have plans. All others, and those that are transparent at the time, are drawn as three.js draws them. */
export class PlannedFrame {
    #renderer;
    #attachments = new Attachments();
    #used = new Map();
    /** Materials of which three.js might make another program than their plan is of. */
    #doubtful = new Set();
    /** Materials whose plans are of another text than three.js makes of them by now: drawn as their authors have them, until they are used anew. */
    outdated = new Set();

    constructor(renderer) {
        this.#renderer = renderer;
    }

    /**
     * Draws `material` by `variant` from now on; `fallback` is the variant of the recipe that its plan falls back to. Where that is "original" none is needed. `text` is what `capture` called
     * the texts that the plan was made of; without it they are taken to be those of the first frame.
     */
    use(material, variant, { fallback = null, text = null } = {}) {
        this.restore(material);
        this.outdated.delete(material);
        const asked = () => this.#doubtful.add(material);
        const drawn = variant.passes.map((of) => ({
            pass: of.pass,
            attachment: variant.plan.attachments.find((a) => a.name === of.pass.depth.attachment),
            material: passMaterial(material, of, this.#attachments, asked),
        }));
        this.#used.set(material, { variant, fallback, text, drawn });
    }

    /** Draws `material` as its author has it. */
    restore(material) {
        for (const { material: derived } of this.#used.get(material)?.drawn ?? []) derived.dispose();
        this.#used.delete(material);
        this.#doubtful.delete(material);
    }

    dispose() {
        for (const material of [...this.#used.keys()]) this.restore(material);
        this.#attachments.dispose();
    }

    /** In place of `renderer.render`: into the same target, which may have another size than in the frame before. */
    render(scene, camera) {
        this.#draw(scene, camera);
        if (this.#someAreOutdated(scene, camera)) this.#draw(scene, camera);
    }

    /** Restores those whose program would be another by now; says of each that it does. */
    #someAreOutdated(scene, camera) {
        const doubtful = this.#active().filter(([author]) => this.#doubtful.has(author));
        if (doubtful.length === 0) return false;
        // What three.js makes of the authors' own materials, in this scene and for this target.
        this.#renderer.compile(scene, camera);
        let some = false;
        for (const [author, entry] of doubtful) {
            this.#doubtful.delete(author);
            // In no object of the scene.
            if (!this.#renderer.properties.get(author).currentProgram) continue;
            const text = named(texts(this.#renderer, author));
            entry.text ??= text;
            if (entry.text === text) continue;
            some = true;
            this.restore(author);
            this.outdated.add(author);
            console.warn(`preshade: "${author.name}" is drawn as three.js has it: its plan was made of another text`);
        }
        return some;
    }

    #draw(scene, camera) {
        const renderer = this.#renderer;
        // One render pass a depth attachment: the depth passes of all materials come before anything is shaded.
        const prepasses = new Map();
        for (const [author, { drawn }] of this.#active()) {
            for (const of of drawn.filter((d) => d.pass.phase === 'depth')) {
                const name = of.attachment.name;
                if (!prepasses.has(name)) prepasses.set(name, new Map());
                prepasses.get(name).set(author, of);
            }
        }
        for (const [name, of] of prepasses) {
            const own = name !== SCENE_DEPTH;
            const target = own ? this.#own([...of.values()][0]) : renderer.getRenderTarget();
            // An attachment of ours is always cleared; the host's as the host has it.
            withValues(renderer, own ? { autoClear: true, autoClearDepth: true } : {}, () =>
                this.#only(scene, camera, target, (material) => of.get(material)?.material),
            );
        }
        const main = new Map();
        for (const [author, { drawn }] of this.#active())
            main.set(author, drawn.find((d) => d.pass.phase !== 'depth').material);
        // The first pass that has the scene's depth cleared it.
        const autoClearDepth = renderer.autoClearDepth && !prepasses.has(SCENE_DEPTH);
        withValues(renderer, { autoClearDepth }, () =>
            withMaterials(
                scene,
                (material) => main.get(material) ?? material,
                () => renderer.render(scene, camera),
            ),
        );
    }

    /**
     * Draws each plan's self-test, and has those fall back that fail: once, when the variants are loaded, with the draws in view. Resolves to what was found of each material:
     * `kept`, `broken` (with the plan's word for it), `unseen` (nothing of it was in view, so it falls back too) or `none` (nothing rests on the driver, or no test can tell).
     *
     * @returns {Promise<Map<Material, { verdict: string, failure?: string }>>}
     */
    async selfTest(scene, camera) {
        const asked = [];
        for (const [author, { variant, drawn }] of this.#active()) {
            const test = variant.plan.self_test;
            const runs = (test?.runs ?? []).map((run) => this.#run(scene, camera, author, drawn, test, run));
            asked.push([author, runs]);
        }
        const found = new Map();
        for (const [author, runs] of asked) {
            let result = { verdict: runs.length === 0 ? 'none' : 'kept' };
            for (const { failure, draws } of runs) {
                for (const { query, samples } of draws) {
                    const passed = await this.#passed(query);
                    if (result.verdict !== 'kept' || passed === (samples === 'some')) continue;
                    // What should have been laid was not: it is out of view, or it does not draw at all.
                    result = samples === 'some' ? { verdict: 'unseen' } : { verdict: 'broken', failure };
                }
            }
            found.set(author, result);
            if (result.verdict === 'broken' || result.verdict === 'unseen') this.#fallBack(author);
        }
        return found;
    }

    /** Materials that are drawn by their plans now. A transparent one is in no pre-pass, nor anything else of its plan. */
    #active() {
        return [...this.#used].filter(([material]) => !material.transparent);
    }

    #fallBack(author) {
        const { variant, fallback, text } = this.#used.get(author);
        if (variant.plan.fallback !== 'original' && fallback) this.use(author, fallback, { text });
        else this.restore(author);
    }

    /** The target of a pass that has a depth attachment of its own. */
    #own({ pass, attachment }) {
        const target = pass.targets[0];
        const color = { name: target?.attachment, type: COLOR_TYPE[target?.format] ?? UnsignedByteType };
        return this.#attachments.target(attachment, color, ...this.#extent());
    }

    /** Size and viewport of what the host draws to, in pixels. */
    #extent() {
        const target = this.#renderer.getRenderTarget();
        const size = target
            ? new Vector2(target.width, target.height)
            : this.#renderer.getDrawingBufferSize(new Vector2());
        return [size, this.#renderer.getCurrentViewport(new Vector4())];
    }

    /** Draws the objects alone for whose material `pick` has another, into `target`. */
    #only(scene, camera, target, pick) {
        const renderer = this.#renderer;
        const host = renderer.getRenderTarget();
        const { shadowMap } = renderer;
        renderer.setRenderTarget(target);
        withValues(scene, { background: null }, () =>
            withValues(shadowMap, { autoUpdate: false, needsUpdate: false }, () =>
                withMaterials(
                    scene,
                    (material) => pick(material) ?? HIDDEN,
                    () => renderer.render(scene, camera),
                ),
            ),
        );
        renderer.setRenderTarget(host);
    }

    /** One run of a self-test, each draw in an occlusion query; the attachments are cleared where the run first has them. */
    #run(scene, camera, author, drawn, test, run) {
        const renderer = this.#renderer;
        const gl = renderer.getContext();
        const host = renderer.getRenderTarget();
        const cleared = new Set();
        const draws = run.draws.map((draw) => {
            const own = drawn.find((d) => d.pass.role === draw.role);
            const of = draw.original || !own ? { material: author } : own;
            const isTests = draw.attachment === test.attachment.name;
            const attachment = isTests ? test.attachment : of.attachment;
            const color = { type: host?.texture.type ?? UnsignedByteType };
            // A later draw of the run may sample what a pass leaves in its own attachments.
            const target = isTests ? this.#attachments.target(attachment, color, ...this.#extent()) : this.#own(of);
            const autoClear = !cleared.has(attachment.name);
            cleared.add(attachment.name);
            const query = gl.createQuery();
            const state = { depthFunc: COMPARE[draw.compare], depthWrite: draw.write };
            renderer.state.buffers.depth.setClear(attachment.clear);
            withValues(renderer, { autoClear, autoClearDepth: true }, () =>
                withValues(of.material, state, () => {
                    gl.beginQuery(gl.ANY_SAMPLES_PASSED, query);
                    this.#only(scene, camera, target, (material) => (material === author ? of.material : null));
                    gl.endQuery(gl.ANY_SAMPLES_PASSED);
                }),
            );
            renderer.state.buffers.depth.setClear(1);
            return { query, samples: draw.samples };
        });
        return { failure: run.failure, draws };
    }

    /** Whether any sample passed; a query's result is there in a later task at the earliest. */
    async #passed(query) {
        const gl = this.#renderer.getContext();
        gl.flush();
        while (!gl.isContextLost() && !gl.getQueryParameter(query, gl.QUERY_RESULT_AVAILABLE)) {
            await new Promise((resolve) => setTimeout(resolve, 2));
        }
        const passed = Boolean(gl.getQueryParameter(query, gl.QUERY_RESULT));
        gl.deleteQuery(query);
        return passed;
    }
}
