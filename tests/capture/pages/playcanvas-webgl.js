import './playcanvas-scene.js';
