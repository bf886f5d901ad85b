// Velocities of the real geometry. three.js' VelocityNode has the previous matrices of objects, instances, batches and
// bones, but not the previous `positionNode`, `vertexNode`, displacement or morph: whatever these move has a velocity
// even where nothing moves. Here each vertex is evaluated twice by the author's own vertex stage, the second time with
// the uniforms of the frame before.

import {
    Color,
    ConstantColorFactor,
    CustomBlending,
    DataUtils,
    HalfFloatType,
    NearestFilter,
    RGFormat,
    RenderTarget,
    RendererUtils,
    TSL,
    Vector2,
    ZeroFactor,
} from 'three/webgpu';
import { Authors } from './authors.js';
import { Prepared, derivedMaterial } from './casting.js';
import { stages, vertexLayouts } from './pipelines.js';
import { PreviousBuffers, moved, movingBuffers } from './previous.js';
import { Entries, stateOf } from './programs.js';
import { row } from './rows.js';

const ROLE = 'outputs';
/** preshade's velocities are parts of the picture, with y down; three.js' are clip space, with y up. */
const SCALE = new Color(2, -2, 0);
/** The blending unit scales: by powers of two, which rounds nothing. */
const velocityMaterial = (author) =>
    derivedMaterial(author, {
        name: 'velocity',
        fog: false,
        transparent: false,
        mrtNode: null,
        alphaToCoverage: false,
        blending: CustomBlending,
        blendSrc: ConstantColorFactor,
        blendDst: ZeroFactor,
        blendSrcAlpha: null,
        blendDstAlpha: null,
        blendColor: SCALE,
        blendAlpha: 1,
    });

/** What of the projection shifts the picture by a part of a pixel: `setViewOffset`, as antialiasing uses it. */
const jitterOf = (camera) =>
    camera.isOrthographicCamera ? 'render.cameraProjectionMatrix[3].xy' : 'render.cameraProjectionMatrix[2].xy';

class Entry {
    state = 'asked';
    reason = null;
    remedy = null;
    code = null;
    ms = 0;
    pipeline = null;
    uniforms = [];
    layout = null;

    end(state, reason, code = null, remedy = null) {
        Object.assign(this, { state, reason, code, remedy });
    }
}

