import * as BABYLON from '@babylonjs/core';
import { makeScene } from './babylon-scene.js';

const engine = new BABYLON.WebGPUEngine(document.getElementById('canvas'), { antialias: true });
engine.initAsync().then(() => makeScene(engine));
