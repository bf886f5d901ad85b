// What three.js (r187) declares for the texts of a `ShaderMaterial` before it compiles them, so that preshade reads
// them without three.js. Its chunks are not among it.

/** Flags by which three.js declares more: `defines` of a material, or definitions given beside its texts. */
const BY_FLAG = {
    USE_INSTANCING: 'attribute mat4 instanceMatrix;',
    USE_INSTANCING_COLOR: 'attribute vec3 instanceColor;',
    USE_TANGENT: 'attribute vec4 tangent;',
    USE_UV1: 'attribute vec2 uv1;',
    USE_UV2: 'attribute vec2 uv2;',
    USE_UV3: 'attribute vec2 uv3;',
    USE_SKINNING: 'attribute vec4 skinIndex, skinWeight;',
};
/** What a vertex stage has in any case: types by name. */
const ATTRIBUTES = { position: 'vec3', normal: 'vec3', uv: 'vec2' };
const UNIFORMS = {
    modelMatrix: 'mat4',
    viewMatrix: 'mat4',
    modelViewMatrix: 'mat4',
    projectionMatrix: 'mat4',
    normalMatrix: 'mat3',
    cameraPosition: 'vec3',
    isOrthographic: 'bool',
};
/** Those that a fragment stage has too. */
const IN_FRAGMENT = ['viewMatrix', 'cameraPosition', 'isOrthographic'];
/** Functions and words of GLSL ES 1.00, by those of 3.00. */
const VERTEX_WORDS = { attribute: 'in', varying: 'out', texture2D: 'texture' };
const FRAGMENT_WORDS = {
    varying: 'in',
    gl_FragDepthEXT: 'gl_FragDepth',
    texture2D: 'texture',
    textureCube: 'texture',
    texture2DProj: 'textureProj',
    texture2DLodEXT: 'textureLod',
    texture2DProjLodEXT: 'textureProjLod',
    textureCubeLodEXT: 'textureLod',
    texture2DGradEXT: 'textureGrad',
    texture2DProjGradEXT: 'textureProjGrad',
    textureCubeGradEXT: 'textureGrad',
};

const START = ['#version 300 es', 'precision highp float;', 'precision highp int;'];
const words = (of) => Object.entries(of).map(([word, now]) => `#define ${word} ${now}`);
const uniforms = (names) => names.map((name) => `uniform ${UNIFORMS[name]} ${name};`);

const VERTEX = [
    ...START,
    ...words(VERTEX_WORDS),
    ...uniforms(Object.keys(UNIFORMS)),
    ...Object.entries(ATTRIBUTES).map(([name, type]) => `attribute ${type} ${name};`),
    ...Object.entries(BY_FLAG).flatMap(([flag, text]) => [`#ifdef ${flag}`, text, '#endif']),
    '#if defined(USE_COLOR_ALPHA)',
    'attribute vec4 color;',
    '#elif defined(USE_COLOR)',
    'attribute vec3 color;',
    '#endif',
];
const FRAGMENT = [...START, ...words(FRAGMENT_WORDS), ...uniforms(IN_FRAGMENT)];
/** Of a fragment stage that writes as GLSL ES 1.00 does. */
const COLOR = ['layout(location = 0) out highp vec4 pc_fragColor;', '#define gl_FragColor pc_fragColor'];

const plain = (text) => text.replace(/\/\*[^]*?\*\/|\/\/.*/g, ' ');
const has = (text, name) => new RegExp(`\\b${name}\\b`).test(text);
/** Names before this one in a declaration, as in `attribute vec3 position, normal;`. */
const BEFORE = '(?:\\w+\\s*(?:\\[[^\\]]*\\]\\s*)?,\\s*)*';
const declares = (text, name) => new RegExp(`\\b(?:bool|vec[234]|mat[34])\\s+${BEFORE}${name}\\b`).test(text);

/** Whether three.js has to complete these texts, and its declarations are enough: they read its names, and no chunk. */
export function isOfThree({ vertex, fragment }) {
    const [v, f] = [plain(vertex), plain(fragment)];
    if ([v, f].some((text) => /^[ \t]*#[ \t]*(?:version\b|include[ \t]*<)/m.test(text))) return false;
    const reads = (text, names) => names.some((name) => has(text, name) && !declares(text, name));
    return reads(v, [...Object.keys(ATTRIBUTES), ...Object.keys(UNIFORMS)]) || reads(f, IN_FRAGMENT);
}

/** The texts of a `ShaderMaterial` with three.js's declarations, in GLSL ES 3.00. Others are given back as they are. */
export function withThree(stages) {
    if (!isOfThree(stages)) return stages;
    const { vertex, fragment } = stages;
    const color = has(plain(fragment), 'gl_FragColor') ? COLOR : [];
    const before = (lines, text) => [...lines, text].join('\n');
    return { vertex: before(VERTEX, vertex), fragment: before([...FRAGMENT, ...color], fragment) };
}
