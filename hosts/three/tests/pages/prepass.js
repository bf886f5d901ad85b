// The frames of a page with and without a pre-pass. `?perturb=4e-7` has the pre-pass's positions off by so much.

import * as THREE from 'three';
import { EffectComposer } from 'three/addons/postprocessing/EffectComposer.js';
import { Reflector } from 'three/addons/objects/Reflector.js';
import { OutputPass } from 'three/addons/postprocessing/OutputPass.js';
import { RenderPass } from 'three/addons/postprocessing/RenderPass.js';
import { Preshade } from 'preshade-three';
import { world } from './world.js';

const query = new URLSearchParams(location.search);
const perturb = query.get('perturb');
const SIZE = 192;
const renderer = new THREE.WebGLRenderer({
    preserveDrawingBuffer: true,
    antialias: query.has('antialias'),
    reversedDepthBuffer: query.has('reversed'),
    logarithmicDepthBuffer: query.has('logarithmic'),
    // Then three.js draws into a target of its own, which `setEffects` has passes for.
    outputBufferType: query.has('effects') ? THREE.HalfFloatType : THREE.UnsignedByteType,
});
renderer.setSize(SIZE, SIZE);
renderer.shadowMap.enabled = true;
renderer.toneMapping = THREE.ACESFilmicToneMapping;
document.body.append(renderer.domElement);
const { scene, camera, materials, set, sun } = world();
const preshade = await Preshade.of(renderer, { cache: false, marks: query.has('marks') });
/** The passes that are off: by default the pre-pass. */
const roles = query.get('roles')?.split(' ') ?? ['prepass'];
const edit = (text, role, stage) =>
    perturb && roles.includes(role) && stage === 'vertex'
        ? text.replace(/^\s*gl_Position = ([^;]+);/m, `gl_Position = $1; gl_Position.z += ${perturb} * gl_Position.w;`)
        : text;
const form = query.get('form') ?? 'equal';
/** The materials that have a pre-pass: all, or those of these names. */
let only = null;
const prepass = preshade.prepass(scene, {
    form,
    edit,
    materials: (material) => only === null || only.includes(material.name),
});

const gl = renderer.getContext();
const target = (options) => new THREE.WebGLRenderTarget(SIZE, SIZE, options);
const targets = {
    half: target({ type: THREE.HalfFloatType }),
    samples: target({ samples: 4 }),
    'half samples': target({ type: THREE.HalfFloatType, samples: 4 }),
    'float depth': target({ depthTexture: new THREE.DepthTexture(SIZE, SIZE, THREE.FloatType) }),
};
const composer = new EffectComposer(renderer);
composer.addPass(new RenderPass(scene, camera));
composer.addPass(new OutputPass());
const second = camera.clone();
if (query.get('effects') === 'pass') renderer.setEffects([new RenderPass(scene, camera)]);

/** Ways in which pages draw. Each leaves its picture in the canvas, or in the target that it gives back. */
const WAYS = {
    canvas: () => renderer.render(scene, camera),
    composer: () => composer.render(),
    'two views': () => {
        renderer.setScissorTest(true);
        second.position.set(2.5, 1, 4);
        second.lookAt(0, 0, -1);
        for (const [i, of] of [camera, second].entries()) {
            renderer.setViewport((i * SIZE) / 2, 0, SIZE / 2, SIZE);
            renderer.setScissor((i * SIZE) / 2, 0, SIZE / 2, SIZE);
            renderer.render(scene, of);
        }
        renderer.setScissorTest(false);
        renderer.setViewport(0, 0, SIZE, SIZE);
    },
    'no autoClear': () => {
        renderer.autoClear = false;
        renderer.setClearColor('#552200');
        const { background } = scene;
        scene.background = null;
        renderer.clear();
        renderer.render(scene, camera);
        renderer.clearDepth();
        renderer.render(scene, second);
        scene.background = background;
        renderer.setClearColor('#000000');
        renderer.autoClear = true;
    },
    ...Object.fromEntries(
        Object.entries(targets).map(([name, target]) => [
            name,
            () => {
                renderer.setRenderTarget(target);
                renderer.render(scene, camera);
                renderer.setRenderTarget(null);
                return target;
            },
        ]),
    ),
};

