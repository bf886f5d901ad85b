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
import { row, withoutVelocity } from '../rows.js';
import { Authors } from './authors.js';
import { Prepared, derivedMaterial } from './casting.js';
import { stages, vertexLayouts } from './pipelines.js';
import { PreviousBuffers, moved, movingBuffers } from './previous.js';
import { Entries, Pending, made, stateOf } from './programs.js';

const ROLE = 'outputs';
/** preshade's velocities are parts of the picture, with y down; three.js' are clip space, with y up. */
const SCALES = { ndc: new Color(2, -2, 0), picture: new Color(1, 1, 0) };
/** The blending unit scales: by powers of two, which rounds nothing. */
const velocityMaterial = (author, scale, side) =>
    derivedMaterial(author, {
        name: 'velocity',
        side,
        fog: false,
        transparent: false,
        mrtNode: null,
        alphaToCoverage: false,
        blending: CustomBlending,
        blendSrc: ConstantColorFactor,
        blendDst: ZeroFactor,
        blendSrcAlpha: null,
        blendDstAlpha: null,
        blendColor: scale,
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
    #pending = new Pending();
    /** Whether it is the velocities that three.js draws now. */
    isDrawing = false;
    #state;

    /** Switches it off and on. While it is off, the texture stays as it is. */
    enabled = true;
    #camera;
    #units;
    #isTransparent;
    #isAutomatic;
    /** three.js' number of the frame whose velocities were drawn last. */
    #frame = null;

    /**
     * `camera`: whose frames; by default that of the first. `units`: `ndc` or `picture`. `transparent`: whether
     * transparent objects are drawn too. With `automatic: false` you call `render` once in each frame.
     */
    constructor(host, scene, { camera = null, units = 'ndc', transparent = false, automatic = true } = {}) {
        if (!Object.hasOwn(SCALES, units))
            throw new TypeError(`preshade: velocities in "ndc" or "picture", not in "${units}"`);
        this.#host = host;
        this.#units = units;
        this.#isTransparent = transparent;
        this.#scene = scene;
        this.#camera = camera;
        this.#isAutomatic = automatic;
        this.#entries = new Entries(host, () => new Entry());
        this.#prepared = new Prepared(host.renderer, 'preshade velocity');
        this.#target.texture.name = 'preshade velocity';
        this.#previous = new PreviousBuffers(host.backend.device);
    }

    /** How far each pixel's surface went since the frame before, in the units of the options; half floats. */
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
        if (!this.#isAutomatic || this.isDrawing || scene !== this.#scene) return;
        // The first frame after the pause has no frame before it.
        if (!this.enabled) return this.#previous.dispose();
        if (scene.overrideMaterial !== null || camera.isArrayCamera) return;
        this.#camera ??= camera;
        if (camera !== this.#camera) return;
        const target = renderer.getRenderTarget();
        const size = target ? new Vector2(target.width, target.height) : this.#size();
        // As three.js' `VelocityNode` counts frames, and its shadow maps: WebGPURenderer raises the number in each
        // animation frame, whether it calls an animation loop of the page or not.
        const { frameId } = renderer._nodes.nodeFrame;
        this.#draw(camera, size, frameId !== this.#frame);
        this.#frame = frameId;
    }

    /**
     * Draws the velocities of a frame: those of the opaque meshes, as large as the drawing buffer, or as `size`. A shift
     * of the projection by `setViewOffset` counts as none. Each call is a frame.
     */
    render(camera, size = this.#size()) {
        this.#draw(camera, size, true);
    }

    #size() {
        return this.#host.renderer.getDrawingBufferSize(new Vector2());
    }

    #draw(camera, size, isNewFrame) {
        const { renderer } = this.#host;
        const scene = this.#scene;
        this.#target.setSize(size.x, size.y);
        this.#state = RendererUtils.resetRendererAndSceneState(renderer, scene, this.#state);
        this.#previous.next(isNewFrame);
        this.isDrawing = true;
        try {
            renderer.transparent = this.#isTransparent;
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
        const author = call.material;
        const known = this.#authors.of(author, String(author.version), () => ({
            entries: new Map(),
            bySide: new Map(),
            materials: [],
        }));
        // three.js draws back and front of transparent objects one after the other.
        const { side } = author;
        let material = known.bySide.get(side);
        if (!material) {
            material = velocityMaterial(author, SCALES[this.#units], side);
            known.bySide.set(side, material);
            known.materials.push(material);
        }
        const own = this.#prepared.of(material, call);
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
        if (own.object.isBatchedMesh) entry.end('refused', 'matrices of a BatchedMesh are in a texture', 'object');
        else if (entry.state === 'asked')
            this.#pending.add(this.#make(entry, own), (message) => entry.end('failed', message, 'failed'));
        return entry;
    }

    async #make(entry, own) {
        const { backend, programs } = this.#host;
        const texts = programs.built(own);
        const moving = movingBuffers(own).flatMap(({ names }) => names);
        const parameters = [
            ...(moving.length ? [`moving=${moving.join('+')}`] : []),
            ...(texts.vertex.includes('render.cameraProjectionMatrix') ? [`jitter=${jitterOf(own.camera)}`] : []),
        ];
        const pass = ['outputs:write=velocity', ...parameters].join(',');
        entry.state = 'compiling';
        const found = await made(this.#host, own, texts, { pass, roles: [ROLE], ...stateOf(own, backend) });
        if (!found) return Object.assign(entry, { state: 'asked' });
        entry.ms = found.ms;
        if (found.state !== 'ready') return entry.end(found.state, found.reason, found.code, found.remedy);
        await this.#compile(entry, own, found.variant);
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
        if (!pipeline) return entry.end('failed', 'the device refuses a pipeline', 'driver');
        Object.assign(entry, { pipeline, layout, uniforms: of.uniforms, state: 'ready' });
    }

    settled() {
        return this.#pending.settled();
    }

    report() {
        const rows = [...this.#authors].flatMap(([material, { entries }]) =>
            [...entries.values()].map(({ state, reason, remedy, code, ms }) =>
                row('velocity', material, { state, reason, remedy, code, ms }),
            ),
        );
        // three.js sorts transmissive materials among the transparent ones.
        const isDrawn = ({ transparent, transmission }) => this.#isTransparent || (!transparent && !(transmission > 0));
        return [...rows, ...withoutVelocity(this.#scene, isDrawn)];
    }

    dispose() {
        this.#authors.release();
        this.#entries.clear();
        this.#previous.dispose();
        this.#target.dispose();
        this.#host.forget(this);
    }
}
