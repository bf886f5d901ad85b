// A scene for pages of three.js: ground, knot, boxes, glass, lights with shadows.

import * as THREE from 'three';
import { RoomEnvironment } from 'three/addons/environments/RoomEnvironment.js';
import { canvas, checks, height, width } from './common.js';

export { THREE };

export function texture(source, repeat = 1) {
    const made = new THREE.CanvasTexture(source);
    made.colorSpace = THREE.SRGBColorSpace;
    made.wrapS = made.wrapT = THREE.RepeatWrapping;
    made.repeat.set(repeat, repeat);
    return made;
}

export function webgl(options = {}) {
    const renderer = new THREE.WebGLRenderer({ canvas, antialias: true, ...options });
    renderer.setSize(width, height, false);
    renderer.toneMapping = THREE.ACESFilmicToneMapping;
    return renderer;
}

export function camera(position = [4, 3, 6], target = [0, 0.6, 0]) {
    const made = new THREE.PerspectiveCamera(50, width / height, 0.1, 100);
    made.position.set(...position);
    made.lookAt(...target);
    return made;
}

export function sun(scene, type = 256) {
    const made = new THREE.DirectionalLight(0xffffff, 3);
    made.position.set(3, 6, 2);
    made.castShadow = true;
    made.shadow.mapSize.set(type, type);
    Object.assign(made.shadow.camera, { left: -6, right: 6, top: 6, bottom: -6 });
    scene.add(made, new THREE.HemisphereLight(0xddeeff, 0x443322, 1));
    return made;
}

export function room(scene, renderer) {
    const generator = new THREE.PMREMGenerator(renderer);
    scene.environment = generator.fromScene(new RoomEnvironment(), 0.04).texture;
}

export function ground(scene, material = {}) {
    const made = new THREE.Mesh(
        new THREE.PlaneGeometry(14, 14),
        new THREE.MeshStandardMaterial({ map: texture(checks(), 6), roughness: 0.9, ...material }),
    );
    made.rotation.x = -Math.PI / 2;
    made.receiveShadow = true;
    scene.add(made);
    return made;
}

export function knot(scene, material = new THREE.MeshStandardMaterial({ color: 0xcc6633, roughness: 0.4 })) {
    const made = new THREE.Mesh(new THREE.TorusKnotGeometry(0.7, 0.25, 96, 16), material);
    made.position.y = 1.4;
    made.castShadow = made.receiveShadow = true;
    scene.add(made);
    return made;
}

export function boxes(scene, count = 25, material = new THREE.MeshStandardMaterial({ roughness: 0.6 })) {
    const made = new THREE.InstancedMesh(new THREE.BoxGeometry(0.4, 0.6, 0.4), material, count);
    const at = new THREE.Matrix4();
    for (let i = 0; i < count; i++) {
        const angle = (i / count) * Math.PI * 2;
        made.setMatrixAt(i, at.makeTranslation(Math.cos(angle) * 3, 0.3, Math.sin(angle) * 3));
        made.setColorAt(i, new THREE.Color().setHSL(i / count, 0.6, 0.5));
    }
    made.castShadow = made.receiveShadow = true;
    scene.add(made);
    return made;
}

export function base(background = 0x8fb3d9) {
    const scene = new THREE.Scene();
    scene.background = new THREE.Color(background);
    return scene;
}
