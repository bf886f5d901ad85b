// The README's pictures: shadows of three.js, and beside them those of preshade.

import { Preshade } from 'preshade-three';

const [WIDTH, HEIGHT] = [380, 300];

/** `THREE`: the module of the renderer. */
export function prepared(THREE, renderer) {
    renderer.setSize(WIDTH, HEIGHT, false);
    renderer.shadowMap.enabled = true;
    renderer.toneMapping = THREE.ACESFilmicToneMapping;
    return renderer;
}

/** Objects on a ground, in the sun, which shines from `at`. */
export function stage(THREE, renderer, objects, at) {
    const scene = new THREE.Scene();
    scene.background = new THREE.Color(0xbfd4e6);
    const camera = new THREE.PerspectiveCamera(38, WIDTH / HEIGHT, 0.1, 40);
    camera.position.set(0, 3.4, 7);
    camera.lookAt(0.3, 0.7, 0);
    const ground = new THREE.Mesh(new THREE.PlaneGeometry(40, 40), new THREE.MeshStandardMaterial({ color: 0x9a9284 }));
    ground.rotation.x = -Math.PI / 2;
    ground.receiveShadow = true;
    const sun = new THREE.DirectionalLight(0xfff0d8, 3.4);
    sun.position.fromArray(at);
    sun.castShadow = true;
    sun.shadow.mapSize.set(2048, 2048);
    sun.shadow.bias = -0.0008;
    sun.shadow.normalBias = 0.03;
    Object.assign(sun.shadow.camera, { left: -5, right: 5, top: 5, bottom: -5, far: 20 });
    scene.add(ground, sun, new THREE.HemisphereLight(0xcfe4ff, 0x70604c, 1.3));
    for (const object of objects) {
        object.castShadow = true;
        scene.add(object);
    }
    return { scene, render: () => renderer.render(scene, camera) };
}

/** A data address of a PNG: three.js on the left, preshade on the right. */
export async function beside(renderer, { scene, render }, settle) {
    const both = Object.assign(document.createElement('canvas'), { width: 2 * WIDTH + 4, height: HEIGHT });
    const context = both.getContext('2d');
    const take = async (x, words) => {
        render();
        const image = new Image();
        image.src = renderer.domElement.toDataURL();
        await image.decode();
        context.drawImage(image, x, 0);
        context.font = '15px sans-serif';
        context.fillStyle = 'rgba( 0, 0, 0, 0.6 )';
        context.fillText(words, x + 10, HEIGHT - 12);
    };
    context.fillStyle = 'white';
    context.fillRect(0, 0, both.width, HEIGHT);
    render();
    await take(0, 'three.js');
    const preshade = await Preshade.of(renderer, { cache: false });
    preshade.shadows(scene);
    await settle(preshade, render);
    await take(WIDTH + 4, 'with preshade.shadows( scene )');
    const states = preshade.report().map(({ state }) => state);
    preshade.dispose();
    return { url: both.toDataURL('image/png'), states };
}
