// Velocities of the real geometry: where each visible point is, less where it was in the frame before. Drawn within the page's own frame, each object by a slice of its own program.

import {
    HalfFloatType,
    Matrix3,
    Matrix4,
    NearestFilter,
    NoBlending,
    RGFormat,
    Vector3,
    WebGLRenderTarget,
} from 'three';
import { withoutVelocity } from '../rows.js';
import { Boths, withRows } from './both.js';
import { Derivations } from './derivations.js';
import { drawItem, Frames, hasCallback, sizeOf, within } from './frames.js';
import { stateFor } from './planned.js';

/** What is the same in both frames: numbers of the draw, and sizes. */
const SAME = ['_gl_DrawID', 'morphTargetsTextureSize', 'isOrthographic'];
/** As preshade writes it: parts of the picture, y down. */
const SCALE = ' * vec2(0.5, -0.5)';
/** What of the projection shifts the picture by a part of a pixel: three.js' `setViewOffset` as antialiasing uses it. It counts as 0 in both frames, and the picture is shifted all the same. */
const JITTER = {
    still: '',
    perspective: ',jitter=projectionMatrix[2].xy',
    orthographic: ',jitter=projectionMatrix[3].xy',
};
const STATE = {
    blending: NoBlending,
    transparent: false,
    colorWrite: true,
    stencilWrite: false,
    alphaToCoverage: false,
};

export class Velocity {
    #host;
    #scene;
    #frames;
    #derivations;
    #boths = new Boths();
    #target;
    #options;
    #number = 0;
    #moment = NaN;
    #camera = null;
    /** The camera's matrices of the frame before. */
    #before = null;
    #now = null;
    #records = new WeakMap();
    /** Of groups of uniforms: what they held in the frame before. */
    #groups = new Map();

    /** Switches it off and on. While it is off, the texture stays as it is. */
    enabled = true;

