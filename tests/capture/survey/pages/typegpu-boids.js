// TypeGPU: compute and drawing in WGSL that the library writes
// Drawn with WebGPU.

import tgpu, { d } from 'typegpu';
import { canvas, loaded, loop, random } from './common.js';

const root = await tgpu.init();
const context = canvas.getContext('webgpu');
const format = navigator.gpu.getPreferredCanvasFormat();
context.configure({ device: root.device, format, alphaMode: 'premultiplied' });
const next = random(2);
const COUNT = 300;
const Boid = d.struct({ at: d.vec2f, speed: d.vec2f });
const start = Array.from({ length: COUNT }, () => ({ at: d.vec2f(next() * 2 - 1, next() * 2 - 1), speed: d.vec2f(next() - 0.5, next() - 0.5) }));
// Two, in turns: in one alone, the order of the threads would decide what each reads.
const buffers = [0, 1].map(() => root.unwrap(root.createBuffer(d.arrayOf(Boid, COUNT), start).$usage('storage', 'vertex')));
const module = root.device.createShaderModule({
    code: tgpu.resolve({
        template: `
@group(0) @binding(0) var<storage> boids: array<Boid>;
@group(0) @binding(1) var<storage, read_write> moved: array<Boid>;
@compute @workgroup_size(64) fn advance(@builtin(global_invocation_id) id: vec3u) {
    if (id.x >= arrayLength(&boids)) { return; }
    var boid = boids[id.x];
    for (var i = 0u; i < arrayLength(&boids); i++) {
        let away = boid.at - boids[i].at;
        let distance = dot(away, away);
        if (i != id.x && distance < 0.01) { boid.speed += away * 0.02 + (boids[i].speed - boid.speed) * 0.01; }
    }
    boid.speed = normalize(boid.speed + vec2f(1e-5)) * 0.4;
    boid.at += boid.speed * 0.01;
    boid.at -= trunc(boid.at) * 2.0;
    moved[id.x] = boid;
}
struct Out { @builtin(position) position: vec4f, @location(0) color: vec3f }
@vertex fn corner(@builtin(vertex_index) i: u32, @location(0) at: vec2f, @location(1) speed: vec2f) -> Out {
    let way = normalize(speed);
    let across = vec2f(-way.y, way.x);
    var corners = array(way * 0.05, across * 0.02 - way * 0.02, -across * 0.02 - way * 0.02);
    return Out(vec4f(at + corners[i], 0.0, 1.0), vec3f(way * 0.5 + 0.5, 0.6));
}
@fragment fn paint(in: Out) -> @location(0) vec4f { return vec4f(in.color, 1.0); }`,
        externals: { Boid },
    }),
});
const compute = root.device.createComputePipeline({ layout: 'auto', compute: { module } });
const attribute = (shaderLocation, offset) => ({ shaderLocation, offset, format: 'float32x2' });
const render = root.device.createRenderPipeline({
    layout: 'auto',
    vertex: { module, buffers: [{ arrayStride: 16, stepMode: 'instance', attributes: [attribute(0, 0), attribute(1, 8)] }] },
    fragment: { module, targets: [{ format }] },
});
const groups = [0, 1].map((from) => {
    const entries = [from, 1 - from].map((i, binding) => ({ binding, resource: { buffer: buffers[i] } }));
    return root.device.createBindGroup({ layout: compute.getBindGroupLayout(0), entries });
});
let from = 0;
loaded();
loop(() => {
    const encoder = root.device.createCommandEncoder();
    const moving = encoder.beginComputePass();
    moving.setPipeline(compute);
    moving.setBindGroup(0, groups[from]);
    from = 1 - from;
    moving.dispatchWorkgroups(Math.ceil(COUNT / 64));
    moving.end();
    const view = context.getCurrentTexture().createView();
    const pass = encoder.beginRenderPass({ colorAttachments: [{ view, loadOp: 'clear', storeOp: 'store', clearValue: [0.05, 0.05, 0.1, 1] }] });
    pass.setPipeline(render);
    pass.setVertexBuffer(0, buffers[from]);
    pass.draw(3, COUNT);
    pass.end();
    root.device.queue.submit([encoder.finish()]);
});
