// The frames of one scene as its page draws them, and draws of ours within them. The page's own `renderer.render( scene, camera )` goes on as it is: when three.js is about to draw the
// first of its objects, the target is bound and cleared, the lights are set up and the objects are sorted, so whatever we draw then needs no second traversal and no clear.

import { BatchedMesh, ColorManagement, Material, NoToneMapping, Object3D } from 'three';

/** Renderers that draw something of ours at the moment. */
const busy = new WeakSet();

/**
 * @typedef {object} Frame
 * @property {number} number
 * @property {import('three').Camera} camera
 * @property {import('three').WebGLRenderTarget | null} target What the scene is drawn into.
 * @property {string} kind What of the target is in the programs' texts: with another kind, three.js draws by other programs.
 * @property {boolean} cleared Whether the page cleared its depth after the first draw.
 * @property {boolean} interrupted Whether it drew listed objects after that.
 * @property {{ opaque: object[], transmissive: object[], transparent: object[] }} list What three.js draws, in order.
 */

export class Frames {
    #host;
    #scene;
    #listener;
    /** For each `renderer.render` that runs, what we know of it, or null where it is none of ours. */
    #stack = [];
    #number = 0;

    /**
     * `listener` has, each optional: `before(scene, camera)`, ahead of a frame; `begin(frame)`, ahead of its first draw; `draw(draw, frame)` ahead of each draw of a listed object, as in
     * `Hooks.draw`; `drawn(draw, frame)` after it; `end(frame)`.
     */
    constructor(host, scene, listener) {
        if (!scene?.isObject3D) throw new TypeError('preshade: give the scene that you render');
        this.#host = host;
        this.#scene = scene;
        this.#listener = listener;
        const { hooks } = host;
        hooks.beforeRender.add(this.#before);
        hooks.afterRender.add(this.#after);
        hooks.draw.add(this.#draw);
        hooks.drawn.add(this.#drawn);
        hooks.clear.add(this.#clear);
    }

    dispose() {
        const { hooks } = this.#host;
        hooks.beforeRender.delete(this.#before);
        hooks.afterRender.delete(this.#after);
        hooks.draw.delete(this.#draw);
        hooks.drawn.delete(this.#drawn);
        hooks.clear.delete(this.#clear);
    }

    #before = (scene, camera) => {
        const ours = !busy.has(this.#host.renderer) && this.#isOurs(scene, camera);
        const frame = ours
            ? {
                  number: ++this.#number,
                  camera,
                  target: null,
                  kind: null,
                  list: null,
                  begun: false,
                  cleared: false,
                  interrupted: false,
              }
            : null;
        if (ours) this.#listener.before?.(scene, camera);
        this.#stack.push(frame);
    };

    #after = () => {
        const frame = this.#stack.pop();
        if (frame?.begun) this.#listener.end?.(frame);
    };

    /** The frame that these draws belong to, or null. */
    #current(scene) {
        const { renderer, hooks } = this.#host;
        if (scene !== this.#scene || hooks.shadow || busy.has(renderer)) return null;
        const frame = this.#stack.at(-1);
        if (!frame || scene.overrideMaterial) return null;
        // The opaque objects are drawn once more for what transmissive ones show of them.
        if (frame.begun) return renderer.getRenderTarget() === frame.target ? frame : null;
        return isTransmission(renderer.getRenderTarget(), this.#list()) ? null : frame;
    }

    #draw = (draw) => {
        const frame = this.#current(draw.scene);
        if (!frame) return;
        if (!frame.begun) {
            const { renderer } = this.#host;
            Object.assign(frame, { begun: true, target: renderer.getRenderTarget(), list: this.#list() });
            frame.kind = kindOf(renderer, frame.target);
            this.#listener.begin?.(frame);
        }
        frame.interrupted ||= frame.cleared;
        this.#listener.draw?.(draw, frame);
    };

    #drawn = (draw) => {
        const frame = this.#current(draw.scene);
        if (frame?.begun) this.#listener.drawn?.(draw, frame);
    };

    /** By a callback of an object, or by a frame of another scene that is drawn into the same target. */
    #clear = (color, depth) => {
        if (!depth) return;
        const target = this.#host.renderer.getRenderTarget();
        for (const frame of this.#stack) if (frame?.begun && frame.target === target) frame.cleared = true;
    };

    #list() {
        return this.#host.renderer.renderLists.get(this.#scene, this.#stack.length - 1);
    }

    /** A view of the scene itself: not one in a mirror or for an environment map, not with one material for everything, not of two eyes. */
    #isOurs(scene, camera) {
        const { renderer } = this.#host;
        if (scene !== this.#scene || !camera || camera.isArrayCamera || scene.overrideMaterial) return false;
        if (renderer.xr.enabled && renderer.xr.isPresenting) return false;
        const target = renderer.getRenderTarget();
        if (target?.isWebGLCubeRenderTarget || target?.isXRRenderTarget || camera.parent?.type === 'CubeCamera')
            return false;
        if (!(target ? target.depthBuffer : renderer.getContextAttributes()?.depth)) return false;
        // Nested: only where a frame of ours leaves the drawing to a pass of its own (`renderer.setEffects` with a RenderPass).
        return this.#stack.every((outer) => outer && !outer.begun && outer.camera === camera);
    }
}

/** The target of three.js' own pass behind transmissive objects. */
function isTransmission(target, list) {
    return list.transmissive.length > 0 && target?.texture.generateMipmaps === true && target.samples > 0;
}

function kindOf(renderer, target) {
    const space = target === null ? renderer.outputColorSpace : ColorManagement.workingColorSpace;
    return `${space} ${target === null ? renderer.toneMapping : NoToneMapping}`;
}

/** Whether three.js would call something of the page's before it draws the object: what it does there is to be done once a frame. */
export function hasCallback({ object, material }) {
    const { onBeforeRender } = object;
    if (material.onBeforeRender !== Material.prototype.onBeforeRender) return true;
    return (
        onBeforeRender !== Object3D.prototype.onBeforeRender && onBeforeRender !== BatchedMesh.prototype.onBeforeRender
    );
}

/** Within a frame: draws an item of its list in `material`, into the target that is bound. */
export function drawItem(
    { renderer, programs },
    scene,
    camera,
    { object, geometry, group, material: author },
    material,
) {
    if (object.isBatchedMesh) object.onBeforeRender(renderer, scene, camera, geometry, author, group);
    object.modelViewMatrix.multiplyMatrices(camera.matrixWorldInverse, object.matrixWorld);
    object.normalMatrix.getNormalMatrix(object.modelViewMatrix);
    const outer = busy.has(renderer);
    busy.add(renderer);
    try {
        programs.unseen(() => renderer.renderBufferDirect(camera, scene, geometry, material, object, group));
    } finally {
        if (!outer) busy.delete(renderer);
    }
}

/** Within a frame: runs `draw` with `target` bound, and binds again what was. */
export function within(renderer, target, draw) {
    const [host, face, level] = [
        renderer.getRenderTarget(),
        renderer.getActiveCubeFace(),
        renderer.getActiveMipmapLevel(),
    ];
    renderer.setRenderTarget(target);
    try {
        return draw();
    } finally {
        renderer.setRenderTarget(host, face, level);
    }
}

/** Size of a target, or of the canvas, in pixels. */
export function sizeOf(renderer, target) {
    if (target) return { width: target.width, height: target.height };
    const { drawingBufferWidth: width, drawingBufferHeight: height } = renderer.getContext();
    return { width, height };
}
