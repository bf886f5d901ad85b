// A glTF model made here: a bent sheet of metal with normals and texture coordinates.

export function model(size = 24) {
    const [positions, normals, coordinates, indices] = [[], [], [], []];
    for (let y = 0; y <= size; y++) {
        for (let x = 0; x <= size; x++) {
            const [u, v] = [x / size, y / size];
            const [a, b] = [u * Math.PI * 2, v * Math.PI];
            const at = [Math.cos(a) * Math.sin(b), Math.cos(b), Math.sin(a) * Math.sin(b)];
            const radius = 1 + 0.15 * Math.sin(a * 5) * Math.sin(b * 4);
            positions.push(...at.map((n) => n * radius));
            normals.push(...at);
            coordinates.push(u, v);
        }
    }
    for (let y = 0; y < size; y++) {
        for (let x = 0; x < size; x++) {
            const at = y * (size + 1) + x;
            indices.push(at, at + 1, at + size + 1, at + 1, at + size + 2, at + size + 1);
        }
    }
    const parts = [new Float32Array(positions), new Float32Array(normals), new Float32Array(coordinates), new Uint16Array(indices)];
    const bytes = new Uint8Array(parts.reduce((sum, { byteLength }) => sum + byteLength, 0));
    let byteOffset = 0;
    const bufferViews = parts.map((part) => {
        bytes.set(new Uint8Array(part.buffer), byteOffset);
        const view = { buffer: 0, byteOffset, byteLength: part.byteLength };
        byteOffset += part.byteLength;
        return view;
    });
    const text = Array.from(bytes, (byte) => String.fromCharCode(byte)).join('');
    const accessor = (bufferView, type, count, componentType = 5126) => ({ bufferView, type, count, componentType });
    const count = positions.length / 3;
    return {
        asset: { version: '2.0' },
        scene: 0,
        scenes: [{ nodes: [0] }],
        nodes: [{ mesh: 0 }],
        meshes: [{ primitives: [{ attributes: { POSITION: 0, NORMAL: 1, TEXCOORD_0: 2 }, indices: 3, material: 0 }] }],
        materials: [{ pbrMetallicRoughness: { baseColorFactor: [0.9, 0.6, 0.3, 1], metallicFactor: 0.8, roughnessFactor: 0.3 } }],
        accessors: [
            { ...accessor(0, 'VEC3', count), min: [-1.2, -1.2, -1.2], max: [1.2, 1.2, 1.2] },
            accessor(1, 'VEC3', count),
            accessor(2, 'VEC2', count),
            accessor(3, 'SCALAR', indices.length, 5123),
        ],
        bufferViews,
        buffers: [{ byteLength: bytes.length, uri: `data:application/octet-stream;base64,${btoa(text)}` }],
    };
}
