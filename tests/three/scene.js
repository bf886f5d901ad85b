// What the page draws: a ruined temple. Its materials are as people write them, and know nothing of preshade.

import {
    BoxGeometry,
    Color,
    CylinderGeometry,
    DirectionalLight,
    DoubleSide,
    FogExp2,
    HemisphereLight,
    LatheGeometry,
    Matrix4,
    Mesh,
    MeshStandardMaterial,
    PerspectiveCamera,
    PlaneGeometry,
    PointLight,
    Quaternion,
    RawShaderMaterial,
    RingGeometry,
    Scene,
    ShaderMaterial,
    SphereGeometry,
    TorusGeometry,
    TorusKnotGeometry,
    Uniform,
    UniformsGroup,
    Vector2,
    Vector3,
    GLSL3,
} from 'three';
import { mergeGeometries } from 'three/addons/utils/BufferGeometryUtils.js';
import { random, textures } from './textures.js';

const SUN = { azimuth: 0.95, elevation: 0.62 };
const FOG = { color: new Color(0x9db4c9), density: 0.017 };

async function text(name) {
    return (await fetch(new URL(`shaders/${name}`, import.meta.url))).text();
}

/** A uniform block of three.js's, with its uniforms by name. */
function group(name, values) {
    const made = new UniformsGroup().setName(name);
    made.named = Object.fromEntries(Object.entries(values).map(([key, value]) => [key, new Uniform(value)]));
    for (const uniform of Object.values(made.named)) made.add(uniform);
    return made;
}

async function materials() {
    const map = textures();
    const [hex, stoneVertex, stoneFragment, leafVertex, leafFragment] = await Promise.all(
        ['hex.glsl', 'stone.vert', 'stone.frag', 'leaf.vert', 'leaf.frag'].map(text),
    );
    const common = {
        azimuth: { value: SUN.azimuth },
        elevation: { value: SUN.elevation },
        skyColor: { value: new Color(0x7d9cc4).multiplyScalar(0.75) },
        groundColor: { value: new Color(0x5b5140).multiplyScalar(0.6) },
        fogColor: { value: FOG.color },
        fogDensity: { value: FOG.density },
    };
    const stone = new ShaderMaterial({
        name: 'stone',
        vertexShader: stoneVertex,
        fragmentShader: stoneFragment.replace('#include <hex>', hex),
        uniforms: {
            ...common,
            stoneMap: { value: map.stone },
            reliefMap: { value: map.relief },
            mossMap: { value: map.moss },
            stoneScale: { value: 0.37 },
            mossScale: { value: 0.61 },
            mossAmount: { value: 0.02 },
            turbidity: { value: 1.4 },
        },
    });
    const leaf = new RawShaderMaterial({
        name: 'leaf',
        glslVersion: GLSL3,
        vertexShader: leafVertex,
        fragmentShader: leafFragment.replace('#include <hex>', hex),
        side: DoubleSide,
        uniforms: {
            ...common,
            leafMap: { value: map.leaf },
            veinMap: { value: map.vein },
            cutoff: { value: 0.5 },
        },
    });
    leaf.uniformsGroups = [
        group('Weather', { time: 0, wind: 0.06 }),
        group('Air', { fogColor: FOG.color, fogDensity: FOG.density }),
    ];
    // The seamless tiling put into three.js's own material, by the hook that there is for it.
    const bronze = new MeshStandardMaterial({ name: 'bronze', map: map.bronze, metalness: 0.75, roughness: 0.42 });
    bronze.onBeforeCompile = (shader) => {
        shader.fragmentShader = shader.fragmentShader
            .replace('#include <map_pars_fragment>', `#include <map_pars_fragment>\n${hex}`)
            .replace(
                '#include <map_fragment>',
                `vec2 mapDx = dFdx( vMapUv );
                vec2 mapDy = dFdy( vMapUv );
                vec4 tiled = hexTile( map, vMapUv, mapDx, mapDy, 6.0 );
                diffuseColor *= tiled;`,
            )
            .replace(
                '#include <roughnessmap_fragment>',
                `float roughnessFactor = roughness + 0.4 * ( 1.0 - tiled.r );`,
            );
    };
    const glass = new MeshStandardMaterial({
        name: 'glass',
        color: 0x66d9ff,
        emissive: 0x0b5a7a,
        roughness: 0.08,
        transparent: true,
        opacity: 0.38,
        depthWrite: false,
    });
    const water = new MeshStandardMaterial({
        name: 'water',
        color: 0x16404a,
        roughness: 0.05,
        transparent: true,
        opacity: 0.5,
        depthWrite: false,
    });
    return { stone, leaf, bronze, glass, water };
}

