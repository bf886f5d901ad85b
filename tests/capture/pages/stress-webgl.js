import { WebGLRenderer } from 'three';
import { run } from './stress-scene.js';

run(new WebGLRenderer({ canvas: document.getElementById('canvas') }));
