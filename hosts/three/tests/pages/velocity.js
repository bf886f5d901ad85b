// Velocities against positions that the CPU computed twice: JavaScript's own displacement, bones, morphs and matrices, drawn as plain triangles.

import * as THREE from 'three';
import { Preshade } from 'preshade-three';
import { world } from './world.js';

const query = new URLSearchParams(location.search);
const SIZE = 192;
const renderer = new THREE.WebGLRenderer({ preserveDrawingBuffer: true, reversedDepthBuffer: query.has('reversed') });
renderer.setSize(SIZE, SIZE);
document.body.append(renderer.domElement);
const { scene, camera, set: setWorld, objects, materials } = world();
const box = scene.children.find(({ material }) => Array.isArray(material));
/** The box of the world has several groups of one material. */
const set = (time) => {
    setWorld(time);
    box.rotation.y = 0.5 * time;
};
const preshade = await Preshade.of(renderer, { cache: false });
const units = query.get('units') ?? 'ndc';
const velocity = preshade.velocity(scene, { units });
const prepass = query.has('prepass') ? preshade.prepass(scene) : null;

/** Where the author's vertex stages put a vertex, in the object's space. */
const DISPLACED = {
    wobbly(p, time) {
        const [x, z] = [p.x + 0.001, p.z + 0.001];
        const by = (Math.sin(time * 3 + p.y * 7) * 0.12) / Math.hypot(x, z);
        return p.set(p.x + x * by, p.y, p.z + z * by);
    },
    reed: (p, time) => p.addScaledVector(new THREE.Vector3(0.2, 0.1, 0), Math.sin(time * 2) * (p.y + 0.5)),
    waves: (p, time) => p.setZ(p.z + 0.1 * Math.sin(time * 2 + p.x * 9)),
};

/** Clip positions of all triangles as they are now: one array a mesh, in the order of the scene. */
function positions(time) {
    scene.updateMatrixWorld();
    camera.updateMatrixWorld();
    const all = [];
    const view = new THREE.Matrix4().multiplyMatrices(camera.projectionMatrix, camera.matrixWorldInverse);
    const add = (name, geometry, vertex, matrix) => {
        const toClip = new THREE.Matrix4().multiplyMatrices(view, matrix);
        const { index } = geometry;
        const values = [];
        const uv = [];
        for (let i = 0; i < (index ?? geometry.attributes.position).count; i++) {
            const n = index ? index.getX(i) : i;
            const p = vertex(n);
            if (name === 'fence') uv.push(geometry.attributes.uv.getX(n), geometry.attributes.uv.getY(n));
            const v = new THREE.Vector4(p.x, p.y, p.z, 1).applyMatrix4(toClip);
            values.push(v.x, v.y, v.z, v.w);
        }
        all.push({ name, values, uv });
    };
    scene.traverse((object) => {
        if (!object.isMesh || object.material.transparent) return;
        const { geometry, matrixWorld } = object;
        const name = [object.material].flat()[0].name;
        const at = (i) => {
            const p = new THREE.Vector3();
            // Morph targets and bones are three.js' own, on the CPU.
            if (object.isSkinnedMesh) return object.getVertexPosition(i, p);
            p.fromBufferAttribute(geometry.attributes.position, i);
            return DISPLACED[name]?.(p, time) ?? p;
        };
        const each = (i) => new THREE.Matrix4().multiplyMatrices(matrixWorld, i);
        const m = new THREE.Matrix4();
        if (object.isInstancedMesh) {
            for (let i = 0; i < object.count; i++) add(name, geometry, at, each((object.getMatrixAt(i, m), m)));
        } else if (object.isBatchedMesh) {
            for (let i = 0; i < object.instanceCount; i++) {
                const { start, count } = object.getGeometryRangeAt(object.getGeometryIdAt(i));
                const part = new THREE.BufferGeometry();
                part.setAttribute('position', geometry.attributes.position);
                part.setIndex(Array.from({ length: count }, (_, k) => geometry.index.getX(start + k)));
                add(name, part, at, each((object.getMatrixAt(i, m), m)));
            }
        } else add(name, geometry, at, matrixWorld);
    });
    return all;
}

