// The authors' whole programs with only their colour replaced: what a pass that overrides materials should write. No part of preshade is in it.

import * as THREE from 'three';

const texts = (renderer, material) => {
    const gl = renderer.getContext();
    const shaders = gl.getAttachedShaders(renderer.properties.get(material).currentProgram.program);
    const text = (type) =>
        gl.getShaderSource(shaders.find((each) => gl.getShaderParameter(each, gl.SHADER_TYPE) === type));
    return [text(gl.VERTEX_SHADER), text(gl.FRAGMENT_SHADER)].map((each) => each.replace(/^#version .*\n/, ''));
};

/** Puts statements at the end of `main`, which is the last function. */
const atEnd = (text, statements) => text.replace(/\}\s*$/, `${statements}\n}\n`);
const packing = () => {
    const names = [
        ...THREE.ShaderChunk.packing.matchAll(/\b(\w*[pP]ack\w*|Inv255|ShiftRight8|\w*ToViewZ|viewZTo\w*)\b/g),
    ].map(([, name]) => name);
    return [...new Set(names)].reduce(
        (text, name) => text.replace(new RegExp(`\\b${name}\\b`, 'g'), `whole_${name}`),
        THREE.ShaderChunk.packing,
    );
};

function ending([vertex, fragment], override) {
    const z = '( 0.5 * whole_zw.x / whole_zw.y + 0.5 )';
    const out = 'gl_FragColor';
    if (override.isMeshNormalMaterial) {
        const names = {
            nonPerturbedNormal: 'nonPerturbedNormal',
            litNormal: 'litNormal',
            worldNormal: 'mat3( viewMatrix ) * worldNormal',
            objectNormal: 'normalMatrix * objectNormal',
            noneNormal: 'noneNormal',
        };
        const name = Object.keys(names).find((each) => new RegExp(`\\b${each}\\b`).test(fragment));
        return [vertex, atEnd(fragment, `${out} = vec4( normalize( ${names[name]} ) * 0.5 + 0.5, 1.0 );`)];
    }
    if (override.isMeshDepthMaterial) {
        const value =
            override.depthPacking === THREE.RGBADepthPacking
                ? `whole_packDepthToRGBA( ${z} )`
                : `vec4( vec3( 1.0 - ${z} ), 1.0 )`;
        return [
            `out vec2 whole_zw;\n${atEnd(vertex, 'whole_zw = gl_Position.zw;')}`,
            `${packing()}\nin vec2 whole_zw;\n${atEnd(fragment, `${out} = ${value};`)}`.replace(
                /([\s\S]*?)(precision highp float;)/,
                '$2\n$1$2',
            ),
        ];
    }
    if (override.isMeshBasicMaterial)
        return [vertex, atEnd(fragment, `${out} = vec4( vec3( ${override.color.r.toFixed(1)} ), 1.0 );`)];
    // OutlinePass: behind the depths of the others or not.
    const position = /\bmvPosition\b/.test(vertex) ? 'mvPosition' : 'litPosition';
    return [
        `uniform mat4 textureMatrix; out vec4 whole_at; out vec4 whole_view;\n${atEnd(vertex, `whole_view = ${position}; whole_at = textureMatrix * inverse( viewMatrix ) * ${position};`)}`,
        `${packing()}\nuniform sampler2D depthTexture; uniform vec2 cameraNearFar; in vec4 whole_at; in vec4 whole_view;\n${atEnd(
            fragment,
            `float wholeDepth = whole_unpackRGBAToDepth( textureProj( depthTexture, whole_at ) );
            float wholeZ = - whole_perspectiveDepthToViewZ( wholeDepth, cameraNearFar.x, cameraNearFar.y );
            ${out} = vec4( 0.0, - whole_view.z > wholeZ ? 1.0 : 0.0, 1.0, 1.0 );`,
        )}`.replace(/([\s\S]*?)(precision highp float;)/, '$2\n$1$2'),
    ];
}

/** `(scene, render)` renders the scene with such materials in place of the override or of what the pass put into objects. */
export function whole(renderer, scene) {
    const made = new Map();
    const authors = new Map();
    scene.traverse((object) => object.material && authors.set(object, object.material));
    const of = (author, override) => {
        const key = `${author.uuid} ${override.uuid}`;
        if (made.has(key)) return made.get(key);
        const [vertexShader, fragmentShader] = ending(texts(renderer, author), override);
        const value = (of) => ({ value: of, writable: true });
        const material = Object.create(author, {
            _listeners: value(undefined),
            id: value(1e6 + made.size),
            isRawShaderMaterial: value(true),
            glslVersion: value(THREE.GLSL3),
            defines: value({}),
            uniformsGroups: value([]),
            vertexShader: value(vertexShader),
            fragmentShader: value(fragmentShader),
            blending: value(override.blending),
            transparent: value(false),
            uniformsNeedUpdate: value(true),
            customProgramCacheKey: value(() => key),
            onBeforeCompile: value((parameters) => {
                const uniforms = {
                    ...renderer.properties.get(author).uniforms,
                    ...(override.isShaderMaterial && override.uniforms),
                };
                Object.assign(parameters, { vertexShader, fragmentShader, uniforms });
            }),
        });
        made.set(key, material);
        return material;
    };
    const draw = (drawn, render) => {
        const { overrideMaterial } = drawn;
        const own = new Map([...authors.keys()].map((object) => [object, object.material]));
        for (const [object, author] of authors) {
            const override = overrideMaterial ?? (object.material === author ? null : object.material);
            if (override && author.allowOverride) object.material = of(author, override);
        }
        drawn.overrideMaterial = null;
        render();
        drawn.overrideMaterial = overrideMaterial;
        for (const [object, material] of own) object.material = material;
    };
    draw.dispose = () => made.forEach((material) => material.dispose());
    return draw;
}