/** Many parts as one mesh, as a level's buildings are: three.js cannot sort what is within. */
class Parts {
    #geometries = [];

    add(geometry, { at = [0, 0, 0], turn = 0, tilt = 0, scale = [1, 1, 1] } = {}) {
        const rotation = new Quaternion()
            .setFromAxisAngle(new Vector3(0, 1, 0), turn)
            .multiply(new Quaternion().setFromAxisAngle(new Vector3(1, 0, 0), tilt));
        const matrix = new Matrix4().compose(new Vector3(...at), rotation, new Vector3(...scale));
        this.#geometries.push(geometry.clone().applyMatrix4(matrix));
        return this;
    }

    mesh(material) {
        return new Mesh(mergeGeometries(this.#geometries), material);
    }
}

function ground() {
    const made = new PlaneGeometry(90, 90, 120, 120).rotateX(-Math.PI / 2);
    const position = made.getAttribute('position');
    for (let i = 0; i < position.count; i++) {
        const [x, z] = [position.getX(i), position.getZ(i)];
        const far = Math.max(Math.hypot(x, z) - 19, 0);
        const hills = Math.sin(x * 0.21 + 1.3) * Math.cos(z * 0.17) + 0.6 * Math.sin(x * 0.43 - z * 0.39);
        position.setY(i, far * 0.12 + 0.09 * far * hills - 0.02);
    }
    made.computeVertexNormals();
    return made;
}

/** A ring of columns, with an arch from each to the next where both stand. */
function ring(parts, { radius, count, height, thick, next }) {
    const shaft = new CylinderGeometry(thick * 0.82, thick, 1, 20, 14, true);
    const block = new BoxGeometry(1, 1, 1, 4, 2, 4);
    const span = 2 * radius * Math.sin(Math.PI / count);
    const arch = new TorusGeometry(span / 2, thick * 0.55, 10, 22, Math.PI);
    const stands = Array.from({ length: count }, () => next() > 0.16);
    for (let i = 0; i < count; i++) {
        const angle = (i / count) * Math.PI * 2;
        const at = (y, a = angle, r = radius) => [Math.sin(a) * r, y, Math.cos(a) * r];
        const tall = stands[i] ? height : height * (0.25 + 0.4 * next());
        parts.add(shaft, { at: at(tall / 2), scale: [1, tall, 1], turn: next() * 6 });
        parts.add(block, { at: at(thick * 0.35), turn: angle, scale: [thick * 2.6, thick * 0.7, thick * 2.6] });
        if (!stands[i]) continue;
        parts.add(block, { at: at(height), turn: angle, scale: [thick * 2.5, thick * 0.6, thick * 2.5] });
        if (stands[(i + 1) % count]) {
            const middle = angle + Math.PI / count;
            const inner = radius * Math.cos(Math.PI / count);
            parts.add(arch, { at: at(height + thick * 0.2, middle, inner), turn: middle });
        }
    }
}

/** A card that bends, with its own normals: what leaves are drawn on. */
function card(width, height) {
    const made = new PlaneGeometry(width, height, 4, 8);
    const position = made.getAttribute('position');
    for (let i = 0; i < position.count; i++) position.setZ(i, 0.16 * Math.cos((position.getX(i) / width) * Math.PI));
    const uv = made.getAttribute('uv');
    for (let i = 0; i < uv.count; i++) uv.setXY(i, (uv.getX(i) * width) / 2.7, (uv.getY(i) * height) / 2.7);
    made.translate(0, height / 2, 0).computeVertexNormals();
    return made;
}

function temple({ stone, leaf, bronze, glass, water }) {
    const next = random(2026);
    const scene = new Scene();
    const rings = [
        { radius: 6.2, count: 10, height: 3.6, thick: 0.36 },
        { radius: 10.5, count: 16, height: 4.8, thick: 0.44 },
        { radius: 15.5, count: 22, height: 6.2, thick: 0.56 },
        { radius: 21, count: 26, height: 7.5, thick: 0.66 },
    ];
    // The far ones first, as levels happen to be ordered.
    for (const of of [...rings].reverse()) {
        const parts = new Parts();
        ring(parts, { ...of, next });
        scene.add(parts.mesh(stone));
    }
    const steps = new Parts();
    for (let i = 0; i < 4; i++) {
        const [top, height] = [3.9 - i * 0.62, 0.34];
        const side = new CylinderGeometry(top, top + 0.15, height, 72, 3, true);
        const cover = new RingGeometry(0, top, 72, 10).rotateX(-Math.PI / 2);
        steps.add(side, { at: [0, (i + 0.5) * height, 0] }).add(cover, { at: [0, (i + 1) * height, 0] });
    }
    for (let i = 0; i < 34; i++) {
        const size = 0.2 + next() * 0.45;
        const [angle, radius] = [next() * Math.PI * 2, 5 + next() * 16];
        steps.add(new BoxGeometry(1, 1, 1, 3, 3, 3), {
            at: [Math.sin(angle) * radius, size * 0.3, Math.cos(angle) * radius],
            turn: next() * 6,
            tilt: next() * 0.7,
            scale: [size * 1.7, size, size * 1.1],
        });
    }
    scene.add(steps.mesh(stone), new Mesh(ground(), stone));

    const ivy = new Parts();
    const leaves = card(1.25, 2.7);
    for (const { radius, count, thick, height } of rings) {
        for (let i = 0; i < count; i++) {
            if (next() < 0.38) continue;
            const angle = (i / count) * Math.PI * 2;
            const face = angle + (next() - 0.5) * 2.4;
            const out = thick + 0.03;
            const at = [
                Math.sin(angle) * radius + Math.sin(face) * out,
                next() * height * 0.3,
                Math.cos(angle) * radius + Math.cos(face) * out,
            ];
            ivy.add(leaves, { at, turn: face, scale: [1, 0.8 + next() * 0.5, 1] });
        }
    }
    const bush = card(1.7, 1.1);
    for (let i = 0; i < 60; i++) {
        const [angle, radius] = [next() * Math.PI * 2, 4.6 + next() * 12];
        const at = [Math.sin(angle) * radius, -0.05, Math.cos(angle) * radius];
        const turn = next() * 6;
        ivy.add(bush, { at, turn }).add(bush, { at, turn: turn + Math.PI / 2 });
    }
    scene.add(ivy.mesh(leaf));

    const knot = new Mesh(new TorusKnotGeometry(0.78, 0.25, 180, 24, 2, 3), bronze);
    knot.position.set(0, 2.75, 0);
    scene.add(knot);
    const profile = [
        [0.02, 0.8],
        [0.14, 0.76],
        [0.24, 0.6],
        [0.3, 0.3],
        [0.46, 0.06],
        [0.5, 0],
        [0.44, 0.02],
    ].map(([x, y]) => new Vector2(x, y));
    const metal = new Parts();
    const bell = new LatheGeometry(profile, 28);
    const bowl = new SphereGeometry(0.62, 32, 16, 0, Math.PI * 2, Math.PI / 2, Math.PI / 2);
    const rim = new TorusGeometry(0.62, 0.07, 10, 40);
    for (const { radius, count, height } of rings) {
        for (let i = 0; i < count; i++) {
            const angle = ((i + 0.5) / count) * Math.PI * 2;
            const at = (y, r) => [Math.sin(angle) * r, y, Math.cos(angle) * r];
            if (i % 2 === 0) metal.add(bell, { at: at(height * 0.82, radius), turn: angle });
            else metal.add(bowl, { at: at(0.95, radius) }).add(rim, { at: at(0.95, radius), tilt: Math.PI / 2 });
        }
    }
    scene.add(metal.mesh(bronze));

    const portal = new Mesh(new SphereGeometry(1.55, 48, 24), glass);
    portal.position.set(2.5, 2.1, 7.4);
    const pool = new Mesh(new PlaneGeometry(30, 30).rotateX(-Math.PI / 2), water);
    pool.position.set(0, 0.12, 0);
    scene.add(portal, pool);

    const sun = new DirectionalLight(0xfff0d8, 3.2);
    const across = Math.cos(SUN.elevation);
    sun.position.set(across * Math.sin(SUN.azimuth), Math.sin(SUN.elevation), across * Math.cos(SUN.azimuth));
    const lamp = new PointLight(0x6fe3ff, 14, 12);
    lamp.position.copy(portal.position);
    scene.add(sun, lamp, new HemisphereLight(0xa9c4e8, 0x6b5d48, 1.3));
    scene.fog = new FogExp2(FOG.color, FOG.density);
    scene.background = FOG.color;
    return scene;
}

/** The scene, its camera and its materials by name, and how it moves: `at(seconds)` puts it into the state of that time. */
export async function makeScene() {
    const made = await materials();
    const scene = temple(made);
    const camera = new PerspectiveCamera(48, 1, 0.3, 120);
    camera.position.set(3.2, 2.6, 13.9);
    camera.lookAt(-0.6, 2.4, 0);
    const at = (seconds) => {
        made.leaf.uniformsGroups[0].named.time.value = seconds;
    };
    return { scene, camera, materials: made, at };
}
