// three-mesh-bvh: rays through a hierarchy in textures, in a fragment shader
// Drawn with WebGL.

import { MeshBVH, MeshBVHUniformStruct, BVHShaderGLSL, SAH } from 'three-mesh-bvh';
import { loaded, loop } from './common.js';
import { THREE, camera, webgl } from './three-common.js';

const renderer = webgl({ antialias: false });
const eye = camera([0, 1, 4], [0, 0, 0]);
const geometry = new THREE.TorusKnotGeometry(1, 0.35, 100, 16);
const bvh = new MeshBVH(geometry, { maxLeafTris: 1, strategy: SAH });
const uniform = new MeshBVHUniformStruct();
uniform.updateFrom(bvh);
const material = new THREE.ShaderMaterial({
    uniforms: { bvh: { value: uniform }, inverse: { value: new THREE.Matrix4() }, world: { value: new THREE.Matrix4() } },
    vertexShader: `varying vec2 at; void main() { at = uv; gl_Position = vec4(position.xy, 0.0, 1.0); }`,
    fragmentShader: `
precision highp isampler2D; precision highp usampler2D;
${BVHShaderGLSL.common_functions}
${BVHShaderGLSL.bvh_struct_definitions}
${BVHShaderGLSL.bvh_ray_functions}
uniform BVH bvh; uniform mat4 inverse, world; varying vec2 at;
void main() {
    vec2 screen = at * 2.0 - 1.0;
    vec3 origin = (world * vec4(0.0, 0.0, 0.0, 1.0)).xyz;
    vec4 far = world * inverse * vec4(screen, 1.0, 1.0);
    vec3 way = normalize(far.xyz / far.w - origin);
    uvec4 face = uvec4(0u); vec3 normal = vec3(0.0), corner = vec3(0.0); float side = 1.0, distance = 0.0;
    bool hit = bvhIntersectFirstHit(bvh, origin, way, face, normal, corner, side, distance);
    vec3 color = hit ? normal * 0.5 + 0.5 : vec3(0.1, 0.12, 0.2);
    if (hit) {
        vec3 from = origin + way * distance + normal * 1e-3;
        float other; vec3 n2, c2; float s2; uvec4 f2;
        if (bvhIntersectFirstHit(bvh, from, normalize(vec3(0.5, 1.0, 0.4)), f2, n2, c2, s2, other)) color *= 0.4;
    }
    gl_FragColor = vec4(color, 1.0);
}`,
});
const screen = new THREE.Mesh(new THREE.PlaneGeometry(2, 2), material);
screen.frustumCulled = false;
const scene = new THREE.Scene();
scene.add(screen);
loaded();
loop((step) => {
    eye.position.set(Math.sin(step * 0.02) * 4, 1, Math.cos(step * 0.02) * 4);
    eye.lookAt(0, 0, 0);
    eye.updateMatrixWorld();
    material.uniforms.inverse.value.copy(eye.projectionMatrixInverse);
    material.uniforms.world.value.copy(eye.matrixWorld);
    renderer.render(scene, eye);
});
