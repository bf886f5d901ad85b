// A small scene for both of three.js's renderers: shadows, a texture, instances, a normal map, transparency.

import * as THREE from 'three';

export function texture(paint) {
    const canvas = document.createElement('canvas');
    canvas.width = canvas.height = 64;
    paint(canvas.getContext('2d'));
    const made = new THREE.CanvasTexture(canvas);
    made.colorSpace = THREE.SRGBColorSpace;
    made.wrapS = made.wrapT = THREE.RepeatWrapping;
    made.repeat.set(4, 4);
    return made;
}

export function makeScene() {
    const scene = new THREE.Scene();
    scene.background = new THREE.Color(0x8fb3d9);
    scene.fog = new THREE.Fog(0x8fb3d9, 8, 30);
    const camera = new THREE.PerspectiveCamera(50, 320 / 240, 0.1, 50);
    camera.position.set(4, 3, 6);
    camera.lookAt(0, 0.5, 0);

    const sun = new THREE.DirectionalLight(0xffffff, 3);
    sun.position.set(3, 6, 2);
    sun.castShadow = true;
    sun.shadow.mapSize.set(256, 256);
    scene.add(sun, new THREE.HemisphereLight(0xddeeff, 0x443322, 1));

    const checks = texture((paint) => {
        paint.fillStyle = '#ccc';
        paint.fillRect(0, 0, 64, 64);
        paint.fillStyle = '#684';
        paint.fillRect(0, 0, 32, 32);
        paint.fillRect(32, 32, 32, 32);
    });
    const ground = new THREE.Mesh(
        new THREE.PlaneGeometry(12, 12),
        new THREE.MeshStandardMaterial({ map: checks, roughness: 0.9 }),
    );
    ground.rotation.x = -Math.PI / 2;
    ground.receiveShadow = true;
    scene.add(ground);

    const knot = new THREE.Mesh(
        new THREE.TorusKnotGeometry(0.6, 0.22, 64, 12),
        new THREE.MeshPhysicalMaterial({ color: 0xcc6633, metalness: 0.3, roughness: 0.35, clearcoat: 0.5 }),
    );
    knot.position.y = 1.2;
    knot.castShadow = knot.receiveShadow = true;
    scene.add(knot);

    const boxes = new THREE.InstancedMesh(
        new THREE.BoxGeometry(0.4, 0.4, 0.4),
        new THREE.MeshLambertMaterial({ color: 0x4477aa }),
        9,
    );
    const at = new THREE.Matrix4();
    for (let i = 0; i < 9; i++) boxes.setMatrixAt(i, at.makeTranslation((i % 3) * 1.5 - 3, 0.2, (i / 3) | 0));
    boxes.castShadow = true;
    scene.add(boxes);

    const glass = new THREE.Mesh(
        new THREE.SphereGeometry(0.5, 24, 16),
        new THREE.MeshPhongMaterial({ color: 0x66ccff, transparent: true, opacity: 0.5, side: THREE.DoubleSide }),
    );
    glass.position.set(1.6, 0.6, 1);
    scene.add(glass);

    const animate = (step) => {
        knot.rotation.y = step * 0.05;
        glass.position.x = 1.6 + Math.sin(step * 0.1) * 0.3;
    };
    return { scene, camera, animate };
}
