// Galacean: PBR with shadows
// Drawn with WebGL.

import { AmbientLight, Camera, Color, DirectLight, MeshRenderer, PBRMaterial, PrimitiveMesh, Script, ShadowType, Vector3, WebGLEngine, WebGLMode } from '@galacean/engine';
import { canvas, loaded } from './common.js';

const engine = await WebGLEngine.create({ canvas, graphicDeviceOptions: { webGLMode: WebGLMode.WebGL2 } });
const scene = engine.sceneManager.activeScene;
scene.background.solidColor = new Color(0.02, 0.03, 0.06, 1);
scene.ambientLight.diffuseSolidColor = new Color(0.3, 0.3, 0.35, 1);
const root = scene.createRootEntity('root');
const eye = root.createChild('eye');
eye.transform.setPosition(4, 4, 6);
eye.transform.lookAt(new Vector3(0, 0.5, 0));
eye.addComponent(Camera);
const sun = root.createChild('sun');
sun.transform.setRotation(-50, 30, 0);
const light = sun.addComponent(DirectLight);
light.shadowType = ShadowType.SoftLow;
class Turn extends Script {
    onUpdate() {
        this.entity.transform.rotate(1, 2, 0);
    }
}
const add = (mesh, color, at, turns) => {
    const entity = root.createChild();
    entity.transform.setPosition(...at);
    const renderer = entity.addComponent(MeshRenderer);
    renderer.mesh = mesh;
    const material = new PBRMaterial(engine);
    material.baseColor = new Color(...color, 1);
    material.metallic = 0.3;
    material.roughness = 0.5;
    renderer.setMaterial(material);
    if (turns) entity.addComponent(Turn);
};
add(PrimitiveMesh.createPlane(engine, 10, 10), [0.6, 0.6, 0.6], [0, 0, 0]);
add(PrimitiveMesh.createCuboid(engine), [0.9, 0.3, 0.2], [-1.6, 1, 0], true);
add(PrimitiveMesh.createTorus(engine), [0.2, 0.7, 0.4], [0, 1.2, 0], true);
add(PrimitiveMesh.createCapsule(engine), [0.2, 0.4, 0.9], [1.6, 1, 0], true);
engine.run();
loaded();
