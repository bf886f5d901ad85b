// Small scenes that three.js exports as glTF, each for a part of the format.

import * as THREE from 'three';

/** A checked texture with a gradient, drawn on a canvas. */
function picture(colors, repeat = 1) {
    const canvas = document.createElement('canvas');
    canvas.width = canvas.height = 128;
    const context = canvas.getContext('2d');
    for (let i = 0; i < 64; i++) {
        context.fillStyle = colors[(i + (i >> 3)) % colors.length];
        context.fillRect((i % 8) * 16, (i >> 3) * 16, 16, 16);
    }
    const texture = new THREE.CanvasTexture(canvas);
    texture.wrapS = texture.wrapT = THREE.RepeatWrapping;
    texture.repeat.set(repeat, repeat);
    return texture;
}

const standard = (values) => new THREE.MeshStandardMaterial(values);
const srgb = (texture) => Object.assign(texture, { colorSpace: THREE.SRGBColorSpace });

export const SCENES = {
    /** Metals and roughnesses. */
    spheres() {
        const scene = new THREE.Scene();
        const sphere = new THREE.SphereGeometry(0.45, 48, 32);
        for (let x = 0; x < 5; x++)
            for (let y = 0; y < 3; y++) {
                const material = standard({ color: 0xd8a860, metalness: y / 2, roughness: 0.1 + x * 0.2 });
                const mesh = new THREE.Mesh(sphere, material);
                mesh.position.set(x - 2, y - 1, 0);
                scene.add(mesh);
            }
        return scene;
    },
    /** Moved texture coordinates, cut-outs from both sides, and glass. */
    layers() {
        const scene = new THREE.Scene();
        const checks = srgb(picture(['#b04030', '#e8d8b0', '#506080'], 3));
        checks.offset.set(0.2, 0.1);
        checks.rotation = 0.4;
        const box = new THREE.Mesh(new THREE.BoxGeometry(1.4, 1.4, 1.4), standard({ map: checks, roughness: 0.7 }));
        box.rotation.y = 0.5;
        scene.add(box);
        const holes = srgb(picture(['rgba(60, 140, 60, 1)', 'rgba(60, 140, 60, 0)']));
        const leaves = new THREE.Mesh(
            new THREE.PlaneGeometry(1.6, 1.6),
            standard({ map: holes, alphaTest: 0.5, side: THREE.DoubleSide }),
        );
        leaves.position.set(1.5, 0, 0.4);
        leaves.rotation.y = 2.6;
        scene.add(leaves);
        const glass = new THREE.Mesh(
            new THREE.SphereGeometry(0.6, 32, 24),
            standard({ color: 0x80b0ff, transparent: true, opacity: 0.4, roughness: 0.2 }),
        );
        glass.position.set(-0.9, 0.2, 1.2);
        scene.add(glass);
        return scene;
    },
    /** A camera, a sun, a lamp and a hierarchy. */
    lamps() {
        const scene = new THREE.Scene();
        const floor = new THREE.Mesh(
            new THREE.PlaneGeometry(8, 8, 8, 8),
            standard({ color: 0x909080, roughness: 0.9 }),
        );
        floor.rotation.x = -Math.PI / 2;
        scene.add(floor);
        const arm = new THREE.Group();
        arm.position.set(0, 0.6, 0);
        for (let i = 0; i < 6; i++) {
            const turned = new THREE.Group();
            turned.rotation.y = (i * Math.PI) / 3;
            const knot = new THREE.Mesh(
                new THREE.TorusKnotGeometry(0.35, 0.12, 96, 16),
                standard({ color: new THREE.Color().setHSL(i / 6, 0.6, 0.5), metalness: 0.3, roughness: 0.4 }),
            );
            knot.position.x = 1.8;
            turned.add(knot);
            arm.add(turned);
        }
        scene.add(arm);
        const lamp = new THREE.PointLight(0xffc080, 12, 9, 2);
        lamp.position.set(0, 1.6, 0);
        const sun = new THREE.DirectionalLight(0xc0d0ff, 0.8);
        sun.position.set(0, 0, 0);
        sun.rotation.set(-0.9, 0.5, 0);
        sun.target.position.set(0, 0, -1);
        sun.add(sun.target);
        scene.add(lamp, sun);
        const camera = new THREE.PerspectiveCamera(45, 16 / 9, 0.1, 50);
        camera.position.set(2.5, 3, 5);
        camera.lookAt(0, 0.5, 0);
        scene.add(camera);
        return scene;
    },
    /** Vertex colours, an emissive and an unlit material, points, lines, and a mirrored node. */
    signs() {
        const scene = new THREE.Scene();
        const cone = new THREE.ConeGeometry(0.6, 1.4, 24, 4);
        const at = cone.attributes.position;
        const colors = new Float32Array(at.count * 3);
        for (let i = 0; i < at.count; i++) colors.set([0.5 + at.getX(i), 0.5 + at.getY(i) / 1.4, 0.6], i * 3);
        cone.setAttribute('color', new THREE.BufferAttribute(colors, 3));
        const colored = new THREE.Mesh(cone, standard({ vertexColors: true, roughness: 0.6 }));
        colored.position.x = -1.6;
        const mirrored = colored.clone();
        mirrored.position.x = 1.6;
        mirrored.scale.set(-1, 0.8, 1);
        scene.add(colored, mirrored);
        const glowing = new THREE.Mesh(
            new THREE.IcosahedronGeometry(0.6, 0),
            standard({ color: 0x202020, emissive: 0xff6020, emissiveIntensity: 0.7, flatShading: true }),
        );
        scene.add(glowing);
        const flat = new THREE.Mesh(
            new THREE.TorusGeometry(0.5, 0.15, 12, 32),
            new THREE.MeshBasicMaterial({ color: 0x40c0a0 }),
        );
        flat.position.set(0, 1.3, 0);
        scene.add(flat);
        const edges = new THREE.LineSegments(
            new THREE.EdgesGeometry(new THREE.BoxGeometry(4.6, 3.2, 1.6)),
            new THREE.LineBasicMaterial({ color: 0xe0e040 }),
        );
        edges.position.y = 0.4;
        scene.add(edges);
        return scene;
    },
    /** Many copies of one mesh. */
    copies() {
        const scene = new THREE.Scene();
        const count = 300;
        const mesh = new THREE.InstancedMesh(
            new THREE.BoxGeometry(0.3, 0.3, 0.3),
            standard({ color: 0x70a0c8, roughness: 0.5 }),
            count,
        );
        const dummy = new THREE.Object3D();
        for (let i = 0; i < count; i++) {
            dummy.position.set((i % 20) * 0.5 - 4.75, Math.sin(i * 0.7) * 0.4, Math.floor(i / 20) * 0.5 - 3.5);
            dummy.rotation.set(i * 0.1, i * 0.3, 0);
            dummy.scale.setScalar(0.6 + 0.4 * Math.sin(i));
            dummy.updateMatrix();
            mesh.setMatrixAt(i, dummy.matrix);
        }
        mesh.position.y = 1;
        scene.add(mesh);
        return scene;
    },
};
