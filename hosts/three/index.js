// Passes of the real geometry for three.js: each is derived by preshade from the shader that three.js made of a material. index.d.ts describes the functions.

import { switchedOff } from './rows.js';

const IN_SCENES = ['shadows', 'prepass', 'rewrite', 'velocity'];
const OTHERS = ['override', 'report', 'settled', 'dispose'];

/** What preshade does for one renderer. */
export class Preshade {
    #host;
    #isDisposed = false;

    constructor(host) {
        this.#host = host;
    }

    static async of(renderer, options = {}) {
        if (!renderer?.isWebGPURenderer && !renderer?.isWebGLRenderer && !renderer?.getContext)
            throw new TypeError('preshade: give a WebGLRenderer or a WebGPURenderer of three.js');
        const { Host } = await (renderer.isWebGPURenderer ? import('./webgpu/host.js') : import('./webgl/host.js'));
        return new Preshade(await Host.of(renderer, options));
    }

    text(material, object) {
        if (!material?.isMaterial) throw new TypeError('preshade: `text` takes a material');
        return this.#host.text(object ? drawnAs(material, object) : material, object);
    }

    static {
        for (const name of [...IN_SCENES, ...OTHERS])
            this.prototype[name] = function (...given) {
                const [first] = given;
                if (IN_SCENES.includes(name) && !first?.isObject3D)
                    throw new TypeError(`preshade: \`${name}\` takes the scene that you render`);
                if (IN_SCENES.includes(name) && first.isCamera)
                    throw new TypeError(`preshade: \`${name}\` takes the scene that you render, and this is a camera`);
                if (name === 'override') checkPass(first);
                checkOptions(name, given[1]);
                if (!this.#host[name]) throw new TypeError(`preshade: ${name} needs a WebGLRenderer`);
                if (this.#isDisposed && (IN_SCENES.includes(name) || name === 'override'))
                    throw new Error(`preshade: \`${name}\` after \`dispose\`: call Preshade.of again`);
                this.#isDisposed ||= name === 'dispose';
                const made = this.#host[name](...given);
                return IN_SCENES.includes(name) ? switched(made) : made;
            };
    }
}

/** Options of each function. A name that is none of them is a slip, and would be without effect. */
// The last two are of tests: a driver that breaks promises.
const PLANNED = ['measure', 'materials', 'remember', 'edit', 'trust'];
const OPTIONS = {
    shadows: ['view', 'replaceCustom'],
    prepass: ['form', ...PLANNED],
    rewrite: ['pass', 'fallback', ...PLANNED],
    velocity: ['camera', 'units', 'transparent', 'automatic'],
    override: ['name', 'normals'],
};

function checkOptions(name, options) {
    const known = OPTIONS[name];
    if (!known || options === undefined || options === null || options === false) return;
    const told = known.filter((key) => key !== 'edit' && key !== 'trust');
    for (const [key, value] of Object.entries(options)) {
        if (!known.includes(key))
            throw new TypeError(`preshade: \`${name}\` has no option \`${key}\`: it has ${told.join(', ')}`);
        if (key === 'view' && value !== undefined && !['drop', 'keep'].includes(value))
            throw new TypeError(`preshade: view is "drop" or "keep", not "${value}"`);
    }
}

function checkPass(pass) {
    if (!pass) throw new TypeError('preshade: `override` takes a pass');
    if (Array.isArray(pass.passes))
        throw new TypeError('preshade: `override` takes a pass, and this is a composer: give it each pass');
}

/** A part whose rows say so if it is switched off. */
function switched(part) {
    if (Object.hasOwn(part, 'report')) return part;
    const report = part.report.bind(part);
    part.report = () => (part.enabled === false ? report().map(switchedOff) : report());
    return part;
}

/** The material that three.js draws an object with, where that is a proxy of the author's material, or derived from it by a package. */
function drawnAs(material, object) {
    const isOf = (own) =>
        own === material || own.uuid === material.uuid || Object.prototype.isPrototypeOf.call(material, own);
    return [object.material ?? []].flat().find(isOf) ?? material;
}