function read(target) {
    if (!target) {
        const bytes = new Uint8Array(SIZE * SIZE * 4);
        renderer.setRenderTarget(null);
        gl.readPixels(0, 0, SIZE, SIZE, gl.RGBA, gl.UNSIGNED_BYTE, bytes);
        return bytes;
    }
    const half = target.texture.type === THREE.HalfFloatType;
    const values = half ? new Uint16Array(SIZE * SIZE * 4) : new Uint8Array(SIZE * SIZE * 4);
    renderer.readRenderTargetPixels(target, 0, 0, SIZE, SIZE, values);
    return values;
}

/** The next frame, no sooner than the GPU is done with this one. */
const next = () => {
    gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(4));
    return new Promise((resolve) => requestAnimationFrame(resolve));
};

/** Draws until nothing is made or tested any more. */
async function settle(way) {
    for (let i = 0; i < 1000; i++) {
        WAYS[way]();
        await next();
        await preshade.settled();
        if (i > 3 && prepass.isSettled) return i;
    }
    throw new Error(`${way}: ${JSON.stringify(preshade.report(), null, 1)}`);
}

/** Pixels that differ, of those that are not of the background, and draws of the frame. */
function compare(way, time) {
    set(time);
    const draw = (on) => {
        prepass.enabled = on;
        const calls = renderer.info.render.calls;
        renderer.info.autoReset = false;
        renderer.info.reset();
        const values = read(WAYS[way]());
        const draws = renderer.info.render.calls;
        renderer.info.autoReset = true;
        void calls;
        return { values, draws };
    };
    draw(true);
    const [without, withIt, again] = [draw(false), draw(true), draw(false)];
    prepass.enabled = true;
    let [off, most, unstable, colours] = [0, 0, 0, new Set()];
    for (let i = 0; i < without.values.length; i += 4) {
        let by = 0;
        for (let c = 0; c < 4; c++) by = Math.max(by, Math.abs(without.values[i + c] - withIt.values[i + c]));
        if (by > 0) off++;
        most = Math.max(most, by);
        if (without.values[i] !== again.values[i]) unstable++;
        colours.add(without.values[i] * 65536 + without.values[i + 1] * 256 + without.values[i + 2]);
    }
    return { off, most, unstable, colours: colours.size, more: withIt.draws - without.draws };
}

