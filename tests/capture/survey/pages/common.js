// What the pages share: the canvas, the API that the address asks for, pictures, numbers with a seed.

export const canvas = document.getElementById('canvas');
export const isWebgpu = new URLSearchParams(location.search).get('api') === 'WebGPU';
export const [width, height] = [innerWidth, innerHeight];
Object.assign(canvas, { width, height });

/** The page is ready soon. */
export function loaded() {
    globalThis.loaded = true;
}

export function withoutCanvas() {
    canvas.remove();
}

/** A picture of `size` squared: `draw(context)` paints it. */
export function picture(size, draw) {
    const made = document.createElement('canvas');
    made.width = made.height = size;
    draw(made.getContext('2d'));
    return made;
}

export function checks(a = '#ccc', b = '#684', size = 64, count = 4) {
    return picture(size, (context) => {
        const step = size / count;
        for (let x = 0; x < count; x++) {
            for (let y = 0; y < count; y++) {
                context.fillStyle = (x + y) % 2 ? a : b;
                context.fillRect(x * step, y * step, step, step);
            }
        }
    });
}

/** Soft spots on transparent ground: sprites and particles. */
export function spot(color = '#fff', size = 64) {
    return picture(size, (context) => {
        const fill = context.createRadialGradient(size / 2, size / 2, 0, size / 2, size / 2, size / 2);
        fill.addColorStop(0, color);
        fill.addColorStop(1, 'transparent');
        context.fillStyle = fill;
        context.fillRect(0, 0, size, size);
    });
}

/** Bumps as a normal map. */
export function bumps(size = 64) {
    return picture(size, (context) => {
        const data = context.createImageData(size, size);
        for (let i = 0; i < size * size; i++) {
            const [x, y] = [(i % size) / size, Math.floor(i / size) / size];
            const dx = Math.cos(x * Math.PI * 8) * 0.4;
            const dy = Math.cos(y * Math.PI * 8) * 0.4;
            data.data.set([128 + dx * 127, 128 + dy * 127, 230, 255], i * 4);
        }
        context.putImageData(data, 0, 0);
    });
}

export function random(seed = 1) {
    let state = seed;
    return () => {
        state = (Math.imul(state, 1664525) + 1013904223) | 0;
        return (state >>> 0) / 2 ** 32;
    };
}

/** Calls `draw(step)` in each frame. */
export function loop(draw) {
    let step = 0;
    const frame = () => {
        draw(step++);
        requestAnimationFrame(frame);
    };
    requestAnimationFrame(frame);
}
