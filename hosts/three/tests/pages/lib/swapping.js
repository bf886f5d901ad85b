// Passes and pages that put materials into objects, or share one overriding material between objects.

import * as THREE from 'three';
import { Preshade } from 'preshade-three';
import { standard, TIME, wobbling } from './cases.js';
import { colours, differing, settle } from './depths.js';
import { whole } from './whole.js';

const SIZE = 96;
const sphere = new THREE.SphereGeometry(0.7, 24, 16);

/** Two spheres with one wobbling material. */
function stage() {
    const scene = new THREE.Scene();
    const camera = new THREE.PerspectiveCamera(50, 1, 0.5, 12);
    camera.position.set(0, 1, 5);
    camera.lookAt(0, 0, 0);
    scene.add(new THREE.HemisphereLight());
    const material = wobbling(new THREE.MeshBasicMaterial({ color: 0x808080 }));
    const meshes = [-0.9, 0.9].map((x) => {
        const mesh = new THREE.Mesh(sphere, material);
        mesh.position.x = x;
        scene.add(mesh);
        return mesh;
    });
    return { scene, camera, meshes, material };
}

/** A pass that draws into targets of its own; `draw(render)` once for each. `read()` is all that the last frame wrote. */
function passOf(renderer, { scene, camera }, ...draws) {
    const targets = draws.map(() => new THREE.WebGLRenderTarget(SIZE, SIZE));
    const pass = {
        disposed: 0,
        /** What is drawn in place of the scene. */
        instead: (scene, render) => render(),
        render() {
            draws.forEach((draw, i) => {
                renderer.setRenderTarget(targets[i]);
                draw(() => this.instead(scene, () => renderer.render(scene, camera)));
            });
            renderer.setRenderTarget(null);
        },
        dispose() {
            this.disposed++;
            for (const target of targets) target.dispose();
        },
    };
    const read = () => targets.flatMap((target) => [...colours(renderer, target)]);
    return { pass, read };
}

/** Frames of the page: the scene, and then the pass. */
function frames(renderer, { scene, camera }, pass) {
    const render = () => {
        renderer.render(scene, camera);
        pass.render();
    };
    render();
    render();
    return render;
}

/** What the pass writes if the authors' whole programs draw. */
function wholes(renderer, scene, pass, render, read) {
    const own = pass.instead;
    const draw = whole(renderer, scene);
    pass.instead = draw;
    render();
    pass.instead = own;
    draw.dispose();
    return read();
}

const open = (renderer) => Preshade.of(renderer, { cache: false });
const flat = (color, more) => new THREE.MeshBasicMaterial({ color, ...more });

/** A pass that puts a material of its own into each mesh, and what was there back. */
const swapping = (meshes, materials) => (render) => {
    const authors = meshes.map(({ material }) => material);
    meshes.forEach((mesh, i) => (mesh.material = materials[i]));
    render();
    meshes.forEach((mesh, i) => (mesh.material = authors[i]));
};

/** It wobbles, and shows a normal that meets no light. */
const bare = () =>
    new THREE.ShaderMaterial({
        uniforms: { time: TIME },
        vertexShader: `
            uniform float time;
            varying vec3 vNormal;
            void main() {
                vNormal = normalMatrix * normal;
                vec3 moved = position * ( 1.0 + 0.2 * sin( time + position.y * 5.0 ) );
                gl_Position = projectionMatrix * modelViewMatrix * vec4( moved, 1.0 );
            }`,
        fragmentShader: `
            varying vec3 vNormal;
            void main() {
                vec3 viewNormal = normalize( vNormal );
                gl_FragColor = vec4( viewNormal * 0.5 + 0.5, 1.0 );
            }`,
    });

const overriding = (scene, material) => (render) => {
    scene.overrideMaterial = material;
    render();
    scene.overrideMaterial = null;
};

