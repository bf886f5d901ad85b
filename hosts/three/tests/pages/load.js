// The package loads, and a frame is drawn as without it.

import * as THREE from 'three';
import { Preshade } from 'preshade-three';

const renderer = new THREE.WebGLRenderer({ preserveDrawingBuffer: true });
renderer.setSize(64, 64);
document.body.append(renderer.domElement);
const scene = new THREE.Scene();
const camera = new THREE.PerspectiveCamera(50, 1, 0.1, 10);
camera.position.z = 3;
const mesh = new THREE.Mesh(new THREE.BoxGeometry(), new THREE.MeshStandardMaterial({ color: 0xff8800 }));
scene.add(mesh, new THREE.HemisphereLight());
const pixels = () => {
    renderer.render(scene, camera);
    const gl = renderer.getContext();
    const bytes = new Uint8Array(64 * 64 * 4);
    gl.readPixels(0, 0, 64, 64, gl.RGBA, gl.UNSIGNED_BYTE, bytes);
    return bytes.join();
};
const before = pixels();
const preshade = await Preshade.of(renderer);
const after = pixels();
preshade.dispose();
globalThis.found = { same: before === after, again: before === pixels(), methods: Object.hasOwn(renderer, 'render') };
globalThis.ready = true;