const target = new THREE.WebGLRenderTarget(SIZE, SIZE, { type: THREE.FloatType });
const plain = new THREE.RawShaderMaterial({
    glslVersion: THREE.GLSL3,
    uniforms: { id: { value: 0 }, map: { value: null }, shift: { value: new THREE.Vector2() } },
    side: THREE.DoubleSide,
    vertexShader:
        'in vec4 now; in vec4 before; in vec2 uv; uniform vec2 shift; out vec4 a; out vec4 b; out vec2 at; void main() { a = now; b = before; at = uv; gl_Position = now + vec4(shift * now.w, 0.0, 0.0); }',
    fragmentShader:
        'precision highp float; uniform float id; uniform sampler2D map; in vec4 a; in vec4 b; in vec2 at; out vec4 color; void main() { if (texture(map, at).a < 0.5) discard; color = vec4(a.xy / a.w - b.xy / b.w, id, 1.0); }',
});
const solid = new THREE.DataTexture(new Uint8Array([255, 255, 255, 255]), 1, 1);
solid.needsUpdate = true;

/** What the velocities are by the CPU, with the number of the mesh. */
function reference(before, now, [x, y]) {
    const drawn = new THREE.Scene();
    now.forEach(({ name, values, uv }, i) => {
        const geometry = new THREE.BufferGeometry();
        geometry.setAttribute('now', new THREE.Float32BufferAttribute(values, 4));
        geometry.setAttribute('before', new THREE.Float32BufferAttribute(before[i].values, 4));
        if (uv.length > 0) geometry.setAttribute('uv', new THREE.Float32BufferAttribute(uv, 2));
        geometry.setDrawRange(0, values.length / 4);
        const material = plain.clone();
        material.uniforms.id.value = i + 1;
        material.uniforms.shift.value.set((-2 * x) / SIZE, (2 * y) / SIZE);
        material.uniforms.map.value = uv.length > 0 ? materials[name].map : solid;
        const mesh = new THREE.Mesh(geometry, material);
        mesh.frustumCulled = false;
        mesh.name = name;
        drawn.add(mesh);
    });
    const { enabled } = velocity;
    renderer.setRenderTarget(target);
    renderer.setClearColor(0, 0);
    renderer.render(drawn, new THREE.OrthographicCamera());
    renderer.setRenderTarget(null);
    velocity.enabled = enabled;
    const values = new Float32Array(SIZE * SIZE * 4);
    renderer.readRenderTargetPixels(target, 0, 0, SIZE, SIZE, values);
    return values;
}

const show = new THREE.Mesh(
    new THREE.PlaneGeometry(2, 2),
    new THREE.RawShaderMaterial({
        glslVersion: THREE.GLSL3,
        uniforms: { velocity: { value: velocity.texture } },
        vertexShader: 'in vec3 position; void main() { gl_Position = vec4(position, 1.0); }',
        fragmentShader:
            'precision highp float; uniform highp sampler2D velocity; out vec4 color; void main() { color = vec4(texelFetch(velocity, ivec2(gl_FragCoord.xy), 0).xy, 0.0, 1.0); }',
        depthTest: false,
        depthWrite: false,
    }),
);
show.frustumCulled = false;

/** The velocities' texture, as floats. */
function drawn() {
    renderer.setRenderTarget(target);
    renderer.render(show, new THREE.OrthographicCamera());
    renderer.setRenderTarget(null);
    const values = new Float32Array(SIZE * SIZE * 4);
    renderer.readRenderTargetPixels(target, 0, 0, SIZE, SIZE, values);
    return values;
}

const next = () => {
    const gl = renderer.getContext();
    gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(4));
    return new Promise((resolve) => requestAnimationFrame(resolve));
};

async function settle(shift = null) {
    for (let i = 0; i < 400; i++) {
        if (shift) camera.setViewOffset(SIZE, SIZE, ...shift, SIZE, SIZE);
        renderer.render(scene, camera);
        camera.clearViewOffset();
        await next();
        await velocity.settled();
        const mode = shift ? 'perspective' : 'still';
        const rows = preshade.report().filter((row) => row.pass === 'velocity' && row.mode === mode);
        const open =
            new Set(rows.map(({ uuid }) => uuid)).size < 10 ||
            rows.some(({ state }) => state === 'pending' || state === 'waiting');
        if (rows.some(({ state }) => state === 'failed')) break;
        if (i > 3 && !open && (prepass === null || prepass.isSettled)) return i;
    }
    throw new Error(JSON.stringify(preshade.report(), null, 1));
}

/**
 * The largest difference in pixels beyond half a half float's step, by material, over pixels whose neighbours show the same mesh. `shifts`: of the projection, in
 * pixels, or null: for each time that the frame is drawn. `apart`: whether an animation frame lies between the two; without, only what moves tells them apart.
 */
