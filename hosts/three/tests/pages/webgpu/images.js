// A picture for the README: shadows of WebGPURenderer, beside those of preshade.

import * as THREE from 'three/webgpu';
import {
    Discard,
    Fn,
    cameraProjectionMatrix,
    modelViewMatrix,
    normalGeometry,
    output,
    positionGeometry,
    sin,
    uv,
    vec4,
} from 'three/tsl';
import { Preshade } from 'preshade-three';
import { settle } from './kit.js';

const [WIDTH, HEIGHT] = [380, 300];
const canvas = document.body.appendChild(document.createElement('canvas'));
const renderer = new THREE.WebGPURenderer({ canvas, antialias: true });
await renderer.init();
renderer.setSize(WIDTH, HEIGHT, false);
renderer.shadowMap.enabled = true;
renderer.toneMapping = THREE.ACESFilmicToneMapping;

/** A sphere that a vertex node moves, and a plane that the output node cuts out. */
function objects() {
    const { y, x, z } = positionGeometry;
    const wave = sin(y.mul(7))
        .mul(0.28)
        .add(sin(x.mul(6).add(z.mul(5))).mul(0.14));
    const moved = positionGeometry.add(normalGeometry.mul(wave));
    const clip = cameraProjectionMatrix.mul(modelViewMatrix).mul(vec4(moved, 1));
    const ball = new THREE.MeshStandardNodeMaterial({ color: 0xd2603c, roughness: 0.5, vertexNode: clip });
    const sphere = new THREE.Mesh(new THREE.SphereGeometry(0.9, 96, 64), ball);
    sphere.position.set(-1.1, 1.4, 0);
    const slats = uv().x.mul(11).fract().sub(0.5).abs();
    const rails = uv().y.sub(0.5).abs().sub(0.3).abs();
    const cut = Fn(() => {
        Discard(slats.greaterThan(0.3).and(rails.greaterThan(0.06)));
        return output;
    })();
    const wood = new THREE.MeshStandardNodeMaterial({ color: 0x8a6a48, side: THREE.DoubleSide, outputNode: cut });
    const fence = new THREE.Mesh(new THREE.PlaneGeometry(3, 1.5), wood);
    fence.position.set(1.6, 0.8, -0.4);
    return [sphere, fence];
}

const scene = new THREE.Scene();
scene.background = new THREE.Color(0xbfd4e6);
const camera = new THREE.PerspectiveCamera(38, WIDTH / HEIGHT, 0.1, 40);
camera.position.set(0, 3.4, 7);
camera.lookAt(0.3, 0.7, 0);
const ground = new THREE.Mesh(new THREE.PlaneGeometry(40, 40), new THREE.MeshStandardMaterial({ color: 0x9a9284 }));
ground.rotation.x = -Math.PI / 2;
ground.receiveShadow = true;
const sun = new THREE.DirectionalLight(0xfff0d8, 3.4);
sun.position.set(-2.5, 5, -4);
sun.castShadow = true;
sun.shadow.mapSize.set(2048, 2048);
sun.shadow.bias = -0.0008;
sun.shadow.normalBias = 0.03;
Object.assign(sun.shadow.camera, { left: -5, right: 5, top: 5, bottom: -5, far: 20 });
scene.add(ground, sun, new THREE.HemisphereLight(0xcfe4ff, 0x70604c, 1.3));
for (const object of objects()) {
    object.castShadow = true;
    scene.add(object);
}
const draw = () => renderer.render(scene, camera);

/** three.js on the left, preshade on the right. */
globalThis.draw = async () => {
    const both = document.createElement('canvas');
    [both.width, both.height] = [2 * WIDTH + 4, HEIGHT];
    const context = both.getContext('2d');
    const take = async (x, words) => {
        draw();
        const image = new Image();
        image.src = canvas.toDataURL();
        await image.decode();
        context.drawImage(image, x, 0);
        context.font = '15px sans-serif';
        context.fillStyle = 'rgba( 0, 0, 0, 0.6 )';
        context.fillText(words, x + 10, HEIGHT - 12);
    };
    context.fillStyle = 'white';
    context.fillRect(0, 0, both.width, HEIGHT);
    draw();
    await take(0, 'three.js');
    const preshade = await Preshade.of(renderer, { cache: false });
    preshade.shadows(scene);
    await settle(preshade, draw);
    await take(WIDTH + 4, 'with preshade.shadows( scene )');
    const states = preshade.report().map(({ state }) => state);
    return { url: both.toDataURL(), states };
};
globalThis.names = ['webgpu'];
globalThis.ready = true;
