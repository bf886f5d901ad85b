// xeokit: entities in data textures, edges, SAO
// Drawn with WebGL.

import { Mesh, PhongMaterial, ReadableGeometry, SceneModel, Viewer, buildBoxGeometry, buildTorusGeometry } from '@xeokit/xeokit-sdk/dist/xeokit-sdk.es.js';
import { canvas, loaded, loop } from './common.js';

canvas.id = 'canvas';
const viewer = new Viewer({ canvasId: 'canvas', transparent: false, backgroundColor: [0.15, 0.2, 0.3], saoEnabled: true, dtxEnabled: true });
viewer.scene.camera.eye = [6, 5, 9];
viewer.scene.camera.look = [0, 0, 0];
const model = new SceneModel(viewer.scene, { id: 'model', isModel: true, dtxEnabled: true });
const box = buildBoxGeometry({ xSize: 0.4, ySize: 0.6, zSize: 0.4 });
model.createGeometry({ id: 'box', primitive: 'triangles', positions: box.positions, normals: box.normals, indices: box.indices });
for (let i = 0; i < 60; i++) {
    model.createMesh({ id: `mesh ${i}`, geometryId: 'box', position: [(i % 10) - 4.5, 0, Math.floor(i / 10) - 3], scale: [1, 1 + (i % 5), 1], color: [(i % 10) / 10, 0.5, 0.7] });
    model.createEntity({ id: `entity ${i}`, meshIds: [`mesh ${i}`], isObject: true });
}
model.finalize();
new Mesh(viewer.scene, {
    geometry: new ReadableGeometry(viewer.scene, buildTorusGeometry({ radius: 1.5, tube: 0.4 })),
    material: new PhongMaterial(viewer.scene, { diffuse: [0.9, 0.6, 0.3] }),
    position: [0, 4, 0],
});
loaded();
loop(() => viewer.scene.camera.orbitYaw(1));
