// Forms of GLSL and of objects that pages use: uniforms of every kind, both versions of GLSL, points, lines, sides.

import * as THREE from 'three';
import { standard, TIME, wobbling } from './cases.js';

const sphere = () => new THREE.SphereGeometry(0.8, 24, 16);
const mesh = (geometry, material) => new THREE.Mesh(geometry, material);

const shader = (uniforms, declared, moved, more) =>
    new THREE.ShaderMaterial({
        uniforms,
        vertexShader: `${declared}
            void main() {
                vec3 moved = position;
                ${moved}
                gl_Position = projectionMatrix * modelViewMatrix * vec4( moved, 1.0 );
            }`,
        fragmentShader: 'void main() { gl_FragColor = vec4( 0.8, 0.5, 0.2, 1.0 ); }',
        ...more,
    });

/** A texture of heights. */
function heights() {
    const data = new Float32Array(16 * 16 * 4).map((_, i) => (i % 4 === 0 ? 0.4 * Math.sin(i) : 0));
    const texture = new THREE.DataTexture(data, 16, 16, THREE.RGBAFormat, THREE.FloatType);
    texture.needsUpdate = true;
    return texture;
}

function grouped() {
    const group = new THREE.UniformsGroup();
    group.setName('Waves');
    group.add(new THREE.Uniform(new THREE.Vector4(0.3, 5, 0.7, 0)));
    group.add(new THREE.Uniform(new THREE.Vector4(0.1, 9, 0.2, 0)));
    return shader(
        {},
        'layout( std140 ) uniform Waves { vec4 first; vec4 second; };',
        'moved += normal * ( first.x * sin( first.y * position.y + first.z ) + second.x * sin( second.y * position.x ) );',
        { uniformsGroups: [group] },
    );
}

function patched(material, vertex) {
    material.onBeforeCompile = (made) => {
        made.vertexShader = made.vertexShader.replace('#include <begin_vertex>', `#include <begin_vertex>\n${vertex}`);
    };
    material.customProgramCacheKey = () => vertex;
    return material;
}

function instancedGeometry() {
    const geometry = new THREE.InstancedBufferGeometry().copy(new THREE.BoxGeometry(0.5, 0.5, 0.5));
    geometry.instanceCount = 5;
    geometry.setAttribute(
        'offset',
        new THREE.InstancedBufferAttribute(
            new Float32Array([-1.5, 0, 0, -0.7, 0.5, 0, 0, 0, 0.4, 0.8, -0.4, 0, 1.5, 0.2, 0]),
            3,
        ),
    );
    geometry.setAttribute('turn', new THREE.InstancedBufferAttribute(new Int32Array([0, 1, 2, 3, 4]), 1));
    geometry.attributes.turn.gpuType = THREE.IntType;
    return geometry;
}

function morphedInstances() {
    const geometry = new THREE.BoxGeometry();
    const target = geometry.attributes.position.clone();
    for (let i = 0; i < target.count; i++) target.setY(i, target.getY(i) * 3);
    geometry.morphAttributes.position = [target];
    const instances = new THREE.InstancedMesh(geometry, wobbling(standard()), 3);
    const one = new THREE.Mesh(geometry);
    for (let i = 0; i < 3; i++) {
        one.morphTargetInfluences[0] = i / 2;
        instances.setMorphAt(i, one);
        instances.setMatrixAt(
            i,
            new THREE.Matrix4().makeTranslation(i * 1.5 - 1.5, 0, 0).scale(new THREE.Vector3(0.6, 0.6, 0.6)),
        );
    }
    instances.morphTexture.needsUpdate = true;
    instances.frustumCulled = false;
    return instances;
}

