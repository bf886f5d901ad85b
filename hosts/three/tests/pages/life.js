// Pages as they live: lights, fog and targets that change, objects that come and go, lost contexts.

import * as THREE from 'three';
import { EffectComposer } from 'three/addons/postprocessing/EffectComposer.js';
import { OutputPass } from 'three/addons/postprocessing/OutputPass.js';
import { RenderPass } from 'three/addons/postprocessing/RenderPass.js';
import { Preshade } from 'preshade-three';
import { standard, TIME, wobbling } from './lib/cases.js';
import { differing, picture, reference, settle, shadowDepths } from './lib/depths.js';
import { open, renderer, sphere, stage, states } from './lib/stage.js';

const scenarios = {
    async EffectComposer() {
        const { scene, camera, light, ground, differ, material } = stage();
        const composer = new EffectComposer(renderer);
        composer.addPass(new RenderPass(scene, camera));
        composer.addPass(new OutputPass());
        const render = () => composer.render(0.01);
        const alone = () => {
            ground.visible = false;
            render();
            ground.visible = true;
            return picture(renderer);
        };
        render();
        const before = alone();
        const preshade = await open();
        preshade.shadows(scene);
        await settle(preshade, render);
        const result = { differ: differ(), picture: differing(before, alone()) };
        preshade.dispose();
        material.dispose();
        light.dispose();
        composer.dispose();
        return result;
    },

    async 'lights, fog and an environment change'() {
        const { scene, light, render, differ } = stage();
        const preshade = await open();
        preshade.shadows(scene);
        await settle(preshade, render);
        const found = [differ()];
        // What was drawn by a variant stays so in each frame, while that of the next program is made.
        const change = async (act) => {
            act();
            for (let i = 0; i < 6; i++) {
                render();
                found.push(differ());
            }
            await settle(preshade, render);
            found.push(differ());
        };
        const second = new THREE.PointLight(0xffffff, 10);
        await change(() => scene.add(second));
        await change(() => (scene.fog = new THREE.Fog(0x888888, 1, 20)));
        await change(() => (renderer.toneMapping = THREE.ACESFilmicToneMapping));
        await change(() => scene.remove(second));
        renderer.toneMapping = THREE.NoToneMapping;
        const result = { differ: Math.max(...found), checks: found.length, states: states(preshade) };
        preshade.dispose();
        light.dispose();
        return result;
    },

    async 'the author’s shader of onBeforeCompile'() {
        const { scene, material, render, differ, light } = stage();
        let calls = 0;
        const own = material.onBeforeCompile;
        material.onBeforeCompile = (shader, ...rest) => {
            calls++;
            own(shader, ...rest);
            // As many pages do it: a uniform that is made here, and reached through the shader.
            shader.uniforms.time = { value: 0.2 };
            material.userData.shader = shader;
        };
        render();
        render();
        const before = calls;
        const preshade = await open();
        preshade.shadows(scene);
        await settle(preshade, render);
        const result = { extra: calls - before };
        // The whole program for the other target calls it too.
        differ();
        render();
        const still = shadowDepths(renderer, light);
        material.userData.shader.uniforms.time.value = 1.9;
        render();
        const moved = shadowDepths(renderer, light);
        result.differ = differ();
        result.moves = differing(still, moved);
        preshade.dispose();
        return result;
    },

    async 'objects and materials added later, and outside of the picture'() {
        const { scene, render, differ, mesh } = stage();
        const preshade = await open();
        preshade.shadows(scene);
        await settle(preshade, render);
        const later = new THREE.Mesh(sphere, wobbling(new THREE.MeshPhongMaterial()));
        later.castShadow = true;
        later.position.set(-2, 0, 0);
        scene.add(later);
        await settle(preshade, render);
        const added = differ();
        // Behind the camera, where the light sees it.
        const behind = new THREE.Mesh(sphere, wobbling(new THREE.MeshToonMaterial({ name: 'behind' })));
        behind.castShadow = true;
        behind.position.set(0, -0.5, 8);
        const { light } = { light: scene.children.find(({ isLight }) => isLight) };
        Object.assign(light.shadow.camera, { left: -9, right: 9, top: 9, bottom: -9 });
        light.shadow.camera.updateProjectionMatrix();
        scene.add(behind);
        await settle(preshade, render);
        await settle(preshade, render);
        const result = { added, behind: differ(), rows: preshade.report().filter((row) => row.material === 'behind') };
        result.states = result.rows.map(({ state }) => state);
        preshade.dispose();
        mesh.material.dispose();
        return result;
    },

    async 'the author’s customDepthMaterial'() {
        const { scene, mesh, render, light } = stage();
        mesh.customDepthMaterial = new THREE.MeshDepthMaterial({ side: THREE.DoubleSide });
        render();
        render();
        const before = shadowDepths(renderer, light);
        const preshade = await open();
        preshade.shadows(scene);
        await settle(preshade, render);
        const result = {
            differ: differing(before, shadowDepths(renderer, light)),
            kept: Boolean(mesh.customDepthMaterial),
        };
        preshade.dispose();
        return result;
    },

    async 'a material that changes under two maps on demand, in view and out of it'() {
        const all = stage();
        const { scene, camera, light, mesh, render } = all;
        const other = light.clone();
        scene.add(other);
        const preshade = await open();
        preshade.shadows(scene);
        await settle(preshade, render);
        const lights = [light, other];
        for (const { shadow } of lights) shadow.autoUpdate = false;
        const own = mesh.material.onBeforeCompile;
        const found = [];
        for (const isInView of [true, false]) {
            if (!isInView) camera.rotation.y += Math.PI;
            const before = lights.map((light) => shadowDepths(renderer, light));
            mesh.material.onBeforeCompile = (shader) => {
                own(shader);
                shader.vertexShader = shader.vertexShader.replace('* 0.2', isInView ? '* 0.3' : '* 0.4');
            };
            mesh.material.customProgramCacheKey = () => `in view ${isInView}`;
            mesh.material.needsUpdate = true;
            for (const { shadow } of lights) shadow.needsUpdate = true;
            for (let i = 0; i < 6; i++) render();
            if (!isInView) camera.rotation.y -= Math.PI;
            for (let i = 0; i < 6; i++) render();
            await settle(preshade, render);
            found.push(lights.map((light, i) => differing(before[i], shadowDepths(renderer, light)) > 0));
            found.push(
                lights.map((light) => differing(shadowDepths(renderer, light), reference(renderer, scene, light))),
            );
        }
        const part = preshade.shadows(scene);
        part.enabled = false;
        found.push(states(preshade));
        preshade.dispose();
        return found;
    },

    async 'shadow maps that are drawn on demand'() {
        const { shadowMap } = renderer;
        // As a page has it: once, and never again.
        const once = (of) => Object.assign(of, { autoUpdate: false, needsUpdate: true });
        const ways = {
            'the light’s, before preshade': { before: ({ light }) => once(light.shadow) },
            'all, after': { after: () => once(shadowMap) },
            'from the second frame on': { after: ({ light, render }) => (render(), (light.shadow.autoUpdate = false)) },
        };
        const found = {};
        for (const [name, { before, after }] of Object.entries(ways)) {
            const all = stage();
            const { scene, light, mesh, render, differ } = all;
            // Nothing of this light's map changes.
            const other = new THREE.DirectionalLight(0xffffff, 1);
            other.position.set(-3, 4, 1);
            other.castShadow = true;
            once(other.shadow);
            scene.add(other);
            let draws = new Map();
            mesh.onBeforeShadow = (...given) => draws.set(given[3], (draws.get(given[3]) ?? 0) + 1);
            before?.(all);
            render();
            render();
            const wrong = shadowDepths(renderer, light);
            const preshade = await open();
            preshade.shadows(scene);
            after?.(all);
            await settle(preshade, render);
            const result = { differ: differ(), moved: differing(wrong, shadowDepths(renderer, light)) > 0 };
            const changed = async (act) => {
                draws = new Map();
                act();
                for (let i = 0; i < 6; i++) render();
                await settle(preshade, render);
                return differ();
            };
            // Not drawn again without a reason; and of a material that changed, once the page asks for it.
            result.still = (await changed(() => {}), draws.size);
            const own = mesh.material.onBeforeCompile;
            mesh.material.onBeforeCompile = (shader) => {
                own(shader);
                shader.vertexShader = shader.vertexShader.replace('* 0.2', '* 0.3');
            };
            mesh.material.customProgramCacheKey = () => `on demand ${name}`;
            result.again = await changed(() => {
                mesh.material.needsUpdate = true;
                if (!light.shadow.autoUpdate) light.shadow.needsUpdate = true;
                if (!shadowMap.autoUpdate) shadowMap.needsUpdate = true;
            });
            result.others = draws.get(other.shadow.camera) ?? 0;
            preshade.dispose();
            render();
            mesh.material = standard();
            const drawn = shadowDepths(renderer, light);
            if (!light.shadow.autoUpdate) light.shadow.needsUpdate = true;
            if (!shadowMap.autoUpdate) shadowMap.needsUpdate = true;
            render();
            result.restored = differing(drawn, shadowDepths(renderer, light));
            Object.assign(shadowMap, { autoUpdate: true, needsUpdate: false });
            light.dispose();
            found[name] = result;
        }
        return found;
    },

    async 'what is refused is drawn as always'() {
        const { scene, mesh, render, light } = stage();
        mesh.material = new THREE.ShaderMaterial({
            name: 'refused',
            vertexShader: `
                out vec3 vAt;
                void main() { vAt = position; gl_Position = projectionMatrix * modelViewMatrix * vec4( position, 1.0 ); }`,
            fragmentShader: `
                in vec3 vAt;
                uniform highp sampler2D map;
                void main() {
                    if ( texture( map, cameraPosition.xy ).r > 0.5 ) discard;
                    gl_FragColor = vec4( 1.0 );
                }`,
            uniforms: { map: { value: null } },
        });
        render();
        render();
        const before = shadowDepths(renderer, light);
        const preshade = await open();
        preshade.shadows(scene);
        await settle(preshade, render);
        const result = { differ: differing(before, shadowDepths(renderer, light)), rows: preshade.report() };
        preshade.dispose();
        return result;
    },

    async 'a fade by distance'() {
        const { scene, mesh, render, light } = stage();
        const faded = (discard) =>
            new THREE.ShaderMaterial({
                uniforms: { time: TIME },
                vertexShader: `
                    uniform float time;
                    varying vec3 vAt;
                    void main() {
                        vec3 moved = position * ( 1.0 + 0.2 * sin( time + position.y * 6.0 ) );
                        vAt = ( modelMatrix * vec4( moved, 1.0 ) ).xyz;
                        gl_Position = projectionMatrix * viewMatrix * vec4( vAt, 1.0 );
                    }`,
                fragmentShader: `
                    varying vec3 vAt;
                    void main() {
                        ${discard}
                        if ( fract( vAt.x * 4.0 ) < 0.2 ) discard;
                        gl_FragColor = vec4( 1.0 );
                    }`,
            });
        mesh.material = faded('if ( distance( cameraPosition, vAt ) > 5.0 ) discard;');
        const draw = async (options) => {
            const preshade = await open();
            preshade.shadows(scene, options);
            await settle(preshade, render);
            const depths = shadowDepths(renderer, light);
            const found = { depths, whole: reference(renderer, scene, light), rows: preshade.report() };
            preshade.dispose();
            return found;
        };
        const dropped = await draw({});
        const kept = await draw({ view: 'keep' });
        mesh.material = faded('');
        const without = await draw({});
        return {
            left_out: dropped.rows[0].left_out.length,
            drop: differing(dropped.depths, without.depths),
            keep: differing(kept.depths, kept.whole),
            fades: differing(dropped.depths, kept.depths),
        };
    },

    async 'the cache of the next visit'() {
        const { scene, mesh, render, differ } = stage();
        mesh.material = wobbling(standard({ name: 'cached' }));
        const visit = async () => {
            const preshade = await Preshade.of(renderer);
            preshade.shadows(scene);
            await settle(preshade, render);
            const [{ state, ms }] = preshade.report().filter(({ material }) => material === 'cached');
            const found = { state, ms, differ: differ() };
            preshade.dispose();
            return found;
        };
        const first = await visit();
        return { first, second: await visit() };
    },

    async 'uniforms that are replaced'() {
        const { scene, mesh, render, differ, light } = stage();
        mesh.material = new THREE.ShaderMaterial({
            uniforms: { time: { value: 0.7 } },
            vertexShader: `
                uniform float time;
                void main() {
                    vec3 moved = position * ( 1.0 + 0.2 * sin( time + position.y * 6.0 ) );
                    gl_Position = projectionMatrix * modelViewMatrix * vec4( moved, 1.0 );
                }`,
            fragmentShader: 'void main() { gl_FragColor = vec4( 1.0 ); }',
        });
        const preshade = await open();
        preshade.shadows(scene);
        await settle(preshade, render);
        const before = shadowDepths(renderer, light);
        mesh.material.uniforms.time = { value: 1.9 };
        render();
        const result = { moves: differing(before, shadowDepths(renderer, light)), differ: differ() };
        preshade.dispose();
        return result;
    },
};

globalThis.runScenario = (name) => scenarios[name]();
globalThis.names = Object.keys(scenarios);
globalThis.ready = true;
