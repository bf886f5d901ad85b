// Many draws, each with a material of its own: what a call costs.

import * as THREE from 'three';

export function run(renderer) {
    const scene = new THREE.Scene();
    const camera = new THREE.PerspectiveCamera(60, 320 / 240, 0.1, 100);
    camera.position.z = 30;
    const box = new THREE.BoxGeometry(0.5, 0.5, 0.5);
    scene.add(new THREE.HemisphereLight(0xffffff, 0x444444, 2));
    for (let i = 0; i < 1000; i++) {
        const mesh = new THREE.Mesh(box, new THREE.MeshLambertMaterial({ color: (i * 7919) % 0xffffff }));
        mesh.position.set((i % 40) - 20, ((i / 40) | 0) - 12, 0);
        scene.add(mesh);
    }
    let step = 0;
    renderer.setSize(320, 240, false);
    renderer.setAnimationLoop(() => {
        step += 1;
        for (const mesh of scene.children) mesh.rotation.y = step * 0.1;
        renderer.render(scene, camera);
        globalThis.ready = step > 3;
    });
}
