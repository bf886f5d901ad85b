// Clipping planes in a shadow map. The author's program has as many as his picture has; in a shadow map three.js applies the material's own, where `clipShadows` says so, and none of the renderer's.

import { Matrix3, Plane } from 'three';

/** A plane that clips nothing, whether planes are united or intersected. */
const NONE = [0, 0, 0, 1];

export class ClipPlanes {
    #plane = new Plane();
    #matrix = new Matrix3();

    /** Sets `uniform` to the planes as `camera` sees them, as many as the text of `made` has. */
    set(renderer, author, camera, made, uniform) {
        const count = (made.planes ??= Number(/\bvec4 clippingPlanes\[(\d+)\]/.exec(made.fragment)?.[1] ?? 0));
        if (count === 0) return;
        uniform.value ??= new Float32Array(4 * count);
        const values = uniform.value;
        const isClipped = renderer.localClippingEnabled && author.clipShadows;
        const own = (isClipped && author.clippingPlanes) || [];
        // The renderer's come first.
        const first = count - (author.clippingPlanes?.length ?? 0);
        this.#matrix.getNormalMatrix(camera.matrixWorldInverse);
        for (let i = 0; i < count; i++) {
            const plane = own[i - first];
            if (!plane) {
                values.set(NONE, 4 * i);
                continue;
            }
            this.#plane.copy(plane).applyMatrix4(camera.matrixWorldInverse, this.#matrix);
            this.#plane.normal.toArray(values, 4 * i);
            values[4 * i + 3] = this.#plane.constant;
        }
    }
}
