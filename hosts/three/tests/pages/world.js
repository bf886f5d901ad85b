// A scene with a bit of everything that three.js draws: what tests of whole frames look at. Nothing in it moves by itself: `set(time)` does.

import * as THREE from 'three';

/** Numbers from 0 to 1, the same in each run. */
function random(seed) {
    return () => {
        seed = (Math.imul(seed, 1664525) + 1013904223) >>> 0;
        return seed / 4294967296;
    };
}

function checker(alpha) {
    const data = new Uint8Array(16 * 16 * 4);
    for (let i = 0; i < 256; i++) {
        const on = ((i >> 2) ^ (i >> 6)) & 1;
        data.set([200 + 40 * on, 120 + 90 * on, 90, alpha && !on ? 0 : 255], 4 * i);
    }
    const texture = new THREE.DataTexture(data, 16, 16);
    texture.colorSpace = THREE.SRGBColorSpace;
    texture.generateMipmaps = true;
    texture.minFilter = THREE.LinearMipmapLinearFilter;
    texture.magFilter = THREE.LinearFilter;
    texture.needsUpdate = true;
    return texture;
}

const WOBBLE = `
    float wobble = sin(time * 3.0 + position.y * 7.0) * 0.12;
    transformed.xz += wobble * normalize(position.xz + 0.001);`;

/** Materials by name. */
export function materials() {
    const wobbly = new THREE.MeshStandardMaterial({ name: 'wobbly', map: checker(false), roughness: 0.6 });
    wobbly.onBeforeCompile = (shader) => {
        shader.uniforms.time = { value: 0 };
        shader.vertexShader = `uniform float time;\n${shader.vertexShader}`.replace(
            '#include <begin_vertex>',
            `#include <begin_vertex>\n${WOBBLE}`,
        );
        // As many pages do it: whatever compiles the material last is what they set.
        wobbly.userData.shader = shader;
    };
    const waves = new THREE.ShaderMaterial({
        name: 'waves',
        uniforms: { time: { value: 0 }, tint: { value: new THREE.Color('#4488cc') } },
        vertexShader: `uniform float time; varying vec3 vAt;
            void main() { vec3 p = position; p.z += 0.1 * sin(time * 2.0 + p.x * 9.0); vAt = p; gl_Position = projectionMatrix * viewMatrix * modelMatrix * vec4(p, 1.0); }`,
        fragmentShader: `uniform vec3 tint; varying vec3 vAt;
            void main() { float s = 0.0; for (int i = 0; i < 8; i++) s += sin(vAt.x * float(i + 3)) * cos(vAt.y * float(i + 5)); gl_FragColor = vec4(tint * (0.6 + 0.05 * s), 1.0); }`,
        side: THREE.DoubleSide,
    });
    const lit = new THREE.ShaderMaterial({
        name: 'lit',
        lights: true,
        uniforms: THREE.UniformsUtils.merge([
            THREE.UniformsLib.lights,
            { color: { value: new THREE.Color('#cc9944') } },
        ]),
        vertexShader:
            'varying vec3 vN; void main() { vN = normalMatrix * normal; gl_Position = projectionMatrix * modelViewMatrix * vec4(position, 1.0); }',
        fragmentShader: `#include <common>
            #include <lights_pars_begin>
            uniform vec3 color; varying vec3 vN;
            void main() { vec3 sum = vec3(0.1);
            #if NUM_DIR_LIGHTS > 0
            for (int i = 0; i < NUM_DIR_LIGHTS; i++) sum += directionalLights[i].color * max(0.0, dot(normalize(vN), directionalLights[i].direction));
            #endif
            gl_FragColor = vec4(color * sum * 0.3, 1.0); }`,
    });
    const wind = new THREE.UniformsGroup();
    wind.setName('Wind');
    wind.add(new THREE.Uniform(0)).add(new THREE.Uniform(new THREE.Vector3(0.2, 0.1, 0)));
    const reed = new THREE.ShaderMaterial({
        name: 'reed',
        uniformsGroups: [wind],
        vertexShader: `layout(std140) uniform Wind { float lean; vec3 towards; };
            varying float vAt; void main() { vec3 p = position + towards * lean * (position.y + 0.5); vAt = p.y; gl_Position = projectionMatrix * modelViewMatrix * vec4(p, 1.0); }`,
        fragmentShader: 'varying float vAt; void main() { gl_FragColor = vec4(0.3, 0.5 + 0.2 * vAt, 0.1, 1.0); }',
        side: THREE.DoubleSide,
    });
    return {
        wobbly,
        waves,
        reed,
        lit,
        fence: new THREE.MeshStandardMaterial({
            name: 'fence',
            map: checker(true),
            alphaTest: 0.5,
            side: THREE.DoubleSide,
        }),
        phong: new THREE.MeshPhongMaterial({ name: 'phong', color: '#88aa66', shininess: 60 }),
        many: new THREE.MeshLambertMaterial({ name: 'many', color: '#aa6688' }),
        bony: new THREE.MeshStandardMaterial({ name: 'bony', color: '#cccccc', metalness: 0.4 }),
        batch: new THREE.MeshStandardMaterial({ name: 'batch', color: '#6677bb' }),
        side: new THREE.MeshBasicMaterial({ name: 'side', color: '#557799' }),
        glass: new THREE.MeshStandardMaterial({ name: 'glass', color: '#ff8888', transparent: true, opacity: 0.4 }),
    };
}

