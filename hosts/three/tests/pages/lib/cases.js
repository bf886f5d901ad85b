// Casters of every kind: what moves their vertices or cuts holes, and in what.

import * as THREE from 'three';

export const TIME = { value: 0.7 };

/** Pushes vertices along their normals, as a page does it. */
export function wobbling(material) {
    material.onBeforeCompile = (shader) => {
        shader.uniforms.time = TIME;
        shader.vertexShader = `uniform float time;\n${shader.vertexShader.replace(
            '#include <begin_vertex>',
            `#include <begin_vertex>
            transformed += normal * ( sin( time + position.y * 5.0 ) + cos( position.x * 4.0 + time ) ) * 0.2;`,
        )}`;
    };
    return material;
}

/** Cuts rows of holes by the material's own alpha test. */
export function holed(material) {
    material.onBeforeCompile = (shader) => {
        shader.vertexShader = `varying vec3 vAt;\n${shader.vertexShader.replace('#include <begin_vertex>', '#include <begin_vertex>\nvAt = position;')}`;
        shader.fragmentShader = `varying vec3 vAt;\n${shader.fragmentShader.replace(
            '#include <alphatest_fragment>',
            'diffuseColor.a = step( 0.4, fract( vAt.x * 3.0 + vAt.y * 2.0 ) );\n#include <alphatest_fragment>',
        )}`;
    };
    material.alphaTest = 0.5;
    return material;
}

const box = () => new THREE.BoxGeometry(1, 1, 1, 6, 6, 6);
const sphere = () => new THREE.SphereGeometry(0.8, 24, 16);
export const standard = (more) => new THREE.MeshStandardMaterial({ color: 0xcc8844, ...more });

const wind = (more) =>
    new THREE.ShaderMaterial({
        uniforms: { time: TIME, color: { value: new THREE.Color(0x44aa33) } },
        side: THREE.DoubleSide,
        vertexShader: `
            uniform float time;
            varying vec2 vUv;
            void main() {
                vUv = uv;
                vec3 moved = position;
                moved.x += sin( time + position.y * 2.0 ) * 0.4 * ( position.y + 1.0 );
                gl_Position = projectionMatrix * viewMatrix * modelMatrix * vec4( moved, 1.0 );
            }`,
        fragmentShader: `
            uniform vec3 color;
            varying vec2 vUv;
            void main() {
                if ( length( fract( vUv * 4.0 ) - 0.5 ) > 0.45 ) discard;
                gl_FragColor = vec4( color, 1.0 );
                #include <colorspace_fragment>
            }`,
        ...more,
    });

/** Lit by a vector of its own; its normals are in the view's axes. */
export const lit = () =>
    new THREE.ShaderMaterial({
        uniforms: { time: TIME },
        vertexShader: `
            uniform float time;
            varying vec3 vLit;
            varying vec2 vUv;
            void main() {
                vUv = uv;
                float slope = 0.5 * cos( time + position.x * 3.0 );
                vLit = normalMatrix * normalize( vec3( -slope, 0.0, 1.0 ) );
                vec4 litPosition = modelViewMatrix * vec4( position + vec3( 0.0, 0.0, sin( time + position.x * 3.0 ) / 6.0 ), 1.0 );
                gl_Position = projectionMatrix * litPosition;
            }`,
        fragmentShader: `
            varying vec3 vLit;
            varying vec2 vUv;
            void main() {
                if ( length( fract( vUv * 3.0 ) - 0.5 ) > 0.47 ) discard;
                vec3 litNormal = normalize( vLit );
                gl_FragColor = vec4( vec3( 0.2 + max( dot( litNormal, normalize( vec3( 1.0, 2.0, 1.0 ) ) ), 0.0 ) ), 1.0 );
            }`,
    });

