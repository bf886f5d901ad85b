// three.js: `BatchedMesh`, LOD, points, sprites, wide lines, logarithmic depth
// Drawn with WebGL.

import { Line2 } from 'three/addons/lines/Line2.js';
import { LineGeometry } from 'three/addons/lines/LineGeometry.js';
import { LineMaterial } from 'three/addons/lines/LineMaterial.js';
import { loaded, loop, random, spot } from './common.js';
import { THREE, base, camera, ground, sun, texture, webgl } from './three-common.js';

const renderer = webgl({ logarithmicDepthBuffer: true });
const scene = base(0x203040);
const eye = camera();
sun(scene);
ground(scene);
const next = random(7);

const shapes = [new THREE.BoxGeometry(0.3, 0.3, 0.3), new THREE.SphereGeometry(0.2, 12, 8), new THREE.ConeGeometry(0.2, 0.5, 10)];
const batch = new THREE.BatchedMesh(90, 4000, 8000, new THREE.MeshStandardMaterial({ roughness: 0.5 }));
const kinds = shapes.map((shape) => batch.addGeometry(shape));
const at = new THREE.Matrix4();
const parts = Array.from({ length: 90 }, (_, i) => {
    const part = batch.addInstance(kinds[i % 3]);
    batch.setMatrixAt(part, at.makeTranslation(next() * 8 - 4, 0.3 + next() * 2, next() * 8 - 4));
    batch.setColorAt(part, new THREE.Color().setHSL(next(), 0.7, 0.5));
    return part;
});
scene.add(batch);

const lod = new THREE.LOD();
[[64, 0], [16, 5], [6, 20]].forEach(([detail, from]) =>
    lod.addLevel(new THREE.Mesh(new THREE.SphereGeometry(0.6, detail, detail), new THREE.MeshNormalMaterial()), from),
);
lod.position.y = 2.4;
scene.add(lod);

const cloud = new THREE.BufferGeometry();
cloud.setAttribute('position', new THREE.Float32BufferAttribute(Array.from({ length: 900 }, () => next() * 6 - 3), 3));
cloud.setAttribute('color', new THREE.Float32BufferAttribute(Array.from({ length: 900 }, next), 3));
scene.add(
    new THREE.Points(
        cloud,
        new THREE.PointsMaterial({ size: 0.15, map: texture(spot()), transparent: true, depthWrite: false, vertexColors: true }),
    ),
);
for (let i = 0; i < 6; i++) {
    const sprite = new THREE.Sprite(new THREE.SpriteMaterial({ map: texture(spot('#fc8')), blending: THREE.AdditiveBlending }));
    sprite.position.set(next() * 4 - 2, 1 + next() * 2, next() * 4 - 2);
    scene.add(sprite);
}
const path = new LineGeometry();
path.setPositions(Array.from({ length: 60 }, (_, i) => [Math.cos(i * 0.3) * 2.5, i * 0.05, Math.sin(i * 0.3) * 2.5]).flat());
const line = new Line2(path, new LineMaterial({ color: 0xff5533, linewidth: 3 }));
scene.add(line);
loaded();
loop((step) => {
    for (let i = 0; i < 10; i++) {
        batch.setMatrixAt(parts[i], at.makeTranslation(Math.cos(step * 0.1 + i), 1.2, Math.sin(step * 0.1 + i)));
    }
    renderer.render(scene, eye);
});
