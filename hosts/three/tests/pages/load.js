// The package loads, and a frame is drawn as without it.

import * as THREE from 'three';
import { Preshade } from 'preshade-three';
import { Store } from '../../store.js';

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

/** Values of two makers in one database, and what they and a third find there. */
globalThis.kept = async () => {
    const visit = async (maker, ...values) => {
        const store = new Store('preshade test', maker);
        const before = await store.get('key');
        for (const value of values) await store.set('key', { value });
        const after = await store.get('key');
        await store.close();
        return [before?.value, after?.value];
    };
    const visits = [await visit('b', 1), await visit('b', 2), await visit('a', 3), await visit('c'), await visit('b')];
    const names = (await indexedDB.databases()).map(({ name }) => name).filter((name) => name.includes('test'));
    indexedDB.deleteDatabase('preshade test');
    return { visits, names };
};

/** The texts of a material before it is drawn, drawn by two kinds of objects, and of a pass of three.js. */
globalThis.texts = async () => {
    const preshade = await Preshade.of(renderer, { cache: false });
    const material = new THREE.ShaderMaterial({
        vertexShader: 'void main() { gl_Position = projectionMatrix * modelViewMatrix * vec4( position, 1.0 ); }',
        fragmentShader: 'void main() { gl_FragColor = vec4( 1.0 ); }',
    });
    const [one, many] = [new THREE.Mesh(mesh.geometry, material), new THREE.InstancedMesh(mesh.geometry, material, 2)];
    const before = preshade.text(material);
    scene.add(one, many);
    renderer.render(scene, camera);
    const found = { before, any: preshade.text(material), one: preshade.text(material, one) };
    found.many = preshade.text(material, many);
    // As some packages and frameworks have it.
    const wrapped = Object.create(material, { uuid: { value: 'another' }, id: { value: -1 } });
    one.material = wrapped;
    renderer.render(scene, camera);
    found.wrapped = preshade.text(material, one);
    one.material = material;
    found.proxy = preshade.text(new Proxy(material, {}), one);
    // Compiled as they are: nothing is missing.
    const gl = renderer.getContext();
    const compiles = (type, text) => {
        const shader = gl.createShader(type);
        gl.shaderSource(shader, text);
        gl.compileShader(shader);
        return gl.getShaderParameter(shader, gl.COMPILE_STATUS);
    };
    const { vertex, fragment } = found.one;
    found.compiles = compiles(gl.VERTEX_SHADER, vertex) && compiles(gl.FRAGMENT_SHADER, fragment);
    scene.remove(one, many);
    many.dispose();
    material.dispose();
    found.disposed = preshade.text(material);
    preshade.dispose();
    return found;
};
globalThis.ready = true;
