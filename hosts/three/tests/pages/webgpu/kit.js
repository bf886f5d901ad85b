// What the pages for WebGPURenderer share: a renderer, materials of all sorts, and the depths of a texture.

import * as THREE from 'three/webgpu';
import {
    Discard,
    Fn,
    If,
    cameraFar,
    cameraNear,
    cameraProjectionMatrix,
    float,
    fract,
    modelViewMatrix,
    normalLocal,
    output,
    positionGeometry,
    positionLocal,
    positionView,
    sin,
    uv,
    vec3,
    vec4,
    viewZToPerspectiveDepth,
    wgslFn,
} from 'three/tsl';

export const SIZE = 128;
const asked = new URLSearchParams(location.search);

/** A renderer on the page. `?reversed`, `?logarithmic`, `?vsm` and `?samples=4` are of the address. */
export async function renderer(options = {}) {
    const canvas = document.body.appendChild(document.createElement('canvas'));
    const of = new THREE.WebGPURenderer({
        canvas,
        antialias: asked.has('samples'),
        reversedDepthBuffer: asked.has('reversed'),
        logarithmicDepthBuffer: asked.has('logarithmic'),
        ...options,
    });
    await of.init();
    of.setSize(SIZE, SIZE, false);
    of.shadowMap.enabled = true;
    if (asked.has('vsm')) of.shadowMap.type = THREE.VSMShadowMap;
    return of;
}

/** Waits for the next frame: three.js draws a shadow map once in a frame. */
export const frame = () => new Promise(requestAnimationFrame);

/** Draws frames until nothing is on its way. */
export async function settle(host, draw, count = 6) {
    for (let i = 0; i < count; i++) {
        draw();
        await host.settled();
        await frame();
    }
}

/** The depths of a layer of a depth texture of three.js, by a compute shader. */
export async function depths(renderer, texture, layer = 0) {
    const { device } = renderer.backend;
    const gpu = renderer.backend.get(texture).texture;
    const size = 4 * gpu.width * gpu.height;
    const code = `
        @group(0) @binding(0) var depths: texture_depth_2d;
        @group(0) @binding(1) var<storage, read_write> out: array<f32>;
        @compute @workgroup_size(8, 8) fn main(@builtin(global_invocation_id) at: vec3<u32>) {
            let size = textureDimensions(depths);
            if (at.x < size.x && at.y < size.y) { out[at.y * size.x + at.x] = textureLoad(depths, vec2<i32>(at.xy), 0); }
        }`;
    const module = device.createShaderModule({ code });
    const pipeline = device.createComputePipeline({ layout: 'auto', compute: { module, entryPoint: 'main' } });
    const { STORAGE, COPY_SRC, COPY_DST, MAP_READ } = GPUBufferUsage;
    const out = device.createBuffer({ size, usage: STORAGE | COPY_SRC });
    const read = device.createBuffer({ size, usage: MAP_READ | COPY_DST });
    const view = gpu.createView({ aspect: 'depth-only', dimension: '2d', baseArrayLayer: layer, arrayLayerCount: 1 });
    const entries = [
        { binding: 0, resource: view },
        { binding: 1, resource: { buffer: out } },
    ];
    const encoder = device.createCommandEncoder();
    const pass = encoder.beginComputePass();
    pass.setPipeline(pipeline);
    pass.setBindGroup(0, device.createBindGroup({ layout: pipeline.getBindGroupLayout(0), entries }));
    pass.dispatchWorkgroups(Math.ceil(gpu.width / 8), Math.ceil(gpu.height / 8));
    pass.end();
    encoder.copyBufferToBuffer(out, 0, read, 0, size);
    device.queue.submit([encoder.finish()]);
    await read.mapAsync(GPUMapMode.READ);
    const found = new Float32Array(read.getMappedRange().slice(0));
    out.destroy();
    read.destroy();
    return found;
}

/** What a renderer has just drawn to its canvas: call it in the same task. Drawing the canvas itself gives nothing. */
export async function shownBy(renderer) {
    const image = new Image();
    image.src = renderer.domElement.toDataURL();
    await image.decode();
    const context = new OffscreenCanvas(SIZE, SIZE).getContext('2d');
    context.drawImage(image, 0, 0);
    return context.getImageData(0, 0, SIZE, SIZE).data;
}

/** How many pixels are not black. */
export const litOf = (data) => data.filter((of, i) => i % 4 === 0 && of + data[i + 1] + data[i + 2] > 0).length;

/** How many groups of `stride` values of two arrays differ, in the first `width`. */
export function differ(a, b, stride = 1, width = stride) {
    let count = 0;
    for (let i = 0; i < a.length; i += stride) {
        for (let k = 0; k < width; k++) {
            if (a[i + k] === b[i + k]) continue;
            count++;
            break;
        }
    }
    return count;
}

