// A scene of @react-three/fiber with preshade's component, without JSX: there is no build but the bundle.

import { createElement as h, StrictMode, useEffect, useRef, useState } from 'react';
import { createRoot } from 'react-dom/client';
import { Canvas, useFrame } from '@react-three/fiber';
import * as THREE from 'three';
import { Preshade } from '../../fiber.js';

const found = { reports: [], ready: 0, renders: 0, frames: 0, errors: [] };

function Waves() {
    const [uniforms] = useState(() => ({ time: { value: 0 } }));
    // @react-three/fiber copies the uniforms.
    const material = useRef(null);
    useFrame(() => {
        material.current.uniforms.time.value += 0.02;
        found.frames++;
    });
    return h(
        'mesh',
        { castShadow: true, receiveShadow: true },
        h('sphereGeometry', { args: [0.8, 24, 16] }),
        h('shaderMaterial', {
            ref: material,
            name: 'waves',
            uniforms,
            // It turns, so that each frame moves it as far as any other.
            vertexShader:
                'uniform float time; void main() { float c = cos(time), s = sin(time); vec3 p = position * (1.0 + 0.1 * sin(9.0 * position.x)); gl_Position = projectionMatrix * modelViewMatrix * vec4(c * p.x - s * p.y, s * p.x + c * p.y, p.z, 1.0); }',
            fragmentShader: 'void main() { gl_FragColor = vec4(0.2, 0.5, 0.8, 1.0); }',
        }),
    );
}

function Page() {
    const [isShown, show] = useState(true);
    const [parts, set] = useState({ of: () => ({ shadows: true, prepass: { form: 'biased' }, velocity: true }) });
    const [, again] = useState(0);
    Object.assign(globalThis, { show, set, again: () => again((count) => count + 1) });
    useEffect(() => void found.renders++);
    return h(
        Canvas,
        {
            shadows: 'basic',
            camera: { position: [0, 0, 3] },
            style: { width: 160, height: 160 },
            onCreated: ({ gl, scene, camera }) => Object.assign(globalThis, { renderer: gl, scene, camera }),
        },
        h('directionalLight', { position: [1, 2, 3], castShadow: true }),
        h(Waves),
        h(
            'mesh',
            { position: [0, 0, -1], receiveShadow: true },
            h('planeGeometry', { args: [4, 4] }),
            h('meshStandardMaterial', { name: 'wall' }),
        ),
        isShown &&
            h(Preshade, {
                options: { cache: false },
                ...parts.of(),
                onReady: (made) => (found.ready++, (globalThis.made = made)),
                onReport: (rows) => found.reports.push(rows),
                onError: (error) => found.errors.push(String(error)),
            }),
    );
}

const element = document.createElement('div');
document.body.append(element);
createRoot(element).render(h(StrictMode, null, h(Page)));
Object.assign(globalThis, { THREE, found, ready: true });
