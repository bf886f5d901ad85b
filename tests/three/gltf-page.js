// Draws a glTF file as docs/reference/gltf.md says that preshade's built-in material does: the same camera, light and surroundings, blended in linear light.

import * as THREE from 'three';
import { GLTFExporter } from 'three/addons/exporters/GLTFExporter.js';
import { GLTFLoader } from 'three/addons/loaders/GLTFLoader.js';
import { SCENES } from './gltf-scenes.js';

const canvas = document.querySelector('#canvas');
const { width, height } = canvas;
const renderer = new THREE.WebGLRenderer({ canvas, antialias: false, preserveDrawingBuffer: true });
renderer.setPixelRatio(1);
renderer.setSize(width, height, false);

const SKY = [0.5, 0.55, 0.6];
const GROUND = [0.2, 0.19, 0.18];

/** The surroundings: from the ground's light below to the sky's above. */
function surroundings() {
    const [w, h] = [256, 128];
    const data = new Float32Array(w * h * 4);
    for (let y = 0; y < h; y++) {
        const up = Math.sin(((y + 0.5) / h - 0.5) * Math.PI);
        for (let x = 0; x < w; x++) {
            for (let c = 0; c < 3; c++) data[(y * w + x) * 4 + c] = GROUND[c] + (SKY[c] - GROUND[c]) * (0.5 + 0.5 * up);
            data[(y * w + x) * 4 + 3] = 1;
        }
    }
    const texture = new THREE.DataTexture(data, w, h, THREE.RGBAFormat, THREE.FloatType);
    texture.mapping = THREE.EquirectangularReflectionMapping;
    texture.magFilter = texture.minFilter = THREE.LinearFilter;
    texture.needsUpdate = true;
    return new THREE.PMREMGenerator(renderer).fromEquirectangular(texture).texture;
}

const environment = surroundings();
const target = new THREE.WebGLRenderTarget(width, height, { type: THREE.HalfFloatType });
const screen = new THREE.Mesh(
    new THREE.PlaneGeometry(2, 2),
    new THREE.MeshBasicMaterial({ map: target.texture, depthTest: false, toneMapped: false }),
);

/** A camera that sees the whole of an object. */
function framing(object) {
    const box = new THREE.Box3().setFromObject(object);
    const center = box.getCenter(new THREE.Vector3());
    const radius = box.getSize(new THREE.Vector3()).length() / 2;
    const distance = radius / Math.sin((20 * Math.PI) / 180);
    const camera = new THREE.PerspectiveCamera(40, width / height, (distance - radius) * 0.5, distance + radius * 2);
    camera.position.set(0.6, 0.4, 1).normalize().multiplyScalar(distance).add(center);
    camera.lookAt(center);
    return camera;
}

function draw(gltf) {
    const scene = new THREE.Scene();
    scene.background = new THREE.Color().setRGB(0.05, 0.07, 0.1);
    scene.environment = environment;
    scene.add(gltf.scene);
    scene.updateMatrixWorld(true);
    let lights = 0;
    gltf.scene.traverse((object) => (lights += object.isLight ? 1 : 0));
    if (lights === 0) {
        const light = new THREE.DirectionalLight(new THREE.Color().setRGB(2.2, 2.1, 1.9), 1);
        light.position.set(0.4, 0.8, 0.45);
        scene.add(light);
    }
    const camera = gltf.cameras[0] ?? framing(gltf.scene);
    if (camera.isPerspectiveCamera) camera.aspect = width / height;
    camera.updateProjectionMatrix();
    renderer.setRenderTarget(target);
    renderer.render(scene, camera);
    renderer.setRenderTarget(null);
    renderer.render(screen, new THREE.OrthographicCamera(-1, 1, 1, -1, -1, 1));
}

const loader = new GLTFLoader();

window.page = {
    /** Draws a file, and gives back the picture. */
    async picture(address) {
        draw(await loader.loadAsync(address));
        return canvas.toDataURL('image/png');
    },
    scenes: Object.keys(SCENES),
    /** What three.js exports of one of its scenes: the bytes of a .glb file, in base64. */
    async exported(name) {
        const bytes = new Uint8Array(await new GLTFExporter().parseAsync(SCENES[name](), { binary: true }));
        let text = '';
        for (const byte of bytes) text += String.fromCharCode(byte);
        return btoa(text);
    },
};
canvas.dataset.ready = 'yes';
