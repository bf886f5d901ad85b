// Matrices that three.js keeps in textures and attributes (bones, instances, batches), those of this frame and of the frame before in one texture: the previous ones are in the rows below.
// A program reads them at a row that is a uniform, so that its copy for the previous frame reads the previous ones.

import { DataTexture, FloatType, RGBAFormat } from 'three';

/** Textures of three.js that move vertices, and what an object has there. */
const TEXTURES = {
    boneTexture: ({ isSkinnedMesh, skeleton }) => {
        if (!isSkinnedMesh || !skeleton) return null;
        if (skeleton.boneTexture === null) skeleton.computeBoneTexture();
        return skeleton.boneTexture;
    },
    batchingTexture: ({ isBatchedMesh, _matricesTexture }) => (isBatchedMesh ? _matricesTexture : null),
    morphTexture: ({ isInstancedMesh, morphTexture }) => (isInstancedMesh ? morphTexture : null),
};
const INSTANCES = 'instanceMatrix';
const DECLARED = /^([ \t]*)(?:attribute|in)\s+(?:highp\s+)?mat4\s+instanceMatrix\s*;/m;
const FUNCTION = `uniform highp sampler2D instanceMatrix_both;
uniform int instanceMatrix_row;
mat4 instanceMatrix_now() {
    int width = textureSize( instanceMatrix_both, 0 ).x;
    int j = gl_InstanceID * 4;
    int x = j % width;
    int y = j / width + instanceMatrix_row;
    return mat4( texelFetch( instanceMatrix_both, ivec2( x, y ), 0 ), texelFetch( instanceMatrix_both, ivec2( x + 1, y ), 0 ),
        texelFetch( instanceMatrix_both, ivec2( x + 2, y ), 0 ), texelFetch( instanceMatrix_both, ivec2( x + 3, y ), 0 ) );
}`;

/** A vertex stage of three.js that reads those matrices at a row. What is not read as three.js does it stays as it is, and counts as unchanged. */
export function withRows(vertex) {
    let text = vertex;
    for (const name of Object.keys(TEXTURES)) {
        const fetch = new RegExp(
            `texelFetch\\(\\s*${name}\\s*,\\s*ivec2\\(\\s*([^,()]+?)\\s*,\\s*([^,()]+?)\\s*\\)`,
            'g',
        );
        const reads = text.match(new RegExp(`texelFetch\\(\\s*${name}\\b`, 'g'))?.length ?? 0;
        if (reads === 0 || reads !== (text.match(fetch)?.length ?? 0)) continue;
        text = text
            .replace(fetch, `texelFetch( ${name}, ivec2( $1, ( $2 ) + ${name}_row )`)
            .replace(
                new RegExp(`^.*uniform\\s+(?:highp\\s+)?sampler2D\\s+${name}\\s*;`, 'm'),
                `$&\nuniform int ${name}_row;`,
            )
            .replace(new RegExp(`\\b${name}\\b`, 'g'), `${name}_both`);
    }
    // A variable of the author's with that name hides the attribute.
    const isHidden = (text.match(/\bmat4\s+instanceMatrix\b/g)?.length ?? 0) > 1;
    if (isHidden || !DECLARED.test(text)) return text;
    const mark = '/* the instances */';
    return text
        .replace(DECLARED, mark)
        .replace(/\binstanceMatrix\b/g, 'instanceMatrix_now()')
        .replace(mark, FUNCTION);
}

/** Rows as wide as fits all devices, of whole matrices. */
function sized(matrices) {
    const width = Math.min(1024, matrices * 4);
    return { width, height: Math.ceil((matrices * 4) / width) };
}

class Both {
    #half;
    #at = null;
    #version = null;
    #still = false;

    constructor({ data, width, height, format = RGBAFormat }) {
        const channels = format === RGBAFormat ? 4 : 1;
        this.rows = height;
        this.width = width;
        this.format = format;
        this.#half = width * height * channels;
        this.texture = new DataTexture(new Float32Array(2 * this.#half), width, 2 * height, format, FloatType);
        this.length = data.length;
    }

    /** Whether the values are others than those of the last frame. */
    differs(data) {
        const all = this.texture.image.data;
        return data.subarray(0, this.#half).some((value, i) => value !== all[i]);
    }

    /** The values of frame `number`; a second call in a frame changes nothing. */
    update(data, version, number) {
        if (this.#at === number) return;
        const known = this.#at === number - 1;
        this.#at = number;
        const isSame = version === this.#version;
        if (isSame && this.#still) return;
        const all = this.texture.image.data;
        if (known) all.copyWithin(this.#half, 0, this.#half);
        all.set(data.length > this.#half ? data.subarray(0, this.#half) : data, 0);
        if (!known) all.copyWithin(this.#half, 0, this.#half);
        this.#version = version;
        this.#still = isSame || !known;
        this.texture.needsUpdate = true;
    }
}

/** What moves an object's vertices: the name in the program, the texture or attribute, and its values as an image. */
function held(object) {
    const found = [];
    for (const [name, of] of Object.entries(TEXTURES)) {
        const holder = of(object);
        if (!holder) continue;
        const { data, width, height } = holder.image;
        found.push({ name, holder, image: { data, width, height, format: holder.format } });
    }
    if (object.isInstancedMesh) {
        const { array: data, count } = object.instanceMatrix;
        found.push({ name: INSTANCES, holder: object.instanceMatrix, image: { data, ...sized(count) } });
    }
    return found;
}

/** The textures of all objects. */
export class Boths {
    /** By what holds the values: a texture or an attribute. */
    #all = new Map();

    /** Uniforms by name for an object that is drawn in frame `number`. */
    uniforms(object, number) {
        const uniforms = {};
        for (const { name, holder, image } of held(object)) {
            const { texture, rows } = this.#of(holder, image, holder.version, number);
            uniforms[`${name}_both`] = texture;
            uniforms[`${name}_row`] = 0;
            uniforms[`${name}_row_previous`] = rows;
        }
        return uniforms;
    }

    /** Whether an object has other values than it had when it was drawn last. */
    haveMoved(object) {
        return held(object).some(({ holder, image }) => this.#all.get(holder)?.differs(image.data));
    }

    #of(holder, image, version, number) {
        let both = this.#all.get(holder);
        if (both && (both.width !== image.width || both.rows !== image.height)) {
            both.texture.dispose();
            both = null;
        }
        if (!both) this.#all.set(holder, (both = new Both(image)));
        both.update(image.data, version, number);
        both.used = number;
        return both;
    }

    /** Releases what no object had for long. */
    sweep(number) {
        for (const [holder, both] of this.#all) {
            if (number - both.used < 300) continue;
            both.texture.dispose();
            this.#all.delete(holder);
        }
    }

    dispose() {
        for (const { texture } of this.#all.values()) texture.dispose();
        this.#all.clear();
    }
}