export const forms = {
    'a texture in the vertex stage': {
        add: () =>
            mesh(
                sphere(),
                shader(
                    { map: { value: heights() } },
                    'uniform sampler2D map;',
                    'moved += normal * texture2D( map, uv ).r;',
                ),
            ),
    },
    'arrays and structs of uniforms': {
        add: () =>
            mesh(
                sphere(),
                shader(
                    {
                        waves: {
                            value: [
                                { turn: new THREE.Vector2(0, 5), size: 0.2 },
                                { turn: new THREE.Vector2(4, 0), size: 0.1 },
                            ],
                        },
                        sizes: { value: [1, 0.5] },
                        turn: { value: new THREE.Matrix3().makeRotation(0.5) },
                    },
                    'struct Wave { vec2 turn; float size; }; uniform Wave waves[ 2 ]; uniform float sizes[ 2 ]; uniform mat3 turn;',
                    'for ( int i = 0; i < 2; i ++ ) moved += turn * normal * sizes[ i ] * waves[ i ].size * sin( dot( waves[ i ].turn, position.xy ) );',
                ),
            ),
    },
    'a block of uniforms': { add: () => mesh(sphere(), grouped()) },
    'GLSL 3 with an output and an integer attribute of its own': {
        add: () => {
            const object = mesh(
                instancedGeometry(),
                new THREE.RawShaderMaterial({
                    glslVersion: THREE.GLSL3,
                    uniforms: { time: TIME },
                    vertexShader: `precision highp float; precision highp int;
                        uniform mat4 projectionMatrix; uniform mat4 viewMatrix; uniform mat4 modelMatrix; uniform float time;
                        in vec3 position; in vec3 offset; in int turn;
                        void main() {
                            float angle = float( turn ) * 0.4 + time;
                            mat2 turned = mat2( cos( angle ), sin( angle ), - sin( angle ), cos( angle ) );
                            vec3 moved = vec3( turned * position.xy, position.z ) + offset;
                            gl_Position = projectionMatrix * viewMatrix * modelMatrix * vec4( moved, 1.0 );
                        }`,
                    fragmentShader: `precision highp float;
                        layout( location = 0 ) out vec4 outColor;
                        void main() {
                            if ( mod( gl_FragCoord.x + gl_FragCoord.y, 3.0 ) < 1.0 ) discard;
                            outColor = vec4( 0.4, 0.7, 0.9, 1.0 );
                        }`,
                }),
            );
            object.frustumCulled = false;
            return object;
        },
    },
    'dashed lines': {
        // Stock, but its holes are not in three.js's depth material.
        add: () => {
            const points = Array.from(
                { length: 60 },
                (_, i) => new THREE.Vector3(Math.sin(i / 3), i / 30 - 1, Math.cos(i / 3)),
            );
            const line = new THREE.Line(
                new THREE.BufferGeometry().setFromPoints(points),
                new THREE.LineDashedMaterial({ dashSize: 0.2, gapSize: 0.2 }),
            );
            return line.computeLineDistances();
        },
    },
    'sides, a mirrored object, and shadowSide': {
        add: () =>
            [THREE.FrontSide, THREE.BackSide, THREE.DoubleSide].map((side, i) => {
                const object = mesh(
                    sphere(),
                    wobbling(standard({ side, shadowSide: i === 1 ? THREE.DoubleSide : null })),
                );
                object.position.x = i * 1.7 - 1.7;
                object.scale.set(i === 0 ? -0.9 : 0.9, 0.9, 0.9);
                return object;
            }),
    },
    'wireframe and flat shading': {
        add: () =>
            [
                mesh(sphere(), wobbling(standard({ wireframe: true }))),
                Object.assign(
                    mesh(new THREE.TorusKnotGeometry(0.5, 0.15, 48, 8), wobbling(standard({ flatShading: true }))),
                    { name: 'flat' },
                ),
            ].map((object, i) => (object.position.set(i * 2 - 1, 0, 0), object)),
    },
    'instances with morphs': { add: () => morphedInstances() },
    'one patch with two texts': {
        add: () =>
            [
                patched(standard(), 'transformed *= 0.6;'),
                patched(standard(), 'transformed *= vec3( 0.6, 1.4, 0.6 );'),
            ].map((material, i) => {
                const object = mesh(sphere(), material);
                object.position.x = i * 2 - 1;
                return object;
            }),
    },
    'depth that the fragment stage writes': {
        add: () =>
            mesh(
                new THREE.PlaneGeometry(2, 2),
                shader({}, 'varying vec2 vUv;', 'vUv = uv * 2.0 - 1.0;', {
                    side: THREE.DoubleSide,
                    fragmentShader: `varying vec2 vUv;
                        void main() {
                            float bulge = 1.0 - dot( vUv, vUv );
                            if ( bulge < 0.0 ) discard;
                            gl_FragDepth = gl_FragCoord.z - 0.05 * bulge;
                            gl_FragColor = vec4( vec3( bulge ), 1.0 );
                        }`,
                }),
            ),
    },
    'the cascades of a SunLight': { lights: ['sun'], add: () => mesh(sphere(), wobbling(standard())) },
    'a patched material that is transparent': {
        add: () => mesh(sphere(), wobbling(standard({ transparent: true, opacity: 0.5 }))),
    },
};