async function compare(first, second, { shifts = [[null], [null]], apart = true } = {}) {
    const frame = (time, shifts) => {
        set(time);
        const of = positions(time);
        for (const shift of shifts) {
            if (shift) camera.setViewOffset(SIZE, SIZE, ...shift, SIZE, SIZE);
            renderer.render(scene, camera);
            camera.clearViewOffset();
        }
        return of;
    };
    await next();
    const before = frame(first, shifts[0]);
    if (apart) await next();
    const now = frame(second, shifts[1]);
    const [ours, theirs] = [drawn(), reference(before, now, shifts[1].at(-1) ?? [0, 0])];
    const found = {};
    for (let y = 1; y < SIZE - 1; y++) {
        for (let x = 1; x < SIZE - 1; x++) {
            const i = 4 * (y * SIZE + x);
            const id = theirs[i + 2];
            let inside = id > 0;
            for (let dy = -1; dy <= 1; dy++)
                for (let dx = -1; dx <= 1; dx++) inside &&= theirs[i + 2 + 4 * (dy * SIZE + dx)] === id;
            if (!inside) continue;
            const { name } = now[id - 1];
            const of = (found[name] ??= { pixels: 0, off: 0, most: 0, largest: 0 });
            of.pixels++;
            const scale = units === 'ndc' ? [1, 1] : [0.5, -0.5];
            for (let c = 0; c < 2; c++) {
                const want = theirs[i + c] * scale[c];
                // A half float has 11 significant bits.
                const rounding = Math.abs(want) * 2 ** -11 + 2 ** -25;
                const pixels = (Math.max(0, Math.abs(ours[i + c] - want) - rounding) * SIZE) / 2 / Math.abs(scale[c]);
                of.most = Math.max(of.most, pixels);
                of.largest = Math.max(of.largest, (Math.abs(theirs[i + c]) * SIZE) / 2);
                if (pixels > 1 / 256) of.off++;
            }
        }
    }
    return found;
}

/** The largest velocity in the first frame after a pause. */
async function resumed() {
    velocity.enabled = false;
    set(0.2);
    renderer.render(scene, camera);
    await next();
    velocity.enabled = true;
    set(0.8);
    renderer.render(scene, camera);
    return drawn().reduce((most, value, i) => (i % 4 < 2 ? Math.max(most, Math.abs(value)) : most), 0);
}

/** The largest velocities of two pictures of a frame in which a callback moves an object. */
async function twice() {
    const material = new THREE.ShaderMaterial({
        uniforms: { shift: { value: 0 } },
        vertexShader:
            'uniform float shift; void main() { gl_Position = projectionMatrix * modelViewMatrix * vec4(position + vec3(shift, 0.0, 0.0), 1.0); }',
        fragmentShader: 'void main() { gl_FragColor = vec4(1.0); }',
    });
    const own = new THREE.Scene();
    const shifts = [0, 0];
    for (const i of [0, 1]) {
        const mesh = new THREE.Mesh(new THREE.PlaneGeometry(1, 1), material);
        mesh.position.y = i;
        mesh.frustumCulled = false;
        mesh.onBeforeRender = () => {
            material.uniforms.shift.value = shifts[i];
            material.uniformsNeedUpdate = true;
        };
        own.add(mesh);
    }
    const its = preshade.velocity(own);
    const most = () => {
        show.material.uniforms.velocity.value = its.texture;
        const largest = drawn().reduce((most, value, i) => (i % 4 < 2 ? Math.max(most, Math.abs(value)) : most), 0);
        show.material.uniforms.velocity.value = velocity.texture;
        return largest;
    };
    // A few more: what is ready is drawn in the frame behind.
    for (let i = 0, more = 4; i < 100 && more > 0; i++) {
        renderer.render(own, camera);
        await next();
        await preshade.settled();
        if (its.report().some(({ state }) => state === 'done')) more--;
    }
    shifts[0] += 0.2;
    shifts[1] += 0.3;
    const pictures = [0, 1].map(() => {
        renderer.render(own, camera);
        return most();
    });
    its.dispose();
    return pictures;
}

Object.assign(globalThis, {
    THREE,
    renderer,
    scene,
    camera,
    velocity,
    preshade,
    settle,
    compare,
    set,
    objects,
    resumed,
    twice,
});
globalThis.ready = true;
