// The README's pictures: shadows of three.js beside those of preshade.

import * as THREE from 'three';
import { beside, prepared, stage } from './lib/beside.js';
import { settle } from './lib/depths.js';

const renderer = prepared(THREE, new THREE.WebGLRenderer({ antialias: true, preserveDrawingBuffer: true }));

/** Adds to the vertex or fragment stage, as a page does. */
function patched(material, vertex, fragment = []) {
    material.onBeforeCompile = (shader) => {
        for (const [of, with_] of vertex) shader.vertexShader = shader.vertexShader.replace(of, with_);
        for (const [of, with_] of fragment) shader.fragmentShader = shader.fragmentShader.replace(of, with_);
    };
    // three.js tells patches apart by the text of the function, which is the same for all of these.
    material.customProgramCacheKey = () => JSON.stringify([vertex, fragment]);
    return material;
}

const scenes = {
    wobble() {
        const material = patched(new THREE.MeshStandardMaterial({ color: 0xd2603c, roughness: 0.5 }), [
            [
                '#include <beginnormal_vertex>',
                'float wave = sin( position.y * 7.0 ) * 0.28 + sin( position.x * 6.0 + position.z * 5.0 ) * 0.14;\n#include <beginnormal_vertex>',
            ],
            ['#include <begin_vertex>', '#include <begin_vertex>\ntransformed += normal * wave;'],
        ]);
        const mesh = new THREE.Mesh(new THREE.SphereGeometry(1.05, 96, 64), material);
        mesh.position.y = 1.5;
        return [mesh];
    },
    tree() {
        const trunk = patched(new THREE.MeshStandardMaterial({ color: 0x6b4a2f }), [
            [
                '#include <begin_vertex>',
                '#include <begin_vertex>\ntransformed.x += 0.22 * pow( position.y + 1.25, 2.0 ) * 0.6;',
            ],
        ]);
        const stem = new THREE.Mesh(new THREE.CylinderGeometry(0.09, 0.17, 2.5, 16, 24), trunk);
        stem.position.y = 1.25;
        // The wind bends the whole tree; the leaves are cut out of quads.
        const leaf = patched(
            new THREE.MeshStandardMaterial({ color: 0x4f8f3a, side: THREE.DoubleSide }),
            [
                ['#include <uv_pars_vertex>', '#include <uv_pars_vertex>\nvarying vec2 vLeaf;'],
                [
                    '#include <project_vertex>',
                    `vLeaf = uv;
                    vec4 mvPosition = instanceMatrix * vec4( transformed, 1.0 );
                    mvPosition.x += 0.22 * pow( max( mvPosition.y, 0.0 ), 2.0 ) * 0.6;
                    mvPosition = modelViewMatrix * mvPosition;
                    gl_Position = projectionMatrix * mvPosition;`,
                ],
            ],
            [
                ['#include <uv_pars_fragment>', '#include <uv_pars_fragment>\nvarying vec2 vLeaf;'],
                [
                    '#include <alphatest_fragment>',
                    'vec2 leaf = ( vLeaf - 0.5 ) * vec2( 2.0, 1.0 );\nif ( length( vec2( leaf.x, leaf.y + 0.35 ) ) > 0.55 || length( vec2( leaf.x, leaf.y - 0.35 ) ) > 0.75 ) discard;',
                ],
            ],
        );
        const leaves = new THREE.InstancedMesh(new THREE.PlaneGeometry(0.5, 0.5), leaf, 420);
        let seed = 7;
        const random = () => (seed = (seed * 16807) % 2147483647) / 2147483647;
        const matrix = new THREE.Matrix4();
        for (let i = 0; i < leaves.count; i++) {
            const turn = new THREE.Euler(random() * 6, random() * 6, random() * 6);
            const at = new THREE.Vector3().randomDirection();
            at.set(
                Math.cos(i * 2.4) * Math.sqrt(1 - ((i + 0.5) / 210 - 1) ** 2),
                (i + 0.5) / 210 - 1,
                Math.sin(i * 2.4) * Math.sqrt(1 - ((i + 0.5) / 210 - 1) ** 2),
            );
            at.multiplyScalar(0.45 + 0.4 * random()).add(new THREE.Vector3(0, 2.3, 0));
            leaves.setMatrixAt(
                i,
                matrix.compose(at, new THREE.Quaternion().setFromEuler(turn), new THREE.Vector3(1, 1, 1)),
            );
        }
        leaves.frustumCulled = false;
        stem.position.x = -1.2;
        leaves.position.x = -1.2;
        return [stem, leaves];
    },
    fence() {
        const material = patched(
            new THREE.MeshStandardMaterial({ color: 0xb88a55, side: THREE.DoubleSide }),
            [
                ['#include <uv_pars_vertex>', '#include <uv_pars_vertex>\nvarying vec2 vAt;'],
                ['#include <begin_vertex>', '#include <begin_vertex>\nvAt = position.xy;'],
            ],
            [
                ['#include <uv_pars_fragment>', '#include <uv_pars_fragment>\nvarying vec2 vAt;'],
                [
                    '#include <alphatest_fragment>',
                    `float slat = abs( fract( vAt.x * 2.2 ) - 0.5 );
                    float top = 0.62 + 0.28 * ( 0.5 - slat ) * 2.0;
                    bool board = slat < 0.27 && vAt.y < top;
                    bool rail = abs( vAt.y - 0.25 ) < 0.07 || abs( vAt.y + 0.5 ) < 0.07;
                    if ( ! board && ! rail ) discard;`,
                ],
            ],
        );
        const mesh = new THREE.Mesh(new THREE.PlaneGeometry(5, 2), material);
        mesh.position.set(0, 1, -0.4);
        mesh.rotation.y = 0.2;
        return [mesh];
    },
};

globalThis.draw = (name) => {
    const objects = scenes[name]();
    for (const object of objects) object.receiveShadow = true;
    const from = name === 'fence' ? [-1.8, 4, -4.5] : [-4, 5, 1.2];
    return beside(renderer, stage(THREE, renderer, objects, from), settle);
};
globalThis.names = Object.keys(scenes);
globalThis.ready = true;
