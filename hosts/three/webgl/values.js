// What materials of passes write, as the end of a slice of the author's program.

import { RGBADepthPacking, RGBDepthPacking, RGDepthPacking, ShaderChunk } from 'three';
import { bendsOnlyPositions } from './bends.js';

/** The text with its `main` under another name, for one that calls it. */
const called = (text) => text.replace(/\bvoid main\(\s*\)/, 'void preshade_main()');
/** The name of the first colour that a fragment stage writes. */
const written = (text) => /^layout\(location = 0\) out \w+ (\w+);$/m.exec(text)[1];
/** A declaration, where the text has none of that name. */
const declared = (text, type, name) =>
    new RegExp(`\\b${type}\\w* ${name}\\b`).test(text) ? '' : `uniform ${type} ${name};`;

/** A chunk of three.js whose functions and constants do not meet the author's. */
function apart(chunk) {
    const names = [...chunk.matchAll(/^(?:const )?(?:float|vec\d) (\w+)(?= ?[(=])/gm)].map(([, name]) => name);
    return names.reduce((text, name) => text.replace(new RegExp(`\\b${name}\\b`, 'g'), `preshade_${name}`), chunk);
}

const cut = (author) => (author.alphaToCoverage ? ',cutoff=0.5' : '');
const request = (pass, author) => ({
    pass,
    state: author.alphaToCoverage ? { multisample: { count: 4, alpha_to_coverage: true } } : undefined,
    roles: ['outputs'],
});
const depthOnly = (source, author) => ({
    texts: source,
    request: request(`outputs:write=depth,colour-target=bound${cut(author)}`, author),
});

/** The axes that the author's normal has, as far as his text tells. */
function axes(vertex) {
    if (/\bnormalMatrix\b/.test(vertex.replace(/^\s*uniform .*$/gm, ''))) return 'view';
    const isWorld = /\bmodelMatrix\b[^;]*\b(?:objectN|n|N)ormal\b|\bmat3\( *modelMatrix *\)/.test(vertex);
    return isWorld ? 'world' : 'object';
}

const TURNED = {
    view: 'OUT.xyz',
    world: 'mat3( viewMatrix ) * OUT.xyz',
    object: 'normalMatrix * OUT.xyz',
};

const STRAIGHT =
    'the shader moves vertices and leaves their normals as they were: bend them there, or take the option `normals: "faces"`';

/** Values that write a normal, by where they take it from. */
const NORMALS = new Map();

/**
 * As MeshNormalMaterial: a normal in the view's axes, from 0 to 1. `from`: `program`: the one that meets a light in the author's program; `faces`: that of the face; the name of a
 * value of the fragment stage; null: that of the program, or where it has none, that of the face.
 */
export function normals(from) {
    if (!NORMALS.has(from))
        NORMALS.set(from, {
            key: from ? `normal ${from}` : 'normal',
            isNormal: true,
            steps: (source, author) => normalSteps(source, author, from),
            build: (pass, source, { has }) => (has === 'normal' ? programNormal(pass, source) : faceNormal(pass)),
        });
    return NORMALS.get(from);
}

function normalSteps(source, author, from) {
    const faces = { ...depthOnly(source, author), has: 'position' };
    if (from === 'faces') return [faces];
    const isNamed = from && from !== 'program';
    // The normal before a normal map, which the pass's material would not have either.
    const isThrees = /\bnonPerturbedNormal\b/.test(source.fragment);
    const name = isNamed ? `,normal=${from}` : isThrees ? ',normal=nonPerturbedNormal' : '';
    const first = {
        texts: source,
        request: request(`outputs:write=normal${name}${cut(author)}`, author),
        has: 'normal',
    };
    return from ? [first] : [first, faces];
}

/** What turns a normal to the viewer on back faces, as the materials of three.js do, where the author's program does not. */
function turned(fragment) {
    if (/\bgl_FrontFacing\b/.test(fragment)) return '';
    if (/^#define DOUBLE_SIDED$/m.test(fragment)) return ' * ( gl_FrontFacing ? 1.0 : - 1.0 )';
    return /^#define FLIP_SIDED$/m.test(fragment) ? ' * - 1.0' : '';
}

function programNormal({ vertex, fragment }, source) {
    const out = written(fragment);
    const space = axes(source.vertex);
    const uniforms = {
        view: '',
        world: declared(fragment, 'mat4', 'viewMatrix'),
        object: declared(fragment, 'mat3', 'normalMatrix'),
    };
    const value = `normalize( ${TURNED[space].replace('OUT', out)} )${turned(source.fragment)} * 0.5 + 0.5`;
    const main = `void main() { preshade_main(); ${out} = vec4( ${value}, 1.0 ); }`;
    const row = { normals: `of the program, in ${space} axes` };
    if (bendsOnlyPositions({ vertex, fragment }, out)) row.note = STRAIGHT;
    return { fragment: `${called(fragment)}\n${uniforms[space]}\n${main}`, row };
}

function faceNormal({ vertex, fragment }) {
    const out = written(fragment);
    const matrix = declared(vertex, 'mat4', 'projectionMatrix');
    return {
        vertex: `${called(vertex)}\n${matrix}\nout vec3 preshade_at;
void main() { preshade_main(); vec4 at = inverse( projectionMatrix ) * gl_Position; preshade_at = at.xyz / at.w; }`,
        fragment: `${called(fragment)}\nin vec3 preshade_at;
void main() {
    vec3 face = normalize( cross( dFdx( preshade_at ), dFdy( preshade_at ) ) );
    preshade_main();
    ${out} = vec4( face * 0.5 + 0.5, 1.0 );
}`,
        row: { normals: 'of faces' },
    };
}

const PACKED = {
    [RGBADepthPacking]: 'preshade_packDepthToRGBA( z )',
    [RGBDepthPacking]: 'vec4( preshade_packDepthToRGB( z ), 1.0 )',
    [RGDepthPacking]: 'vec4( preshade_packDepthToRG( z ), 0.0, 1.0 )',
};

/** As MeshDepthMaterial: the depth, packed into a colour. */
export function depth(packing) {
    return {
        key: `depth ${packing}`,
        steps: (source, author) => [depthOnly(source, author)],
        build({ vertex, fragment }, source) {
            const out = written(fragment);
            const isReversed = /^#define USE_REVERSED_DEPTH_BUFFER$/m.test(source.fragment);
            const z = isReversed ? 'preshade_zw.x / preshade_zw.y' : '0.5 * preshade_zw.x / preshade_zw.y + 0.5';
            const value = PACKED[packing] ?? 'vec4( vec3( 1.0 - z ), 1.0 )';
            const chunk = packing in PACKED ? apart(ShaderChunk.packing) : '';
            return {
                vertex: `${called(vertex)}\nout vec2 preshade_zw;\nvoid main() { preshade_main(); preshade_zw = gl_Position.zw; }`,
                fragment: `${called(fragment)}\nin vec2 preshade_zw;\n${chunk}
void main() { preshade_main(); float z = ${z}; ${out} = ${value}; }`,
            };
        },
    };
}

/** As a MeshBasicMaterial without maps, in a target: one colour. */
export const colour = {
    key: 'colour',
    steps: (source, author) => [depthOnly(source, author)],
    build({ fragment }, source, step, material) {
        const out = written(fragment);
        return {
            fragment: `${called(fragment)}\nuniform vec3 preshade_colour;\nvoid main() { preshade_main(); ${out} = vec4( preshade_colour, 1.0 ); }`,
            uniforms: { preshade_colour: { value: material.color } },
        };
    },
    /** Returns whether it changed. */
    update({ preshade_colour }, { color }) {
        const isOther = preshade_colour.value !== color;
        preshade_colour.value = color;
        return isOther;
    },
};

/** As the mask of OutlinePass: what is behind the depths of the others. Its vertex stage gives it two positions, which are made of the author's here. */
export const mask = {
    key: 'mask',
    is: ({ isShaderMaterial, uniforms, fragmentShader }) =>
        isShaderMaterial && uniforms.textureMatrix && uniforms.depthTexture && /\bprojTexCoord\b/.test(fragmentShader),
    steps: (source, author) => [depthOnly(source, author)],
    build({ vertex, fragment }, source, step, { fragmentShader, uniforms }) {
        const out = written(fragment);
        const theirs = fragmentShader
            .replace(/#include <(\w+)>/g, (_, name) => ShaderChunk[name])
            .replace(/\bvarying\b/g, 'in')
            .replace(/\btexture2DProj\b/g, 'textureProj')
            .replace(/\bgl_FragColor\b/g, out)
            .replace(/\bvoid main\(\s*\)/, 'void preshade_mask()');
        return {
            vertex: `${called(vertex)}
${declared(vertex, 'mat4', 'projectionMatrix')} ${declared(vertex, 'mat4', 'viewMatrix')}
uniform mat4 textureMatrix;
out vec4 projTexCoord;
out vec4 vPosition;
void main() {
    preshade_main();
    vPosition = inverse( projectionMatrix ) * gl_Position;
    vPosition /= vPosition.w;
    projTexCoord = textureMatrix * ( inverse( viewMatrix ) * vPosition );
}`,
            fragment: `${called(fragment)}\n${theirs}\nvoid main() { preshade_main(); preshade_mask(); }`,
            uniforms,
        };
    },
};
