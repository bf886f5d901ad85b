// FLIP: how different two pictures look to someone who alternates between them (Andersson et al., FLIP: A Difference
// Evaluator for Alternating Images, 2020). The map's mean and 99th percentile, at the default viewing distance.

const PIXELS_PER_DEGREE = 67.02064;

/** Weights and widths of the contrast sensitivity of the achromatic, red-green and blue-yellow channels. */
const SENSITIVITY = [
    [[1, 0.0047]],
    [[1, 0.0053]],
    [
        [34.1, 0.04],
        [13.5, 0.025],
    ],
];
const WIDEST = 0.04;
const FEATURE = 0.082;
const COLOR_POWER = 0.7;
const COLOR_SHARE = 0.4;
const COLOR_RANGE = 0.95;
const FEATURE_POWER = 0.5;

const toLinear = (c) => (c <= 0.04045 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4);
const LINEAR = Float64Array.from({ length: 256 }, (_, i) => toLinear(i / 255));
const clamp = (c) => Math.min(1, Math.max(0, c));

const RGB_TO_XYZ = [
    [10135552 / 24577794, 8788810 / 24577794, 4435075 / 24577794],
    [2613072 / 12288897, 8788810 / 12288897, 887015 / 12288897],
    [1425312 / 73733382, 8788810 / 73733382, 70074185 / 73733382],
];
const times = (m, a, b, c) => m.map((row) => row[0] * a + row[1] * b + row[2] * c);
const WHITE = times(RGB_TO_XYZ, 1, 1, 1);
const XYZ_TO_RGB = inverse(RGB_TO_XYZ);

function inverse([[a, b, c], [d, e, f], [g, h, i]]) {
    const det = a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g);
    return [
        [e * i - f * h, c * h - b * i, b * f - c * e],
        [f * g - d * i, a * i - c * g, c * d - a * f],
        [d * h - e * g, b * g - a * h, a * e - b * d],
    ].map((row) => row.map((n) => n / det));
}

/** Channels of the opponent space YCxCz, a plane each. */
function opponent(texels, pixels) {
    const planes = [0, 1, 2].map(() => new Float64Array(pixels));
    for (let i = 0; i < pixels; i++) {
        const xyz = times(RGB_TO_XYZ, LINEAR[texels[i * 4]], LINEAR[texels[i * 4 + 1]], LINEAR[texels[i * 4 + 2]]);
        const [x, y, z] = xyz.map((n, c) => n / WHITE[c]);
        planes[0][i] = 116 * y - 16;
        planes[1][i] = 500 * (x - y);
        planes[2][i] = 200 * (y - z);
    }
    return planes;
}

/** A plane, filtered by one kernel along rows and by another along columns. Edges are repeated. */
function filtered(plane, size, alongRow, alongColumn) {
    const half = new Float64Array(plane.length);
    const out = new Float64Array(plane.length);
    const radius = (alongRow.length - 1) / 2;
    const inside = (n) => Math.min(size - 1, Math.max(0, n));
    for (let y = 0; y < size; y++)
        for (let x = 0; x < size; x++) {
            let sum = 0;
            for (let k = -radius; k <= radius; k++) sum += alongRow[k + radius] * plane[y * size + inside(x + k)];
            half[y * size + x] = sum;
        }
    for (let y = 0; y < size; y++)
        for (let x = 0; x < size; x++) {
            let sum = 0;
            for (let k = -radius; k <= radius; k++) sum += alongColumn[k + radius] * half[inside(y + k) * size + x];
            out[y * size + x] = sum;
        }
    return out;
}

const kernel = (radius, weight) => Float64Array.from({ length: radius * 2 + 1 }, (_, i) => weight(i - radius));
const sum = (values) => values.reduce((a, b) => a + b, 0);

/** What the eye resolves of an opponent plane: a sum of Gaussians. */
function resolved(plane, size, parts) {
    const radius = Math.ceil(3 * Math.sqrt(WIDEST / (2 * Math.PI ** 2)) * PIXELS_PER_DEGREE);
    const kernels = parts.map(([weight, width]) => {
        const along = kernel(radius, (k) => Math.exp((-(Math.PI ** 2) * (k / PIXELS_PER_DEGREE) ** 2) / width));
        return { along, weight: weight * Math.sqrt(Math.PI / width) };
    });
    const total = sum(kernels.map(({ along, weight }) => weight * sum(along) ** 2));
    const out = new Float64Array(plane.length);
    for (const { along, weight } of kernels) {
        const part = filtered(plane, size, along, along);
        for (let i = 0; i < out.length; i++) out[i] += (part[i] * weight) / total;
    }
    return out;
}