export const scenarios = {
    async 'a page that swaps a material'(renderer) {
        const all = stage();
        const { meshes, material } = all;
        const { pass, read } = passOf(renderer, all, (render) => render());
        const highlight = flat(0xff0000);
        // The pass draws the scene itself, as SSRPass does, and nothing else does.
        const render = () => pass.render();
        render();
        meshes[0].material = highlight;
        render();
        const expected = read();
        meshes[0].material = material;
        const preshade = await open(renderer);
        preshade.override(pass);
        await settle(preshade, render);
        // On, off and on again.
        for (const each of [highlight, material, highlight]) {
            meshes[0].material = each;
            await settle(preshade, render);
        }
        const result = { differ: differing(read(), expected), rows: preshade.report().length };
        preshade.dispose();
        pass.dispose();
        return { ...result, drawn: expected.some((value, i) => i % 4 === 0 && value === 1) };
    },

    async 'a page that swaps a material in onBeforeRender'(renderer) {
        const all = stage();
        const { meshes, material } = all;
        const { pass, read } = passOf(
            renderer,
            all,
            (render) => render(),
            (render) => render(),
        );
        const highlight = flat(0xff0000);
        meshes[0].onBeforeRender = function () {
            if (renderer.getRenderTarget()) this.material = this.material === material ? highlight : material;
        };
        const render = frames(renderer, all, pass);
        const expected = read();
        const preshade = await open(renderer);
        preshade.override(pass);
        await settle(preshade, render);
        const result = { differ: differing(read(), expected), rows: preshade.report().length };
        preshade.dispose();
        pass.dispose();
        return { ...result, drawn: expected.some((value, i) => i % 4 === 0 && value === 1) };
    },

    async 'a pass that swaps materials, and a page that swaps them too'(renderer) {
        const all = stage();
        const { scene, meshes } = all;
        const other = wobbling(new THREE.MeshBasicMaterial());
        const { onBeforeCompile } = other;
        other.onBeforeCompile = (shader) => {
            onBeforeCompile(shader);
            shader.vertexShader = shader.vertexShader.replace('* 0.2', '* 0.4');
        };
        other.customProgramCacheKey = () => 'other';
        const { pass, read } = passOf(renderer, all, swapping(meshes, [flat(0xffffff), flat(0x000000)]), (render) =>
            render(),
        );
        const render = frames(renderer, all, pass);
        const threes = read();
        const preshade = await open(renderer);
        preshade.override(pass);
        await settle(preshade, render);
        const found = [];
        const check = () => found.push(differing(read(), wholes(renderer, scene, pass, render, read)));
        check();
        const moved = differing(read(), threes);
        meshes[0].material = other;
        await settle(preshade, render);
        render();
        check();
        // Both variants are there: the very next frame has the right one, although the pass may be the first that draws it.
        meshes[0].material = meshes[1].material;
        pass.render();
        check();
        const result = { differ: Math.max(...found), checks: found.length, moved };
        result.states = [...new Set(preshade.report().map(({ state }) => state))];
        preshade.dispose();
        pass.dispose();
        return result;
    },

    async 'one overriding material, whose colour changes from object to object'(renderer) {
        const all = stage();
        const { scene, meshes } = all;
        const shared = [flat(0xffffff), flat(0x000000)];
        const { pass, read } = passOf(renderer, all, swapping(meshes, shared), overriding(scene, shared[0]));
        const render = frames(renderer, all, pass);
        const expected = wholes(renderer, scene, pass, render, read);
        const preshade = await open(renderer);
        preshade.override(pass);
        await settle(preshade, render);
        const result = { differ: differing(read(), expected), states: preshade.report().map(({ state }) => state) };
        preshade.dispose();
        pass.dispose();
        return result;
    },

    async 'overriding materials that are transparent or in a fog'(renderer) {
        const all = stage();
        const { scene } = all;
        scene.fog = new THREE.Fog(0x00ff00, 3, 6);
        const env = new THREE.CubeTexture();
        const overrides = [
            new THREE.MeshNormalMaterial({ transparent: true, opacity: 0.5 }),
            flat(0xff0000, { transparent: true, opacity: 0.5, fog: false }),
            flat(0xff0000),
            flat(0xff0000, { fog: false, envMap: env }),
        ];
        const result = { differ: [], reasons: [] };
        for (const override of overrides) {
            const { pass, read } = passOf(renderer, all, overriding(scene, override));
            const render = frames(renderer, all, pass);
            const expected = read();
            const preshade = await open(renderer);
            preshade.override(pass);
            await settle(preshade, render);
            result.differ.push(differing(read(), expected));
            result.reasons.push(preshade.report().map(({ reason }) => reason));
            preshade.dispose();
            pass.dispose();
        }
        return result;
    },

    async 'a pass that is disposed of, or let go'(renderer) {
        const all = stage();
        const { scene } = all;
        const { pass, read } = passOf(renderer, all, overriding(scene, new THREE.MeshNormalMaterial()));
        const { render: draw, dispose } = pass;
        const render = frames(renderer, all, pass);
        const threes = read();
        const preshade = await open(renderer);
        const with_ = async (options) => {
            preshade.override(pass, options);
            await settle(preshade, render);
            return { moved: differing(read(), threes), rows: preshade.report().length };
        };
        const is = () => ({
            isOwn: pass.render === draw && pass.dispose === dispose,
            rows: preshade.report().length,
            differ: (render(), differing(read(), threes)),
        });
        const result = { on: [await with_()] };
        // Twice is once.
        result.on.push(await with_());
        preshade.override(pass, false);
        result.off = [is()];
        result.on.push(await with_());
        pass.dispose();
        result.disposed = pass.disposed;
        result.off.push(is());
        result.on.push(await with_());
        preshade.dispose();
        result.off.push(is());
        result.disposedAfter = pass.disposed;
        pass.dispose();
        return result;
    },

    async 'back faces of a program that does not turn its normal'(renderer) {
        const all = stage();
        const { scene, meshes } = all;
        const [mesh, other] = meshes;
        scene.remove(other);
        // A bowl: the viewer sees its inside.
        mesh.geometry = new THREE.SphereGeometry(1, 24, 16, 0, 2 * Math.PI, Math.PI / 2, Math.PI / 2);
        mesh.material = new THREE.ShaderMaterial({
            side: THREE.DoubleSide,
            vertexShader:
                'varying vec3 vAt; void main() { vAt = normalMatrix * normal; gl_Position = projectionMatrix * modelViewMatrix * vec4(position, 1.0); }',
            fragmentShader:
                'varying vec3 vAt; void main() { gl_FragColor = vec4(vec3(dot(normalize(vAt), vec3(0.3, 0.9, 0.3))), 1.0); }',
        });
        const override = new THREE.MeshNormalMaterial({ side: THREE.DoubleSide });
        const { pass, read } = passOf(renderer, all, overriding(scene, override));
        const render = frames(renderer, all, pass);
        pass.render();
        const expected = read();
        const preshade = await open(renderer);
        preshade.override(pass);
        await settle(preshade, render);
        const drawn = read();
        const [{ state }] = preshade.report();
        const most = drawn.reduce((max, value, i) => Math.max(max, Math.abs(value - expected[i])), 0);
        const pixels = expected.filter((value) => value !== 0).length;
        preshade.dispose();
        pass.dispose();
        return { state, most, pixels };
    },

    async 'where normals come from'(renderer) {
        const all = stage();
        const { scene, meshes } = all;
        const [mesh, other] = meshes;
        scene.remove(other);
        const override = overriding(scene, new THREE.MeshNormalMaterial());
        const { pass, read } = passOf(renderer, all, override);
        const draw = () => pass.render();
        const [round, flatShaded] = [wobbling(standard()), wobbling(standard({ flatShading: true }))];
        const plain = bare();
        const own = () => {
            const { pass, read } = passOf(renderer, all, (render) => render());
            pass.render();
            const found = read();
            pass.dispose();
            return found;
        };
        const three = () => (pass.render(), read());
        const program = (material) => () => {
            mesh.material = material;
            renderer.render(scene, all.camera);
            const found = wholes(renderer, scene, pass, draw, read);
            return found;
        };
        const asked = [];
        const ask = (material) => (asked.push(material.uuid), 'faces');
        const found = [];
        for (const [material, from, expect] of [
            [round, undefined, program(round)],
            [round, 'faces', program(flatShaded)],
            [round, ask, program(flatShaded)],
            [plain, undefined, own],
            [plain, 'program', three],
            [plain, 'viewNormal', own],
        ]) {
            mesh.material = material;
            const render = frames(renderer, all, pass);
            const expected = expect();
            mesh.material = material;
            const preshade = await open(renderer);
            preshade.override(pass, { normals: from });
            await settle(preshade, render);
            const drawn = read();
            const [{ state, normals, note, code }] = preshade.report();
            const most = drawn.reduce((max, value, i) => Math.max(max, Math.abs(value - expected[i])), 0);
            found.push({ state, normals, note: note ?? null, code, differ: differing(drawn, expected), most });
            preshade.dispose();
        }
        pass.dispose();
        return { found, asked: asked.length };
    },
};