/** What pages do to their scenes. Each gives back what undoes it. */
const CHANGES = {
    'one light more': () => {
        const lamp = new THREE.PointLight('#ff8844', 6);
        lamp.position.set(-1, 1, 2);
        scene.add(lamp);
        return () => scene.remove(lamp);
    },
    fog: () => {
        scene.fog = new THREE.Fog('#223344', 3, 9);
        return () => (scene.fog = null);
    },
    'another tone mapping': () => {
        renderer.toneMapping = THREE.NeutralToneMapping;
        return () => (renderer.toneMapping = THREE.ACESFilmicToneMapping);
    },
    'one map more': () => {
        materials.phong.map = materials.wobbly.map;
        materials.phong.needsUpdate = true;
        return () => {
            materials.phong.map = null;
            materials.phong.needsUpdate = true;
        };
    },
    'other values': () => {
        materials.phong.color.set('#ff3355');
        materials.waves.uniforms.tint.value.set('#ffffff');
        materials.fence.alphaTest = 0.8;
        return () => (materials.fence.alphaTest = 0.5);
    },
    'another displacement': () => {
        const { onBeforeCompile } = materials.wobbly;
        materials.wobbly.onBeforeCompile = (shader) => {
            onBeforeCompile(shader);
            shader.vertexShader = shader.vertexShader.replace('* 0.12;', '* 0.3;');
        };
        materials.wobbly.customProgramCacheKey = () => 'more';
        materials.wobbly.needsUpdate = true;
        return () => {};
    },
    'another side': () => {
        materials.phong.side = THREE.BackSide;
        return () => (materials.phong.side = THREE.FrontSide);
    },
    transparent: () => {
        materials.many.transparent = true;
        materials.many.opacity = 0.5;
        return () => (materials.many.transparent = false);
    },
    'clipping planes': () => {
        renderer.localClippingEnabled = true;
        materials.wobbly.clippingPlanes = [new THREE.Plane(new THREE.Vector3(0, 1, 0), 0.1)];
        materials.phong.clippingPlanes = [new THREE.Plane(new THREE.Vector3(1, 0, 0), 1.4)];
        return () => {
            materials.wobbly.clippingPlanes = materials.phong.clippingPlanes = null;
            renderer.localClippingEnabled = false;
        };
    },
    'transmissive glass': () => {
        const mesh = new THREE.Mesh(
            new THREE.SphereGeometry(0.6, 24, 16),
            new THREE.MeshPhysicalMaterial({ transmission: 1, thickness: 0.5, roughness: 0.1 }),
        );
        mesh.position.set(0.6, 0.3, 2);
        scene.add(mesh);
        return () => scene.remove(mesh);
    },
    'a mirror': () => {
        const mirror = new Reflector(new THREE.PlaneGeometry(2, 2), { textureWidth: 128, textureHeight: 128 });
        mirror.position.set(-1.6, 0.4, -1);
        mirror.rotation.y = 0.5;
        scene.add(mirror);
        return () => scene.remove(mirror);
    },
    'a callback': () => {
        const mesh = scene.children.find(({ material }) => material === materials.waves);
        mesh.onBeforeRender = () => {
            materials.waves.uniforms.time.value = 0.33;
            materials.waves.uniformsNeedUpdate = true;
        };
        return () => delete mesh.onBeforeRender;
    },
    'depth cleared in the middle of a frame': () => {
        const mesh = scene.children.find(({ material }) => material === materials.lit);
        mesh.onBeforeRender = () => renderer.clearDepth();
        return () => delete mesh.onBeforeRender;
    },
    'another scene drawn over it in the middle': () => {
        const mesh = scene.children.find(({ material }) => material === materials.lit);
        const other = new THREE.Scene();
        mesh.onBeforeRender = () => {
            renderer.autoClearColor = false;
            renderer.render(other, camera);
            renderer.autoClearColor = true;
        };
        return () => delete mesh.onBeforeRender;
    },
    'two surfaces at one depth': () => {
        const pair = ['#ff2222', '#22ff22'].map((color, i) => {
            const material = new THREE.MeshBasicMaterial({ name: `tie ${i}`, color, depthFunc: THREE.LessDepth });
            const mesh = new THREE.Mesh(new THREE.PlaneGeometry(0.8, 0.8), material);
            mesh.position.set(0.2, -0.9, 2);
            // Of the two the first is seen.
            mesh.renderOrder = i;
            return mesh;
        });
        scene.add(...pair);
        return () => scene.remove(...pair);
    },
    'a picture as background': () => {
        const { background } = scene;
        scene.background = materials.wobbly.map;
        return () => (scene.background = background);
    },
    'one material for all': () => {
        scene.overrideMaterial = new THREE.MeshNormalMaterial();
        return () => (scene.overrideMaterial = null);
    },
    'a stencil': () => {
        materials.lit.stencilWrite = true;
        return () => (materials.lit.stencilWrite = false);
    },
    'objects gone and new': () => {
        const [first] = scene.children.filter(({ material }) => material === materials.wobbly);
        scene.remove(first);
        const mesh = new THREE.Mesh(new THREE.IcosahedronGeometry(0.6, 2), materials.many);
        mesh.position.set(0, 1.4, 1);
        scene.add(mesh);
        return () => {};
    },
};

/** The first frame after a change, drawn with what was made before it, and the same by three.js alone. */
function firstAfter(change, way) {
    const undo = CHANGES[change]();
    const values = read(WAYS[way]());
    prepass.enabled = false;
    const plain = read(WAYS[way]());
    prepass.enabled = true;
    let off = 0;
    for (let i = 0; i < plain.length; i += 4) if ([0, 1, 2, 3].some((c) => plain[i + c] !== values[i + c])) off++;
    globalThis.undo = undo;
    return off;
}

/** Loses the context, and has it restored. */
async function lose() {
    const extension = gl.getExtension('WEBGL_lose_context');
    const event = (name) =>
        new Promise((resolve) => renderer.domElement.addEventListener(name, resolve, { once: true }));
    const lost = event('webglcontextlost');
    extension.loseContext();
    await lost;
    const restored = event('webglcontextrestored');
    setTimeout(() => extension.restoreContext(), 50);
    await restored;
}

Object.assign(globalThis, {
    CHANGES,
    firstAfter,
    lose,
    THREE,
    renderer,
    scene,
    camera,
    materials,
    sun,
    prepass,
    preshade,
    settle,
    compare,
    set,
    WAYS,
    next,
    only: (names) => (only = names),
});
globalThis.ready = true;
