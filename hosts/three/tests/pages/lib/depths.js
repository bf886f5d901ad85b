// Depths of shadow maps, read back, and those that the authors' whole programs draw in their place.

import * as THREE from 'three';

const DIRECTIONS = [
    ['vec3( 1.0, -uv.y, -uv.x )', [1, 0, 0], [0, -1, 0]],
    ['vec3( -1.0, -uv.y, uv.x )', [-1, 0, 0], [0, -1, 0]],
    ['vec3( uv.x, 1.0, uv.y )', [0, 1, 0], [0, 0, 1]],
    ['vec3( uv.x, -1.0, -uv.y )', [0, -1, 0], [0, 0, -1]],
    ['vec3( uv.x, -uv.y, 1.0 )', [0, 0, 1], [0, -1, 0]],
    ['vec3( -uv.x, -uv.y, -1.0 )', [0, 0, -1], [0, -1, 0]],
];

/** Draws `fragment`, whose value is `value`, to floats of `size`. */
function floats(renderer, size, declared, value, uniforms, of = 1) {
    const target = new THREE.WebGLRenderTarget(size.x, size.y, {
        type: THREE.FloatType,
        minFilter: THREE.NearestFilter,
        magFilter: THREE.NearestFilter,
        depthBuffer: false,
    });
    const material = new THREE.RawShaderMaterial({
        glslVersion: THREE.GLSL3,
        uniforms,
        depthTest: false,
        vertexShader:
            'in vec3 position; out vec2 uv; void main() { uv = position.xy; gl_Position = vec4( position, 1.0 ); }',
        fragmentShader: `precision highp float; in vec2 uv; out vec4 color; ${declared} void main() { color = vec4( ${value} ); }`,
    });
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute('position', new THREE.Float32BufferAttribute([-1, -1, 0, 3, -1, 0, -1, 3, 0], 3));
    const mesh = new THREE.Mesh(geometry, material);
    mesh.frustumCulled = false;
    const { autoUpdate } = renderer.shadowMap;
    renderer.shadowMap.autoUpdate = false;
    renderer.setRenderTarget(target);
    renderer.render(mesh, new THREE.OrthographicCamera());
    const found = new Float32Array(size.x * size.y * 4);
    renderer.readRenderTargetPixels(target, 0, 0, size.x, size.y, found);
    renderer.setRenderTarget(null);
    renderer.shadowMap.autoUpdate = autoUpdate;
    for (const each of [target, material, geometry]) each.dispose();
    return of === 1 ? found.filter((_, i) => i % 4 === 0) : found;
}

/** Runs `read` while the texture gives depths and not comparisons. */
function uncompared(renderer, texture, read) {
    const gl = renderer.getContext();
    const type = texture.isCubeTexture ? gl.TEXTURE_CUBE_MAP : gl.TEXTURE_2D;
    const set = (mode, filter) => {
        renderer.state.bindTexture(type, renderer.properties.get(texture).__webglTexture);
        gl.texParameteri(type, gl.TEXTURE_COMPARE_MODE, mode);
        gl.texParameteri(type, gl.TEXTURE_MIN_FILTER, filter);
        gl.texParameteri(type, gl.TEXTURE_MAG_FILTER, filter);
    };
    set(gl.NONE, gl.NEAREST);
    try {
        return read();
    } finally {
        if (texture.compareFunction !== null) set(gl.COMPARE_REF_TO_TEXTURE, gl.LINEAR);
    }
}

/** The depths of a depth texture; six times as many of a cube. */
export function depths(renderer, texture, { width, height }) {
    const size = new THREE.Vector2(width, height);
    const uniforms = { map: { value: texture } };
    return uncompared(renderer, texture, () => {
        if (!texture.isCubeTexture)
            return floats(renderer, size, 'uniform highp sampler2D map;', 'texture( map, uv * 0.5 + 0.5 ).r', uniforms);
        const faces = DIRECTIONS.map(([direction]) =>
            floats(renderer, size, 'uniform highp samplerCube map;', `texture( map, ${direction} ).r`, uniforms),
        );
        return faces.flatMap((face) => [...face]);
    });
}

/** All of the first colour of a target, as floats. */
export function colours(renderer, { texture, width, height }) {
    const uniforms = { map: { value: texture } };
    return floats(
        renderer,
        { x: width, y: height },
        'uniform highp sampler2D map;',
        'texelFetch( map, ivec2( gl_FragCoord.xy ), 0 )',
        uniforms,
        4,
    );
}

export const shadowDepths = (renderer, { shadow }) => depths(renderer, shadow.map.depthTexture, shadow.map);

/**
 * VSM clears the depths when it has blurred them: an object that is drawn last copies them before. `read()` after a frame is what the map held.
 */
export function sentinel(renderer, scene, light) {
    const gl = renderer.getContext();
    const last = new THREE.InstancedMesh(new THREE.BoxGeometry(), new THREE.MeshBasicMaterial(), 1);
    last.count = 0;
    last.castShadow = true;
    last.frustumCulled = false;
    let copy = null;
    last.onBeforeShadow = () => {
        const { width, height, depthTexture } = light.shadow.map;
        if (!copy) {
            copy = new THREE.WebGLRenderTarget(width, height, { depthTexture: depthTexture.clone() });
            renderer.initRenderTarget(copy);
        }
        const to = renderer.properties.get(copy).__webglFramebuffer;
        const from = renderer.properties.get(light.shadow.map).__webglFramebuffer;
        gl.bindFramebuffer(gl.READ_FRAMEBUFFER, from);
        gl.bindFramebuffer(gl.DRAW_FRAMEBUFFER, to);
        gl.blitFramebuffer(0, 0, width, height, 0, 0, width, height, gl.DEPTH_BUFFER_BIT, gl.NEAREST);
        gl.bindFramebuffer(gl.FRAMEBUFFER, from);
    };
    scene.add(last);
    return { read: () => depths(renderer, copy.depthTexture, copy), dispose: () => copy?.dispose() };
}