/** A tube of two bones, with a morph target. */
function skinned(material) {
    const geometry = new THREE.CylinderGeometry(0.3, 0.3, 2, 16, 12);
    const { position } = geometry.attributes;
    const [index, weight, morph] = [[], [], []];
    for (let i = 0; i < position.count; i++) {
        const w = THREE.MathUtils.clamp(position.getY(i) / 2 + 0.5, 0, 1);
        index.push(0, 1, 0, 0);
        weight.push(1 - w, w, 0, 0);
        morph.push(position.getX(i) * 1.5, position.getY(i), position.getZ(i));
    }
    geometry.setAttribute('skinIndex', new THREE.Uint16BufferAttribute(index, 4));
    geometry.setAttribute('skinWeight', new THREE.Float32BufferAttribute(weight, 4));
    geometry.morphAttributes.position = [new THREE.Float32BufferAttribute(morph, 3)];
    const mesh = new THREE.SkinnedMesh(geometry, material);
    const [lower, upper] = [new THREE.Bone(), new THREE.Bone()];
    lower.position.y = -1;
    upper.position.y = 1;
    lower.add(upper);
    mesh.add(lower);
    mesh.updateMorphTargets();
    mesh.bind(new THREE.Skeleton([lower, upper]));
    return { mesh, upper };
}

export function world() {
    const of = materials();
    const scene = new THREE.Scene();
    scene.background = new THREE.Color('#223344');
    const next = random(5);
    const add = (geometry, material, x, y, z) => {
        const mesh = new THREE.Mesh(geometry, material);
        mesh.position.set(x, y, z);
        mesh.castShadow = mesh.receiveShadow = true;
        scene.add(mesh);
        return mesh;
    };
    const ball = new THREE.SphereGeometry(0.7, 24, 16);
    for (let i = 0; i < 5; i++) add(ball, of.wobbly, -2 + i, 0, -i * 0.8);
    add(new THREE.PlaneGeometry(7, 5, 30, 20), of.waves, 0, 0, -4.5);
    const spun = add(new THREE.BoxGeometry(), of.lit, 1.4, 1.1, 0);
    for (let i = 0; i < 3; i++) add(new THREE.PlaneGeometry(3, 1.6), of.fence, i - 1, -0.7, 0.9 - 0.5 * i);
    add(new THREE.TorusKnotGeometry(0.5, 0.16, 64, 12), of.phong, -1.6, 1.2, 0.3).scale.x = -1;
    add(
        new THREE.BoxGeometry(0.7, 0.7, 0.7),
        Array.from({ length: 6 }, (_, i) => (i % 2 ? of.side : of.phong)),
        2.2,
        -0.3,
        0.4,
    );
    add(new THREE.PlaneGeometry(0.5, 1.4, 2, 8), of.reed, -1.4, -1.1, 1.3);
    const instances = new THREE.InstancedMesh(new THREE.BoxGeometry(0.3, 0.3, 0.3), of.many, 60);
    const at = new THREE.Object3D();
    const place = (i, time) => {
        at.position.set(Math.sin(i * 2.4 + time) * 2.6, Math.cos(i * 1.7) * 1.8, -3.5 + (i % 9) * 0.4);
        at.rotation.set(i, time + i, 0);
        at.updateMatrix();
        return at.matrix;
    };
    scene.add(instances);
    const { mesh: tube, upper } = skinned(of.bony);
    tube.position.set(0.2, 0.2, 0.2);
    scene.add(tube);
    const batched = new THREE.BatchedMesh(12, 2000, 4000, of.batch);
    const shapes = [new THREE.ConeGeometry(0.25, 0.6, 12), new THREE.SphereGeometry(0.22, 10, 8)].map((g) =>
        batched.addGeometry(g),
    );
    const placed = Array.from({ length: 12 }, (_, i) => batched.addInstance(shapes[i % 2]));
    scene.add(batched);
    add(ball, of.glass, -0.6, -0.2, 1.6);
    const sun = new THREE.DirectionalLight('#ffffff', 2.5);
    sun.position.set(2, 4, 3);
    sun.castShadow = true;
    sun.shadow.mapSize.set(256, 256);
    scene.add(sun, new THREE.HemisphereLight('#aaccff', '#443322', 1.2));
    const camera = new THREE.PerspectiveCamera(55, 1, 0.1, 50);
    camera.position.set(0, 0.4, 5);
    for (let i = 0; i < 8; i++) next();
    /** As the scene is at that time. */
    const set = (time) => {
        of.waves.uniforms.time.value = time;
        of.reed.uniformsGroups[0].uniforms[0].value = Math.sin(time * 2);
        if (of.wobbly.userData.shader) of.wobbly.userData.shader.uniforms.time.value = time;
        spun.rotation.set(time, time * 0.7, 0);
        for (let i = 0; i < instances.count; i++) instances.setMatrixAt(i, place(i, time * 0.3));
        instances.instanceMatrix.needsUpdate = true;
        placed.forEach((id, i) => {
            at.position.set(-2.4 + 0.45 * i, 1.9 + 0.1 * Math.sin(time * 2 + i), -1 + (i % 3) * 0.6);
            at.rotation.set(0, 0, time + i);
            at.updateMatrix();
            batched.setMatrixAt(id, at.matrix);
        });
        upper.rotation.z = 0.5 * Math.sin(time);
        tube.morphTargetInfluences[0] = 0.5 + 0.5 * Math.sin(time * 1.3);
        camera.position.x = 0.6 * Math.sin(time * 0.5);
        camera.lookAt(0, 0, -1);
    };
    set(0);
    return { scene, camera, materials: of, set, sun, objects: { spun, instances, tube, batched } };
}
