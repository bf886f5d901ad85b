// luma.gl: textured cubes, uniform buffers, instances
// Drawn with WebGL and WebGPU.

import { luma } from '@luma.gl/core';
import { CubeGeometry, Model } from '@luma.gl/engine';
import { webgl2Adapter } from '@luma.gl/webgl';
import { webgpuAdapter } from '@luma.gl/webgpu';
import { mat4 } from 'gl-matrix';
import { canvas, checks, height, isWebgpu, loaded, loop, width } from './common.js';

const device = await luma.createDevice({
    type: isWebgpu ? 'webgpu' : 'webgl',
    adapters: [webgl2Adapter, webgpuAdapter],
    createCanvasContext: { canvas, autoResize: false },
});
const COUNT = 16;
const view = device.createBuffer({ byteLength: 64, usage: 0x40 | 8 });
const places = device.createBuffer({ data: new Float32Array(COUNT * 4).map((_, i) => [((i >> 2) % 4) * 2.4 - 3.6, (i >> 4) * 2.4 - 3.6, 0, (i >> 2) / COUNT][i % 4]), usage: 0x20 | 8 });
const image = await createImageBitmap(checks('#fc8', '#48a'));
const map = device.createTexture({ width: 64, height: 64, data: null, format: 'rgba8unorm', usage: 4 | 2 | 16, sampler: { minFilter: 'linear', magFilter: 'linear' } });
map.copyExternalImage({ image });
const model = new Model(device, {
    source: `
struct View { matrix: mat4x4<f32> }
@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var map: texture_2d<f32>;
@group(0) @binding(2) var mapSampler: sampler;
struct Varying { @builtin(position) position: vec4<f32>, @location(0) uv: vec2<f32>, @location(1) tint: f32 }
@vertex fn vertexMain(@location(0) positions: vec3<f32>, @location(1) normals: vec3<f32>, @location(2) texCoords: vec2<f32>, @location(3) place: vec4<f32>) -> Varying {
    return Varying(view.matrix * vec4(positions * 0.7 + place.xyz, 1.0), texCoords, place.w);
}
@fragment fn fragmentMain(in: Varying) -> @location(0) vec4<f32> {
    return vec4(textureSample(map, mapSampler, in.uv).rgb * (0.4 + 0.6 * in.tint), 1.0);
}`,
    vs: `#version 300 es
layout(std140) uniform view { mat4 matrix; };
in vec3 positions; in vec3 normals; in vec2 texCoords; in vec4 place; out vec2 uv; out float tint;
void main() { uv = texCoords; tint = place.w; gl_Position = matrix * vec4(positions * 0.7 + place.xyz, 1.0); }`,
    fs: `#version 300 es
precision highp float; uniform sampler2D map; in vec2 uv; in float tint; out vec4 color;
void main() { color = vec4(texture(map, uv).rgb * (0.4 + 0.6 * tint), 1.0); }`,
    geometry: new CubeGeometry({ indices: true }),
    bufferLayout: [{ name: 'place', format: 'float32x4', stepMode: 'instance' }],
    attributes: { place: places },
    bindings: { view, map },
    instanceCount: COUNT,
    parameters: { depthWriteEnabled: true, depthCompare: 'less-equal', depthFormat: 'depth24plus' },
});
const matrix = mat4.create();
loaded();
loop((step) => {
    mat4.perspective(matrix, 1, width / height, 0.1, 50);
    mat4.translate(matrix, matrix, [0, 0, -11]);
    mat4.rotateY(matrix, matrix, step * 0.02);
    mat4.rotateX(matrix, matrix, 0.4);
    view.write(new Float32Array(matrix));
    const pass = device.beginRenderPass({ clearColor: [0.1, 0.1, 0.2, 1], clearDepth: 1 });
    model.draw(pass);
    pass.end();
    device.submit();
});
