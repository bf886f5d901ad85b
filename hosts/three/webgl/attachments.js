// The depth textures that plans share by name: each is as large as what the frame is drawn into, and one for all materials.

import { DepthTexture, FloatType, UnsignedIntType, UnsignedShortType, Vector4, WebGLRenderTarget } from 'three';
import { sizeOf } from './frames.js';

export const DEPTH_TYPE = { depth16unorm: UnsignedShortType, depth24plus: UnsignedIntType, depth32float: FloatType };
/** The name a plan gives the depth buffer of what is drawn into. */
export const SCENE_DEPTH = 'scene-depth';

export class Attachments {
    #targets = new Map();
    #uniforms = new Map();

    /** The uniform that holds the texture of that name; one object, whatever the texture becomes. */
    uniform(name) {
        if (!this.#uniforms.has(name)) this.#uniforms.set(name, { value: null });
        return this.#uniforms.get(name);
    }

    /** In a frame: what to draw into for this attachment of a plan. */
    target(renderer, frame, { name, format }) {
        const { width, height } = sizeOf(renderer, frame.target);
        let target = this.#targets.get(name);
        if (!target) {
            const depthTexture = new DepthTexture(width, height, DEPTH_TYPE[format]);
            target = new WebGLRenderTarget(width, height, { depthTexture });
            this.#targets.set(name, target);
            this.uniform(name).value = depthTexture;
        }
        target.setSize(width, height);
        target.viewport.copy(renderer.getCurrentViewport(new Vector4()));
        return target;
    }

    dispose() {
        for (const target of this.#targets.values()) {
            target.depthTexture.dispose();
            target.dispose();
        }
        this.#targets.clear();
    }
}

/** How many samples a pixel of the target has; 0 for one. */
export function samplesOf(renderer, target) {
    if (target) return target.samples;
    return renderer.getContextAttributes()?.antialias ? 4 : 0;
}
