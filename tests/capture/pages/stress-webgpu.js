import { WebGPURenderer } from 'three/webgpu';
import { run } from './stress-scene.js';

run(new WebGPURenderer({ canvas: document.getElementById('canvas') }));
