// Materials of other packages, as their pages use them: shadow maps by preshade against the whole programs, and a pass that is not three.js's.

import * as THREE from 'three';
import { MToonMaterial } from '@pixiv/three-vrm-materials-mtoon';
import { ProjectedMaterial } from '@lume/three-projected-material/dist/ProjectedMaterial.js';
import { InstancedMesh2 } from '@three.ez/instanced-mesh';
import { MeshLineGeometry, MeshLineMaterial } from 'meshline';
import { EffectComposer, NormalPass, OverrideMaterialManager, RenderPass } from 'postprocessing';
import CustomShaderMaterial from 'three-custom-shader-material/vanilla';
import { InstancedUniformsMesh } from 'three-instanced-uniforms-mesh';
import { BezierMesh } from 'troika-three-utils';
import { Preshade } from 'preshade-three';
import { fence, lit, standard, TIME, wobbling } from './lib/cases.js';
import { colours, differing, settle } from './lib/depths.js';
import { open, run } from './lib/run.js';
import { whole } from './lib/whole.js';

const sphere = () => new THREE.SphereGeometry(0.8, 24, 16);

const cases = {
    'three-custom-shader-material': {
        add: () =>
            new THREE.Mesh(
                sphere(),
                new CustomShaderMaterial({
                    baseMaterial: THREE.MeshPhysicalMaterial,
                    uniforms: { time: TIME },
                    vertexShader: `
                        uniform float time;
                        varying vec2 vAt;
                        void main() {
                            vAt = uv;
                            csm_Position += normal * sin( time + position.y * 6.0 ) * 0.2;
                        }`,
                    fragmentShader: `
                        varying vec2 vAt;
                        void main() {
                            if ( fract( vAt.x * 8.0 ) < 0.3 ) discard;
                            csm_DiffuseColor = vec4( vAt, 0.5, 1.0 );
                        }`,
                }),
            ),
    },
    '@pixiv/three-vrm-materials-mtoon': {
        add: () => {
            const geometry = sphere();
            geometry.addGroup(0, Infinity, 0);
            geometry.addGroup(0, Infinity, 1);
            const outline = new MToonMaterial({ outlineWidthMode: 'worldCoordinates', outlineWidthFactor: 0.15 });
            outline.isOutline = true;
            outline.side = THREE.BackSide;
            return new THREE.Mesh(geometry, [new MToonMaterial(), outline]);
        },
    },
    meshline: {
        add: () => {
            const geometry = new MeshLineGeometry();
            geometry.setPoints(
                Array.from({ length: 40 }, (_, i) => [Math.sin(i / 4), i / 20 - 1, Math.cos(i / 4)]).flat(),
            );
            const material = new MeshLineMaterial({
                lineWidth: 0.25,
                resolution: new THREE.Vector2(96, 96),
                side: THREE.DoubleSide,
            });
            return new THREE.Mesh(geometry, material);
        },
    },
    '@three.ez/instanced-mesh': {
        add: (scene, camera, renderer) => {
            const mesh = new InstancedMesh2(new THREE.BoxGeometry(1, 1, 1, 6, 6, 6), wobbling(standard()), {
                capacity: 4,
                renderer,
            });
            mesh.addInstances(3, ({ position, scale }, i) => {
                position.set(i * 1.3 - 1.3, i * 0.3, 0);
                scale.setScalar(0.6);
            });
            return mesh;
        },
    },
    // It has depth materials of its own, which lack what this material does.
    'three-instanced-uniforms-mesh': {
        options: { replaceCustom: true },
        add: () => {
            const material = new THREE.ShaderMaterial({
                uniforms: { shift: { value: new THREE.Vector3() } },
                vertexShader: `
                    uniform vec3 shift;
                    varying vec2 vUv;
                    void main() {
                        vUv = uv;
                        gl_Position = projectionMatrix * modelViewMatrix * instanceMatrix * vec4( position + shift * uv.x, 1.0 );
                    }`,
                fragmentShader: 'varying vec2 vUv; void main() { gl_FragColor = vec4( vUv, 0.0, 1.0 ); }',
            });
            const mesh = new InstancedUniformsMesh(new THREE.BoxGeometry(), material, 3);
            for (let i = 0; i < 3; i++) {
                mesh.setMatrixAt(
                    i,
                    new THREE.Matrix4().makeTranslation(i * 1.5 - 1.5, 0, 0).scale(new THREE.Vector3(0.6, 0.6, 0.6)),
                );
                mesh.setUniformAt('shift', i, new THREE.Vector3(0.3 * i, 0.5, 0.2));
            }
            return mesh;
        },
    },
    '@lume/three-projected-material': {
        add: () =>
            new THREE.Mesh(
                sphere(),
                new ProjectedMaterial({ camera: new THREE.PerspectiveCamera(45, 1, 0.1, 9), texture: fence() }),
            ),
    },
    // It has depth materials of its own, which stay.
    'troika-three-utils': {
        add: () => {
            const mesh = new BezierMesh();
            mesh.pointA.set(-1.2, -0.5, 0);
            mesh.controlA.set(-0.5, 1.5, 0.5);
            mesh.controlB.set(0.5, -1.5, -0.5);
            mesh.pointB.set(1.2, 0.8, 0);
            mesh.radius = 0.15;
            return mesh;
        },
    },
};

const renderer = open();
globalThis.runPackage = (name) => run(renderer, cases[name]);

/** The pass of normals in the package postprocessing, which puts materials of its own into objects. */
globalThis.runNormalPass = async (isSwapped) => {
    OverrideMaterialManager.workaroundEnabled = isSwapped;
    const SIZE = 96;
    const scene = new THREE.Scene();
    const camera = new THREE.PerspectiveCamera(50, 1, 0.5, 12);
    camera.position.set(0, 2, 6);
    camera.lookAt(0, 0, 0);
    scene.add(new THREE.HemisphereLight());
    const add = (geometry, material, x) => {
        const mesh = new THREE.Mesh(geometry, material);
        mesh.position.x = x;
        scene.add(mesh);
    };
    add(sphere(), wobbling(standard()), -1);
    add(new THREE.PlaneGeometry(2, 2, 8, 8), lit(), 1.2);
    const composer = new EffectComposer(renderer);
    const normals = new NormalPass(scene, camera);
    composer.addPass(normals);
    composer.addPass(new RenderPass(scene, camera));
    composer.setSize(SIZE, SIZE);
    const render = () => composer.render(0.01);
    const read = () => colours(renderer, { texture: normals.texture, width: SIZE, height: SIZE });
    render();
    render();
    const before = read();
    const draw = whole(renderer, scene);
    const { render: original } = renderer;
    renderer.render = (drawn, view) => {
        const isOwn =
            drawn === scene &&
            (scene.overrideMaterial || scene.children.some(({ material }) => material?.isMeshNormalMaterial));
        if (isOwn) draw(drawn, () => original.call(renderer, drawn, view));
        else original.call(renderer, drawn, view);
    };
    render();
    renderer.render = original;
    const expected = read();
    draw.dispose();
    const preshade = await Preshade.of(renderer, { cache: false });
    preshade.override(normals);
    await settle(preshade, render);
    const drawn = read();
    const report = preshade.report();
    preshade.dispose();
    render();
    return {
        differ: differing(drawn, expected),
        moved: differing(drawn, before),
        restored: differing(read(), before),
        report,
    };
};
globalThis.names = Object.keys(cases);
globalThis.ready = true;
