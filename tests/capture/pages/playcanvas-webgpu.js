globalThis.deviceType = 'webgpu';
require('./playcanvas-scene.js');
