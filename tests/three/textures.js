// The page's textures, made here: 256 x 256, repeating, the same on every machine.

import { DataTexture, LinearFilter, LinearMipmapLinearFilter, RepeatWrapping, SRGBColorSpace } from 'three';

const SIZE = 256;

/** Numbers from 0 to 1 that follow from `seed` alone. */
export function random(seed) {
    let state = seed >>> 0;
    return () => {
        state = (state + 0x6d2b79f5) >>> 0;
        let t = Math.imul(state ^ (state >>> 15), state | 1);
        t ^= t + Math.imul(t ^ (t >>> 7), t | 61);
        return ((t ^ (t >>> 14)) >>> 0) / 4294967296;
    };
}

const mix = (a, b, t) => a + (b - a) * t;
const clamp = (x) => Math.min(Math.max(x, 0), 1);
const smooth = (low, high, x) => {
    const t = clamp((x - low) / (high - low));
    return t * t * (3 - 2 * t);
};

/** Value noise over the unit square that repeats, of several octaves; from 0 to 1. */
function noise(seed, cells, octaves) {
    const layers = [];
    for (let i = 0; i < octaves; i++) {
        const next = random(seed + i);
        const n = cells << i;
        layers.push({ n, values: Float32Array.from({ length: n * n }, next) });
    }
    return (u, v) => {
        let sum = 0;
        let amplitude = 0.5;
        for (const { n, values } of layers) {
            const x = u * n;
            const y = v * n;
            const at = (i, j) => values[(((j % n) + n) % n) * n + (((i % n) + n) % n)];
            const [i, j] = [Math.floor(x), Math.floor(y)];
            const [s, t] = [smooth(0, 1, x - i), smooth(0, 1, y - j)];
            sum += amplitude * mix(mix(at(i, j), at(i + 1, j), s), mix(at(i, j + 1), at(i + 1, j + 1), s), t);
            amplitude *= 0.5;
        }
        return sum / (1 - amplitude * 2);
    };
}

/** Distance to the nearest and the second nearest of points strewn over the unit square, and which the nearest is. */
function cells(seed, n) {
    const next = random(seed);
    const points = Array.from({ length: n * n }, () => [next(), next(), next()]);
    return (u, v) => {
        const [x, y] = [u * n, v * n];
        const [i, j] = [Math.floor(x), Math.floor(y)];
        let found = { first: 9, second: 9, value: 0 };
        for (let dj = -1; dj <= 1; dj++) {
            for (let di = -1; di <= 1; di++) {
                const point = points[((j + dj + n) % n) * n + ((i + di + n) % n)];
                const distance = Math.hypot(i + di + point[0] - x, j + dj + point[1] - y);
                if (distance < found.first) found = { first: distance, second: found.first, value: point[2] };
                else if (distance < found.second) found.second = distance;
            }
        }
        return found;
    };
}

function texture(name, colorSpace, texel) {
    const data = new Uint8Array(SIZE * SIZE * 4);
    for (let y = 0; y < SIZE; y++) {
        for (let x = 0; x < SIZE; x++) {
            const rgba = texel((x + 0.5) / SIZE, (y + 0.5) / SIZE);
            for (let c = 0; c < 4; c++) data[(y * SIZE + x) * 4 + c] = Math.round(clamp(rgba[c]) * 255);
        }
    }
    const made = new DataTexture(data, SIZE, SIZE);
    made.name = name;
    made.colorSpace = colorSpace;
    made.wrapS = made.wrapT = RepeatWrapping;
    made.magFilter = LinearFilter;
    made.minFilter = LinearMipmapLinearFilter;
    made.generateMipmaps = true;
    made.needsUpdate = true;
    return made;
}

/** Everything the scene draws with. */
export function textures() {
    const rough = noise(11, 8, 5);
    const stones = cells(5, 7);
    const height = (u, v) => {
        const { first, second } = stones(u, v);
        return smooth(0.02, 0.22, second - first) * (0.75 + 0.25 * rough(u, v));
    };
    const stone = texture('stone', SRGBColorSpace, (u, v) => {
        const h = height(u, v);
        const { value } = stones(u, v);
        const grain = 0.75 + 0.5 * rough(u * 3, v * 3);
        const warm = mix(0.92, 1.1, value);
        return [h, h, h].map((x, i) => mix(0.2, [0.66 * warm, 0.61, 0.54 / warm][i], x) * grain);
    });
    const relief = texture('relief', '', (u, v) => {
        const e = 1 / SIZE;
        const slope = (a, b) => 0.5 - 0.9 * (a - b);
        return [slope(height(u + e, v), height(u - e, v)), slope(height(u, v + e), height(u, v - e)), 1, 1];
    });
    const tufts = cells(23, 24);
    const patches = noise(31, 6, 4);
    const moss = texture('moss', SRGBColorSpace, (u, v) => {
        const t = clamp(1.1 - tufts(u, v).first) * mix(0.55, 1.15, patches(u, v));
        return [0.36 * t, 0.47 * t, 0.16 * t, 1];
    });
    const next = random(47);
    const leaves = Array.from({ length: 46 }, () => ({
        x: next(),
        y: next(),
        turn: next() * Math.PI * 2,
        size: mix(0.055, 0.1, next()),
        shade: next(),
    }));
    const leaf = texture('leaf', SRGBColorSpace, (u, v) => {
        let [alpha, shade, rib] = [0, 0.4, 0];
        for (const l of leaves) {
            let [dx, dy] = [u - l.x, v - l.y].map((d) => d - Math.round(d));
            [dx, dy] = [dx * Math.cos(l.turn) - dy * Math.sin(l.turn), dx * Math.sin(l.turn) + dy * Math.cos(l.turn)];
            const angle = Math.atan2(dy, dx);
            const radius = l.size * (0.72 + 0.28 * Math.cos(angle * 5) - 0.1 * Math.cos(angle));
            const inside = clamp((radius - Math.hypot(dx, dy)) * SIZE * 0.35);
            if (inside < 0.5 && alpha >= 0.5) continue;
            if (inside >= alpha) [alpha, shade, rib] = [inside, l.shade, Math.exp(-Math.abs(dy) * 190)];
        }
        return [
            mix(0.13, 0.34, shade) + 0.12 * rib,
            mix(0.33, 0.52, shade) + 0.12 * rib,
            mix(0.08, 0.12, shade),
            alpha,
        ];
    });
    const veins = cells(61, 12);
    const vein = texture('vein', '', (u, v) => {
        const { first, second } = veins(u, v);
        const t = 0.35 + 0.65 * smooth(0.0, 0.25, second - first);
        return [t, t, t * 0.9, 1];
    });
    const spots = noise(71, 5, 5);
    const bronze = texture('bronze', SRGBColorSpace, (u, v) => {
        const t = smooth(0.42, 0.62, spots(u, v));
        const shine = 0.85 + 0.3 * rough(u * 2, v * 2);
        return [mix(0.3, 0.72, t) * shine, mix(0.5, 0.48, t) * shine, mix(0.42, 0.24, t) * shine, 1];
    });
    return { stone, relief, moss, leaf, vein, bronze };
}