/** Lit by a vector in the axes of the `world` or of the `object`, or, with `none`, not lit at all. */
export const axes = (of) =>
    new THREE.ShaderMaterial({
        uniforms: { time: TIME },
        vertexShader: `
            uniform float time;
            varying vec3 vLit;
            varying vec4 vView;
            void main() {
                float slope = 0.5 * cos( time + position.x * 3.0 );
                vec3 bent = normalize( vec3( -slope, 0.0, 1.0 ) ) + normal * 0.001;
                vLit = ${{ world: 'mat3( modelMatrix ) * bent', object: 'bent', none: 'vec3( 0.0 )' }[of]};
                vView = modelViewMatrix * vec4( position + vec3( 0.0, 0.0, sin( time + position.x * 3.0 ) / 6.0 ), 1.0 );
                gl_Position = projectionMatrix * vView;
            }`,
        fragmentShader: `
            ${of === 'object' ? 'uniform mat3 normalMatrix;' : ''}
            varying vec3 vLit;
            varying vec4 vView;
            void main() {
                vec3 ${of}Normal = ${of === 'none' ? 'cross( dFdx( vView.xyz ), dFdy( vView.xyz ) )' : 'normalize( vLit )'};
                gl_FragColor = vec4( vec3( ${of === 'none' ? '0.5' : `max( dot( ${of}Normal, normalize( vec3( 1.0, 2.0, 1.0 ) ) ), 0.0 )`} ), 1.0 );
            }`,
    });

const raw = () =>
    new THREE.RawShaderMaterial({
        uniforms: { time: TIME },
        vertexShader: `
            precision highp float;
            uniform mat4 projectionMatrix;
            uniform mat4 modelViewMatrix;
            uniform float time;
            attribute vec3 position;
            attribute float phase;
            void main() {
                vec3 moved = position * ( 1.0 + 0.3 * sin( time + phase ) );
                gl_Position = projectionMatrix * modelViewMatrix * vec4( moved, 1.0 );
            }`,
        fragmentShader: `
            precision highp float;
            void main() {
                gl_FragColor = vec4( 0.2, 0.5, 0.9, 1.0 );
            }`,
    });

function phased(geometry) {
    const count = geometry.attributes.position.count;
    geometry.setAttribute(
        'phase',
        new THREE.Float32BufferAttribute(
            Array.from({ length: count }, (_, i) => i * 0.1),
            1,
        ),
    );
    return geometry;
}

export function instanced(material) {
    const mesh = new THREE.InstancedMesh(box(), material, 4);
    for (let i = 0; i < 4; i++) {
        mesh.setMatrixAt(
            i,
            new THREE.Matrix4()
                .makeTranslation(i - 1.5, (i % 2) * 0.8, i * 0.3 - 0.5)
                .scale(new THREE.Vector3(0.6, 0.6, 0.6)),
        );
        mesh.setColorAt(i, new THREE.Color().setHSL(i / 4, 1, 0.5));
    }
    return mesh;
}

function batched(material) {
    const mesh = new THREE.BatchedMesh(3, 2000, 6000, material);
    const ids = [mesh.addGeometry(box()), mesh.addGeometry(sphere())];
    for (let i = 0; i < 3; i++) {
        const at = mesh.addInstance(ids[i % 2]);
        mesh.setMatrixAt(
            at,
            new THREE.Matrix4().makeTranslation(i * 1.2 - 1.2, 0.2 * i, 0).scale(new THREE.Vector3(0.6, 0.6, 0.6)),
        );
    }
    return mesh;
}

function skinned(material) {
    const geometry = new THREE.CylinderGeometry(0.4, 0.4, 2, 12, 8);
    const { position } = geometry.attributes;
    const indices = [];
    const weights = [];
    for (let i = 0; i < position.count; i++) {
        const share = (position.getY(i) + 1) / 2;
        indices.push(0, 1, 0, 0);
        weights.push(1 - share, share, 0, 0);
    }
    geometry.setAttribute('skinIndex', new THREE.Uint16BufferAttribute(indices, 4));
    geometry.setAttribute('skinWeight', new THREE.Float32BufferAttribute(weights, 4));
    const bones = [new THREE.Bone(), new THREE.Bone()];
    bones[0].position.y = -1;
    bones[1].position.y = 2;
    bones[0].add(bones[1]);
    const mesh = new THREE.SkinnedMesh(geometry, material);
    mesh.add(bones[0]);
    mesh.bind(new THREE.Skeleton(bones));
    bones[1].rotation.z = 0.8;
    return mesh;
}