/** CIELab of a linear colour, with colour differences of dark places made smaller (Hunt). */
function perceived(r, g, b) {
    const f = (t) => (t > (6 / 29) ** 3 ? Math.cbrt(t) : t / (3 * (6 / 29) ** 2) + 4 / 29);
    const [x, y, z] = times(RGB_TO_XYZ, r, g, b).map((n, c) => f(n / WHITE[c]));
    const light = 116 * y - 16;
    return [light, 5 * light * (x - y), 2 * light * (y - z)];
}

const distance = (a, b) => Math.abs(a[0] - b[0]) + Math.hypot(a[1] - b[1], a[2] - b[2]);
const MOST = distance(perceived(0, 1, 0), perceived(0, 0, 1)) ** COLOR_POWER;

function seen([planeY, planeX, planeZ], i) {
    const y = (planeY[i] + 16) / 116;
    const xyz = [y + planeX[i] / 500, y, y - planeZ[i] / 200].map((n, c) => n * WHITE[c]);
    return perceived(...times(XYZ_TO_RGB, ...xyz).map(clamp));
}

/** Edges and points of a plane of luminance: the length of each one's derivative. */
function features(luminance, size) {
    const deviation = 0.5 * FEATURE * PIXELS_PER_DEGREE;
    const radius = Math.ceil(3 * deviation);
    const smooth = kernel(radius, (k) => Math.exp(-(k ** 2) / (2 * deviation ** 2)));
    const derivative = (of) => {
        const raw = kernel(radius, (k) => of(k) * Math.exp(-(k ** 2) / (2 * deviation ** 2)));
        const above = sum(raw.filter((w) => w > 0));
        const below = -sum(raw.filter((w) => w < 0));
        return raw.map((w) => (w > 0 ? w / above : w / below));
    };
    const across = smooth.map((w) => w / sum(smooth));
    const lengths = (along) => {
        const x = filtered(luminance, size, along, across);
        const y = filtered(luminance, size, across, along);
        return x.map((n, i) => Math.hypot(n, y[i]));
    };
    return [lengths(derivative((k) => -k)), lengths(derivative((k) => k ** 2 / deviation ** 2 - 1))];
}

/** The map of two pictures, 0 to 1 a pixel. */
export function map(a, b, size) {
    const pixels = size * size;
    const sides = [a, b].map((texels) => {
        const planes = opponent(texels, pixels);
        const luminance = planes[0].map((y) => (y + 16) / 116);
        const [edges, points] = features(luminance, size);
        return { colors: planes.map((plane, c) => resolved(plane, size, SENSITIVITY[c])), edges, points };
    });
    const [first, second] = sides;
    const knee = COLOR_SHARE * MOST;
    const out = new Float64Array(pixels);
    for (let i = 0; i < pixels; i++) {
        const difference = distance(seen(first.colors, i), seen(second.colors, i)) ** COLOR_POWER;
        const color =
            difference < knee
                ? (difference * COLOR_RANGE) / knee
                : COLOR_RANGE + ((difference - knee) / (MOST - knee)) * (1 - COLOR_RANGE);
        const edge = Math.abs(first.edges[i] - second.edges[i]);
        const point = Math.abs(first.points[i] - second.points[i]);
        const feature = (Math.max(edge, point) / Math.SQRT2) ** FEATURE_POWER;
        out[i] = color ** (1 - feature);
    }
    return out;
}

/** Width and height of a tile, as in `preshade verify`. */
const TILE = 16;

/** The largest mean over a tile. A tile at the right or lower edge counts the pixels that it has. */
export function worstTile(map, size) {
    let worst = 0;
    for (let top = 0; top < size; top += TILE)
        for (let left = 0; left < size; left += TILE) {
            const [bottom, right] = [top, left].map((from) => Math.min(from + TILE, size));
            let total = 0;
            for (let y = top; y < bottom; y++) for (let x = left; x < right; x++) total += map[y * size + x];
            worst = Math.max(worst, total / ((bottom - top) * (right - left)));
        }
    return worst;
}

/** The map's mean, 99th percentile and worst tile. */
export function flip(a, b, size) {
    const found = map(a, b, size);
    const sorted = [...found].sort((x, y) => x - y);
    const at = Math.min(sorted.length - 1, Math.floor(sorted.length * 0.99));
    return { mean: sum(found) / found.length, p99: sorted[at], tile: worstTile(found, size) };
}