export class Velocity {
    #host;
    #scene;
    #target = new RenderTarget(1, 1, {
        type: HalfFloatType,
        format: RGFormat,
        minFilter: NearestFilter,
        magFilter: NearestFilter,
    });
    #previous;
    #authors = new Authors();
    #entries;
    #groups = new WeakMap();
    #prepared;
    #pending = new Set();
    /** Whether it is the velocities that three.js draws now. */
    isDrawing = false;
    #state;

    /** Switches it off and on. While it is off, the texture stays as it is. */
    enabled = true;
    #camera;
    #isAutomatic;

    /**
     * `camera`: whose frames; by default that of the first. With `automatic: false` you call `render` once in each frame.
     */
    constructor(host, scene, { camera = null, automatic = true } = {}) {
        this.#host = host;
        this.#scene = scene;
        this.#camera = camera;
        this.#isAutomatic = automatic;
        this.#entries = new Entries(host, () => new Entry());
        this.#prepared = new Prepared(host.renderer, 'preshade velocity');
        this.#target.texture.name = 'preshade velocity';
        this.#previous = new PreviousBuffers(host.backend.device);
    }

    /** Clip space that each pixel's surface went since the frame before, as three.js' `velocity`; half floats. */
    get texture() {
        return this.#target.texture;
    }

    /** The texture as a node, for `traa` and `motionBlur`. */
    get node() {
        return (this.texture.userData.node ??= TSL.texture(this.texture));
    }

    /** Whenever three.js begins a render: draws the velocities ahead of the scene's own picture. */
    begin(scene, camera) {
        const { renderer } = this.#host;
        if (!this.#isAutomatic || !this.enabled || this.isDrawing || scene !== this.#scene) return;
        if (scene.overrideMaterial !== null || camera.isArrayCamera) return;
        this.#camera ??= camera;
        if (camera !== this.#camera) return;
        const target = renderer.getRenderTarget();
        this.render(camera, target ? new Vector2(target.width, target.height) : undefined);
    }

    /**
     * Draws the velocities of a frame: those of the opaque meshes, as large as the drawing buffer, or as `size`. A shift
     * of the projection by `setViewOffset` counts as none.
     */
    render(camera, size = this.#host.renderer.getDrawingBufferSize(new Vector2())) {
        const { renderer } = this.#host;
        const scene = this.#scene;
        this.#target.setSize(size.x, size.y);
        this.#state = RendererUtils.resetRendererAndSceneState(renderer, scene, this.#state);
        this.#previous.next();
        this.isDrawing = true;
        try {
            renderer.transparent = false;
            renderer.setClearColor(0, 0);
            renderer.setRenderTarget(this.#target);
            renderer.render(scene, camera);
        } finally {
            this.isDrawing = false;
            RendererUtils.restoreRendererAndSceneState(renderer, scene, this.#state);
        }
    }

    /** The velocities, for tests and tools: two numbers a pixel. */
    async pixels() {
        const { width, height } = this.#target;
        const half = await this.#host.renderer.readRenderTargetPixelsAsync(this.#target, 0, 0, width, height);
        return Float32Array.from(half, DataUtils.fromHalfFloat);
    }

    /** Draws one object, if it is the velocities that are drawn. */
    draw(call) {
        if (!this.isDrawing || call.scene !== this.#scene) return false;
        if (!call.object.isMesh) return true;
        const known = this.#authors.of(call.material, String(call.material.version), () => {
            const material = velocityMaterial(call.material);
            return { entries: new Map(), material, materials: [material] };
        });
        const own = this.#prepared.of(known.material, call);
        if (own) this.#encode(own, this.#entry(own, known));
        return true;
    }

    #encode(own, entry) {
        const { backend, renderer } = this.#host;
        const uniforms = entry.uniforms.map(([group, binding]) => own.getBindings()[group].bindings[binding]);
        if (entry.state !== 'ready' || !uniforms.every((of) => of?.buffer)) return;
        const gpu = uniforms.map((binding) => this.#previous.of(binding));
        let group = this.#groups.get(own);
        if (group?.entry !== entry || group.gpu.some((buffer, i) => buffer !== gpu[i])) {
            group = { entry, gpu, of: {} };
            const entries = gpu.map((buffer, binding) => ({ binding, resource: { buffer } }));
            backend.get(group.of).group = backend.device.createBindGroup({ layout: entry.layout, entries });
            this.#groups.set(own, group);
        }
        const vertices = movingBuffers(own).map(({ data }) => {
            const of = {};
            backend.get(of).buffer = this.#previous.of(data);
            return of;
        });
        const [bindings, buffers] = [own.getBindings(), own.getVertexBuffers()];
        own.pipeline = entry.pipeline;
        own.getBindings = () => [...bindings, group.of];
        own.getVertexBuffers = () => [...buffers, ...vertices];
        try {
            backend.draw(own, renderer.info);
        } finally {
            delete own.getBindings;
            delete own.getVertexBuffers;
        }
    }

    #entry(own, known) {
        const entry = this.#entries.of(own, own.camera.isOrthographicCamera, (key, of) => known.entries.set(key, of));
        if (own.object.isBatchedMesh) entry.end('unsupported', 'matrices of a BatchedMesh are in a texture');
        else if (entry.state === 'asked') this.#ask(entry, own);
        return entry;
    }

    #ask(entry, own) {
        const { variants, backend, programs } = this.#host;
        const texts = programs.built(own);
        const state = stateOf(own, backend);
        const moving = movingBuffers(own).flatMap(({ names }) => names);
        const parameters = [
            ...(moving.length ? [`moving=${moving.join('+')}`] : []),
            ...(texts.vertex.includes('render.cameraProjectionMatrix') ? [`jitter=${jitterOf(own.camera)}`] : []),
        ];
        const pass = ['outputs:write=velocity', ...parameters].join(',');
        const found = variants.get(texts, { pass, roles: [ROLE], ...state });
        if (found.state === 'pending') return;
        entry.ms = found.ms;
        if (found.state !== 'ready') return entry.end(found.state, found.reason, found.code, found.remedy);
        entry.state = 'compiling';
        const done = this.#compile(entry, own, found.variant)
            .catch((error) => entry.end('unsupported', error.message))
            .finally(() => this.#pending.delete(done));
        this.#pending.add(done);
    }

    async #compile(entry, own, variant) {
        const { backend, pipelines } = this.#host;
        const bindings = own.getBindings();
        const outputs = variant.passes.find(({ pass }) => pass.role === ROLE);
        const layouts = vertexLayouts(backend, own);
        const of = moved(outputs, bindings.length, movingBuffers(own), layouts);
        if (bindings.length >= backend.device.limits.maxBindGroups) throw new Error('no bind group is left');
        const entries = of.uniforms.map((_, binding) => ({
            binding,
            visibility: GPUShaderStage.VERTEX | GPUShaderStage.FRAGMENT,
            buffer: { type: 'uniform' },
        }));
        const layout = backend.device.createBindGroupLayout({ label: 'preshade previous', entries });
        const group = {};
        backend.get(group).layout = { layoutGPU: layout };
        const renderObject = Object.create(own, { getBindings: { value: () => [...bindings, group] } });
        const { compare, write } = of.pass.depth;
        const pipeline = await pipelines.make({ renderObject }, stages({ passes: [of] }, ROLE), {
            compare,
            write,
            colorWrite: true,
            buffers: of.vertices,
        });
        if (!pipeline) return entry.end('failed', 'the device refuses a pipeline');
        Object.assign(entry, { pipeline, layout, uniforms: of.uniforms, state: 'ready' });
    }

    async settled() {
        await Promise.all(this.#pending);
    }

    report() {
        return [...this.#authors].flatMap(([material, { entries }]) =>
            [...entries.values()].map(({ state, reason, remedy, code, ms }) =>
                row('velocity', material, { state, reason, remedy, code, ms }),
            ),
        );
    }

    dispose() {
        this.#authors.release();
        this.#entries.clear();
        this.#previous.dispose();
        this.#target.dispose();
        this.#host.forget(this);
    }
}
