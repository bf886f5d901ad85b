// What the page of packages imports.

const of = (path) => `/three/tests/packages/node_modules/${path}`;

export const imports = {
    'three/src/': '/three/node_modules/three/src/',
    'three-custom-shader-material/vanilla': of(
        'three-custom-shader-material/vanilla/three-custom-shader-material.es.js',
    ),
    '@pixiv/three-vrm-materials-mtoon': of('@pixiv/three-vrm-materials-mtoon/lib/three-vrm-materials-mtoon.module.js'),
    '@lume/three-projected-material/': of('@lume/three-projected-material/'),
    '@three.ez/instanced-mesh': of('@three.ez/instanced-mesh/build/index.js'),
    'bvh.js': of('bvh.js/build/index.js'),
    meshline: of('meshline/dist/index.js'),
    postprocessing: of('postprocessing/build/index.js'),
    'three-instanced-uniforms-mesh': of('three-instanced-uniforms-mesh/dist/three-instanced-uniforms-mesh.esm.js'),
    'troika-three-utils': of('troika-three-utils/dist/troika-three-utils.esm.js'),
};