    /**
     * `camera`: whose frames; by default that of the first. `units`: `ndc` or `picture`. `transparent`: whether transparent objects are drawn too.
     */
    constructor(host, scene, { camera = null, units = 'ndc', transparent = false } = {}) {
        if (units !== 'ndc' && units !== 'picture')
            throw new TypeError(`preshade: velocities in "ndc" or "picture", not in "${units}"`);
        this.#host = host;
        this.#scene = scene;
        this.#camera = camera;
        this.#options = { units, transparent };
        this.#target = new WebGLRenderTarget(1, 1, {
            format: RGFormat,
            type: HalfFloatType,
            minFilter: NearestFilter,
            magFilter: NearestFilter,
        });
        this.#target.texture.name = 'velocity';
        this.#derivations = new Derivations(host, {
            pass: 'velocity',
            steps: (source, mode, author) => [
                {
                    texts: { vertex: withRows(source.vertex), fragment: source.fragment },
                    request: { pass: `outputs:write=velocity${JITTER[mode]}`, state: stateFor(author, 'depth24plus') },
                },
            ],
            build: (variant) => this.#build(variant.passes[0]),
        });
        this.#frames = new Frames(host, scene, { begin: this.#begin, drawn: this.#drawn });
    }

    /**
     * Velocities as large as what the scene is drawn into: red to the right, green up, in normalised device coordinates (2 is the width of the picture), as three.js' `VelocityNode` has them;
     * with `units: 'picture'` in parts of the picture, green down. 0 where nothing is drawn.
     */
    get texture() {
        return this.#target.texture;
    }

    report() {
        const isDrawn = ({ transparent }) => !transparent || this.#options.transparent;
        return [...this.#derivations.rows(), ...withoutVelocity(this.#scene, isDrawn)];
    }

    settled() {
        return this.#derivations.settled();
    }

    dispose() {
        this.#frames.dispose();
        this.#derivations.dispose();
        this.#boths.dispose();
        for (const { before } of this.#groups.values()) before.dispose();
        this.#groups.clear();
        this.#target.dispose();
    }

    #build({ pass, vertex, fragment, blocks, uniforms }) {
        // A member of that name would be taken for the number of the draw.
        let text = vertex.replace(/(\.|^\s+int )_gl_DrawID\b/gm, '$1drawNumber');
        for (const name of SAME)
            text = text.replace(new RegExp(`^uniform \\w+ ${name}_previous;`, 'm'), `#define ${name}_previous ${name}`);
        const previous = uniforms.filter(
            ({ name, previous_of: of }) => of && !SAME.includes(of) && !name.endsWith('_row_previous'),
        );
        const own = Object.fromEntries(previous.map(({ name }) => [name, { value: null }]));
        for (const { name } of uniforms) if (/_row(_previous)?$/.test(name)) own[name] = { value: 0 };
        for (const name of vertex.match(/\b\w+_both(?=;)/g) ?? []) own[name] = { value: null };
        if (this.#options.units === 'ndc' && !fragment.includes(SCALE))
            throw new Error('the unit of the velocity is not known');
        return {
            pass,
            blocks,
            vertex: text,
            fragment: this.#options.units === 'ndc' ? fragment.replace(SCALE, '') : fragment,
            uniforms: own,
            previous: previous.map(({ name, previous_of: of }) => ({ name, of })),
            groups: groupsOf(pass, blocks),
            state: STATE,
        };
    }

    // ---- a frame --------------------------------------------------------------------------------------------------------------------------------------------------------------

    #begin = (frame) => {
        if (!this.enabled) {
            // The next frame has no frame before it.
            this.#now = null;
            return;
        }
        this.#camera ??= frame.camera;
        if (frame.camera !== this.#camera) return;
        const { renderer } = this.#host;
        const view = new View(frame.camera);
        if (!this.#isAgain(frame, view)) {
            this.#number += this.#now ? 1 : 2;
            this.#before = this.#now ?? view;
            this.#now = view;
        }
        const size = sizeOf(renderer, frame.target);
        this.#target.setSize(size.width, size.height);
        this.#target.viewport.copy(renderer.getCurrentViewport(this.#target.viewport));
        within(renderer, this.#target, () => {
            const gl = renderer.getContext();
            renderer.state.buffers.color.setMask(true);
            gl.clearBufferfv(gl.COLOR, 0, [0, 0, 0, 0]);
            renderer.clear(false, true, false);
            const { opaque, transmissive, transparent } = frame.list;
            for (const list of [opaque, transmissive, this.#options.transparent ? transparent : []])
                for (const item of list) if (!hasCallback(item)) this.#draw(item, frame.camera);
        });
        if (this.#number % 300 === 0) this.#sweep();
    };

    /**
     * Whether a picture is of the same frame as the one before it, as where a page draws its scene twice for an effect, or takes several samples: no animation frame lies between them, and
     * nothing moved. The document's timeline stands still within an animation frame; three.js's `info.render.frame` counts each picture. A page that draws by hand, as for a video or a test, may
     * draw many frames before the timeline goes on: these differ by what moved. A worker has no timeline; there each picture is a frame.
     */
    #isAgain({ list }, view) {
        const last = this.#moment;
        this.#moment = globalThis.document?.timeline?.currentTime ?? NaN;
        if (this.#moment !== last || !this.#now?.equals(view)) return false;
        // What a callback sets for its object is not set yet.
        const own = [list.opaque, list.transmissive, list.transparent].flat().filter((item) => !hasCallback(item));
        return !own.some((item) => this.#hasMoved(item));
    }

    /** Whether an object moved since it was drawn last in this frame. */
    #hasMoved({ object, material: author }) {
        const record = this.#records.get(object)?.get(author);
        if (record?.number !== this.#number) return false;
        const { model, values } = record.now;
        if (!model.equals(object.matrixWorld) || this.#boths.haveMoved(object)) return true;
        for (const [name, value] of values) if (!isSame(value, this.#value(name, object, author))) return true;
        const groups = (author.uniformsGroups ?? []).map((group) => [group, this.#groups.get(group)]);
        return groups.some(([group, held]) => held?.number === this.#number && !isSame(held.values, valuesOf(group)));
    }

    /** What the page sets ahead of an object's draw holds for that draw alone. */
    #drawn = ({ object, geometry, material, group }, { camera }) => {
        if (!this.enabled || camera !== this.#camera || (material.transparent && !this.#options.transparent)) return;
        const item = { object, geometry, material, group };
        if (hasCallback(item) && object.material)
            within(this.#host.renderer, this.#target, () => this.#draw(item, camera));
    };

    #draw(item, camera) {
        const { object, material: author } = item;
        if (!object.isMesh) return;
        const { renderer } = this.#host;
        const record = this.#record(object, author);
        const material = this.#derivations.pick(author, object, modeOf(camera), null, this.#scene, camera);
        if (!material) return;
        const { uniforms, previous, blocks, groups } = material.preshade;
        for (const [name, value] of Object.entries(this.#boths.uniforms(object, this.#number)))
            if (uniforms[name]) uniforms[name].value = value;
        object.modelViewMatrix.multiplyMatrices(camera.matrixWorldInverse, object.matrixWorld);
        // An object has several draws in a frame: its groups may share a material, and the frame may be drawn again.
        const isFirst = record.number !== this.#number;
        if (isFirst) {
            record.isKnown = record.number === this.#number - 1;
            record.number = this.#number;
            [record.before, record.now] = [record.now, record.before];
        }
        const known = record.isKnown ? record.before : null;
        const model = known?.model ?? object.matrixWorld;
        for (const { name, of } of previous)
            uniforms[name].value =
                this.#before.of(of, model) ?? known?.values.get(of) ?? this.#value(of, object, author);
        if (groups.length > 0) this.#group(material, author, blocks, groups);
        // Has three.js set all uniforms, though the program may be that of the draw before.
        renderer.state.useProgram(null);
        drawItem(this.#host, this.#scene, camera, item, material);
        if (!isFirst) return;
        record.now.model.copy(object.matrixWorld);
        record.now.values.clear();
        for (const { of } of previous) record.now.values.set(of, this.#value(of, object, author));
    }

    /** Gives the material the groups of the author's that it has blocks for, and what they held in the frame before. */
    #group(material, author, blocks, groups) {
        const theirs = author.uniformsGroups ?? [];
        const held = groups.flatMap(({ block, of }) => {
            const group = theirs.find(({ name }) => name === of);
            return group ? [this.#held(group, block)] : [];
        });
        const own = theirs.filter(({ name }) => blocks.some(({ block }) => block === name));
        Object.defineProperty(material, 'uniformsGroups', { value: [...own, ...held], configurable: true });
    }

    #held(group, block) {
        let of = this.#groups.get(group);
        if (!of) {
            of = { number: -1, before: group.clone(), values: null };
            of.before.name = block;
            this.#groups.set(group, of);
        }
        if (of.number === this.#number) return of.before;
        const now = valuesOf(group).map(copyOf);
        const values = of.number === this.#number - 1 ? of.values : now;
        of.before.uniforms.flat().forEach((uniform, i) => (uniform.value = values[i]));
        Object.assign(of, { number: this.#number, values: now });
        return of.before;
    }

    /** What was not drawn for long is forgotten. */
    #sweep() {
        this.#boths.sweep(this.#number);
        for (const [group, { number, before }] of this.#groups) {
            if (number > this.#number - 300) continue;
            before.dispose();
            this.#groups.delete(group);
        }
    }

    #record(object, material) {
        let records = this.#records.get(object);
        if (!records) this.#records.set(object, (records = new Map()));
        let record = records.get(material);
        const values = () => ({ model: new Matrix4(), values: new Map() });
        if (!record) records.set(material, (record = { number: -1, isKnown: false, before: values(), now: values() }));
        return record;
    }

    /** A uniform's value now, as a copy. */
    #value(name, object, author) {
        if (name === 'bindMatrix' || name === 'bindMatrixInverse') return object[name].clone();
        const influences = object.morphTargetInfluences ?? [];
        if (name === 'morphTargetInfluences') return [...influences];
        if (name === 'morphTargetBaseInfluence')
            return object.geometry.morphTargetsRelative ? 1 : 1 - influences.reduce((sum, value) => sum + value, 0);
        return copyOf(this.#host.renderer.properties.get(author).uniforms?.[name]?.value ?? 0);
    }
}

/** Blocks that hold what another held in the frame before. */
function groupsOf({ bindings }, blocks) {
    const at = (group, binding) => blocks.find((block) => block.binding[0] === group && block.binding[1] === binding);
    return blocks.flatMap(({ block, binding: [group, binding] }) => {
        const { source } = bindings.find((each) => each.group === group && each.binding === binding) ?? {};
        return source?.from === 'previous' ? [{ block, of: at(source.group, source.binding)?.block ?? source.of }] : [];
    });
}

function modeOf({ view, isOrthographicCamera }) {
    if (!view?.enabled || view.width !== view.fullWidth || view.height !== view.fullHeight) return 'still';
    return isOrthographicCamera ? 'orthographic' : 'perspective';
}

/** What of a camera is in uniforms. */
class View {
    #mode;

    constructor(camera) {
        this.#mode = modeOf(camera);
        this.viewMatrix = camera.matrixWorldInverse.clone();
        this.projectionMatrix = camera.projectionMatrix.clone();
        this.cameraPosition = new Vector3().setFromMatrixPosition(camera.matrixWorld);
        this.logDepthBufFC = 2 / (Math.log(camera.far + 1) / Math.LN2);
    }

    /** The value of that name for an object at `model`, or undefined where it does not depend on the camera or the place. */
    of(name, model) {
        if (name === 'modelMatrix') return model.clone();
        if (name === 'modelViewMatrix') return new Matrix4().multiplyMatrices(this.viewMatrix, model);
        if (name === 'normalMatrix') return new Matrix3().getNormalMatrix(this.of('modelViewMatrix', model));
        return Object.hasOwn(this, name) ? this[name] : undefined;
    }

    /** Whether another shows the same, but for a shift of the picture. */
    equals(other) {
        return isSame(this.#still(), other.#still());
    }

    #still() {
        const projection = [...this.projectionMatrix.elements];
        if (this.#mode === 'perspective') projection[8] = projection[9] = 0;
        if (this.#mode === 'orthographic') projection[12] = projection[13] = 0;
        return [projection, this.viewMatrix];
    }
}

const valuesOf = (group) => group.uniforms.flat().map(({ value }) => value);

/** Whether two values of uniforms are equal. */
function isSame(a, b) {
    if (Object.is(a, b)) return true;
    if (typeof a !== 'object' || typeof b !== 'object' || a === null || b === null) return a === b;
    if (a.isTexture || b.isTexture) return false;
    if (typeof a.equals === 'function') return a.equals(b);
    return a.length === b.length && Object.keys(a).every((key) => isSame(a[key], b[key]));
}

function copyOf(value) {
    if (value === null || typeof value !== 'object' || value.isTexture) return value;
    if (Array.isArray(value)) return value.map(copyOf);
    if (ArrayBuffer.isView(value)) return value.slice();
    if (typeof value.clone === 'function') return value.clone();
    return Object.fromEntries(Object.entries(value).map(([name, each]) => [name, copyOf(each)]));
}
