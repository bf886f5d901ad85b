import { Engine } from '@babylonjs/core/Engines/engine';
import '@babylonjs/core/Engines/Extensions/engine.rawTexture';
import '@babylonjs/core/Meshes/instancedMesh';
import { makeScene } from './babylon-scene.js';

makeScene(new Engine(document.getElementById('canvas'), true, { stencil: true }));
