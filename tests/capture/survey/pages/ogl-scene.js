// OGL: textures, instances, a render target, a post pass, polylines
// Drawn with WebGL.

import { Box, Camera, Mesh, Plane, Polyline, Post, Program, Renderer, Sphere, Texture, Torus, Transform, Vec3, Color } from 'ogl';
import { canvas, checks, height, loaded, loop, width } from './common.js';

const renderer = new Renderer({ canvas, width, height, dpr: 1, antialias: true });
const { gl } = renderer;
gl.clearColor(0.15, 0.2, 0.3, 1);
const camera = new Camera(gl, { fov: 45, aspect: width / height });
camera.position.set(3, 2, 5);
camera.lookAt([0, 0, 0]);
const scene = new Transform();
const map = new Texture(gl, { image: checks(), generateMipmaps: true, wrapS: gl.REPEAT, wrapT: gl.REPEAT });
const program = new Program(gl, {
    vertex: `#version 300 es
in vec3 position, normal; in vec2 uv; uniform mat4 modelViewMatrix, projectionMatrix; uniform mat3 normalMatrix;
out vec3 facing; out vec2 at;
void main() { facing = normalize(normalMatrix * normal); at = uv * 3.0; gl_Position = projectionMatrix * modelViewMatrix * vec4(position, 1.0); }`,
    fragment: `#version 300 es
precision highp float; in vec3 facing; in vec2 at; uniform sampler2D map; out vec4 color;
void main() { color = vec4(texture(map, at).rgb * (0.3 + max(0.0, dot(facing, normalize(vec3(0.4, 0.8, 0.6))))), 1.0); }`,
    uniforms: { map: { value: map } },
});
const meshes = [new Box(gl), new Sphere(gl, { radius: 0.6 }), new Torus(gl, { radius: 0.6, tube: 0.2 }), new Plane(gl)].map((geometry, i) => {
    const mesh = new Mesh(gl, { geometry, program });
    mesh.position.x = i * 1.3 - 2;
    mesh.setParent(scene);
    return mesh;
});
const line = new Polyline(gl, {
    points: Array.from({ length: 20 }, (_, i) => new Vec3(i * 0.2 - 2, Math.sin(i) * 0.3 + 1, 0)),
    uniforms: { uColor: { value: new Color('#ff8844') }, uThickness: { value: 6 } },
});
line.mesh.setParent(scene);
const post = new Post(gl, { width, height, dpr: 1 });
post.addPass({
    fragment: `precision highp float; uniform sampler2D tMap; varying vec2 vUv;
void main() { vec2 d = (vUv - 0.5) * 0.01; gl_FragColor = vec4(texture2D(tMap, vUv + d).r, texture2D(tMap, vUv).g, texture2D(tMap, vUv - d).b, 1.0); }`,
});
loaded();
loop((step) => {
    meshes.forEach((mesh) => mesh.rotation.set(step * 0.02, step * 0.03, 0));
    line.updateGeometry();
    post.render({ scene, camera });
});
