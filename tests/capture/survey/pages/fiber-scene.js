// React Three Fiber: a scene of components with shadows and instances
// Drawn with WebGL.

import { createRoot, extend, useFrame } from '@react-three/fiber';
import { createElement as h, useRef } from 'react';
import * as THREE from 'three';
import { canvas, height, loaded, width } from './common.js';

extend(THREE);

function Box({ at, color }) {
    const mesh = useRef();
    useFrame(() => {
        mesh.current.rotation.x += 0.02;
        mesh.current.rotation.y += 0.03;
    });
    return h('mesh', { ref: mesh, position: at, castShadow: true, receiveShadow: true }, [
        h('boxGeometry', { key: 'g', args: [0.7, 0.7, 0.7] }),
        h('meshStandardMaterial', { key: 'm', color, roughness: 0.4 }),
    ]);
}
const root = createRoot(canvas);
await root.configure({ size: { width, height, top: 0, left: 0 }, shadows: true, dpr: 1, camera: { position: [3, 3, 5] } });
const colors = ['#e66', '#6e6', '#66e', '#ee6', '#6ee', '#e6e'];
root.render([
    h('color', { key: 'background', attach: 'background', args: ['#223'] }),
    h('ambientLight', { key: 'ambient', intensity: 0.6 }),
    h('directionalLight', { key: 'sun', position: [3, 6, 2], intensity: 3, castShadow: true }),
    ...colors.map((color, i) => h(Box, { key: color, color, at: [Math.cos(i) * 1.8, 0.7, Math.sin(i) * 1.8] })),
    h('mesh', { key: 'ground', 'rotation-x': -Math.PI / 2, receiveShadow: true }, [
        h('planeGeometry', { key: 'g', args: [10, 10] }),
        h('meshStandardMaterial', { key: 'm', color: '#999' }),
    ]),
]);
loaded();
