// VTK.js: a volume by ray casting, a contour, a glyph
// Drawn with WebGL.

import '@kitware/vtk.js/Rendering/Profiles/All';
import vtkColorTransferFunction from '@kitware/vtk.js/Rendering/Core/ColorTransferFunction';
import vtkPiecewiseFunction from '@kitware/vtk.js/Common/DataModel/PiecewiseFunction';
import vtkImageData from '@kitware/vtk.js/Common/DataModel/ImageData';
import vtkDataArray from '@kitware/vtk.js/Common/Core/DataArray';
import vtkVolume from '@kitware/vtk.js/Rendering/Core/Volume';
import vtkVolumeMapper from '@kitware/vtk.js/Rendering/Core/VolumeMapper';
import vtkConeSource from '@kitware/vtk.js/Filters/Sources/ConeSource';
import vtkActor from '@kitware/vtk.js/Rendering/Core/Actor';
import vtkMapper from '@kitware/vtk.js/Rendering/Core/Mapper';
import vtkGenericRenderWindow from '@kitware/vtk.js/Rendering/Misc/GenericRenderWindow';
import { height, loaded, loop, width, withoutCanvas } from './common.js';

withoutCanvas();
const holder = document.createElement('div');
holder.style.cssText = `width:${width}px;height:${height}px`;
document.body.append(holder);
const view = vtkGenericRenderWindow.newInstance({ background: [0.1, 0.12, 0.2] });
view.setContainer(holder);
view.resize();
const SIZE = 24;
const values = Uint8Array.from({ length: SIZE ** 3 }, (_, i) => {
    const [x, y, z] = [i % SIZE, Math.floor(i / SIZE) % SIZE, Math.floor(i / SIZE ** 2)].map((n) => (n / SIZE) * 2 - 1);
    return Math.max(0, 1 - Math.hypot(x, y, z)) * 255;
});
const image = vtkImageData.newInstance();
image.setDimensions(SIZE, SIZE, SIZE);
image.getPointData().setScalars(vtkDataArray.newInstance({ name: 'density', values, numberOfComponents: 1 }));
const mapper = vtkVolumeMapper.newInstance({ sampleDistance: 0.8 });
mapper.setInputData(image);
const volume = vtkVolume.newInstance();
volume.setMapper(mapper);
const color = vtkColorTransferFunction.newInstance();
color.addRGBPoint(0, 0, 0.1, 0.6);
color.addRGBPoint(255, 1, 0.7, 0.2);
const opacity = vtkPiecewiseFunction.newInstance();
opacity.addPoint(0, 0);
opacity.addPoint(255, 0.6);
volume.getProperty().setRGBTransferFunction(0, color);
volume.getProperty().setScalarOpacity(0, opacity);
const cone = vtkConeSource.newInstance({ height: 20, radius: 6, resolution: 24, center: [34, 12, 12] });
const surface = vtkMapper.newInstance();
surface.setInputConnection(cone.getOutputPort());
const actor = vtkActor.newInstance();
actor.setMapper(surface);
view.getRenderer().addVolume(volume);
view.getRenderer().addActor(actor);
view.getRenderer().resetCamera();
loaded();
loop(() => {
    view.getRenderer().getActiveCamera().azimuth(1);
    view.getRenderer().resetCameraClippingRange();
    view.getRenderWindow().render();
});
