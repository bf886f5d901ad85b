// Velocities of an object of which every point moves by the same known amount, or not at all: three.js' and preshade's.

import * as THREE from 'three/webgpu';
import {
    cameraProjectionMatrix,
    modelViewMatrix,
    mrt,
    normalLocal,
    output,
    positionGeometry,
    positionLocal,
    sin,
    uniform,
    vec3,
    vec4,
    velocity as threes,
} from 'three/tsl';
import { Preshade } from 'preshade-three';
import { MATERIALS, OBJECTS, SIZE, frame, renderer as make } from './kit.js';

const renderer = await make();
const preshade = await Preshade.of(renderer, { cache: false });
/** In world space; the camera is 4 wide, so in clip space it is half as much. */
const STEP = 0.25;
const shift = uniform(0);
const bump = positionLocal.add(normalLocal.mul(sin(positionLocal.y.mul(6)).mul(0.2)));

/** Materials of this page; `shift` moves the vertices of some. */
const OWN = {
    transparent: () => new THREE.MeshBasicNodeMaterial({ transparent: true, opacity: 0.5, side: THREE.DoubleSide }),
    positionNode: () => new THREE.MeshBasicNodeMaterial({ positionNode: bump.add(vec3(shift, 0, 0)) }),
    vertexNode: () =>
        new THREE.MeshBasicNodeMaterial({
            vertexNode: cameraProjectionMatrix
                .mul(modelViewMatrix)
                .mul(vec4(positionGeometry.add(vec3(shift, 0, 0)), 1)),
        }),
};

/** What moves an object by STEP in x, or nothing. */
const MOTIONS = {
    none() {},
    object: (mesh) => (mesh.position.x += STEP),
    up: (mesh) => (mesh.position.y += STEP),
    camera: (_, camera) => (camera.position.x -= STEP),
    shift: () => (shift.value += STEP),
    instance(mesh) {
        const matrix = new THREE.Matrix4();
        for (let i = 0; i < 3; i++) {
            mesh.getMatrixAt(i, matrix);
            matrix.elements[12] += STEP;
            mesh.setMatrixAt(i, matrix);
        }
        if (mesh.instanceMatrix) mesh.instanceMatrix.needsUpdate = true;
    },
    bone: (mesh) => (mesh.skeleton.bones[0].position.x += STEP),
    morph(mesh) {
        mesh.morphTargetInfluences[0] += STEP;
    },
};

/** What leaves an object out of the velocities of some frames, or no longer. */
const AWAY = {
    hidden: (mesh, _, isAway) => (mesh.visible = !isAway),
    off: (_, velocity, isAway) => (velocity.enabled = !isAway),
};

async function read(target, index = 0) {
    const half = await renderer.readRenderTargetPixelsAsync(target, 0, 0, SIZE, SIZE, index);
    return Float32Array.from(half, THREE.DataUtils.fromHalfFloat);
}

/** Pixels whose velocity is not that. `covered`: those that the object covers, by their index. */
function wrong(of, channels, covered, [right, up]) {
    let count = 0;
    for (const i of covered) {
        const [x, y] = [of[channels * i], of[channels * i + 1]];
        if (Math.abs(x - right) > 1e-4 || Math.abs(y - up) > 1e-4) count++;
    }
    return count;
}

globalThis.compare = async ({ material = 'plain', object = 'mesh', motion = 'none', again = 1, away, ...options }) => {
    shift.value = 0;
    const scene = new THREE.Scene();
    const camera = new THREE.OrthographicCamera(-2, 2, 2, -2, 0.1, 20);
    camera.position.z = 8;
    scene.add(new THREE.DirectionalLight());
    const of = (OWN[material] ?? MATERIALS[material])();
    const mesh = OBJECTS[object](of);
    if (object === 'morphed') {
        const moved = mesh.geometry.attributes.position.clone();
        for (let i = 0; i < moved.count; i++) moved.setX(i, moved.getX(i) + 1);
        mesh.geometry.morphAttributes.position = [moved];
        mesh.morphTargetInfluences = [0.3];
    }
    mesh.frustumCulled = false;
    scene.add(mesh);
    const box = new THREE.BoxGeometry();
    const others = [
        new THREE.Mesh(box, new THREE.MeshBasicNodeMaterial({ name: 'glass', transparent: true })),
        new THREE.Points(box, new THREE.PointsNodeMaterial({ name: 'points' })),
    ];
    // Out of the picture.
    for (const other of others) other.position.x = 100;
    scene.add(...others);
    const target = new THREE.RenderTarget(SIZE, SIZE, { count: 2, type: THREE.HalfFloatType });
    [target.textures[0].name, target.textures[1].name] = ['output', 'velocity'];
    const velocity = preshade.velocity(scene, options);
    const draw = async (count) => {
        await frame();
        renderer.setRenderTarget(target);
        renderer.setMRT(mrt({ output, velocity: threes }));
        for (let i = 0; i < count; i++) renderer.render(scene, camera);
        renderer.setMRT(null);
        renderer.setRenderTarget(null);
        await preshade.settled();
    };
    for (let i = 0; i < 5; i++) await draw(1);
    if (away) {
        AWAY[away](mesh, velocity, true);
        for (let i = 0; i < 2; i++) {
            mesh.position.x += STEP;
            await draw(1);
        }
        AWAY[away](mesh, velocity, false);
    }
    MOTIONS[motion](mesh, camera);
    await draw(again);
    // Each frame is compared with the last picture of the one before.
    if (again > 1) {
        MOTIONS[motion](mesh, camera);
        await draw(again);
    }
    const picture = await read(target, 0);
    const covered = Array.from({ length: SIZE * SIZE }, (_, i) => i).filter((i) => picture[4 * i + 3] > 0);
    const theirs = await read(target, 1);
    const ours = await velocity.pixels();
    const step = motion === 'none' ? 0 : STEP / 2;
    const expected = motion === 'up' ? [0, step] : [step, 0];
    const scale = options.units === 'picture' ? [0.5, -0.5] : [1, 1];
    const all = preshade.report();
    const rows = all.filter(({ uuid }) => uuid === of.uuid);
    const left = others.map(({ material }) => all.find(({ uuid }) => uuid === material.uuid)?.code);
    velocity.dispose();
    target.dispose();
    mesh.geometry.dispose();
    of.dispose();
    return {
        covered: covered.length,
        three: wrong(theirs, 4, covered, expected),
        ours: wrong(
            ours,
            2,
            covered,
            expected.map((value, i) => value * scale[i]),
        ),
        rows,
        left,
    };
};
globalThis.materials = Object.keys(MATERIALS);
globalThis.ready = true;
