// From the scene's linear colours to what is on the screen, and one picture beside, or minus, another.

import {
    BufferGeometry,
    Float32BufferAttribute,
    GLSL3,
    HalfFloatType,
    Mesh,
    NearestFilter,
    OrthographicCamera,
    RawShaderMaterial,
    UnsignedByteType,
    WebGLRenderTarget,
} from 'three';

const VERTEX = `
in vec3 position;
void main() { gl_Position = vec4( position, 1.0 ); }
`;

// A curve of the usual shape (a shoulder and a toe), then sRGB.
const DEVELOP = `
precision highp float;
uniform sampler2D source;
out vec4 color;
void main() {
    vec3 c = texelFetch( source, ivec2( gl_FragCoord.xy ), 0 ).rgb;
    c = clamp( c * ( 2.2 * c + 0.12 ) / ( c * ( 2.0 * c + 0.75 ) + 0.16 ), 0.0, 1.0 );
    color = vec4( mix( 12.92 * c, 1.055 * pow( c, vec3( 1.0 / 2.4 ) ) - 0.055, step( 0.0031308, c ) ), 1.0 );
}
`;

const SHOW = `
precision highp float;
uniform sampler2D original;
uniform sampler2D variant;
uniform float split;
uniform float gain;
out vec4 color;
void main() {
    ivec2 pixel = ivec2( gl_FragCoord.xy );
    vec4 a = texelFetch( original, pixel, 0 );
    vec4 b = texelFetch( variant, pixel, 0 );
    float end = split * float( textureSize( variant, 0 ).x );
    color = gain > 0.0 ? vec4( abs( a.rgb - b.rgb ) * gain, 1.0 ) : gl_FragCoord.x < end ? a : b;
    if ( gain == 0.0 && split > 0.0 && abs( gl_FragCoord.x - end ) < 1.0 ) color = vec4( 1.0 );
}
`;

function target(type, depthBuffer) {
    return new WebGLRenderTarget(1, 1, { type, depthBuffer, minFilter: NearestFilter, magFilter: NearestFilter });
}

/** How much smaller, in either direction, a picture is that nobody looks at. */
const SMALLER = 4;

/** A picture in linear colours with a depth buffer, two developed ones, and the passes between them. */
export class Views {
    #renderer;
    #mesh;
    #camera = new OrthographicCamera();
    #develop = this.#material(DEVELOP, ['source']);
    #show = this.#material(SHOW, ['original', 'variant', 'split', 'gain']);
    scene = target(HalfFloatType, true);
    small = target(HalfFloatType, true);
    original = target(UnsignedByteType, false);
    variant = target(UnsignedByteType, false);

    constructor(renderer) {
        this.#renderer = renderer;
        const triangle = new BufferGeometry();
        triangle.setAttribute('position', new Float32BufferAttribute([-1, -1, 0, 3, -1, 0, -1, 3, 0], 3));
        this.#mesh = new Mesh(triangle);
        this.#mesh.frustumCulled = false;
    }

    #material(fragmentShader, uniforms) {
        return new RawShaderMaterial({
            glslVersion: GLSL3,
            vertexShader: VERTEX,
            fragmentShader,
            uniforms: Object.fromEntries(uniforms.map((name) => [name, { value: null }])),
            depthTest: false,
            depthWrite: false,
        });
    }

    #draw(material, into, values) {
        for (const [name, value] of Object.entries(values)) material.uniforms[name].value = value;
        this.#mesh.material = material;
        this.#renderer.setRenderTarget(into);
        this.#renderer.render(this.#mesh, this.#camera);
    }

    setSize(width, height) {
        for (const target of [this.scene, this.original, this.variant]) target.setSize(width, height);
        this.small.setSize(Math.ceil(width / SMALLER), Math.ceil(height / SMALLER));
    }

    /** The scene's colours as a picture of 8 bits a channel. */
    develop(into) {
        this.#draw(this.#develop, into, { source: this.scene.texture });
    }

    /** On the screen: the original left of `split` (0 to 1) and the variant right of it, or `gain` times their difference. */
    show({ split = 0, gain = 0 }) {
        const values = { original: this.original.texture, variant: this.variant.texture, split, gain };
        this.#draw(this.#show, null, values);
    }

    /** The bytes of a developed picture, from the lower left. */
    read(picture) {
        const { width, height } = picture;
        const bytes = new Uint8Array(width * height * 4);
        this.#renderer.readRenderTargetPixels(picture, 0, 0, width, height, bytes);
        return bytes;
    }
}

/** How two pictures differ: pixels by more than 1/255 in any channel, and the most. */
export function difference(a, b) {
    let [off, most] = [0, 0];
    for (let i = 0; i < a.length; i += 4) {
        const apart = Math.max(Math.abs(a[i] - b[i]), Math.abs(a[i + 1] - b[i + 1]), Math.abs(a[i + 2] - b[i + 2]));
        if (apart > 1) off += 1;
        most = Math.max(most, apart);
    }
    return { off, most, pixels: a.length / 4 };
}