function morphed(material) {
    const geometry = box();
    const target = geometry.attributes.position.clone();
    for (let i = 0; i < target.count; i++) target.setXYZ(i, target.getX(i) * 2, target.getY(i) * 0.5, target.getZ(i));
    geometry.morphAttributes.position = [target];
    geometry.morphAttributes.normal = [geometry.attributes.normal.clone()];
    const mesh = new THREE.Mesh(geometry, material);
    mesh.morphTargetInfluences[0] = 0.6;
    return mesh;
}

/** A texture of a fence: half of it is holes. */
export function fence() {
    const size = 64;
    const data = new Uint8Array(size * size * 4);
    for (let i = 0; i < size * size; i++) {
        const [x, y] = [i % size, Math.floor(i / size)];
        data.set([200, 160, 120, x % 16 < 8 ? 255 : y % 32 < 12 ? 150 : 60], i * 4);
    }
    const texture = new THREE.DataTexture(data, size, size);
    texture.colorSpace = THREE.SRGBColorSpace;
    texture.needsUpdate = true;
    return texture;
}

const mesh = (geometry, material) => new THREE.Mesh(geometry, material);
const two = (material) => [mesh(box(), material), Object.assign(mesh(sphere(), material), { name: 'second' })];
const apart = (objects) => objects.map((object, i) => (object.position.set(i * 2 - 1, i * 0.4, 0), object));
const planes = () => [
    new THREE.Plane(new THREE.Vector3(0, -1, 0.2), 0.3),
    new THREE.Plane(new THREE.Vector3(1, 0, 0), 0.3),
];
const wall = () => new THREE.PlaneGeometry(2.4, 2, 12, 12);

