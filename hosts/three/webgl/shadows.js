// Shadow maps drawn with the author's own vertices and discards.
//
// WebGLShadowMap asks for a depth or distance material for each object, copies sides and maps onto it, and draws into a depth texture. The draw is the place to change: in
// three.js's own depth material's place goes a slice of the author's program. No object and no material is touched, so that there is nothing to find and nothing to restore.

import { FrontSide, LessEqualDepth, NoBlending } from 'three';
import { ClipPlanes } from './clipping.js';
import { Derivations } from './derivations.js';
import { Left } from './left.js';
import { Maps } from './maps.js';
import { left } from './stock.js';

const STATE = {
    side: FrontSide,
    blending: NoBlending,
    transparent: false,
    premultipliedAlpha: false,
    alphaToCoverage: false,
    depthTest: true,
    depthWrite: true,
    depthFunc: LessEqualDepth,
    colorWrite: true,
    stencilWrite: false,
    polygonOffset: false,
};

/** Of a point light: three.js's distance material has no logarithmic depth, and what reads its map expects none. */
const LOGARITHMIC = /^#define USE_LOGARITHMIC_DEPTH_BUFFER$/m;

/** The author's texts as a shadow map of that mode needs them. */
function texts(source, mode) {
    if (mode !== 'cube' || !LOGARITHMIC.test(source.vertex)) return source;
    const without = (text) => text.replace(LOGARITHMIC, '');
    return { vertex: without(source.vertex), fragment: without(source.fragment), key: `${source.key} linear` };
}

export class Shadows {
    #host;
    #scene;
    #view;
    #replaceCustom;
    #derivations;
    #planes = new ClipPlanes();
    #isEnabled = true;
    #maps;
    #left = new Left('shadow');

    /**
     * `view`: what becomes of a discard that depends on the viewer: `drop` leaves that part of it out, `keep` has it follow the light.
     * `replaceCustom`: whether to draw over the depth materials that authors gave their objects.
     */
    constructor(host, scene, { view = 'drop', replaceCustom = false } = {}) {
        this.#replaceCustom = replaceCustom;
        this.#host = host;
        this.#scene = scene;
        this.#view = view;
        this.#derivations = new Derivations(host, {
            pass: 'shadow',
            steps: (source, mode, author, extra) => this.#steps(source, mode, author, extra),
            build: ({ passes: [pass] }) => ({
                ...pass,
                state: STATE,
                uniforms: { viewMatrix: { value: null }, clippingPlanes: { value: null } },
                row: { left_out: pass.pass.left_out ?? [] },
            }),
        });
        this.#maps = new Maps(host, scene);
        this.#derivations.ready.add(this.#maps.ready);
        host.hooks.draw.add(this.#draw);
        host.hooks.drawn.add(this.#drawn);
    }

    /** Switches it off and on; three.js draws as always while it is off. */
    get enabled() {
        return this.#isEnabled;
    }

    set enabled(on) {
        if (on !== this.#isEnabled) this.#maps.again();
        this.#isEnabled = on;
    }

    report() {
        return [...this.#derivations.rows(), ...this.#left.rows()];
    }

    settled() {
        return this.#derivations.settled();
    }

    dispose() {
        this.#host.hooks.draw.delete(this.#draw);
        this.#host.hooks.drawn.delete(this.#drawn);
        this.#derivations.dispose();
        this.#left.clear();
        this.#maps.dispose();
    }

    #steps(source, mode, author, { depth, isAlone }) {
        const own = texts(source, mode);
        // three.js sets these planes in the view's axes, whichever view that is.
        const planes = /\buniform vec4 clippingPlanes\b/.test(own.fragment) ? ',viewer=-modelViewMatrix' : '';
        const cut = author.alphaToCoverage ? ',cutoff=0.5' : '';
        const pass = `outputs:write=shadow,colour-target=bound,view=${this.#view}${planes}${cut}`;
        const state = author.alphaToCoverage ? { multisample: { count: 4, alpha_to_coverage: true } } : undefined;
        const rewrite = { texts: own, request: { pass, state, roles: ['outputs'] } };
        if (isAlone) return [rewrite];
        // Known after the first shadow map that three.js draws by itself.
        if (!depth) return null;
        // A test of alpha has the material's opacity in the one, and 1 in the other.
        const proved = ({ agrees, promises }) =>
            agrees && promises.every(({ outcome }) => outcome.kind === 'proved') && !(author.alphaTest > 0) && 'same';
        return [{ texts: own, request: { agree: depth, as: 'shadow' }, accept: proved }, rewrite];
    }

    #draw = (draw) => {
        const { hooks, renderer } = this.#host;
        if (draw.scene !== null || hooks.shadow?.scene !== this.#scene || !this.#isEnabled) return;
        const { object, group, material: depth, camera } = draw;
        const isCustom = depth === object.customDepthMaterial || depth === object.customDistanceMaterial;
        if (isCustom && !this.#replaceCustom) return;
        // Not three.js's full-screen passes.
        if (!isCustom && !depth.isMeshDepthMaterial && !depth.isMeshDistanceMaterial) return;
        const author = Array.isArray(object.material) ? object.material[group?.materialIndex] : object.material;
        if (!author || (!isCustom && this.#isLeft(author, object))) return;
        const isPoint = isCustom ? depth === object.customDistanceMaterial : depth.isMeshDistanceMaterial;
        const mode = isPoint ? 'cube' : 'flat';
        const extra = {
            depth: this.#depths.get(author)?.get(mode),
            // Nothing of three.js is there to compare with, or it hardly does the same.
            isAlone: isCustom || author.isRawShaderMaterial,
        };
        const material = this.#derivations.pick(author, object, mode, extra, this.#scene, hooks.shadow.camera);
        this.#maps.draws(camera, author, this.#derivations.lacks, Boolean(material));
        if (!material) {
            draw.author = author;
            draw.mode = mode;
            return;
        }
        material.side = depth.side;
        const { viewMatrix, clippingPlanes } = material.preshade.uniforms;
        // three.js does not set it anew for the faces of a cube, which share a camera.
        viewMatrix.value = camera.matrixWorldInverse;
        this.#planes.set(renderer, author, camera, material.preshade, clippingPlanes);
        if ((material.preshade.usesNormalMatrix ??= /\bnormalMatrix\b/.test(material.preshade.vertex)))
            object.normalMatrix.getNormalMatrix(object.modelViewMatrix);
        draw.material = material;
    };

    /** Programs of three.js's own depth material, by author and mode. */
    #depths = new WeakMap();

    #drawn = ({ author, mode, material }) => {
        if (!author || (!material.isMeshDepthMaterial && !material.isMeshDistanceMaterial)) return;
        let modes = this.#depths.get(author);
        if (!modes) this.#depths.set(author, (modes = new Map()));
        modes.set(mode, this.#host.programs.source(material));
    };

    /** Whether three.js draws the object as always, by a decision that takes no compiler. */
    #isLeft(author, object) {
        const [state, ...why] = left(author, object) ?? [];
        if (state) this.#left.set(author, state, ...why);
        else this.#left.delete(author);
        return Boolean(state);
    }
}