const SIDES = {
    [THREE.FrontSide]: THREE.BackSide,
    [THREE.BackSide]: THREE.FrontSide,
    [THREE.DoubleSide]: THREE.DoubleSide,
};

/**
 * What the scene's own materials leave in a depth buffer when they are drawn whole from where the light is: their own program with its whole fragment stage, by `renderer.render`.
 */
export function reference(renderer, scene, light) {
    const { shadow } = light;
    const { width, height, depthTexture } = shadow.map;
    const target = new THREE.WebGLRenderTarget(width, height, {
        minFilter: THREE.NearestFilter,
        magFilter: THREE.NearestFilter,
        depthTexture: new THREE.DepthTexture(width, height, depthTexture.type),
    });
    target.depthTexture.format = depthTexture.format;
    target.depthTexture.minFilter = target.depthTexture.magFilter = THREE.NearestFilter;
    const hidden = [];
    const sides = new Map();
    const isVsm = renderer.shadowMap.type === THREE.VSMShadowMap;
    scene.traverse((object) => {
        if (!object.material) return;
        if (!object.castShadow && !(isVsm && object.receiveShadow)) {
            hidden.push([object, object.visible]);
            object.layers.disableAll();
        }
        for (const material of [object.material].flat()) {
            if (sides.has(material)) continue;
            sides.set(material, material.side);
            material.side = material.shadowSide ?? (isVsm ? material.side : SIDES[material.side]);
        }
    });
    const { autoUpdate } = renderer.shadowMap;
    const { background } = scene;
    const planes = renderer.clippingPlanes;
    const unclipped = [...sides.keys()].filter(({ clippingPlanes, clipShadows }) => clippingPlanes && !clipShadows);
    const own = unclipped.map((material) => material.clippingPlanes);
    unclipped.forEach((material) => (material.clippingPlanes = null));
    Object.assign(renderer.shadowMap, { autoUpdate: false });
    scene.background = null;
    renderer.clippingPlanes = [];
    const read = () => {
        renderer.setRenderTarget(target);
        renderer.clear();
        renderer.render(scene, shadow.camera);
        renderer.setRenderTarget(null);
        return depths(renderer, target.depthTexture, target);
    };
    let found;
    if (light.isPointLight) {
        const position = new THREE.Vector3().setFromMatrixPosition(light.matrixWorld);
        found = DIRECTIONS.flatMap(([, look, up]) => {
            shadow.camera.position.copy(position);
            shadow.camera.up.fromArray(UPS[look.join()] ?? up);
            shadow.camera.lookAt(position.clone().add(new THREE.Vector3().fromArray(look)));
            shadow.camera.updateMatrixWorld();
            return [...read()];
        });
    } else {
        // Some lights draw several views into one map.
        renderer.setRenderTarget(target);
        renderer.clear();
        const { autoClear } = renderer;
        renderer.autoClear = false;
        for (let i = 0; i < shadow.getViewportCount(); i++) {
            const { x, y, z, w } = shadow.getViewport(i);
            // Newer than some versions of three.js.
            const camera = shadow.getCamera?.(i) ?? shadow.camera;
            target.viewport.set(x, y, z, w).multiply(sizes(shadow.mapSize));
            target.scissor.copy(target.viewport);
            renderer.setRenderTarget(target);
            const { matrixWorldAutoUpdate } = camera;
            camera.matrixWorldAutoUpdate = false;
            renderer.render(scene, camera);
            camera.matrixWorldAutoUpdate = matrixWorldAutoUpdate;
        }
        renderer.autoClear = autoClear;
        renderer.setRenderTarget(null);
        found = depths(renderer, target.depthTexture, target);
    }
    Object.assign(renderer.shadowMap, { autoUpdate });
    scene.background = background;
    renderer.clippingPlanes = planes;
    unclipped.forEach((material, i) => (material.clippingPlanes = own[i]));
    for (const [material, side] of sides) material.side = side;
    for (const [object] of hidden) object.layers.enable(0);
    target.depthTexture.dispose();
    target.dispose();
    return found;
}

const sizes = ({ x, y }) => new THREE.Vector4(x, y, x, y);

/** As WebGLShadowMap has them. */
const UPS = {
    '1,0,0': [0, -1, 0],
    '-1,0,0': [0, -1, 0],
    '0,1,0': [0, 0, 1],
    '0,-1,0': [0, 0, -1],
    '0,0,1': [0, -1, 0],
    '0,0,-1': [0, -1, 0],
};

/** How many of two lists differ. */
export const differing = (a, b) =>
    a.length === b.length ? a.reduce((sum, value, i) => sum + (value !== b[i]), 0) : NaN;

/** The bytes of the picture. */
export function picture(renderer) {
    const gl = renderer.getContext();
    const { drawingBufferWidth: width, drawingBufferHeight: height } = gl;
    const bytes = new Uint8Array(width * height * 4);
    gl.readPixels(0, 0, width, height, gl.RGBA, gl.UNSIGNED_BYTE, bytes);
    return bytes;
}

/** Renders until nothing is pending any more, and once more. */
export async function settle(preshade, render, { frames = 40 } = {}) {
    for (let i = 0; i < frames; i++) {
        render();
        await preshade.settled();
        await new Promise((resolve) => setTimeout(resolve, 0));
        if (i >= 4 && preshade.report().every(({ state }) => !['pending', 'waiting'].includes(state))) break;
    }
    render();
}
