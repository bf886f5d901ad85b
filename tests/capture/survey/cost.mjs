// What recording costs: the time of a page's frames with and without it, and the size of what it writes. It prints a
// Markdown table.
//
// A frame's time is from one callback of requestAnimationFrame to the next, the median of `FRAMES`.

import { capture, launch, open } from '../browser.mjs';
import { serve } from '../serve.mjs';

const FRAMES = 30;
const PAGES = ['stress-webgl', 'stress-webgpu', 'babylon-webgl', 'babylon-webgpu', 'playcanvas-webgl', 'playcanvas-webgpu'];

/** Milliseconds between frames: the median of the next `count`. */
const interval = (page, count) =>
    page.evaluate(
        (count) =>
            new Promise((resolve) => {
                const times = [];
                const next = () => {
                    times.push(performance.now());
                    if (times.length <= count) return requestAnimationFrame(next);
                    const between = times.slice(1).map((time, i) => time - times[i]);
                    resolve(between.sort((a, b) => a - b)[count >> 1]);
                };
                requestAnimationFrame(next);
            }),
        count,
    );

export async function cost() {
    const { server, address } = await serve();
    const browser = await launch();
    const rows = [];
    for (const name of PAGES) {
        const plain = await open(browser, `${address}/${name}`, { record: false });
        const alone = await interval(plain.page, FRAMES);
        await plain.page.close();
        const visited = await open(browser, `${address}/${name}`);
        const loaded = await interval(visited.page, FRAMES);
        const recording = capture(visited, FRAMES + 5);
        const recorded = await interval(visited.page, FRAMES);
        const { files } = await recording;
        await visited.page.close();
        const bytes = [...files.values()].reduce((sum, { length }) => sum + length, 0);
        const data = bytes - files.get('frame.json').length;
        rows.push({ name, alone, loaded, recorded, bytes, data });
    }
    await browser.close();
    server.close();
    return rows;
}

export function costTable(rows) {
    const ms = (time) => time.toFixed(1);
    const mib = (bytes) => (bytes / 2 ** 20).toFixed(2);
    const lines = rows.map(({ name, alone, loaded, recorded, bytes, data }) => {
        const times = [ms(alone), ms(loaded), ms(recorded), (recorded / alone).toFixed(1)];
        return `| \`${name}\` | ${[...times, mib(data), mib(bytes), (bytes / data).toFixed(2)].join(' | ')} |\n`;
    });
    return `| page | alone, ms | recorder loaded | recording | ratio | data, MiB | folder, MiB | ratio |
|---|--:|--:|--:|--:|--:|--:|--:|
${lines.join('')}`;
}