/** A texture whose red is one pattern of holes, and whose alpha is another. */
export function holes() {
    const data = new Uint8Array(16 * 16 * 4);
    for (let i = 0; i < 256; i++) data.set([(i >> 2) % 2 ? 255 : 0, 200, 200, (i + (i >> 4)) % 2 ? 255 : 0], 4 * i);
    const texture = new THREE.DataTexture(data, 16, 16);
    texture.needsUpdate = true;
    return texture;
}

const stripes = fract(uv().x.mul(8));
const isHole = stripes.lessThan(0.5);
const wave = positionLocal.add(normalLocal.mul(sin(positionLocal.y.mul(6)).mul(0.2)));
const bent = positionGeometry.add(vec3(0, sin(positionGeometry.x.mul(6)).mul(0.3), 0));
const bentClip = cameraProjectionMatrix.mul(modelViewMatrix).mul(vec4(bent, 1));
const cut = wgslFn(`fn cut( uv: vec2<f32> ) -> vec4<f32> {
    if ( fract( uv.x * 8.0 ) < 0.5 ) { discard; }
    return vec4<f32>( 1.0 );
}`);
const cutting = (value) => Fn(() => (Discard(isHole), value))();
const ifCutting = (value) =>
    Fn(() => {
        If(isHole, () => {
            Discard();
        });
        return value;
    })();

const sides = { side: THREE.DoubleSide, shadowSide: THREE.DoubleSide };
const node = (options) => () => Object.assign(new THREE.MeshStandardNodeMaterial(sides), options);
const classic = (options) => () => new THREE.MeshStandardMaterial({ ...sides, ...options });
const tested = { alphaTest: 0.5 };

/** Makers of materials, by what they have of their own. */
export const MATERIALS = {
    plain: node({}),
    positionNode: node({ positionNode: wave }),
    vertexNode: node({ vertexNode: bentClip }),
    displacementMap: node({ displacementMap: holes(), displacementScale: 0.3 }),
    'map, alphaTest': node({ map: holes(), ...tested }),
    'alphaMap, alphaTest': node({ alphaMap: holes(), ...tested }),
    'colorNode alpha, alphaTest': node({ colorNode: vec4(1, 1, 1, stripes), ...tested }),
    'opacityNode, alphaTest': node({ opacityNode: stripes, ...tested }),
    'opacityNode by distance, alphaTest': node({ opacityNode: positionView.z.negate().div(4).fract(), ...tested }),
    alphaTestNode: node({ colorNode: vec4(1, 1, 1, stripes), alphaTestNode: float(0.5) }),
    'opacity below alphaTest': node({ opacity: 0.3, ...tested }),
    'vertexColors alpha, alphaTest': node({ vertexColors: true, ...tested }),
    alphaHash: node({ opacity: 0.5, alphaHash: true }),
    'alphaToCoverage, alphaTest': node({ opacityNode: stripes, alphaToCoverage: true, ...tested }),
    maskNode: node({ maskNode: isHole.not() }),
    maskShadowNode: node({ maskNode: isHole.not(), maskShadowNode: stripes.greaterThan(0.2) }),
    'Discard in colorNode': node({ colorNode: cutting(vec4(1)) }),
    'If, Discard in colorNode': node({ colorNode: ifCutting(vec4(1)) }),
    'discard of wgslFn in colorNode': node({ colorNode: cut({ uv: uv() }) }),
    'Discard in outputNode': node({ outputNode: cutting(output) }),
    'Discard in fragmentNode': node({ fragmentNode: cutting(vec4(1)) }),
    'discard of wgslFn in fragmentNode': node({ fragmentNode: cut({ uv: uv() }) }),
    'Discard in emissiveNode': node({ emissiveNode: cutting(vec3(1)) }),
    'Discard in normalNode': node({ normalNode: cutting(vec3(0, 0, 1)) }),
    'Discard in roughnessNode': node({ roughnessNode: cutting(float(0.5)) }),
    depthNode: node({ depthNode: viewZToPerspectiveDepth(positionView.z.sub(0.3), cameraNear, cameraFar) }),
    castShadowPositionNode: node({ positionNode: wave, castShadowPositionNode: positionLocal.mul(0.8) }),
    'MeshStandardMaterial: map, alphaTest': classic({ map: holes(), ...tested }),
    'MeshStandardMaterial: opacity below alphaTest': classic({ opacity: 0.3, ...tested }),
    'MeshStandardMaterial: alphaHash': classic({ opacity: 0.5, alphaHash: true }),
};