/** `covered`: three.js does it right by itself, and nothing is replaced. `context`: of the renderer. */
export const cases = {
    onBeforeCompile: { add: () => apart(two(wobbling(standard()))) },
    'onBeforeCompile, three lights': {
        lights: ['directional', 'spot', 'point'],
        add: () => mesh(sphere(), wobbling(standard())),
    },
    'ShaderMaterial, wind and holes': { add: () => mesh(wall(), wind()) },
    RawShaderMaterial: { add: () => mesh(phased(sphere()), raw()) },
    'alphaTest by onBeforeCompile': { add: () => mesh(sphere(), holed(standard())) },
    'alphaTest of a map, opacity 0.8': {
        add: () => mesh(wall(), standard({ map: fence(), alphaTest: 0.5, opacity: 0.3 + 0.5, side: THREE.DoubleSide })),
    },
    alphaHash: { add: () => mesh(sphere(), standard({ alphaHash: true, opacity: 0.5 })) },
    'vertex colours with alpha': {
        add: () => {
            const geometry = wall();
            const count = geometry.attributes.position.count;
            geometry.setAttribute(
                'color',
                new THREE.Float32BufferAttribute(
                    Array.from({ length: count }, (_, i) => [1, 1, 1, (i % 5) / 4]).flat(),
                    4,
                ),
            );
            return mesh(geometry, standard({ vertexColors: true, alphaTest: 0.5, side: THREE.DoubleSide }));
        },
    },
    InstancedMesh: { add: () => instanced(wobbling(standard())) },
    SkinnedMesh: { add: () => skinned(wobbling(standard())) },
    morphs: { add: () => morphed(wobbling(standard())) },
    BatchedMesh: { add: () => batched(wobbling(standard())) },
    'one material, five kinds of object': {
        add: () => {
            const material = wobbling(standard());
            return [
                mesh(box(), material),
                instanced(material),
                skinned(material),
                morphed(material),
                batched(material),
            ].map(
                (object, i) => (
                    object.position.set((i - 2) * 1.1, 0, (i % 2) - 0.5),
                    object.scale.setScalar(0.5),
                    object
                ),
            );
        },
    },
    'groups of one geometry': {
        add: () => {
            const geometry = box();
            const materials = [
                wobbling(standard()),
                holed(standard()),
                standard(),
                wind(),
                standard(),
                wobbling(standard()),
            ];
            return mesh(geometry, materials);
        },
    },
    clippingPlanes: {
        renderer: { localClippingEnabled: true },
        add: () =>
            mesh(sphere(), wobbling(standard({ clippingPlanes: planes(), clipShadows: true, side: THREE.DoubleSide }))),
    },
    'clippingPlanes, intersected, with one of the renderer': {
        renderer: { localClippingEnabled: true, clippingPlanes: [new THREE.Plane(new THREE.Vector3(0, 0, -1), 0.4)] },
        add: () =>
            mesh(
                sphere(),
                wobbling(
                    standard({
                        clippingPlanes: planes(),
                        clipShadows: true,
                        clipIntersection: true,
                        side: THREE.DoubleSide,
                    }),
                ),
            ),
    },
    'clippingPlanes, not in shadows': {
        renderer: { localClippingEnabled: true },
        add: () => mesh(sphere(), wobbling(standard({ clippingPlanes: planes() }))),
    },
    'point light': {
        lights: ['point'],
        add: () =>
            [2, -2].flatMap((x) =>
                [2, -2].map((z) => {
                    const of = mesh(sphere(), wind());
                    of.position.set(x, 0.3 * z, z * 0.8);
                    return of;
                }),
            ),
    },
    VSM: { type: THREE.VSMShadowMap, add: () => mesh(sphere(), wobbling(standard())) },
    'basic shadow maps': { type: THREE.BasicShadowMap, add: () => mesh(sphere(), wobbling(standard())) },
    'logarithmic depth': {
        context: { logarithmicDepthBuffer: true },
        lights: ['directional', 'spot'],
        add: () => mesh(sphere(), wobbling(standard())),
    },
    // three.js's distance material, and what reads its map, have no logarithmic depth: this material moves nothing at this time, and has to leave the same depths.
    'logarithmic depth, point light': {
        context: { logarithmicDepthBuffer: true },
        lights: ['point'],
        add: () => {
            const material = standard();
            material.onBeforeCompile = (shader) => {
                shader.uniforms.time = TIME;
                shader.vertexShader = `uniform float time;\n${shader.vertexShader.replace('#include <begin_vertex>', '#include <begin_vertex>\ntransformed += normal * min( time, 0.0 );')}`;
            };
            const of = mesh(sphere(), material);
            of.position.set(2, 0, 0.5);
            return of;
        },
    },
    'reversed depth': {
        context: { reversedDepthBuffer: true },
        lights: ['directional', 'spot', 'point'],
        add: () => mesh(sphere(), wobbling(standard())),
    },
    displacementMap: {
        covered: true,
        add: () => mesh(sphere(), standard({ displacementMap: fence(), displacementScale: 0.3 })),
    },
    'colour only by onBeforeCompile': {
        covered: true,
        add: () => {
            const material = standard();
            material.onBeforeCompile = (shader) => {
                shader.fragmentShader = shader.fragmentShader.replace(
                    '#include <dithering_fragment>',
                    'gl_FragColor.r *= 0.5;',
                );
            };
            return mesh(sphere(), material);
        },
    },
    'stock materials': {
        covered: true,
        add: () =>
            apart([
                mesh(box(), standard()),
                mesh(wall(), standard({ map: fence(), alphaTest: 0.5, side: THREE.DoubleSide })),
            ]),
    },
};
