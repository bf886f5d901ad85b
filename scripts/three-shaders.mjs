// Writes three.js's built-in materials as WebGL gets them: every entry of ShaderLib with several sets of parameters, put together by three's own WebGLProgram in front of an
// object that only keeps the text.
//
//   npm pack three@0.187 && tar xzf three-0.187*.tgz
//   node scripts/three-shaders.mjs package OUT
import { mkdirSync, writeFileSync } from 'node:fs';
import { join, resolve } from 'node:path';
import { pathToFileURL } from 'node:url';

const [ folder, out ] = process.argv.slice( 2 );
if ( ! out ) {

	console.error( 'usage: node three-shaders.mjs PACKAGE_FOLDER OUT_FOLDER' );
	process.exit( 2 );

}

const load = ( path ) => import( pathToFileURL( resolve( folder, path ) ) );
const { ShaderLib } = await load( 'src/renderers/shaders/ShaderLib.js' );
const { WebGLProgram } = await load( 'src/renderers/webgl/WebGLProgram.js' );

const lights = {
	numDirLights: 1, numPointLights: 1, numSpotLights: 1, numRectAreaLights: 0, numHemiLights: 1,
	numDirLightShadows: 0, numPointLightShadows: 0, numSpotLightShadows: 0, numSpotLightMaps: 0, numSpotLightShadowsWithMaps: 0,
	numLightProbes: 0, numSunLights: 0, numSunLightShadows: 0, numLightProbeGrids: 0,
};
const maps = {
	map: true, mapUv: 'uv', vertexUvs: true, alphaTest: true, doubleSided: true,
	normalMap: true, normalMapTangentSpace: true, normalMapUv: 'uv',
	roughnessMap: true, roughnessMapUv: 'uv', metalnessMap: true, metalnessMapUv: 'uv',
	emissiveMap: true, emissiveMapUv: 'uv', aoMap: true, aoMapUv: 'uv', lightMap: true, lightMapUv: 'uv1', vertexUv1s: true,
	specularMap: true, specularMapUv: 'uv', alphaMap: true, alphaMapUv: 'uv', displacementMap: true, displacementMapUv: 'uv',
	envMap: true, envMapPMREM: true, envMapMaxLod: 8, envMapSize: 256, envMapMode: 306, combine: 0, cubeUVHeight: 1024,
	envMapCubeUVHeight: 1024,
};
const pmrem = { CUBEUV_TEXEL_WIDTH: '0.0013', CUBEUV_TEXEL_HEIGHT: '0.00098', CUBEUV_MAX_MIP: '8.0' };
// Points are one pixel large in WebGPU: what reads gl_PointCoord is left out of these sets and named in an error elsewhere.
const sets = {
	plain: {},
	lights: { ...lights },
	fog: { ...lights, useFog: true, fog: true, fogExp2: true, vertexColors: true, dithering: true },
	shadows: { ...lights, numDirLightShadows: 1, numPointLightShadows: 1, numSpotLightShadows: 1, shadowMapEnabled: true, shadowMapType: 1 },
	vsm: { ...lights, numDirLightShadows: 1, numSpotLightShadows: 1, shadowMapEnabled: true, shadowMapType: 3 },
	skinning: { ...lights, skinning: true },
	morph: { ...lights, morphTargets: true, morphNormals: true, morphTargetsCount: 4, morphTextureStride: 2 },
	instancing: { ...lights, instancing: true, instancingColor: true },
	clipping: { ...lights, numClippingPlanes: 2, logarithmicDepthBuffer: true },
	maps: { ...lights, ...maps, tangents: false },
	physical: { ...lights, ...maps, clearcoat: true, sheen: true, iridescence: true, transmission: true, anisotropy: true, dispersion: true, defines: { PHYSICAL: '' } },
};

const lit = [ 'standard', 'physical', 'phong', 'lambert', 'toon', 'matcap', 'normal' ];
const sources = [];
const gl = new Proxy( {}, {
	get( _, name ) {

		if ( name === 'VERTEX_SHADER' || name === 'FRAGMENT_SHADER' ) return name;
		if ( name === 'shaderSource' ) return ( _, text ) => sources.push( text );
		if ( name === 'getProgramInfoLog' || name === 'getShaderInfoLog' ) return () => '';
		return () => ( {} );

	},
} );
const renderer = { getContext: () => gl, debug: { checkShaderErrors: false } };

for ( const [ name, shader ] of Object.entries( ShaderLib ) ) {

	for ( const [ set, given ] of Object.entries( sets ) ) {

		if ( set === 'physical' && name !== 'physical' && name !== 'standard' ) continue;
		const points = name === 'points' || name === 'sprite';
		const parameters = {
			shaderType: name, shaderName: name, shaderID: name, precision: 'highp', vertexShader: shader.vertexShader, fragmentShader: shader.fragmentShader,
			numClippingPlanes: 0, numClipIntersection: 0, toneMapping: 4, outputColorSpace: 'srgb', vertexNormals: true, opaque: true,
			...Object.fromEntries( Object.keys( lights ).map( ( k ) => [ k, 0 ] ) ),
			...given,
		};
		parameters.defines = { ...( given.defines ?? {} ) };
		if ( parameters.envMap ) Object.assign( parameters.defines, pmrem );
		if ( points && given.map ) Object.assign( parameters, { map: name === 'sprite', alphaMap: false } );
		// What a material of the kind does not have is not given to it.
		if ( ! lit.includes( name ) ) {

			for ( const key of Object.keys( parameters ) ) if ( /^(normalMap|envMap|roughness|metalness|displacement)/.test( key ) ) delete parameters[ key ];

		}

		if ( name === 'backgroundCube' ) Object.assign( parameters, { envMap: true, envMapPMREM: set === 'maps', envMapMaxLod: 8, envMapSize: 256, defines: pmrem } );
		if ( name === 'depth' ) Object.assign( parameters, { useDepthPacking: true, depthPacking: 3200 } );
		sources.length = 0;
		new WebGLProgram( renderer, 'key', parameters, null );
		const into = join( out, name );
		mkdirSync( into, { recursive: true } );
		writeFileSync( join( into, `${ set }.vert` ), sources[ 0 ] );
		writeFileSync( join( into, `${ set }.frag` ), sources[ 1 ] );

	}

}
