// CesiumJS: a globe without imagery, boxes, labels, an atmosphere
// Drawn with WebGL.

import { height, loaded, width, withoutCanvas } from './common.js';

withoutCanvas();
globalThis.CESIUM_BASE_URL = '/npm/cesium/Build/Cesium/';
const script = document.createElement('script');
script.src = '/npm/cesium/Build/Cesium/Cesium.js';
document.head.append(script);
await new Promise((resolve) => (script.onload = resolve));
const { Cesium } = globalThis;
const holder = document.createElement('div');
holder.style.cssText = `width:${width}px;height:${height}px`;
document.body.append(holder);
const widget = new Cesium.CesiumWidget(holder, {
    baseLayer: new Cesium.ImageryLayer(await Cesium.TileMapServiceImageryProvider.fromUrl('/npm/cesium/Build/Cesium/Assets/Textures/NaturalEarthII')),
    useBrowserRecommendedResolution: true,
    requestRenderMode: false,
});
const { scene } = widget;
for (let i = 0; i < 20; i++) {
    const at = Cesium.Cartesian3.fromDegrees(-100 + i * 2, 35 + (i % 5), 200000);
    scene.primitives.add(
        new Cesium.Primitive({
            geometryInstances: new Cesium.GeometryInstance({
                geometry: Cesium.BoxGeometry.fromDimensions({ dimensions: new Cesium.Cartesian3(120000, 120000, 400000), vertexFormat: Cesium.PerInstanceColorAppearance.VERTEX_FORMAT }),
                modelMatrix: Cesium.Transforms.eastNorthUpToFixedFrame(at),
                attributes: { color: Cesium.ColorGeometryInstanceAttribute.fromColor(Cesium.Color.fromHsl(i / 20, 0.7, 0.5)) },
            }),
            appearance: new Cesium.PerInstanceColorAppearance(),
            asynchronous: false,
        }),
    );
}
scene.camera.setView({ destination: Cesium.Cartesian3.fromDegrees(-90, 15, 4000000), orientation: { pitch: -0.9 } });
setTimeout(loaded, 6000);