/** What pages change of a material or an object while it is drawn: as it is at first, and as it is then. */
export const CHANGES = {
    opacity: ({ material }, isThen) => (material.opacity = isThen ? 0.3 : 1),
    alphaTest: ({ material }, isThen) => (material.alphaTest = isThen ? 0.5 : 0),
    'alpha of a batch': ({ mesh }, isThen) => isThen && mesh.setColorAt(0, new THREE.Vector4(1, 1, 1, 0.2)),
};

function geometry() {
    const of = new THREE.SphereGeometry(1, 24, 16);
    const { count } = of.attributes.position;
    const color = new Float32Array(4 * count).fill(1);
    for (let i = 0; i < count; i++) color[4 * i + 3] = i % 3 ? 1 : 0;
    return of.setAttribute('color', new THREE.BufferAttribute(color, 4));
}

const at = (i) => new THREE.Matrix4().makeScale(0.5, 0.5, 0.5).setPosition(i - 1, 0.3 * i, 0);

/** Makers of objects with a material. */
export const OBJECTS = {
    mesh: (material) => new THREE.Mesh(geometry(), material),
    instanced(material) {
        const mesh = new THREE.InstancedMesh(geometry(), material, 3);
        for (let i = 0; i < 3; i++) mesh.setMatrixAt(i, at(i));
        return mesh;
    },
    batched(material) {
        const of = geometry();
        const mesh = new THREE.BatchedMesh(3, 3000, 6000, material);
        const id = mesh.addGeometry(of);
        for (let i = 0; i < 3; i++) mesh.setMatrixAt(mesh.addInstance(id), at(i));
        return mesh;
    },
    skinned(material) {
        const of = geometry();
        const { position } = of.attributes;
        const weight = (i) => (position.getY(i) + 1) / 2;
        const each = (make) => Array.from({ length: position.count }, (_, i) => make(i)).flat();
        of.setAttribute(
            'skinIndex',
            new THREE.Uint16BufferAttribute(
                each(() => [0, 1, 0, 0]),
                4,
            ),
        );
        of.setAttribute(
            'skinWeight',
            new THREE.Float32BufferAttribute(
                each((i) => [1 - weight(i), weight(i), 0, 0]),
                4,
            ),
        );
        const mesh = new THREE.SkinnedMesh(of, material);
        const [root, tip] = [new THREE.Bone(), new THREE.Bone()];
        root.add(tip);
        mesh.add(root);
        mesh.bind(new THREE.Skeleton([root, tip]));
        tip.rotation.z = 0.6;
        tip.position.x = 0.4;
        return mesh;
    },
    morphed(material) {
        const of = geometry();
        const moved = of.attributes.position.clone();
        for (let i = 0; i < moved.count; i++) moved.setX(i, 1.4 * moved.getX(i));
        of.morphAttributes.position = [moved];
        const mesh = new THREE.Mesh(of, material);
        mesh.morphTargetInfluences = [0.7];
        return mesh;
    },
};

/** Makers of lights with a shadow. */
export const LIGHTS = {
    directional() {
        const light = new THREE.DirectionalLight(0xffffff, 3);
        Object.assign(light.shadow.camera, { left: -2, right: 2, top: 2, bottom: -2, near: 1, far: 12 });
        return light;
    },
    spot: () => new THREE.SpotLight(0xffffff, 100, 20, 0.5),
    point: () => new THREE.PointLight(0xffffff, 100, 20),
};

/** A scene of one object over a ground, and its camera. */
export function scene({ material = 'plain', object = 'mesh', light = 'directional', clipping = null } = {}) {
    const of = new THREE.Scene();
    const camera = new THREE.PerspectiveCamera(50, 1, 0.1, 50);
    camera.position.set(0, 3, 6);
    camera.lookAt(0, 0, 0);
    const sun = LIGHTS[light]();
    sun.position.set(2, 4, 2);
    sun.castShadow = true;
    sun.shadow.mapSize.set(SIZE, SIZE);
    const ground = new THREE.Mesh(new THREE.PlaneGeometry(8, 8), new THREE.MeshStandardMaterial());
    ground.rotation.x = -Math.PI / 2;
    ground.position.y = -1.5;
    ground.receiveShadow = true;
    const mesh = OBJECTS[object](MATERIALS[material]());
    mesh.castShadow = true;
    if (clipping) {
        const group = new THREE.ClippingGroup();
        group.clippingPlanes = [new THREE.Plane(new THREE.Vector3(0, -1, 0.2), 0.3)];
        group.clipShadows = true;
        of.add(group.add(mesh));
    } else of.add(mesh);
    of.add(sun, ground, new THREE.AmbientLight(0xffffff, 0.4));
    return { scene: of, camera, sun, ground, mesh, material: mesh.material };
}
