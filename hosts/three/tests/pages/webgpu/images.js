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
import { beside, prepared, stage } from '../lib/beside.js';
import { settle } from './kit.js';

const renderer = new THREE.WebGPURenderer({ antialias: true });
await renderer.init();
document.body.append(prepared(THREE, renderer).domElement);

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

const pictured = stage(THREE, renderer, objects(), [-2.5, 5, -4]);
globalThis.draw = () => beside(renderer, pictured, settle);
globalThis.names = ['webgpu'];
globalThis.ready = true;
